"""From the search on an impact campaign to an answer that a person can read."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

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
from impactscope.discrepancy.evidence import Thresholds, probabilities
from impactscope.discrepancy.impact_adequacy import TESTED, Adequacy, adequacy, law_instead
from impactscope.discrepancy.impact_baseline import baseline_model
from impactscope.discrepancy.impact_candidates import Candidate
from impactscope.discrepancy.impact_data import CampaignData, prepare
from impactscope.discrepancy.impact_fit import Fit
from impactscope.discrepancy.impact_follow import fit_baseline, held_out_fit, prediction_misfit
from impactscope.discrepancy.impact_search import Found, Outcome, Search
from impactscope.discrepancy.locate import Phase, Strip, locate, phases
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism
from impactscope.physics.twin import layout as at

__all__ = ['explain_impact']

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

_VISIBLE_STEP = 0.15  # of the noise, from which the converter's steps are coarse
_STATED_TESTS = 4
_AS_GOOD = 0.985  # of the evidence, of an explanation that is as good
_NOT_MET = 100.0  # reduced chi-square of a blow that no start has met
_WEAK = 2.0  # reduced chi-square of a baseline up to which a missing effect is a weak one

_UNITS = {
    'stiffness': 'N/m',
    'moving_mass': 'kg',
    'damping_ratio': '1',
    'damping': 'N s/m',
    'parallel_stiffness': 'N/m',
    'restitution': '1',
    'exponent': '1',
    'rod_mass': 'kg',
    'rod_length': 'm',
    'contact_distance': 'm',
    'mass_distance': 'm',
    'angle': 'deg',
    'time': 's',
    'tap_peak': 'N',
    'tap_duration': 's',
    'impactor_mass': 'kg',
    'speed': 'm/s',
}


def explain_impact(campaign: Campaign, progress: Progress) -> Answer:
    """The answer for a campaign of blows on the bench; see :func:`explain`."""
    thresholds = Thresholds()
    progress(0.0, 'recordings')
    data = prepare(campaign)
    model = baseline_model(campaign, data)
    progress(0.02, 'baseline')
    baseline = fit_baseline(model)
    search = Search(campaign.baseline_names, thresholds, progress)
    outcome = search.run(baseline)
    progress(0.9, 'held-out recordings')
    search.check(outcome)
    progress(0.95, 'regions')
    return _answer(campaign, data, outcome, thresholds)


def _answer(
    campaign: Campaign, data: CampaignData, outcome: Outcome, thresholds: Thresholds
) -> Answer:
    direct = _direct_findings(data)
    accepted = list(outcome.accepted)
    unexplained, description = _unexplained(outcome, thresholds)
    traces, strips = _pictures(outcome)
    findings = _ranking(outcome, accepted)
    found = [_label(c) for c in accepted] + [f.name for f in direct]
    if unexplained:
        kept = _share_of_known(outcome, thresholds)
        findings = [_weaker(f, kept) for f in findings]
        resembles = ', '.join(dict.fromkeys(f.name for f in findings[:1]))
        if resembles:
            description += f' Of what is known here it most resembles {resembles}.'
        found = [f.name for f in direct]
        findings.insert(
            0,
            Finding(
                'unknown', 1 - kept, 'unknown', sentence='Something is missing that is not known.'
            ),
        )
        found.append('unknown')
    ranking = [*direct, *findings]
    detected = bool(found)
    regions = locate(strips, thresholds.false_region) if detected else ()
    regions = (*_clipped_regions(data), *regions)
    subsystems = dict.fromkeys(f.subsystem for name in found for f in ranking if f.name == name)
    p_value = min(outcome.p_value, 0.0 if direct else 1.0)
    if unexplained and outcome.tests is not None:
        p_value = min(p_value, outcome.tests.p_value)
    return Answer(
        campaign=campaign.name,
        kind=campaign.kind.value,
        mismatch=Mismatch(detected, p_value, regions, tuple(subsystems)),
        accepted=tuple(found),
        ranking=tuple(ranking),
        fit=_table(data, outcome),
        unexplained=unexplained,
        unexplained_description=description if unexplained else '',
        next_tests=_next_tests(ranking, found, campaign),
        baseline=campaign.baseline_names,
        baseline_parameters=_parameters(outcome.baseline),
        extended_parameters=_parameters(outcome.final),
        model=_saved(campaign, outcome, accepted),
        notes=(*campaign.notes, *data.notes, *outcome.notes),
        traces=traces,
    )


# --- decisions -----------------------------------------------------------------------------------


def _unexplained(outcome: Outcome, thresholds: Thresholds) -> tuple[bool, str]:
    """Whether something is left that nothing explains, and how it behaves."""
    final = outcome.final
    ratio = final.reduced
    held = outcome.held_out_final
    tests = outcome.tests = outcome.tests or adequacy(final)
    allowed = thresholds.unexplained_ratio * max(1.0, ratio)
    missed = (
        held is not None
        and held.reduced > allowed  # quick to see, and never less than what follows
        and prediction_misfit(final, held) > allowed
        and _missed_early(outcome, allowed)
    )
    if ratio <= thresholds.unexplained_ratio:
        if tests.p_value < thresholds.inadequate:
            return True, (
                'Something is missing that no known mechanism explains: what is left is as small '
                f'as the noise, but not of its kind ({tests.worst}; by chance in '
                f'{tests.p_value:.1g} of campaigns).'
            )
        instead, law = _law_instead(outcome)
        if instead < thresholds.inadequate:
            outcome.tests = Adequacy({**tests.p_values, 'laws': instead}, tests.excess, law)
            return True, (
                f'Something is missing that no known mechanism explains: {law} explains the '
                'recordings better than anything that is known here.'
            )
        if held is None or not missed:
            return False, ''
        return True, (
            'Something is missing that no known mechanism explains: held-out recordings are '
            f'missed by {math.sqrt(held.reduced):.3g} times the noise.'
        )
    parts = []
    for (i, name), span in final.layout.spans.items():
        residual = final.residuals[span]
        if residual.size:
            share = math.sqrt(float(residual @ residual) / residual.size)
            parts.append((share, f'{name} of {final.model.data.blows[i].name}'))
    parts.sort(reverse=True)
    where = parts[0][1] if parts else 'the recordings'
    return True, (
        'Something is missing that no known mechanism explains: with the best of them the '
        f'residual is still {math.sqrt(ratio):.3g} times the noise, most of all in {where} '
        f'({parts[0][0]:.3g} times).'
    )


def _law_instead(outcome: Outcome) -> tuple[float, str]:
    """Chance of a law that is ahead of the findings, see :func:`law_instead`; and its name."""
    tunable = outcome.accepted and all(c.free for c in outcome.accepted)
    if not tunable or outcome.baseline.reduced > _WEAK:
        return 1.0, ''
    cost = sum(c.cost for c in outcome.accepted)
    return law_instead(outcome.baseline, outcome.final, cost)


def _missed_early(outcome: Outcome, allowed: float) -> bool:
    """Whether a prediction is missed before many bounces have amplified what is small.

    A blow that is missed by far from its first contact on was not met by any start: that tells
    nothing of the model where the fitted recordings leave only noise.
    """
    final = outcome.final
    held = held_out_fit(final, final.model.data.held_out, TESTED)
    if held is not None and held.reduced > _NOT_MET and final.reduced < _WEAK:
        outcome.notes.append(
            'A held-out recording could not be met from its first contact on; its prediction '
            'says nothing. Is it labelled rightly?'
        )
        return False
    return held is not None and prediction_misfit(final, held) > allowed


def _direct_findings(data: CampaignData) -> list[Finding]:
    """Effects of the chain that are seen in the samples themselves."""
    found = {}
    for blow in data.blows:
        for name, channel in blow.channels.items():
            kind, value = '', 0.0
            if math.isfinite(channel.clipped_at):
                kind, value = 'saturation', channel.clipped_at
            elif channel.step > _VISIBLE_STEP * channel.noise:
                kind, value = 'quantisation', channel.step
            if kind and (kind, name) not in found:
                effect = mechanism(kind)
                parameter = effect.parameters[0].name
                std = channel.noise if kind == 'saturation' else 1e-3 * value
                found[kind, name] = Finding(
                    kind,
                    0.99,
                    effect.subsystem.value,
                    {parameter: ParameterEstimate(value, std, channel.unit)},
                    channel=name,
                    sentence=effect.sentence,
                    equation=effect.equation,
                    source=effect.source,
                )
    return list(found.values())


def _clipped_regions(data: CampaignData) -> list[Region]:
    """Stretches in which a channel is cut off."""
    regions = []
    for blow in data.blows:
        for name, channel in blow.channels.items():
            if not math.isfinite(channel.clipped_at):
                continue
            hit = np.abs(channel.samples) >= channel.clipped_at * (1 - 1e-6)
            times = channel.time[hit]
            parts = np.split(times, np.flatnonzero(np.diff(times) > 5e-3) + 1)
            regions += [
                Region(blow.name, name, float(part[0]), float(part[-1]), 'peak') for part in parts
            ]
    return regions


# --- ranking -------------------------------------------------------------------------------------


def _label(candidate: Candidate) -> str:
    return candidate.name


def _share_of_known(outcome: Outcome, thresholds: Thresholds) -> float:
    """Probability that a known mechanism explains after all what a test calls unexplained."""
    if outcome.final.reduced > thresholds.unexplained_ratio:
        return 0.1
    chance = 1.0 if outcome.tests is None else outcome.tests.p_value
    return 0.02 + 0.28 * min(1.0, chance / thresholds.inadequate)


def _listed(gain: float) -> float:
    """Probability that the truth is among what is known here, for a finding of that evidence.

    A weak effect that nobody has listed looks like one that is.
    """
    return 0.97 - 0.2 * math.exp(-max(gain, 0.0) / 60.0)


def _weaker(finding: Finding, share: float) -> Finding:
    return Finding(
        finding.name,
        finding.probability * share,
        finding.subsystem,
        finding.parameters,
        finding.confused_with,
        finding.channel,
        finding.recording,
        finding.sentence,
        finding.equation,
        finding.source,
        finding.evidence,
        finding.held_out_gain,
    )


def _ranking(outcome: Outcome, accepted: Sequence[Candidate]) -> list[Finding]:
    """Every explanation that was fitted, with its probability among those that exclude it."""
    thresholds = Thresholds()
    ranked: list[Finding] = []
    seen: set[str] = {c.label for c in accepted}
    held = math.nan
    if outcome.held_out_baseline is not None and outcome.held_out_final is not None:
        held = outcome.held_out_baseline.chi_square - outcome.held_out_final.chi_square
    later: list[Finding] = []
    for candidate in accepted:
        mine = outcome.found[candidate.label]
        rivals = outcome.rivals.get(candidate.label, [])
        shares = probabilities([0.0, mine.criterion, *(r.criterion for r in rivals)])
        listed = _listed(mine.gain)
        own, others = listed * shares[1], [listed * share for share in shares[2:]]
        confused: dict[str, float] = {}
        for rival, share in zip(rivals, others, strict=True):
            name = rival.candidate.name
            if name == candidate.name and rival.candidate.channel == candidate.channel:
                own += share if name != 'wrong_parameter' else 0.0
            elif share > thresholds.confusable * own or _nests(rival, mine) or _kin(rival, mine):
                confused[name] = max(confused.get(name, 0.0), share)
        finding = _finding(candidate, outcome.final, own, tuple(confused), mine, held)
        ranked.append(_among_orders(finding, mine, rivals))
        for rival, share in zip(rivals, others, strict=True):
            if rival.candidate.label in seen or rival.candidate.name == candidate.name:
                continue
            seen.add(rival.candidate.label)
            later.append(
                _finding(rival.candidate, rival.fit, share, (candidate.name,), rival, math.nan)
            )
    if not accepted:
        shares = probabilities([0.0, *(f.criterion for f in outcome.last)])[1:]
        later += [
            _finding(f.candidate, f.fit, share, (), f, math.nan)
            for f, share in zip(outcome.last, shares, strict=True)
        ]
    later.sort(key=lambda f: -f.probability)
    return [*ranked, *later]


def _among_orders(finding: Finding, mine: Found, rivals: Sequence[Found]) -> Finding:
    """A filter's cut-off with the uncertainty of its order, where the data leave that open."""
    same = [
        r
        for r in rivals
        if finding.name == 'low_pass_filter' == r.candidate.name
        and finding.channel == r.candidate.channel
    ]
    if not same:
        return finding
    key = f'low_pass_filter:{finding.channel}.cutoff'
    shares = probabilities([f.criterion for f in (mine, *same)])
    stated = finding.parameters['cutoff']
    cutoffs = [float(stated.value), *(r.fit.values[key] for r in same)]
    spread = sum(p * (f - cutoffs[0]) ** 2 for p, f in zip(shares, cutoffs, strict=True))
    cutoff = ParameterEstimate(stated.value, math.hypot(stated.std, math.sqrt(spread)), 'Hz')
    return dataclasses.replace(finding, parameters={**finding.parameters, 'cutoff': cutoff})


