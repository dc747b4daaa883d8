"""All benchmarks in a row: ``make bench``, or one or several by name."""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

from machine import describe

NOT_BENCHMARKS = {'run', 'machine'}


def main(argv: list[str] | None = None) -> int:
    """Run them one after the other; each prints what it measures."""
    names = sorted(
        path.stem
        for path in Path(__file__).parent.glob('*.py')
        if path.stem not in NOT_BENCHMARKS and not path.stem.startswith('_')
    )
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('names', nargs='*', metavar='NAME', help=', '.join(names))
    parser.add_argument('--quick', action='store_true', help='shorter runs, wider intervals')
    given = parser.parse_args(argv)
    unknown = sorted(set(given.names) - set(names))
    if unknown:
        parser.error(f'no benchmark {unknown[0]!r}; there are {", ".join(names)}')
    print(describe())
    failed = 0
    for name in given.names or names:
        print(f'\n== {name} ==', flush=True)
        failed += importlib.import_module(name).main(['--quick'] if given.quick else []) != 0
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
