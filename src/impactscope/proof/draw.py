"""Campaigns drawn at random: what is concealed in them, and how strongly."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError, InputError

from .conditions import draw_scenario
from .detectability import Companion, Freedom, norm
from .effect import DRY_FRICTIONS, axial, swung
from .effects import EFFECTS, Effect
from .noise import seen_better
from .population import PAPER, Population
from .scenario import Scenario

__all__ = [
    'CATEGORIES',
    'CONFUSABLE',
    'KINDS',
    'Concealed',
    'Part',
    'by_all',
    'differences',
    'draw',
    'look_alikes',
    'solve_strength',
]

Array = NDArray[np.float64]

CATEGORIES: Mapping[str, float] = {
    'clean': 0.20,
    'single': 0.42,
    'pair': 0.12,
    'outside': 0.10,
    'parameter': 0.09,
    'label': 0.07,
}
KINDS: Mapping[str, float] = {
    'impact': 0.62,
    'driven': 0.12,
    'closed_loop': 0.08,
    'prescribed': 0.09,
    'chain': 0.09,
}
_POSSIBLE = {  # where numbers are stated
    'parameter': ('impact', 'closed_loop', 'chain'),
    'label': ('impact',),
}
WEAKEST, STRONGEST = 0.3, 100.0  # d'
_TOO_MUCH = 1e9  # d' of what cannot be
_DRAWS = 30  # until the wanted channel comes; some effects are of one channel only
# An alternative that leaves less than this d' cannot be ruled out: between two known courses an
# ideal observer errs in Phi(-d'/2), here in one of twenty.
CONFUSABLE = 3.29
ALIKE = 1.0  # an alternative that leaves less needs no other draw of its shape
_NEAR = 0.5  # of d', less than which an alternative leaves that cannot be ruled out
_LIKE = 0.7  # of d', less than which one leaves that is looked at closer
# what is drawn beside the strength of an effect and is no number to re-tune
_NO_NUMBERS = ('channel', 'peak', 'sign', 'order', 'zero_phase', 'already')
TRIES = 2  # draws of its shape with either sign


@dataclass(frozen=True)
class Part:
    """One concealed effect with its strength."""

    key: str
    name: str
    subsystem: str
    family: str
    parameters: Mapping[str, float | str]
    detectability: float
    # the same were all recordings fitted; only where those that are fitted do not show it
    by_all: float = 0.0
    # d' that each other mechanism leaves of it, at most; empty where that was not looked at
    differences: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Concealed:
    """A campaign, what its file states, and what is hidden in it."""

    stated: Scenario
    truth: Scenario
    category: str
    parts: tuple[Part, ...] = ()
    detectability: float = 0.0  # the least of the parts, each beside the others
    confusable: Mapping[str, float] = field(default_factory=dict)  # name: d' it leaves


def draw(
    rng: np.random.Generator,
    *,
    category: str | None = None,
    kind: str | None = None,
    classes: bool = True,
    population: Population = PAPER,
) -> Concealed:
    """A concealed campaign.

    Args:
        rng: the only source of chance.
        category: one of ``CATEGORIES``; None: drawn.
        kind: of the campaign, as of ``KINDS``; None: drawn.
        classes: whether to find what the data cannot tell from the truth (takes longest).
        population: from which conditions are drawn.

    Raises ConfigurationError where the kind states nothing of that category.
    """
    if category is None:
        category = _drawn(
            rng, {c: w for c, w in CATEGORIES.items() if kind is None or _possible(c, kind)}
        )
    if kind is None:
        kind = _drawn(rng, {k: w for k, w in KINDS.items() if _possible(category, k)})
    if not _possible(category, kind):
        raise ConfigurationError(f'no campaign of kind {kind!r} conceals a wrong {category}')
    clean = draw_scenario(rng, kind, population)
    while not _states(clean, category):
        clean = draw_scenario(rng, kind, population)
    if category == 'clean':
        return Concealed(clean, clean, category)
    if category == 'pair':
        return _pair(rng, clean, classes=classes)
    family = 'library' if category == 'single' else category
    chosen = _choose(rng, clean, family)
    baseline = chosen.prepare(clean)
    aux = chosen.setup(rng, baseline)
    wanted = _wanted(rng)
    freedom = Freedom(baseline)
    strength, size = solve_strength(freedom, chosen, aux, wanted)
    truth = chosen.apply(baseline, strength, aux)
    others: Mapping[str, float] = {}
    if classes and size >= 1:
        others = differences(rng, freedom, truth, {chosen.key}, kin=_kin(chosen))
    part = _part(chosen, strength, aux, size, by_all(size, baseline, truth), others)
    return Concealed(baseline, truth, category, (part,), size, look_alikes(others, size))


def solve_strength(
    freedom: Freedom, chosen: Effect, aux: Mapping[str, float | str], wanted: float
) -> tuple[float, float]:
    """Strength at which an effect has the wanted d', and the d' it then has.

    Found on a logarithmic scale, linear re-tuning first and the baseline simulated anew at the
    end; where no strength in the effect's range has the wanted d', the nearest.
    """
    if not chosen.tunable:
        truth = chosen.apply(freedom.scenario, 1.0, aux)
        return 1.0, freedom.detectability(truth)
    if chosen.name == 'quantisation':
        return _quantisation(freedom, aux, wanted)
    strength, _ = _search(freedom, chosen, aux, wanted, math.sqrt(chosen.low * chosen.high))
    return _search(freedom, chosen, aux, wanted, strength, linear=False, trials=5)


def differences(
    rng: np.random.Generator,
    freedom: Freedom,
    truth: Scenario,
    skip: Collection[str],
    kin: Collection[str] = (),
) -> dict[str, float]:
    """The d' that each other mechanism leaves of a truth, least first.

    Every effect of the library but those whose keys are in ``skip`` is given the same d', an
    effect of the measuring chain in the channel that shows most of what the baseline leaves. Its
    own remainder is subtracted in the best proportion, 0 to 2; what it cannot remove is its d'.
    Where that is near, and for those named in ``kin``, the baseline is re-tuned anew with the
    other effect in it and all its numbers: two remainders that were re-tuned apart differ by what
    both can be re-tuned by, and how an effect looks hangs on its strength and its other numbers.
    """
    rng = rng.spawn(1)[0]  # so that what is looked at changes no recording
    left, size = freedom.fitted(truth)
    found: dict[str, float] = {}
    if size < 1e-9:  # the baseline hides it completely: there is nothing to look like
        return found
    telling = _telling_channel(freedom.scenario, left)
    for other in EFFECTS:
        if other.family in ('outside', 'label') or other.key in skip:
            continue
        if not other.tunable or other.name == 'quantisation' or not other.fits(freedom.scenario):
            continue
        if other.name == 'gravity_load' and 'gravity_load' in freedom.scenario.baseline:
            continue
        for aux in _shapes(rng, other, freedom.scenario, telling):
            start = math.sqrt(other.low * other.high)
            strength, _ = _search(freedom, other, aux, size, start, trials=5, close=1.5)
            turned = other.apply(freedom.scenario, strength, aux)
            for linear in (True, False):
                mine, reached = freedom.fitted(turned, linear=linear)
                rest = _without(left, mine, reached)
                if rest > _LIKE * size:  # nothing like it: no need to look closer
                    break
            if ALIKE < rest < _LIKE * size or other.name in kin:
                if other.name in kin:
                    strength, _ = _search(freedom, other, aux, size, strength, linear=False)
                beside = freedom.beside(_applied(other, strength, aux, _numbers(aux)))
                with contextlib.suppress(InputError):
                    rest = min(rest, beside.detectability(truth))
            found[other.name] = min(rest, found.get(other.name, math.inf))
            if not aux or found[other.name] < min(ALIKE, _NEAR * size):  # nothing else to try
                break
    return dict(sorted(found.items(), key=lambda item: item[1]))


def look_alikes(found: Mapping[str, float], size: float) -> dict[str, float]:
    """Those of :func:`differences` that the data cannot tell from a truth of d' ``size``."""
    least = min(CONFUSABLE, _NEAR * size)
    return {name: rest for name, rest in found.items() if rest < least}


