"""From a search's outcome to the answer that people and files get."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal, stats

from impactscope.discrepancy.answer import (
    Answer,
    Finding,
    FitFigures,
    FitTable,
    Mismatch,
    ParameterEstimate,
    Region,
    Trace,
)
from impactscope.discrepancy.campaign import Campaign
from impactscope.discrepancy.driven.decide import Judge
from impactscope.discrepancy.driven.exact import NoiseJudge
from impactscope.discrepancy.driven.fitting import Fit, numbers_of
from impactscope.discrepancy.driven.located import plate_regions
from impactscope.discrepancy.driven.measuring import filter_of, step_of
from impactscope.discrepancy.driven.modal import Modes
from impactscope.discrepancy.driven.model import Model, Segment
from impactscope.discrepancy.driven.plate import Plate
from impactscope.discrepancy.driven.search import Outcome
from impactscope.discrepancy.driven.strangers import Verdict
from impactscope.discrepancy.driven.terms import Term, key
from impactscope.discrepancy.evidence import (
    family_p_value,
    first_discoveries,
    is_white,
    noise_std,
    probabilities,
    quantisation_step,
)

__all__ = ['Subject', 'describe']

Array = NDArray[np.float64]

WINDOWS = 32  # into which a recording is cut to say where it differs
LARGE = 0.05  # of the channel: what is left beyond this asks for an explanation
REMOVED = 0.5  # of the baseline's residual: what is left below this was mostly explained
STATED = (('stiffness', 'stiffness'), ('moving_mass', 'mass'))  # in campaigns and in fits
STEPS = 25.0  # chi-square of rounding from which steps are named
APART = 0.3  # relative difference of two numbers that is to be excluded
HINT = 4.0  # chi-square a number that makes a richer rival more than a possibility
SUSPECT = 4.0  # standard uncertainties between a stated and a fitted number


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """All that an answer is made from."""

    campaign: Campaign
    model: Model
    segments: Sequence[Segment]
    judge: Judge
    outcome: Outcome
    modes: Modes | None
    notes: tuple[str, ...]
    plate: Plate | None = None  # where the residual is noise
    verdict: Verdict | None = None  # on what the vocabulary lacks, there


def describe(s: Subject) -> Answer:
    """The answer to a campaign."""
    base = s.outcome.baseline
    final = s.modes.fit if s.modes is not None else s.outcome.best
    new = () if s.modes is not None else _new_terms(s)
    findings = [_modal_finding(s)] if s.modes is not None else _findings(s, new)
    accepted = ['further_modes'] if s.modes is not None else [t.name for t in new]
    steps = _quantisation(s, final)
    findings[len(accepted) : len(accepted)] = steps
    accepted += [f.name for f in steps]
    wrong = _wrong_parameters(s, final)
    findings[len(accepted) : len(accepted)] = wrong
    accepted += [f.name for f in wrong]
    unexplained, sentence = _left(s, base, final)
    if s.verdict is not None and s.verdict.left:
        unknown = _unknown(s.verdict)
        if s.verdict.instead:
            findings.insert(0, unknown)
            accepted = ['unknown', *(f.name for f in (*steps, *wrong))]
            named = set(accepted)
            findings = [f for f in findings if f.name in named] + [
                f for f in findings if f.name not in named
            ]
        else:
            findings.insert(len(accepted), unknown)
            accepted.append('unknown')
    elif unexplained and not accepted:
        findings.insert(0, Finding('unknown', 1.0, 'unknown', sentence=sentence))
        accepted = ['unknown']
    detected = bool(accepted)
    taken = findings[: len(accepted)]
    subsystems = tuple(dict.fromkeys(f.subsystem for f in taken if f.subsystem))
    tests = tuple(dict.fromkeys(_tests(s, new, taken)))
    units = {k: n.unit for k, n in numbers_of(s.model, s.outcome.best.terms)}
    return Answer(
        campaign=s.campaign.name,
        kind=s.campaign.kind.value,
        mismatch=Mismatch(
            detected,
            _p_value(s, final),
            _places(s, base, final) if detected else (),
            subsystems,
        ),
        accepted=tuple(accepted),
        ranking=tuple(findings),
        fit=_table(s, base, final),
        unexplained=unexplained,
        unexplained_description=sentence if unexplained else '',
        next_tests=tests,
        baseline=s.campaign.baseline_names,
        baseline_parameters=_estimates(base, units),
        extended_parameters=_estimates(s.outcome.best if s.modes is None else base, units),
        model=_saved(s, new, wrong),
        notes=(*s.notes, *(() if unexplained or not sentence else (sentence,))),
        traces=_traces(s, base, final),
    )


def _new_terms(s: Subject) -> tuple[Term, ...]:
    given = {t.label for t in s.outcome.baseline.terms}
    return tuple(t for t in s.outcome.best.terms if t.label not in given)


def _estimates(made: Fit, units: Mapping[str, str]) -> dict[str, ParameterEstimate]:
    return {
        name: ParameterEstimate(value, made.std.get(name, math.nan), units.get(name, ''))
        for name, value in made.values.items()
    }


def _unknown(verdict: Verdict) -> Finding:
    """What is not in the vocabulary, by the law that it resembles most."""
    stranger = verdict.strongest
    return Finding(
        'unknown',
        verdict.probability,
        'unknown',
        sentence=(
            f'Something is missing that is not in the library; it goes like {stranger.law}.'
        ),
        source='laws beyond the library, each acting as a small force on the fitted plate',
        evidence=stranger.gain,
    )


# --- findings ------------------------------------------------------------------------------------


def _findings(s: Subject, new: Sequence[Term]) -> list[Finding]:
    """Accepted terms first, then what else was tried, by probability."""
    fits = [s.outcome.best, *s.outcome.rivals]
    for made in fits:
        s.judge.weights(made)
    if s.plate is not None:
        fits = _one_form_each(s, fits)
    weight = probabilities([s.judge.criterion(f, s.outcome.baseline) for f in fits])
    given = {t.name for t in s.outcome.baseline.terms}
    best = {t.name for t in s.outcome.best.terms}
    share: dict[str, float] = {}
    source: dict[str, tuple[Term, Fit, float]] = {}
    for made, p in zip(fits, weight, strict=True):
        for term in made.terms:
            if term.name in given:
                continue
            share[term.name] = share.get(term.name, 0.0) + p
            if term.name not in source or p > source[term.name][2]:
                source[term.name] = term, made, p
    found = []
    if s.verdict is not None:
        share = {n: p * (1.0 - s.verdict.probability) for n, p in share.items()}
    for term in new:
        rivals = _confused(s, term.name, best, fits, weight)
        found.append(_finding(s, term, s.outcome.best, share[term.name], rivals))
    others = sorted((n for n in share if n not in best), key=lambda n: -share[n])
    for name in others[:8]:
        term, made, _ = source[name]
        found.append(_finding(s, term, made, share[name], ()))
    return found


def _one_form_each(s: Subject, fits: Sequence[Fit]) -> list[Fit]:
    """Of every set of effects the best form alone; the chosen fit first."""
    ordered = sorted(fits[1:], key=lambda f: s.judge.criterion(f, s.outcome.baseline))
    found = {frozenset(t.name for t in fits[0].terms): fits[0]}
    for made in ordered:
        found.setdefault(frozenset(t.name for t in made.terms), made)
    return list(found.values())


def _confused(
    s: Subject, name: str, best: set[str], fits: Sequence[Fit], weight: Sequence[float]
) -> tuple[str, ...]:
    """Effects that stand in for one in models that are not excluded and need no more numbers."""
    top = weight[0]
    found: list[str] = []
    for made, p in zip(fits, weight, strict=True):
        names = {t.name for t in made.terms}
        extra = made.added - s.outcome.best.added
        if name in names or (extra > 0 and s.plate is None):
            continue
        if extra > 0 and not _open(s, made):
            continue
        if extra <= 0 and p < s.judge.thresholds.confusable * top:
            continue
        found += [t.name for t in made.terms if t.name not in best]
    return tuple(dict.fromkeys(found))


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
    value, std = made.values, made.std
    if 'asymmetric_friction.force_forward' in value:
        ways = ('asymmetric_friction.force_forward', 'asymmetric_friction.force_backward')
        scatter = math.hypot(*(std[w] for w in ways))
        apart = abs(value[ways[0]] - value[ways[1]]) + 2.0 * scatter
        return apart > APART * (value[ways[0]] + value[ways[1]])
    if 'stribeck_friction.excess_force' in value:
        excess, kinetic = 'stribeck_friction.excess_force', 'stribeck_friction.kinetic_force'
        return value[excess] + 2.0 * std[excess] > value[kinetic]
    return False


def _finding(
    s: Subject, term: Term, made: Fit, probability: float, rivals: tuple[str, ...]
) -> Finding:
    rest = [
        f
        for f in (s.outcome.baseline, s.outcome.best, *s.outcome.rivals)
        if {t.label for t in f.terms} == {t.label for t in made.terms} - {term.label}
    ]
    gain = s.judge.gain(rest[0] if rest else s.outcome.baseline, made)
    return Finding(
        name=term.name,
        probability=min(probability, 1.0),
        subsystem='parameter' if term.name == 'wrong_parameter' else term.subsystem,
        parameters=_parameters(term, made),
        confused_with=rivals,
        channel=term.channel,
        sentence=term.sentence,
        equation=term.equation,
        source=term.source,
        evidence=gain.fitted,
        held_out_gain=gain.held_out if s.judge.has_held_out else math.nan,
    )


def _parameters(term: Term, made: Fit) -> dict[str, ParameterEstimate]:
    found = {
        n.name: ParameterEstimate(
            made.values[key(term, n)], made.std.get(key(term, n), math.nan), n.unit
        )
        for n in term.numbers
    }
    if term.name == 'restoring_force' and 'stiffness' in made.values:
        std = made.std.get('stiffness', math.nan)
        found['stiffness'] = ParameterEstimate(made.values['stiffness'], std, '1/s^2')
    if term.name == 'low_pass_filter':
        order, both = filter_of(term)
        found['order'] = ParameterEstimate(float(order), 0.0, '1')
        found['zero_phase'] = ParameterEstimate(float(both), 0.0, 'bool')
    if term.name == 'wrong_parameter':
        found['name'] = ParameterEstimate('gain', 0.0, 'text')
    if term.name == 'mains_hum':
        size = math.hypot(found['sine'].value, found['cosine'].value)  # type: ignore[arg-type]
        std = math.hypot(found['sine'].std, found['cosine'].std) / math.sqrt(2.0)
        found['amplitude'] = ParameterEstimate(size, std, found['sine'].unit)
    if term.name == 'stribeck_friction':
        kinetic, excess = found['kinetic_force'], found.pop('excess_force')
        value = float(kinetic.value) + float(excess.value)
        std = math.hypot(kinetic.std, excess.std)
        found['static_force'] = ParameterEstimate(value, std, kinetic.unit)
    return found


def _modal_finding(s: Subject) -> Finding:
    assert s.modes is not None  # noqa: S101 - called only then
    parameters = {}
    rows = zip(s.modes.frequencies, s.modes.damping_ratios, s.modes.std, strict=True)
    for k, (frequency, ratio, (f_std, r_std)) in enumerate(rows, 1):
        parameters[f'frequency_{k}'] = ParameterEstimate(frequency, f_std, 'Hz')
        parameters[f'damping_ratio_{k}'] = ParameterEstimate(ratio, r_std, '1')
    gain = s.judge.gain(s.outcome.baseline, s.modes.fit)
    count = len(s.modes.frequencies)
    return Finding(
        'further_modes',
        1.0,
        'fixture',
        parameters,
        sentence=(
            f'The structure is linear and has more modes than the simulation: {count} are seen. '
            'No nonlinear effect on one mode explains as much.'
        ),
        equation='sum over modes of (b0 + b1 s) / (s^2 + 2 zeta w s + w^2)',
        source='Ewins, Modal Testing (2000), ch. 2',
        evidence=gain.fitted,
        held_out_gain=gain.held_out if s.judge.has_held_out else math.nan,
    )


def _quantisation(s: Subject, final: Fit) -> list[Finding]:
    """Coarse steps of a channel, where they are what is left, in a chain that asks for it."""
    if s.plate is not None:
        return _plate_steps(s)
    if s.campaign.kind.value != 'chain':
        return []
    for segment, residual in zip(s.segments, final.residuals, strict=True):
        step = quantisation_step(segment.measured)
        spread = float(np.std(residual))
        own = quantisation_step(segment.drive) if segment.drive.ndim == 1 else 0.0
        if step <= 0.0 or abs(own - step) < 1e-3 * step or spread > step:
            continue
        if step / math.sqrt(12.0) > 0.5 * spread:
            return [_steps(segment, step)]
    return []


def _plate_steps(s: Subject) -> list[Finding]:
    """Steps of a channel whose noise is known, where they add to it beyond doubt."""
    step, gain = _rounding(s)
    return [_steps(s.segments[0], step)] if gain > STEPS else []


def _rounding(s: Subject) -> tuple[float, float]:
    """Step of the output channel, and the chi-square of rounding to it; zeros without steps."""
    fitted = [x.measured for x in s.segments if not x.held_out]
    steps = [step_of(x) for x in fitted]
    if s.plate is None or min(steps) <= 0.0 or max(steps) > 1.01 * min(steps):
        return 0.0, 0.0
    share = min(steps) ** 2 / 12.0 / s.plate.noise**2
    return min(steps), share * sum(x.size for x in fitted)


def _steps(segment: Segment, step: float) -> Finding:
    return Finding(
        'quantisation',
        1.0,
        'measurement',
        {'step': ParameterEstimate(step, 1e-3 * step, segment.unit)},
        channel=segment.channel,
        sentence='The channel has coarse steps.',
        equation='round to multiples of the step',
        source='Widrow and Kollar, Quantization Noise (2008)',
    )


def _wrong_parameters(s: Subject, final: Fit) -> list[Finding]:
    """Numbers that the campaign states and the recordings contradict."""
    found = []
    values = s.outcome.best.values if s.modes is None else {}
    channels = [s.segments[0].channel, str(s.campaign.bench.get('input', ''))]
    for stated, fitted in STATED:
        quantity = s.campaign.sensor.get(stated)
        if quantity is None or not quantity.known or fitted not in values:
            continue
        value = values[fitted]
        gains = [s.campaign.gain_std_of(c) for c in channels]
        std = math.hypot(
            quantity.std, s.outcome.best.std.get(fitted, 0.0), *(g * value for g in gains)
        )
        off = value - quantity.value
        floor = 0.0 if s.plate is not None else 0.005 * abs(quantity.value)
        if abs(off) > SUSPECT * std + floor:
            ratio = values[fitted] / quantity.value
            found.append(
                Finding(
                    'wrong_parameter',
                    1.0,
                    'parameter',
                    {
                        'name': ParameterEstimate(stated, 0.0, 'text'),
                        'ratio': ParameterEstimate(ratio, std / abs(quantity.value), '1'),
                    },
                    sentence=f'The stated {stated} is not that of the recordings.',
                    equation=f'{stated} x {ratio:.4g}',
                )
            )
    del final
    return found


# --- where and how much --------------------------------------------------------------------------


def _p_value(s: Subject, final: Fit) -> float:
    if isinstance(s.judge, NoiseJudge):
        tried = [final] if final is not s.outcome.baseline else list(s.outcome.rivals)
        chances = [s.judge.p_value(s.outcome.baseline, f) for f in tried]
        if s.verdict is not None and s.verdict.left:
            chances.append(s.verdict.strongest.p_value)
        step, gain_of_steps = _rounding(s)
        if step > 0.0 and gain_of_steps > STEPS:
            chances.append(family_p_value(gain_of_steps, 1, s.judge.looks))
        return min(chances, default=1.0)
    gain = s.judge.gain(s.outcome.baseline, final)
    if final is s.outcome.baseline:
        gains = [s.judge.gain(final, f) for f in s.outcome.rivals if f.added > final.added]
        best = max(gains, key=lambda g: g.fitted - 2 * g.numbers, default=None)
        if best is None:
            return 1.0
        gain = best
    return family_p_value(max(gain.fitted, 0.0), max(gain.numbers, 1), s.judge.looks)


def _floor(segment: Segment, residual: Array) -> float:
    return segment.noise if math.isfinite(segment.noise) else noise_std(residual)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _left(s: Subject, base: Fit, final: Fit) -> tuple[bool, str]:
    """Whether what is left asks for an explanation, and a sentence on it."""
    if s.verdict is not None:
        return s.verdict.left, _unknown(s.verdict).sentence if s.verdict.left else ''
    worst: tuple[float, bool, str] = (0.0, False, '')
    for i, segment in enumerate(s.segments):
        residual = final.residuals[i]
        left, size, before = _rms(residual), _rms(segment.measured), _rms(base.residuals[i])
        noise = _floor(segment, residual)
        ratio = left / noise if noise > 0.0 else math.inf
        if left <= 1e-7 * size or ratio**2 <= s.judge.thresholds.unexplained_ratio:
            continue
        if is_white(residual):
            continue
        stated = math.isfinite(segment.noise)
        asks = (stated or left > LARGE * size) and left > REMOVED * before
        low, high = _band(residual, segment.period)
        text = (
            f'{segment.recording}: {left:.3g} {segment.unit} rms of {segment.channel} is left '
            f'({left / size:.2g} of the signal, {ratio:.3g} times the noise), mostly from '
            f'{low:.3g} to {high:.3g} Hz.'
        )
        if (asks, left / size) > (worst[1], worst[0]):
            worst = left / size, asks, text
    return worst[1], worst[2]


def _band(residual: Array, period: float) -> tuple[float, float]:
    """Band with the middle 80 % of a residual's power, Hz."""
    length = min(residual.size, 8192)
    frequency, power = signal.welch(residual, 1.0 / period, nperseg=length, detrend=False)
    share = np.cumsum(power)
    low, high = np.interp([0.1 * share[-1], 0.9 * share[-1]], share, frequency)
    return float(low), float(high)


