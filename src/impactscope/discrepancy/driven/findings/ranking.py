"""From fits to findings: what was accepted, what else was tried, what cannot be told apart."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

from impactscope.discrepancy.answer import Finding, ParameterEstimate, numbers_left_open
from impactscope.discrepancy.campaign import CampaignKind
from impactscope.discrepancy.driven.adequacy.unmodelled_laws import Verdict
from impactscope.discrepancy.driven.findings.free_swing import (
    as_force,
    mass_of_free_swing,
    swings_freely,
)
from impactscope.discrepancy.driven.findings.mains_hum import hum_in_force
from impactscope.discrepancy.driven.findings.subject import Subject
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.model_selection.chi_square import BETWEEN, DELAYING
from impactscope.discrepancy.driven.models.backlash import COUPLED
from impactscope.discrepancy.driven.models.measuring_chain import filter_of
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel, gain_of
from impactscope.discrepancy.driven.models.relaxation import NAME as RELAXING
from impactscope.discrepancy.driven.models.relaxation import TIME
from impactscope.discrepancy.driven.models.terms import Number, Term, key
from impactscope.discrepancy.driven.noise.quantisation import step_of
from impactscope.discrepancy.driven.systems.linear_baseline import gain_tolerance
from impactscope.discrepancy.driven.systems.prescribed_motion import PrescribedModel
from impactscope.discrepancy.driven.systems.prescribed_noise_limited import NoiseLimitedMotionModel
from impactscope.discrepancy.evidence import flat_top, probabilities
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism

__all__ = [
    'STATED',
    'findings_of',
    'modal_finding',
    'unknown_finding',
    'unlikely',
    'wrong_parameters',
]

STATED = (
    ('stiffness', 'stiffness'),
    ('moving_mass', 'mass'),
    ('damping', 'damping'),
)  # in campaigns and in fits
LIKELY = 0.5  # probability below which nothing is named beside something unknown
APART = 0.3  # relative difference of two numbers that is to be excluded
REFUSED = 0.5  # probability of what a criterion may like and the rule against chance refuses
EXCESS = 0.2  # of friction at rest over that in motion, likewise
ALIKE = 9.0  # chi-square that does not tell a delay's form
HINT = 4.0  # chi-square a number that makes a richer rival more than a possibility
AT_AN_END = 0.02  # of a number's scale, from the end of what it may be
ONE_WAY = ('coulomb_friction', 'hysteresis', 'softening_spring', 'offset')  # friction, not turned
OF_SENSORS = 0.005  # by which the gains of two sensors may differ, where nothing is known of them
SUSPECT = 4.0  # standard uncertainties between a stated and a fitted number
SAME_FACTOR = 2.5  # the same, between numbers that are off by one factor


def unknown_finding(verdict: Verdict) -> Finding:
    """What is not in the vocabulary, by the law that it resembles most."""
    law_left = verdict.strongest
    return Finding(
        'unknown',
        verdict.probability,
        'unknown',
        sentence=(
            f'Something is missing that is not in the library; it goes like {law_left.law}.'
        ),
        source='laws beyond the library, each as a small change beside the fit',
        evidence=law_left.gain,
    )


def findings_of(s: Subject, new: Sequence[Term]) -> list[Finding]:
    """Accepted terms first, then what else was tried, by probability.

    Beside something unknown a richer rival fits a part of that: it says nothing of what was found.
    """
    beside = s.verdict is not None and s.verdict.left and not s.verdict.instead
    fits, weight = _weighted(s, no_richer=beside)
    given = s.given
    best = {t.name for t in s.outcome.best.terms}
    share: dict[str, float] = {}
    source: dict[str, tuple[Term, Fit, float]] = {}
    for made, p in zip(fits, weight, strict=True):
        for term in made.terms:
            if (term.name, term.channel) in given:
                continue
            share[term.name] = share.get(term.name, 0.0) + p
            if term.name not in source or p > source[term.name][2]:
                source[term.name] = term, made, p
    found = []
    if s.verdict is not None and not beside:
        share = {n: p * (1.0 - s.verdict.probability) for n, p in share.items()}
    for term in new:
        rivals = _confused(s, term.name, best, fits, weight)
        words = _same_law(s, term)
        if 'offset' in rivals and _on_axis(s):
            words = (*words, 'gravity_load')  # a constant force on an axis may be a weight
        alike = (*words, *_other_delay(s, term, fits), *_one_way(s, term))
        rivals = tuple(dict.fromkeys((*rivals, *alike)))
        likely = share[term.name] + _in_other_words(term.name, words, fits, weight)
        found.append(_finding(s, term, s.outcome.best, likely, rivals))
    # what has given way to a finding, by a rule or by a hair, is told as no likelier
    at_most = {name: f.probability for f in found for name in f.confused_with}
    listed = (n for n in share if n not in best and source[n][0].listed)
    others = sorted(listed, key=lambda n: -share[n])
    for name in others[:8]:
        term, made, _ = source[name]
        likely = min(share[name], REFUSED, at_most.get(name, 1.0))
        other = _finding(s, term, made, likely, ())
        found.append(numbers_left_open(other) if _bends_no_further(s, term, made) else other)
    return found


def unlikely(s: Subject, new: Sequence[Term]) -> frozenset[str]:
    """Names of terms that are likelier not there than there, in this law or one of its kind.

    The search has chosen them because something is needed; other effects do as well.
    """
    fits, weight = _weighted(s)
    found = set()
    for term in new:
        alike = (*_same_law(s, term), *_other_delay(s, term, fits), *_one_way(s, term))
        there = [
            any(t.name in alike or not t.stands_with(term) for t in made.terms) for made in fits
        ]
        if math.fsum(p for p, of_its in zip(weight, there, strict=True) if of_its) < LIKELY:
            found.add(term.name)
    return frozenset(found)


def _weighted(s: Subject, *, no_richer: bool = False) -> tuple[list[Fit], list[float]]:
    """The chosen fit and its rivals, or those with no more numbers; the probability of each."""
    best, rivals = s.outcome.best, s.outcome.rivals
    if no_richer:
        rivals = tuple(f for f in rivals if f.added <= best.added)
    fits = [best, *rivals]
    for made in fits:
        s.judge.weights(made)
    if s.case is None:
        return fits, probabilities([s.judge.criterion(f, s.outcome.baseline) for f in fits])
    found = _one_form_each(s, fits)
    return list(found), probabilities(list(found.values()))


def _one_form_each(s: Subject, fits: Sequence[Fit]) -> dict[Fit, float]:
    """Of every set of effects the likeliest form alone, with its criterion; the chosen fit first.

    The chosen fit stands for its effects, and is as likely as their likeliest form: it may have
    a number more (the rate of a clock) to tell how far that may go.
    """
    names = {made: frozenset(t.name for t in made.terms) for made in fits}
    judged = {made: s.judge.criterion(made, s.outcome.baseline) for made in fits}
    likeliest = {names[made]: made for made in sorted(fits, key=lambda f: -judged[f])}
    least = {name: judged[made] for name, made in likeliest.items()}
    likeliest.pop(names[fits[0]])
    rest = sorted(likeliest.values(), key=lambda f: judged[f])
    return {made: least[names[made]] for made in (fits[0], *rest)}


def _confused(
    s: Subject, name: str, best: set[str], fits: Sequence[Fit], weight: Sequence[float]
) -> tuple[str, ...]:
    """Effects that stand in for one in models that are not excluded and need no more numbers.

    Numbers of each recording, such as a filter's state where it begins, are no part of the law.
    """
    top, best_fit = weight[0], s.outcome.best
    found: list[str] = []
    for made, p in zip(fits, weight, strict=True):
        names = {t.name for t in made.terms}
        extra = (made.added - made.own) - (best_fit.added - best_fit.own)
        if name in names or (extra > 0 and s.case is None):
            continue
        if extra > 0 and not _open(s, made):
            continue
        if extra <= 0 and p < s.judge.thresholds.confusable * top:
            continue
        new = [t.told_name for t in made.terms if t.name not in best]
        if extra <= 0 or len(new) == 1:  # what a richer rival has beside is no stand-in
            found += new
    return tuple(dict.fromkeys(found))


def _other_delay(s: Subject, term: Term, fits: Sequence[Fit]) -> tuple[str, ...]:
    """What else delays in the place of a filter or a clock, where only the form of it differs.

    How a filter acts between samples and of which order it is nobody has stated, and what it
    takes from the motion's own noise is known roughly: a slight difference decides nothing. A
    device that relaxes within a small part of its motion's period is viscous and late.
    """
    if term.name not in (*DELAYING, RELAXING):
        return ()
    names = {t.name for t in s.outcome.best.terms}
    rest = next((f for f in fits if {t.name for t in f.terms} == names - {term.name}), None)
    rest = s.outcome.baseline if rest is None else rest
    whole = s.judge.gain(rest, s.outcome.best).fitted
    found = []
    for made in fits:
        instead = {t.name for t in made.terms} - (names - {term.name})
        other = next((t for t in made.terms if {t.name} == instead), None)
        if other is None or other.name in names or len(made.terms) != len(s.outcome.best.terms):
            continue
        same_place = RELAXING in (term.name, other.name) or other.channel == term.channel
        gain = s.judge.gain(rest, made).fitted
        if (
            other.name in (*DELAYING, RELAXING)
            and same_place
            and gain > whole - ALIKE - BETWEEN**2 * whole
        ):
            found.append(other.name)
    return tuple(dict.fromkeys(found))


def _same_law(s: Subject, term: Term) -> tuple[str, ...]:
    """Other words for a law that no recording can tell apart.

    Friction that differs by direction is plain friction beside a constant force, which on a
    prescribed motion may as well be a wrong zero; a constant force on an axis may be a weight.
    """
    if isinstance(s.model, OscillatorModel):
        if s.model.free:
            return ()
        labels, label = {t.label for t in s.outcome.best.terms}, term.label
    elif isinstance(s.model, NoiseLimitedMotionModel):
        labels, label = {t.name for t in s.outcome.best.terms}, term.name
    else:
        return ()
    found: tuple[str, ...] = ()
    if label == 'asymmetric_friction':
        found = ('coulomb_friction', 'offset')
    elif label in {'coulomb_friction', 'offset'} and {'coulomb_friction', 'offset'} <= labels:
        found = ('asymmetric_friction',)
    if label in {'offset', 'gravity_load'} and _on_axis(s):
        found = (*found, 'gravity_load' if label == 'offset' else 'offset')
    return found


def _one_way(s: Subject, term: Term) -> tuple[str, ...]:
    """What friction may be as well where a prescribed motion never comes back."""
    if not (isinstance(s.model, PrescribedModel) and s.model.one_way):
        return ()
    return tuple(n for n in ONE_WAY if n != term.name) if term.name in ONE_WAY else ()


def _on_axis(s: Subject) -> bool:
    """Whether nothing brings the mass back."""
    return isinstance(s.model, OscillatorModel) and not s.model.free and s.model.drifts


def _in_other_words(
    name: str, words: Sequence[str], fits: Sequence[Fit], weight: Sequence[float]
) -> float:
    """Probability of models that have an effect under the other words for its law."""
    even = {'coulomb_friction', 'offset'}
    wanted = even if even <= set(words) else {'asymmetric_friction'} & set(words)
    if not wanted:
        return 0.0
    named = [{t.name for t in f.terms} for f in fits]
    return sum(p for n, p in zip(named, weight, strict=True) if name not in n and wanted <= n)


def _open(s: Subject, made: Fit) -> bool:
    """Whether a richer rival is more than a possibility that nothing speaks for.

    Either chi-square hints at it, or what it has beyond the simpler law may well be large: a
    friction that differs by direction, say, where the recordings cannot tell both ways apart.
    """
    gain = s.judge.gain(s.outcome.best, made).total
    if gain > HINT * (made.added - s.outcome.best.added):
        return True
    if gain < -HINT:
        return False
    for term in made.terms:
        value = {n.name: made.values[key(term, n)] for n in term.numbers}
        std = {n.name: made.std[key(term, n)] for n in term.numbers}
        if term.name == 'asymmetric_friction':
            one, other = 'force_forward', 'force_backward'
            apart = abs(value[one] - value[other]) + 2.0 * math.hypot(std[one], std[other])
            return apart > APART * (value[one] + value[other])
        if term.name == 'stribeck_friction' and 'excess_force' in value:
            excess = value['excess_force'] + 2.0 * std['excess_force']
            return excess > EXCESS * value['kinetic_force']
    return False


def _bends_no_further(s: Subject, term: Term, made: Fit) -> bool:
    """Whether a law is that of a finding with a shape of its own, of which nothing is seen."""
    names = {t.name for t in s.outcome.best.terms}
    plain = term.name in all_mechanisms() and names & set(mechanism(term.name).contains)
    shaped = any(n.name not in term.amounts for n in term.numbers)
    return bool(plain) and shaped and s.judge.gain(s.outcome.best, made).fitted < ALIKE


def _finding(
    s: Subject, term: Term, made: Fit, probability: float, rivals: tuple[str, ...]
) -> Finding:
    rest = [
        f
        for f in (s.outcome.baseline, s.outcome.best, *s.outcome.rivals)
        if {t.label for t in f.terms} == {t.label for t in made.terms} - {term.label}
    ]
    gain = s.judge.gain(rest[0] if rest else s.outcome.baseline, made)
    parameters, channel, sentence = _parameters(s, term, made), term.channel, term.sentence
    if term.name == 'low_pass_filter':
        cutoff = parameters['cutoff']
        std = math.hypot(cutoff.std, _among_forms(s, term, made))
        parameters['cutoff'] = dataclasses.replace(cutoff, std=std)
    if len(term.amounts) == 1 and gain.fitted > 0.0:
        name = term.amounts[0]
        if name in parameters:
            parameters[name] = _no_surer(parameters[name], gain.fitted)
    hum = hum_in_force(s, term, made)
    if hum is not None:
        parameters['amplitude'], channel = hum, str(s.campaign.bench['input'])
        sentence = 'Mains hum stands in the recorded force; the axis has not felt it.'
    return Finding(
        name=term.told_name,
        probability=min(probability, 1.0),
        subsystem=term.subsystem,
        parameters=parameters,
        confused_with=rivals,
        channel=channel,
        sentence=sentence,
        equation=term.equation,
        source=term.source,
        evidence=gain.fitted,
        held_out_gain=gain.held_out if s.judge.has_held_out else math.nan,
    )


def _at_an_end(value: float, number: Number) -> bool:
    return min(value - number.lower, number.upper - value) < AT_AN_END * number.scale


def _no_surer(amount: ParameterEstimate, gain: float) -> ParameterEstimate:
    """An amount that is known no better than that there is any of it.

    Where a mass sticks and slips slopes are steep here and there, and tell too much.
    """
    least = abs(float(amount.value)) / math.sqrt(gain)
    return dataclasses.replace(amount, std=max(amount.std, least))


def _among_forms(s: Subject, term: Term, made: Fit) -> float:
    """Standard deviation of a cut-off over orders and forms, by their probability."""
    names = {t.name for t in made.terms}
    others = [f for f in s.outcome.rivals if {t.name for t in f.terms} == names and f is not made]
    cutoffs, judged = [], []
    for f in (made, *others):
        same = next(t for t in f.terms if t.name == term.name)
        if same.channel == term.channel:
            cutoffs.append(f.values[key(same, same.numbers[0])])
            judged.append(s.judge.criterion(f, s.outcome.baseline))
    pairs = zip(probabilities(judged), cutoffs, strict=True)
    return math.sqrt(sum(p * (c - cutoffs[0]) ** 2 for p, c in pairs))


def _parameters(s: Subject, term: Term, made: Fit) -> dict[str, ParameterEstimate]:
    found, mass = _numbers(s, term, made), mass_of_free_swing(s)
    return {name: as_force(item, mass, term) for name, item in found.items()}


def _numbers(s: Subject, term: Term, made: Fit) -> dict[str, ParameterEstimate]:
    # a fit may measure a number by where it set out
    usual = {n.name: n for t in s.model.terms if t.label == term.label for n in t.numbers}
    found = {
        n.name: ParameterEstimate(
            made.values[key(term, n)],
            # at the end of what is possible a number is known from one side only
            math.nan
            if _at_an_end(made.values[key(term, n)], usual.get(n.name, n))
            else made.std.get(key(term, n), math.nan),
            n.unit,
        )
        for n in term.numbers
    }
    if term.label == 'restoring_force/joint':
        found = _weight(found, getattr(s.model, 'middle', 0.0))
    elif term.name == 'restoring_force' and 'stiffness' in made.values:
        std = made.std.get('stiffness', math.nan)
        unit = next(n.unit for n in s.model.numbers if n.name == 'stiffness')
        if 'mass' not in made.values and s.segments[0].unit.startswith('rad'):
            unit = '1/s^2'  # over the moment of inertia, which a free swing does not tell
        stiffness = made.values['stiffness']
        found['stiffness'] = ParameterEstimate(abs(stiffness), std, unit)
        if stiffness < 0.0 and 'rest_angle' not in found:
            found['rest_angle'] = ParameterEstimate(math.pi, 0.0, 'rad')
    if term.name == 'low_pass_filter':
        order, both = filter_of(term)
        found['order'] = ParameterEstimate(float(order), 0.0, '1')
        found['zero_phase'] = ParameterEstimate(float(both), 0.0, 'bool')
    if term.name == 'saturation':
        mine = [x for x in s.segments if x.channel == term.channel] or s.segments
        limit, step = found['limit'], max(step_of(x.measured) for x in mine)
        noise = max(x.noise for x in mine)
        told = flat_top([x.measured for x in mine], step, float(limit.value), noise)
        found['limit'] = limit if told is None else ParameterEstimate(*told, limit.unit)
    if term.name == 'hysteresis' and 'closing' in found:
        parts = [found[n] for n in ('closing', 'leaning') if n in found]
        rate = sum(float(e.value) for e in parts)
        if rate > 0.0:  # else it never slips
            std = math.hypot(*(e.std for e in parts)) / rate**2
            unit = parts[0].unit.removeprefix('1/')
            found['yield_displacement'] = ParameterEstimate(1.0 / rate, std, unit)
    if term.name == 'wrong_parameter':
        excess = found.pop('excess')
        found['name'] = ParameterEstimate('gain', 0.0, 'text')
        found['ratio'] = ParameterEstimate(1.0 + float(excess.value), excess.std, '1')
    if TIME in found:
        branch, time = found['stiffness'], found.pop(TIME)
        k, t = float(branch.value), float(time.value)
        slopes = {key(term, n): d for n, d in zip(term.numbers, (t, k), strict=True)}
        known = math.isfinite(branch.std) and math.isfinite(time.std)
        std = math.sqrt(made.variance_along(slopes)) if known else math.nan
        found['damping'] = ParameterEstimate(k * t, std, branch.unit.replace('/', ' s/', 1))
    if term.name == COUPLED:
        # how the mass is shared hangs on which of the two the damping acts, which is not seen
        found.pop('load_share')
    if term.name == 'stribeck_friction':
        kinetic, excess = found['kinetic_force'], found.pop('excess_force')
        value = float(kinetic.value) + float(excess.value)
        std = math.hypot(0.0 if math.isnan(kinetic.std) else kinetic.std, excess.std)
        found['static_force'] = ParameterEstimate(value, std, kinetic.unit)
    return found


def _weight(found: Mapping[str, ParameterEstimate], middle: float) -> dict[str, ParameterEstimate]:
    """Torque of a weight over the sine, and the angle at which it hangs at rest."""
    sine, cosine = found['sine'], found['cosine']
    s, c = float(sine.value), float(cosine.value)
    size = math.hypot(s, c) or 1.0
    scatter = math.hypot(s * sine.std, c * cosine.std) / size
    turn = math.hypot(c * sine.std, s * cosine.std) / size**2
    rest = math.atan2(-c, s) + middle
    return {
        'stiffness': ParameterEstimate(size, scatter, f'{sine.unit}/rad'),
        'rest_angle': ParameterEstimate(math.remainder(rest, 2.0 * math.pi), turn, 'rad'),
    }


def modal_finding(s: Subject) -> Finding:
    """The modes that a structure has beyond its simulation."""
    assert s.modes is not None  # noqa: S101 - called only then
    parameters = {}
    rows = zip(s.modes.frequencies, s.modes.damping_ratios, s.modes.std, strict=True)
    for k, (frequency, ratio, (f_std, r_std)) in enumerate(rows, 1):
        parameters[f'frequency_{k}'] = ParameterEstimate(frequency, f_std, 'Hz')
        parameters[f'damping_ratio_{k}'] = ParameterEstimate(ratio, r_std, '1')
    gain = s.judge.gain(s.outcome.baseline, s.modes.fit)
    count = len(s.modes.frequencies)
    overlap = _overlapping(s.modes.frequencies, s.modes.damping_ratios)
    return Finding(
        'further_modes',
        1.0,
        'fixture',
        parameters,
        sentence=(
            f'The structure is linear and has more modes than the simulation: {count} are seen. '
            f'No nonlinear effect on one mode explains as much.{overlap}'
        ),
        equation='sum over modes of (b0 + b1 s) / (s^2 + 2 zeta w s + w^2)',
        source='Ewins, Modal Testing (2000), ch. 2',
        evidence=gain.fitted,
        held_out_gain=gain.held_out if s.judge.has_held_out else math.nan,
    )


def _overlapping(frequencies: Sequence[float], ratios: Sequence[float]) -> str:
    """A sentence where two neighbours are closer than they are wide; empty where none are."""
    modes = sorted(zip(frequencies, ratios, strict=True))
    for (low, r_low), (high, r_high) in itertools.pairwise(modes):
        if high - low < r_low * low + r_high * high:
            return (
                f' Those at {low:.4g} and {high:.4g} Hz overlap: one mode whose frequency or '
                'damping depends on the amplitude looks like that, too.'
            )
    return ''


def wrong_parameters(s: Subject) -> list[Finding]:
    """Numbers that the campaign states and the recordings contradict."""
    values, certain = s.outcome.best.values, s.outcome.best.std
    beside = ', or the mass is not: they show over it alone' if swings_freely(s) else ''
    ratios: dict[str, tuple[float, float]] = {}  # of the recordings' number to the stated one
    evidence: dict[str, float] = {}  # chi-square of the difference
    wrong = []
    for name, fitted, stated, std in [] if s.modes is not None else _stated(s):
        if fitted not in values:
            continue
        value = values[fitted] + (1.0 if fitted.endswith('.excess') else 0.0)
        std = math.hypot(std, certain.get(fitted, 0.0))
        floor = 0.0 if s.case is not None else 0.005 * abs(stated)
        ratios[name] = (value / stated, std / abs(stated)) if stated else (math.inf, math.inf)
        beyond = abs(value - stated) - floor
        if beyond > SUSPECT * std:
            wrong.append(name)
            evidence[name] = (beyond / std) ** 2 if std > 0.0 else math.nan
    of_machine = [r for name, r in ratios.items() if not name.startswith('gain.')]
    if len(wrong) > 1 and (gain := _common_gain(s, of_machine)) is not None:
        return [gain]
    return [
        _wrong(
            name,
            *ratios[name],
            f'The stated {name} is not that of the recordings{beside}.',
            evidence[name],
        )
        for name in wrong
    ]


def _wrong(
    name: str, ratio: float, std: float, sentence: str, evidence: float = math.nan
) -> Finding:
    return Finding(
        'wrong_parameter',
        1.0,
        'parameter',
        {
            'name': ParameterEstimate(name, 0.0, 'text'),
            'ratio': ParameterEstimate(ratio, std, '1'),
        },
        sentence=sentence,
        equation=f'{name} x {ratio:.4g}',
        evidence=evidence,
    )


def _common_gain(s: Subject, ratios: Sequence[tuple[float, float]]) -> Finding | None:
    """The gain of the input, where all that is stated is off by one factor; None where it is not.

    A force that is stated too large by a factor makes mass, damping and stiffness too large by it.
    """
    drive = str(s.campaign.bench.get('input', ''))
    if s.campaign.kind is not CampaignKind.DRIVEN or swings_freely(s) or not drive:
        return None
    if not all(0.0 < std < math.inf for _, std in ratios):
        return None
    worths = [1.0 / std**2 for _, std in ratios]
    common = math.fsum(w * r for w, (r, _) in zip(worths, ratios, strict=True)) / math.fsum(worths)
    if common <= 0.0 or any(abs(r - common) > SAME_FACTOR * std for r, std in ratios):
        return None
    controller = s.campaign.bench.get('controller')
    own = isinstance(controller, Mapping) and 'gain' in controller
    name = 'controller.gain' if own else f'gain.{drive}'
    std = 1.0 / math.sqrt(math.fsum(worths)) / common**2
    return _wrong(
        name,
        1.0 / common,
        std,
        f'All that is stated of the machine is off by one factor: the gain by which {drive} is '
        'known is not that of the recordings.',
    )


def _stated(s: Subject) -> Iterator[tuple[str, str, float, float]]:
    """Names in the campaign and in fits, values and uncertainties of what the campaign states."""
    if s.campaign.kind is CampaignKind.CHAIN:
        tolerance = gain_tolerance(s.campaign)
        for term in s.outcome.baseline.terms:
            if term.name == 'wrong_parameter' and tolerance is not None:
                yield 'gain', f'{term.label}.excess', 1.0, tolerance
        return
    first, *others = dict.fromkeys(x.channel for x in s.segments)
    for channel in others:
        tolerance = math.hypot(*(s.campaign.gain_std_of(c) for c in (first, channel)))
        tolerance = tolerance or OF_SENSORS
        yield gain_of(channel), gain_of(channel), 1.0, tolerance
    if swings_freely(s):
        yield from _stated_per_mass(s)
        return
    channels = [s.segments[0].channel, str(s.campaign.bench.get('input', ''))]
    gains = [s.campaign.gain_std_of(c) for c in channels]
    for name, fitted in STATED:
        quantity = s.campaign.sensor.get(name)
        if quantity is not None and quantity.known:
            value = s.outcome.best.values.get(fitted, quantity.value)
            std = math.hypot(quantity.std, *(g * value for g in gains))
            yield name, fitted, quantity.value, std


def _stated_per_mass(s: Subject) -> Iterator[tuple[str, str, float, float]]:
    """The same of a free swing, which tells a number over the mass alone, and by no gain."""
    mass, sensor = mass_of_free_swing(s), s.campaign.sensor
    for name, fitted in STATED:
        quantity = sensor.get(name)
        if mass is None or quantity is None or not quantity.known or not quantity.value:
            continue
        told = sensor.get('moving_mass')
        if fitted == 'stiffness' and (told is None or not told.known):
            continue  # the mass has been taken from it
        value = quantity.value / mass.value
        parts = quantity.std / quantity.value, mass.std / mass.value
        yield name, fitted, value, abs(value) * math.hypot(*parts)