def _nests(rival: Found, mine: Found) -> bool:
    """Whether a rival fits as well and only costs more numbers: the data cannot tell them."""
    return rival.candidate.cost > mine.candidate.cost and rival.gain > mine.gain - 3.0


def _kin(rival: Found, mine: Found) -> bool:
    """Whether a filter explains what a delay does to within what simulations agree, or vice versa.

    Which of the two it is hangs on the finest detail of the fastest samples.
    """
    one, other = mine.candidate, rival.candidate
    if not one.channel or one.channel != other.channel:
        return False
    related = one.name in all_mechanisms() and other.name in mechanism(one.name).kin
    return related and rival.gain > _AS_GOOD * mine.gain


def _finding(
    candidate: Candidate,
    fitted: Fit,
    probability: float,
    confused: tuple[str, ...],
    found: Found,
    held_out_gain: float,
) -> Finding:
    if candidate.name == 'wrong_parameter':
        sentence, equation, source = _wrong_sentence(candidate, fitted)
    else:
        effect = mechanism(candidate.name)
        sentence, equation, source = effect.sentence, effect.equation, effect.source
    return Finding(
        name=candidate.name,
        probability=probability,
        subsystem=candidate.subsystem,
        parameters=_estimates(candidate, fitted),
        confused_with=confused,
        channel=candidate.channel,
        recording=candidate.recording,
        sentence=sentence,
        equation=equation,
        source=source,
        evidence=found.gain,
        held_out_gain=held_out_gain,
    )