def _places(s: Subject, base: Fit, final: Fit) -> tuple[Region, ...]:
    """Where the baseline differs from the recordings."""
    if s.plate is None:
        return _regions(s, base, final)
    column = None
    if s.verdict is not None and s.verdict.left:
        column = s.verdict.strongest.column
        final = base if s.verdict.instead else final
    rate = s.judge.thresholds.false_region
    found = plate_regions(s.model, base, final, column, s.segments, s.plate.forces, rate)
    if _rounding(s)[1] > STEPS:
        found += tuple(_throughout(x) for x in s.segments)
    return found


def _throughout(segment: Segment) -> Region:
    """A recording from end to end."""
    return Region(
        segment.recording, segment.channel, segment.begin, float(segment.time[-1]), 'before'
    )


def _regions(s: Subject, base: Fit, final: Fit) -> tuple[Region, ...]:
    """Intervals in which the baseline's residual exceeds what the extended model leaves."""
    rows = []
    for i, segment in enumerate(s.segments):
        edges = np.linspace(0, segment.measured.size, WINDOWS + 1).astype(int)
        floor = max(_rms(final.residuals[i]), 1e-9 * _rms(segment.measured), 1e-300)
        counts = max(s.judge.weights(final)[i] / WINDOWS, 1.0)
        for a, b in itertools.pairwise(edges):
            ratio = _rms(base.residuals[i][a:b]) / floor
            p = float(stats.chi2.sf(counts * ratio**2, counts))
            rows.append((i, int(a), int(b), p))
    hits = first_discoveries([r[3] for r in rows], s.judge.thresholds.false_region)
    if not np.any(hits):  # the strongest windows, so that an answer says where to look
        order = np.argsort([r[3] for r in rows])
        hits[order[: max(1, len(rows) // 16)]] = True
    runs: list[list[tuple[int, int, int, float]]] = []
    for row, hit in zip(rows, hits, strict=True):
        if not hit:
            continue
        if runs and runs[-1][-1][0] == row[0] and runs[-1][-1][2] == row[1]:
            runs[-1].append(row)
        else:
            runs.append([row])
    regions = []
    for run in runs:
        i, a, b = run[0][0], run[0][1], run[-1][2]
        segment = s.segments[i]
        part = base.residuals[i][a:b]
        regions.append(
            Region(
                segment.recording,
                segment.channel,
                segment.begin + a * segment.period,
                segment.begin + b * segment.period,
                '',
                _band(part, segment.period) if part.size >= 16 else None,
                min(r[3] for r in run),
                _rms(part) / max(_rms(final.residuals[i]), 1e-300),
            )
        )
    return tuple(sorted(regions, key=lambda r: -r.ratio))


def _table(s: Subject, base: Fit, final: Fit) -> FitTable:
    floor: dict[str, float] = {}
    for i, segment in enumerate(s.segments):
        value = _floor(segment, final.residuals[i])
        floor[segment.channel] = min(value, floor.get(segment.channel, math.inf))
    return FitTable(_figures(s, base, floor), _figures(s, final, floor), floor)


def _figures(s: Subject, made: Fit, floor: Mapping[str, float]) -> FitFigures:
    def rmse(held_out: bool) -> dict[str, float]:
        found = {}
        for channel in dict.fromkeys(x.channel for x in s.segments):
            parts = [
                made.residuals[i]
                for i, x in enumerate(s.segments)
                if x.channel == channel and x.held_out == held_out
            ]
            if parts:
                found[channel] = _rms(np.concatenate(parts))
        return found

    def reduced(values: Mapping[str, float]) -> float:
        ratios = [(v / floor[c]) ** 2 for c, v in values.items() if floor[c] > 0.0]
        return float(np.mean(ratios)) if ratios else math.nan

    fitted, held_out = rmse(False), rmse(True)
    return FitFigures(fitted, held_out, reduced(fitted), reduced(held_out))


def _traces(s: Subject, base: Fit, final: Fit) -> tuple[Trace, ...]:
    found = []
    best = s.outcome.best
    for i, segment in enumerate(s.segments):
        x = v = np.zeros(0)
        if best.starts:  # none where the model is a sum of modes
            x, v = s.model.motion(best.values, best.terms, best.starts[i], segment)
        found.append(
            Trace(
                segment.recording,
                segment.channel,
                segment.unit,
                segment.held_out,
                _floor(segment, final.residuals[i]),
                segment.time,
                segment.measured,
                segment.measured - base.residuals[i],
                segment.measured - final.residuals[i],
                np.asarray(x),
                np.asarray(v),
            )
        )
    return tuple(found)


def _tests(s: Subject, new: Sequence[Term], taken: Sequence[Finding]) -> list[str]:
    tests = []
    if not s.judge.has_held_out:
        tests.append('a recording of another strength that is held out: it would test the answer')
    rivals = {name for f in taken for name in f.confused_with}
    for term in (*new, *s.model.terms):
        if term in new and not any(f.confused_with for f in taken if f.name == term.name):
            continue
        if term not in new and term.name not in rivals:
            continue
        tests.append(f'{term.name}: {term.test}')
    return tests


def _saved(s: Subject, new: Sequence[Term], corrected: Sequence[Finding]) -> dict[str, Any]:
    """The extended model as the baseline of a next search."""
    items: list[Any] = [
        {'name': item.name, 'values': dict(item.values)} if item.values else item.name
        for item in s.campaign.baseline
    ]
    best = s.outcome.best
    for term in new:
        values = {n.name: best.values[key(term, n)] for n in term.numbers}
        items.append({'name': term.name, 'values': values} if values else term.name)
    saved: dict[str, Any] = {'baseline': items, 'values': dict(best.values)}
    wrong = {str(f.parameters['name'].value) for f in corrected}
    saved['corrected'] = {name: best.values[fitted] for name, fitted in STATED if name in wrong}
    saved['sensor'] = {
        stated: {'value': best.values[fitted], 'std': best.std.get(fitted, 0.0)}
        for stated, fitted in STATED
        if stated in wrong
    }
    if s.modes is not None:
        saved['modes'] = len(s.modes.frequencies)
        saved['frequencies'] = list(s.modes.frequencies)
        saved['damping_ratios'] = list(s.modes.damping_ratios)
    return saved
