"""``python -m impactscope.proof generate|run|score|all|agreement``: the concealed examination."""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from impactscope.errors import ImpactscopeError

from .bench_mujoco import FEATURES, simulate_mujoco
from .confusion_picture import confusion_svg
from .draw import CATEGORIES, KINDS
from .examine import examine
from .generate import SHORT, generate
from .known_cases import Simulator, agreement, simulate
from .peers import peers
from .population import POPULATIONS
from .score import confusion, lines, read_marks, score, write
from .sealed import open_sealed

AGREEMENT = 0.1  # of the noise, within which two simulators agree


def main(argv: list[str] | None = None) -> int:
    """Run one stage of the examination, or all of them; returns the exit code."""
    options = _parser().parse_args(argv)
    output: Path = options.output
    try:
        if options.stage == 'agreement':
            return _agreement(options.simulator, options.features)
        if options.stage in ('generate', 'all'):
            _generate(options)
        if options.stage in ('run', 'all'):
            engine = shlex.split(options.engine) if options.engine else _engine()
            _say(f'engine: {" ".join(engine)}')
            examine(output, engine, jobs=options.jobs, timeout=options.timeout, progress=_progress)
        if options.stage in ('score', 'all'):
            _score(output, options.digest, with_peers=not options.no_peers)
    except (ImpactscopeError, OSError) as error:
        sys.stderr.write(f'{error}\n')
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='impactscope.proof', description=__doc__)
    parser.add_argument(
        'stage', choices=('generate', 'run', 'score', 'all', 'agreement'), nargs='?'
    )
    parser.set_defaults(stage='all')
    parser.add_argument('--seed', type=int, help='of all chance; default: fresh, and printed')
    parser.add_argument('--campaigns', type=int, help='how many; default 200, short 12')
    parser.add_argument('--jobs', type=int, default=2, help='at the same time')
    parser.add_argument('--short', action='store_true', help='a dozen campaigns of every kind')
    parser.add_argument(
        '--only', choices=tuple(CATEGORIES), help='one category, as for 300 clean ones'
    )
    parser.add_argument('--kind', choices=tuple(KINDS), help='of every campaign; default: drawn')
    parser.add_argument(
        '--population',
        choices=tuple(POPULATIONS),
        default='paper',
        help='benches and instruments: about those of the paper, or of a wide range',
    )
    parser.add_argument('--no-classes', action='store_true', help='do not search look-alikes')
    parser.add_argument('--no-peers', action='store_true', help='leave the simple methods out')
    parser.add_argument('--output', type=Path, default=Path('out/proof'))
    parser.add_argument('--engine', help='command in front of: explain CAMPAIGN --json FILE')
    parser.add_argument('--timeout', type=float, default=900.0, help='s for one campaign')
    parser.add_argument(
        '--simulator', help='module:function, for agreement: another simulator of the known cases'
    )
    parser.add_argument('--features', default='', help='what it knows, with commas; default: all')
    parser.add_argument('--digest', help='SHA-256 of the sealed answers, as published')
    return parser


def _generate(options: argparse.Namespace) -> None:
    seed = options.seed if options.seed is not None else int.from_bytes(os.urandom(6))
    count = options.campaigns or (len(SHORT) if options.short else 200)
    categories: tuple[str, ...] = SHORT if options.short else ()
    if options.only:
        categories = (options.only,)
    _say(f'seed {seed}, {count} campaigns')
    digest = generate(
        options.output,
        seed,
        count,
        jobs=options.jobs,
        categories=categories,
        kind=options.kind,
        classes=not options.no_classes,
        population=options.population,
        progress=_progress,
    )
    _say(f'sealed answers: SHA-256 {digest}')


def _agreement(simulator: str | None, features: str) -> int:
    """Distances of simulators from the exact solutions; 1 where one exceeds a tenth of noise."""
    chosen: list[tuple[str, Simulator, frozenset[str] | None]] = []
    if simulator is None:
        chosen.append(('integrator', simulate, None))
        if find_spec('mujoco') is not None:
            chosen.append(('MuJoCo', simulate_mujoco, FEATURES))
    else:
        module, _, function = simulator.partition(':')
        known = frozenset(filter(None, features.split(','))) or None
        chosen.append((simulator, getattr(import_module(module), function), known))
    worst = 0.0
    for name, run, known in chosen:
        for row in agreement(run, known):
            worst = max(worst, row.in_noise)
            _say(f'{name:12s} {row.case:28s} {row.channel:22s} {row.in_noise:.2g} of the noise')
    return int(not worst < AGREEMENT)


def _engine() -> list[str]:
    """The suite's command line beside this interpreter, else on the path."""
    beside = Path(sys.executable).with_name('impactscope')
    found = str(beside) if beside.exists() else shutil.which('impactscope')
    return [found] if found else [sys.executable, '-m', 'impactscope']


def _score(output: Path, digest: str | None, *, with_peers: bool) -> None:
    marks = read_marks(output, digest)
    result = score(marks)
    write(output, marks, result)
    for line in lines(result):
        _say(line)
    counts = confusion(marks)
    if counts:
        picture = output / 'confusion.svg'
        picture.write_text(confusion_svg(counts, "Truth against first answer, d' 5 and more"))
        _say(f'\nconfusion matrix: {picture}')
    if with_peers:
        _peers(output)


def _peers(output: Path) -> None:
    """What the simple methods say, sorted by what was concealed."""
    answers = open_sealed(output / 'answers.sealed')['campaigns']
    views = {name: peers(output / 'campaigns' / name) for name in sorted(answers)}
    clean = [v for n, v in views.items() if answers[n]['category'] == 'clean' and v.recordings]
    strong = [
        (answers[n], v)
        for n, v in views.items()
        if answers[n]['category'] == 'single' and answers[n]['detectability'] >= 5 and v.recordings
    ]
    _say('\nthe same campaigns, simple methods on the free motion after taps')
    for what, chosen in (('clean', clean), ("one effect, d' 5 and more", [v for _, v in strong])):
        if chosen:
            fit = sorted(v.r_squared for v in chosen)
            named = sum(bool(v.terms) for v in chosen)
            _say(
                f'  {what}: re-fitted baseline R² {fit[0]:.4f} to {fit[-1]:.4f}; '
                f'sparse regression adds terms in {named} of {len(chosen)}'
            )
    if strong:
        right = sum(a['parts'][0]['name'] in v.names for a, v in strong)
        alone = sum(v.names == (a['parts'][0]['name'],) for a, v in strong)
        _say(
            f'  sparse regression has the right term among its own in {right}, '
            f'alone in {alone} of {len(strong)}'
        )


def _progress(what: str, done: int, total: int) -> None:
    end = '\n' if done == total else '\r'
    sys.stderr.write(f'{what} {done} of {total}{end}')
    sys.stderr.flush()


def _say(text: str) -> None:
    sys.stdout.write(text + '\n')
    sys.stdout.flush()


if __name__ == '__main__':
    sys.exit(main())