def _stated(candidate: Candidate) -> float:
    """Value of the baseline for a number that is wrong."""
    number = candidate.free[0]
    if candidate.amplitudes:
        return float(candidate.amplitudes[number.key])
    return number.start


def _wrong_sentence(candidate: Candidate, fitted: Fit) -> tuple[str, str, str]:
    key = candidate.parameter.split('@')[0]
    where = f' of {candidate.recording}' if candidate.recording else ''
    if not candidate.free:
        text = f'The {key} stated for the bench is wrong: the recordings fit the other one.'
        return text, '', ''
    value, stated = fitted.values[candidate.free[0].key], _stated(candidate)
    text = (
        f'No physics is missing: {key}{where} is stated as {stated:.5g}, the recordings say '
        f'{value:.5g}.'
    )
    return text, '', ''


def _estimates(candidate: Candidate, fitted: Fit) -> dict[str, ParameterEstimate]:
    if candidate.name == 'wrong_parameter':
        key = candidate.parameter.split('@')[0]
        name = key.rsplit('.', 1)[-1] if not key.startswith('gain') else key
        name = {'angle': 'release_angle_deg'}.get(name, name)
        result = {'name': ParameterEstimate(name, math.nan, 'text')}
        if candidate.free:
            stated = _stated(candidate)
            value = fitted.values[candidate.free[0].key]
            std = fitted.std(candidate.free[0].key)
            result['ratio'] = ParameterEstimate(value / stated, std / abs(stated), '1')
            result['value'] = ParameterEstimate(value, std, _unit(candidate.parameter))
        return result
    values = fitted.values
    result = {}
    for parameter in mechanism(candidate.name).parameters:
        key = f'{candidate.effects[0].tag}.{parameter.name}'
        if key not in values:
            continue
        unit = _channel_unit(parameter.unit, candidate.channel, fitted)
        result[parameter.name] = ParameterEstimate(values[key], fitted.std(key), unit)
    if candidate.name == 'mains_hum':
        tag = candidate.effects[0].tag
        blows = fitted.model.data.fitted
        size = [math.hypot(values[f'{tag}.sine@{i}'], values[f'{tag}.cosine@{i}']) for i in blows]
        std = math.sqrt(sum(fitted.std(f'{tag}.sine@{i}') ** 2 for i in blows)) / len(blows)
        unit = result['amplitude'].unit
        result['amplitude'] = ParameterEstimate(float(np.mean(size)), std, unit)
        result.pop('phase', None)
    return result


