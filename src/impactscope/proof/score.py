"""The score of an examination: shares with exact intervals, by detectability."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .draw import KINDS
from .intervals import Share, share
from .marking import DETECTABLE, Mark, mark
from .sealed import open_sealed

__all__ = ['BINS', 'Score', 'confusion', 'lines', 'read_marks', 'score', 'write']

BINS: tuple[tuple[float, float], ...] = (
    (0.0, 1.0),
    (1.0, 2.0),
    (2.0, 3.0),
    (3.0, 5.0),
    (5.0, math.inf),
)


@dataclass(frozen=True)
class Score:
    """Everything that is printed; one row of ``shares`` is (what, range of d', share)."""

    campaigns: int
    answered: int
    shares: tuple[tuple[str, str, Share], ...]
    # what, range of d', right, of an ideal observer at most (expected), from how many
    ideal: tuple[tuple[str, str, int, float, int], ...]
    medians: tuple[tuple[str, float, int], ...]  # what, median, from how many
    calibration: tuple[tuple[str, float, Share], ...]  # bin, mean probability, hits
    brier: float


def read_marks(output: Path, digest: str | None = None) -> list[Mark]:
    """Open the sealed answers of an examination and mark what the engine replied.

    Raises InputError where the seal is not the published one.
    """
    sealed = open_sealed(output / 'answers.sealed', digest)
    marks = []
    for name, answer in sorted(sealed['campaigns'].items()):
        run = output / 'results' / f'{name}.run.json'
        if not run.exists():
            continue  # not asked yet
        reply = _reply(output / 'results' / f'{name}.json')
        seconds = float(json.loads(run.read_text())['seconds'])
        marks.append(mark(name, answer, reply, seconds))
    return marks


def _reply(path: Path) -> dict[str, Any] | None:
    try:
        reply = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    return reply if isinstance(reply, dict) else None


def score(marks: Sequence[Mark]) -> Score:
    """Figures of an examination."""
    shares: list[tuple[str, str, Share]] = []
    ideal: list[tuple[str, str, int, float, int]] = []

    def add(what: str, where: str, chosen: Iterable[Mark], hit: Callable[[Mark], bool]) -> None:
        among = list(chosen)
        shares.append((what, where, share(sum(hit(m) for m in among), len(among))))

    clean = [m for m in marks if m.category == 'clean']
    add('finding although nothing is missing', 'clean', clean, lambda m: m.finding)
    for kind in KINDS:
        of_kind = [m for m in clean if m.kind == kind]
        add('finding although nothing is missing', kind, of_kind, lambda m: m.finding)
    for where, coloured in (('white noise', False), ('other noise', True)):
        of_noise = [m for m in clean if m.coloured == coloured]
        add('finding although nothing is missing', where, of_noise, lambda m: m.finding)
    faint = [m for m in marks if m.category != 'clean' and not m.truth]
    add('finding although it cannot be seen', "d' < 1", faint, lambda m: m.finding)
    for low, high in BINS[1:]:
        where = f"d' {low:g} to {high:g}" if math.isfinite(high) else f"d' {low:g} and more"
        inside = [m for m in marks if m.truth and low <= _visible(m) < high]
        library = [m for m in inside if m.category in ('single', 'pair')]
        add('right name first', where, library, lambda m: bool(m.name_first))
        add('right family first', where, library, lambda m: bool(m.family_first))
        add('right set or class', where, library, lambda m: bool(m.right_set))
        add('exactly the right set', where, library, lambda m: bool(m.exact_set))
        names = [(m.name_first, m.ideal_name) for m in library]
        ideal.append(('right name first', where, *_of_ideal(names)))
        sets = [(m.right_set, m.ideal_set) for m in library]
        ideal.append(('right set or class', where, *_of_ideal(sets)))
        wrong = [m for m in inside if m.category in ('parameter', 'label')]
        add('wrong number called one', where, wrong, lambda m: bool(m.right_set))
        add('and the right one named', where, wrong, lambda m: bool(m.parameter_named))
        outside = [m for m in inside if m.category == 'outside']
        add('unknown called unknown', where, outside, lambda m: bool(m.unknown))
        add('subsystem named', where, inside, lambda m: bool(m.subsystem))
    strong = [m for m in marks if m.truth and _visible(m) >= 5]
    for kind in KINDS:
        add('right, whatever is hidden', kind, [m for m in strong if m.kind == kind], _right)
    for where, coloured in (('white noise', False), ('other noise', True)):
        of_noise = [m for m in strong if m.coloured == coloured]
        add('right, whatever is hidden', where, of_noise, _right)
    covered = [c for m in strong if m.name_first for c in m.covered.values()]
    coverage = share(sum(covered), len(covered))
    shares.append(('true parameter inside 95 % interval', "d' 5 and more", coverage))
    held = [m for m in marks if m.held_out_ratio is not None]
    for where, of in (('all', held), ("d' 5 and more", [m for m in held if m in strong])):
        add('held-out RMSE within 1.1 of noise', where, of, lambda m: _close(m, 1.0))
        able = [m for m in of if m.held_out_limit is not None]
        add('held-out RMSE, 1.1 of what data allow', where, able, _as_near_as_can_be)
    add('answered', 'all', marks, lambda m: m.answered)
    add('answered within 60 s', 'all', marks, lambda m: m.answered and m.seconds <= 60)
    medians = (
        _median("share of d'² inside named regions", [m.evidence_inside for m in strong]),
        _median('time named as regions, s', [m.time_named for m in strong]),
        _median(
            'relative error of parameters',
            [e for m in strong if m.name_first for e in m.parameter_errors.values()],
        ),
        _median('held-out RMSE over noise floor', [m.held_out_ratio for m in held]),
        _median('seconds a campaign', [m.seconds for m in marks]),
    )
    calibration, brier = _calibration(marks)
    return Score(
        campaigns=len(marks),
        answered=sum(m.answered for m in marks),
        shares=tuple(shares),
        ideal=tuple(ideal),
        medians=medians,
        calibration=calibration,
        brier=brier,
    )


def confusion(marks: Sequence[Mark], least: float = 5.0) -> dict[tuple[str, str], int]:
    """Counts of (truth, first answer); 'nothing' and 'unknown' are names too.

    Only clean campaigns, and those with one visible effect of at least this d'.
    """
    counts: Counter[tuple[str, str]] = Counter()
    for m in marks:
        if m.category == 'clean':
            counts['nothing', m.first or 'nothing'] += 1
        elif len(m.truth) == 1 and _visible(m) >= least:
            counts[m.truth[0], m.first or 'nothing'] += 1
    return dict(counts)


def lines(result: Score) -> list[str]:
    """The score as text."""
    text = [f'{result.campaigns} campaigns, {result.answered} answered', '']
    for what, where, value in result.shares:
        if value.trials:
            text.append(f'{what:38s} {where:16s} {value}')
    text.append('')
    for what, where, hits, expected, count in result.ideal:
        if count:
            text.append(
                f'{what:38s} {where:16s} {hits}; ideal observer at most {expected:.1f} of {count}'
            )
    text.append('')
    for name, middle, count in result.medians:
        if count:
            text.append(f'{name:38s} median {middle:.4g} of {count}')
    if result.calibration:
        text += ['', f'probability of the first name: Brier score {result.brier:.3f}']
        for where, mean, value in result.calibration:
            if value.trials:
                text.append(f'  said {where} (mean {100 * mean:.0f} %): right in {value}')
    return text


def write(output: Path, marks: Sequence[Mark], result: Score) -> None:
    """Leave ``score.json`` beside the examination."""
    content = {'score': asdict(result), 'marks': [asdict(m) for m in marks]}
    (output / 'score.json').write_text(json.dumps(content, indent=1, default=str))


def _of_ideal(told: Sequence[tuple[bool | None, float | None]]) -> tuple[int, float, int]:
    """How many are right, and of an ideal observer at most, among those of which that is known."""
    known = [(bool(right), chance) for right, chance in told if chance is not None]
    return sum(right for right, _ in known), math.fsum(chance for _, chance in known), len(known)


def _right(m: Mark) -> bool:
    return bool(m.unknown if m.category == 'outside' else m.right_set)


def _close(m: Mark, limit: float) -> bool:
    return m.held_out_ratio is not None and m.held_out_ratio <= 1.1 * limit


def _as_near_as_can_be(m: Mark) -> bool:
    return _close(m, m.held_out_limit or 1.0)


def _visible(m: Mark) -> float:
    """The d' by which a campaign is sorted; at least what makes its truth visible."""
    return max(m.detectability, DETECTABLE)


def _median(what: str, values: Iterable[float | None]) -> tuple[str, float, int]:
    known = [v for v in values if v is not None]
    return what, float(np.median(known)) if known else math.nan, len(known)


def _calibration(
    marks: Sequence[Mark],
) -> tuple[tuple[tuple[str, float, Share], ...], float]:
    told = [
        (m.probability, bool(m.name_first))
        for m in marks
        if m.probability is not None and m.category in ('single', 'pair', 'parameter')
    ]
    if not told:
        return (), math.nan
    rows = []
    for low, high in ((0.0, 0.5), (0.5, 0.8), (0.8, 0.95), (0.95, 1.0)):
        inside = [(p, hit) for p, hit in told if low <= p < high or (high == 1.0 and p >= 1.0)]
        mean = float(np.mean([p for p, _ in inside])) if inside else math.nan
        hits = share(sum(hit for _, hit in inside), len(inside))
        rows.append((f'{100 * low:.0f} to {100 * high:.0f} %', mean, hits))
    return tuple(rows), float(np.mean([(p - hit) ** 2 for p, hit in told]))