def _without(left: Sequence[Array], mine: Sequence[Array], reached: float) -> float:
    """Norm of a remainder without the best share, 0 to 2, of another of norm ``reached``."""
    if reached == 0:
        return norm(left)
    along = sum(float(np.einsum('i,i', a, b)) for a, b in zip(left, mine, strict=True))
    share = min(max(along / reached**2, 0.0), 2.0)
    return math.sqrt(max(norm(left) ** 2 - 2 * share * along + (share * reached) ** 2, 0.0))


def _telling_channel(scenario: Scenario, left: Sequence[Array]) -> str:
    """The channel with most of a remainder."""
    energy = dict.fromkeys(scenario.channels, 0.0)
    for blow, values in zip(scenario.blows, left, strict=False):  # priors come last
        begin = 0
        for name in scenario.channels:
            part = values[begin : begin + math.ceil(blow.duration * scenario.rates[name])]
            energy[name] += float(part @ part)
            begin += part.size
    return max(energy, key=lambda name: energy[name])


def _shapes(
    rng: np.random.Generator, effect: Effect, scenario: Scenario, channel: str
) -> Iterator[Mapping[str, float | str]]:
    """What an effect is tried with as a look-alike: its own shapes, else draws of either sign."""
    own = effect.shapes(scenario)
    if own:
        drawn = _set_up(rng, effect, scenario, channel)
        yield from ({**drawn, **shape} for shape in own)
        return
    for sign in (1, -1) * TRIES:  # what else is drawn beside the strength may be near or far
        aux = _set_up(rng, effect, scenario, channel)
        yield {**aux, 'sign': sign} if 'sign' in aux else aux