def _channel_unit(unit: str, channel: str, fitted: Fit) -> str:
    if 'channel' not in unit:
        return unit
    for blow in fitted.model.data.blows:
        if channel in blow.channels:
            return unit.replace(
                'of the channel per s', blow.channels[channel].unit + '/s'
            ).replace('of the channel', blow.channels[channel].unit)
    return unit


def _unit(key: str) -> str:
    name = key.split('@')[0]
    if name.startswith('gain'):
        return '1'
    return _UNITS.get(name.rsplit('.', 1)[-1], '')


def _parameters(fitted: Fit) -> dict[str, ParameterEstimate]:
    values = fitted.values
    names = [b.name for b in fitted.model.data.blows]
    covariance = np.sqrt(np.maximum(np.diag(fitted.covariance()), 0.0))
    result = {}
    for j, number in enumerate(fitted.model.free):
        if number.blow is not None and number.blow not in fitted.layout.blow_spans:
            continue
        value = values[number.key]
        std = float(covariance[j]) * (value if number.logarithmic else 1.0)
        label = number.key
        if number.blow is not None:
            label = f'{number.key.split("@")[0]} of {names[number.blow]}'
        result[label] = ParameterEstimate(value, std, _unit(number.key))
    return result


# --- before and after ----------------------------------------------------------------------------


