"""Make the recordings in bags/ from the folder of published measurements.

    python scripts/make_bags.py DATA_FOLDER [BAGS_FOLDER]

Every recording begins at 2024-01-01T00:00:00Z, so that the same data give the same file; the
true dates of measurement are not published. Simulated campaigns are made elsewhere.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from impactscope.errors import ImpactscopeError
from impactscope.recordings import ColumnMapping, ColumnSpec, convert

START_NS = 1_704_067_200_000_000_000  # 2024-01-01T00:00:00Z
STAMPS = 'begin at 2024-01-01T00:00:00Z by convention; the date of measurement is not published'


def conversions() -> Iterator[tuple[str, str, ColumnMapping]]:
    """Source below the data folder, name of the recording, mapping."""
    for i in range(1, 6):
        yield (
            f'modal_hammer/measurements_{i}.npy',
            f'hammer_blow_{i}.mcap',
            ColumnMapping(
                channels=(
                    ColumnSpec('force.hammer', 1, 'N', frame_id='hammer'),
                    ColumnSpec('acceleration.structure', 2, 'm/s^2', frame_id='structure'),
                ),
                time=0,
                transpose=True,
                start_ns=START_NS,
                provenance={
                    'title': f'Instrumented hammer blow {i} of 5 on a structure',
                    'kind': 'measured',
                    'origin': 'https://github.com/ladisk/pyFRF (data/, commit e3ce4ef)',
                    'licence': 'MIT (repository since 2023; see bags/LICENSES.md)',
                    'stamps': STAMPS,
                },
            ),
        )
    for i in range(1, 4):
        moved = '; an arm moves the pendulum until about 1.8 s' if i < 3 else ''
        yield (
            f'pendulum_free_swing/pendulum_free_swing_data_{i:02d}.txt',
            f'pendulum_swing_{i:02d}.mcap',
            ColumnMapping(
                channels=(ColumnSpec('displacement.angle', 0, 'deg', frame_id='pendulum'),),
                sample_rate=1000.0,
                skip_rows=2,
                start_ns=START_NS,
                provenance={
                    'title': f'Free swing {i} of 3 of a pendulum, by encoder{moved}',
                    'kind': 'measured',
                    'origin': 'https://github.com/jensen-benard/rotary-inverted-pendulum '
                    '(commit 1f3bb80)',
                    'licence': 'MIT (see bags/LICENSES.md)',
                    'stamps': STAMPS,
                },
            ),
        )


def main(argv: list[str] | None = None) -> int:
    """Convert everything; 1 where a file cannot be converted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('data', type=Path, help='folder with modal_hammer/, pendulum_free_swing/')
    parser.add_argument(
        'bags', type=Path, nargs='?', default=Path(__file__).resolve().parents[1] / 'bags'
    )
    options = parser.parse_args(argv)
    try:
        for source, name, mapping in conversions():
            made = convert(options.data / source, options.bags / name, mapping, overwrite=True)
            size = made.path.stat().st_size
            sys.stdout.write(
                f'{name}: {", ".join(made.channels)}; {made.samples} samples at '
                f'{made.sample_rate:g} Hz; {size} bytes\n'
            )
    except ImpactscopeError as error:
        sys.stderr.write(f'{error}\n')
        return 1
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