def _set_up(
    rng: np.random.Generator, effect: Effect, scenario: Scenario, channel: str
) -> Mapping[str, float | str]:
    """What is drawn beside an effect's strength, in a given channel where it has one."""
    for _ in range(_DRAWS):
        aux = effect.setup(rng, scenario)
        if aux.get('channel', channel) == channel:
            break
    return aux


def _pair(rng: np.random.Generator, clean: Scenario, *, classes: bool) -> Concealed:
    """Two effects of different subsystems; d' is the lesser, each beside the other."""
    first = _choose(rng, clean, 'library', tunable=True)
    while True:
        second = _choose(rng, clean, 'library', tunable=True)
        apart = second.subsystem != first.subsystem
        apart |= clean.kind == 'chain' and second.name != first.name
        if apart and 'quantisation' not in (first.name, second.name):
            break
        if first.name == 'quantisation':
            first = _choose(rng, clean, 'library', tunable=True)
    baseline = second.prepare(first.prepare(clean))
    freedom = Freedom(baseline)
    wanted = _wanted(rng)
    turned = []
    for effect, target in ((first, wanted), (second, wanted * 10 ** rng.uniform(0, 0.5))):
        aux = effect.setup(rng, baseline)
        strength, _ = solve_strength(freedom, effect, aux, target)
        turned.append((effect, strength, aux))
    truth = baseline
    for effect, strength, aux in turned:
        truth = effect.apply(truth, strength, aux)
    parts = []
    confusable: dict[str, float] = {}
    for (effect, strength, aux), other in zip(turned, turned[::-1], strict=True):
        beside = Freedom(baseline, _applied(*other))
        reached = beside.detectability(truth)
        seen = by_all(reached, baseline, truth, _applied(*other))
        others: Mapping[str, float] = {}
        if classes and reached >= 1:
            others = differences(rng, beside, truth, {effect.key, other[0].key}, kin=_kin(effect))
            confusable |= look_alikes(others, reached)
        parts.append(_part(effect, strength, aux, reached, seen, others))
    size = min(p.detectability for p in parts)
    return Concealed(baseline, truth, 'pair', tuple(parts), size, confusable)


def by_all(size: float, baseline: Scenario, truth: Scenario, *beside: Companion) -> float:
    """The d' of what those that are fitted do not show (``size``), were all recordings fitted."""
    if size >= 1:
        return 0.0
    return Freedom(baseline.all_fitted(), *beside).detectability(truth.all_fitted())


def _kin(effect: Effect) -> tuple[str, ...]:
    return DRY_FRICTIONS if effect.name in DRY_FRICTIONS else ()


def _applied(
    effect: Effect,
    strength: float,
    aux: Mapping[str, float | str],
    numbers: Mapping[str, float] | None = None,
) -> Companion:
    """An effect as a companion whose strength, and ``numbers`` of ``aux``, may be re-tuned."""
    free = numbers or {}

    def apply(scenario: Scenario, factors: Sequence[float]) -> Scenario:
        own = {k: v * f for (k, v), f in zip(free.items(), factors[1:], strict=True)}
        return effect.apply(scenario, strength * factors[0], {**aux, **own})

    return Companion(apply, 1 + len(free))