def _table(data: CampaignData, outcome: Outcome) -> FitTable:
    def figures(fitted: Fit, held_out: Fit | None) -> FitFigures:
        return FitFigures(
            rmse=_rmse(fitted),
            held_out_rmse={} if held_out is None else _rmse(held_out),
            reduced_chi_square=fitted.reduced,
            held_out_reduced_chi_square=math.nan if held_out is None else held_out.reduced,
        )

    return FitTable(
        figures(outcome.baseline, outcome.held_out_baseline),
        figures(outcome.final, outcome.held_out_final),
        dict(data.noise),
    )


def _rmse(fitted: Fit) -> dict[str, float]:
    """RMSE of each channel, as that of single samples: bins count by what they tell."""
    squares: dict[str, list[float]] = {}
    for (i, name), span in fitted.layout.spans.items():
        residual = fitted.residuals[span]
        noise = fitted.model.data.blows[i].channels[name].noise
        total = squares.setdefault(name, [0.0, 0.0])
        total[0] += noise**2 * float(residual @ residual)
        total[1] += residual.size
    return {name: math.sqrt(s / n) for name, (s, n) in squares.items() if n}


def _pictures(outcome: Outcome) -> tuple[tuple[Trace, ...], list[Strip]]:
    """Overlays for the page, and residuals for locating."""
    traces: list[Trace] = []
    strips: list[Strip] = []
    for before, after, held_out in (
        (outcome.baseline, outcome.final, False),
        (outcome.held_out_baseline, outcome.held_out_final, True),
    ):
        if before is None or after is None:
            continue
        for i in after.layout.blows:
            blow = after.model.data.blows[i]
            old = before.model.predict(before.values, i)
            new = after.model.predict(after.values, i)
            rows = new.rows
            spans = None
            for name, channel in blow.channels.items():
                mask = after.layout.masks[i, name]
                where = blow.where[name]
                same = rows.shape[0] == blow.times.size
                x = rows[where, at.PLATE_POSITION].mean(axis=0) if same else np.zeros(mask.size)
                v = rows[where, at.PLATE_VELOCITY].mean(axis=0) if same else np.zeros(mask.size)
                if spans is None:
                    spans = _phases(blow.recording.kind, channel.centres, x, after, i)
                traces.append(
                    Trace(
                        blow.name,
                        name,
                        channel.unit,
                        held_out,
                        channel.noise,
                        channel.centres[mask],
                        channel.means[mask],
                        old.means[name][mask],
                        new.means[name][mask],
                        x[mask],
                        v[mask],
                    )
                )
                std = channel.std[mask]
                strips.append(
                    Strip(
                        blow.name,
                        name,
                        channel.centres[mask],
                        (channel.means[mask] - old.means[name][mask]) / std,
                        (channel.means[mask] - new.means[name][mask]) / std,
                        x[mask],
                        v[mask],
                        spans,
                    )
                )
    return tuple(traces), strips


def _phases(kind: str, time: Array, x: Array, after: Fit, i: int) -> tuple[Phase, ...]:
    values = after.values
    prediction = after.model.predict(values, i)
    start = prediction.start
    end = float(time[-1])
    early = (time > start) & (time < start + 0.05)
    peak = float(time[early][np.argmax(x[early])]) if early.any() else start + 0.01
    if kind == 'tap':
        lost = after.model.data.blows[i].settled
        return phases(start, min(peak, 0.5 * (start + lost)), [(lost, False)], end)
    contacts = [
        (float(t), int(k) == at.CONTACT_BEGINS)
        for t, k in zip(prediction.contacts, prediction.contact_kinds, strict=True)
    ]
    return phases(start, peak, contacts, end)


# --- what to measure next, what to save ----------------------------------------------------------


def _next_tests(
    ranking: Sequence[Finding], found: Sequence[str], campaign: Campaign
) -> tuple[str, ...]:
    """The tests that would settle what is open."""
    known = all_mechanisms()
    tests: dict[str, None] = {}
    for finding in ranking:
        if finding.name not in found:
            continue
        for name in finding.confused_with:
            if name in known:
                tests[f'To tell {finding.name} from {name}: {known[name].test}.'] = None
            elif name == 'wrong_parameter':
                tests[
                    f'To tell {finding.name} from a wrong number of the simulation: measure that '
                    'number on its own (stiffness, mass and angle by a static test).'
                ] = None
    if 'unknown' in found:
        kinds = {r.kind for r in campaign.recordings}
        if 'tap' not in kinds:
            tests['Hammer taps of different strength: they show guide and spring alone.'] = None
        else:
            tests['Blows at several speeds and masses, otherwise alike: they part the states.'] = (
                None
            )
    if not found and not any('held out' in note for note in campaign.notes):
        for finding in ranking[:1]:
            if finding.name in known and finding.probability > 0.05:
                tests[f'To rule out {finding.name}: {known[finding.name].test}.'] = None
    return tuple(tests)[:_STATED_TESTS]


def _saved(
    campaign: Campaign, outcome: Outcome, accepted: Sequence[Candidate]
) -> dict[str, object]:
    """The extended model as a new baseline of ``campaign.yaml``."""
    values = outcome.final.values
    baseline: list[object] = [
        {'name': b.name, 'values': dict(b.values)} if b.values else b.name
        for b in campaign.baseline
    ]
    for candidate in accepted:
        if candidate.name == 'wrong_parameter':
            continue
        numbers = {
            name: item.value
            for name, item in _estimates(candidate, outcome.final).items()
            if not isinstance(item.value, str)
        }
        entry: dict[str, object] = {'name': candidate.name, 'values': numbers}
        if candidate.channel:
            entry['channel'] = candidate.channel
        baseline.append(entry)
    sensor = {
        key.split('.', 1)[1]: {'value': values[key], 'std': outcome.final.std(key)}
        for key in values
        if key.startswith('sensor.')
    }
    corrected = {
        c.parameter: values[c.free[0].key]
        for c in accepted
        if c.name == 'wrong_parameter' and c.free
    }
    return {'baseline': baseline, 'sensor': sensor, 'corrected': corrected}