def _numbers(aux: Mapping[str, float | str]) -> dict[str, float]:
    """What was drawn beside the strength and may be re-tuned."""
    return {k: float(v) for k, v in aux.items() if k not in _NO_NUMBERS and v != 0}


def _possible(category: str, kind: str) -> bool:
    return kind in _POSSIBLE.get(category, KINDS)


def _states(scenario: Scenario, category: str) -> bool:
    """Whether the file says what is to be wrong in it."""
    if category == 'label':  # those that may be wrong are the pendulum's
        return swung(scenario)
    return category != 'parameter' or not axial(scenario) or scenario.stated_axis is not None


def _drawn(rng: np.random.Generator, shares: Mapping[str, float]) -> str:
    weights = np.array(list(shares.values()))
    return str(rng.choice(list(shares), p=weights / weights.sum()))


def _wanted(rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(np.log(WEAKEST), np.log(STRONGEST))))


def _choose(
    rng: np.random.Generator, scenario: Scenario, family: str, *, tunable: bool = False
) -> Effect:
    candidates = [
        e
        for e in EFFECTS
        if e.family == family and e.fits(scenario) and (e.tunable or not tunable)
    ]
    return candidates[int(rng.integers(len(candidates)))]


def _part(
    chosen: Effect,
    strength: float,
    aux: Mapping[str, float | str],
    size: float,
    seen_by_all: float,
    others: Mapping[str, float],
) -> Part:
    values = chosen.parameters(strength, aux)
    if 'channel' in aux:
        values = values | {'channel': aux['channel']}
    return Part(
        key=chosen.key,
        name=chosen.name,
        subsystem=chosen.subsystem,
        family=chosen.family,
        parameters=values,
        detectability=size,
        by_all=seen_by_all,
        differences=others,
    )


def _search(
    freedom: Freedom,
    chosen: Effect,
    aux: Mapping[str, float | str],
    wanted: float,
    start: float,
    *,
    linear: bool = True,
    trials: int = 14,
    close: float = 1.05,
) -> tuple[float, float]:
    """Strength for a d', by secants of log d' over log strength inside a bracket."""
    low, high = math.log(chosen.low), math.log(chosen.high)
    at = min(max(math.log(start), low), high)
    slope = 1.0
    last: tuple[float, float] | None = None
    best = (math.inf, math.exp(at), 0.0)
    for _ in range(trials):
        try:
            size = freedom.detectability(
                chosen.apply(freedom.scenario, math.exp(at), aux), linear=linear
            )
        except InputError:  # a controller that does not hold it
            size = _TOO_MUCH
        level = math.log(max(size, 1e-9))
        miss = abs(level - math.log(wanted))
        if miss < best[0]:
            best = (miss, math.exp(at), size)
        if miss < math.log(close):
            break
        if level < math.log(wanted):
            low = max(low, at)
        else:
            high = min(high, at)
        if high - low < 1e-3:
            break
        if last is not None and abs(at - last[0]) > 1e-6:
            slope = min(max((level - last[1]) / (at - last[0]), 0.3), 8.0)
        last = (at, level)
        ahead = at + (math.log(wanted) - level) / slope
        margin = 0.02 * (high - low)
        if not low + margin < ahead < high - margin:
            at_edge = low if ahead <= low + margin else high
            edge = math.log(chosen.low) if at_edge == low else math.log(chosen.high)
            ahead = at_edge if at_edge == edge and at != edge else 0.5 * (low + high)
        at = ahead
    return best[1], best[2]


def _quantisation(
    freedom: Freedom, aux: Mapping[str, float | str], wanted: float
) -> tuple[float, float]:
    """Steps act as further noise: d' from the rise of the variance, step²/12."""
    scenario, name = freedom.scenario, str(aux['channel'])
    count = sum(math.ceil(b.duration * scenario.rates[name]) for b in scenario.blows)
    rise = wanted / math.sqrt(count / 2) / seen_better(scenario.colour(name))
    return scenario.noise[name] * math.sqrt(12 * rise), wanted
