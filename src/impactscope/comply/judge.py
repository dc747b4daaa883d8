"""The verdict on one blow: a pure function of the blow, the limits and the rules.

Everything that speaks for or against is a finding, a verdict with its sentence; the worst
finding is the verdict. What is not known can only make it worse: a blow is passed for what was
seen in full, never for what was not seen.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from impactscope.comply.decision import PhaseDecision, decide, newtons, rule_in_words
from impactscope.comply.evaluation import ForceEvaluation, ForceReading, evaluate, read_force
from impactscope.comply.filtered_peak import filtered_peak_statement
from impactscope.comply.limits import LimitSet, RegionLimits
from impactscope.comply.rules import STATEMENTS, JudgementRules, unstated
from impactscope.comply.severity import severity, worst
from impactscope.comply.soundness import channel_flags, find_faults
from impactscope.comply.validity import validity_statement
from impactscope.errors import ConfigurationError, InputError
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import (
    ComplianceVerdict,
    ContactKind,
    Estimate,
    ImpactEvent,
    ImpactParameters,
    Quality,
    SensorParameters,
    TestPoint,
    Verdict,
    VerdictScope,
)

__all__ = ['judge']

_NO_RULES = JudgementRules()


class _Finding(NamedTuple):
    verdict: Verdict
    sentence: str


class _Blow(NamedTuple):
    """What was read of a blow; without reading and evaluation where there is no force."""

    faults: tuple[str, ...]
    flags: Quality  # of the force channel
    reading: ForceReading | None = None
    evaluation: ForceEvaluation | None = None


def judge(
    event: ImpactEvent,
    limits: LimitSet | None,
    profile: MeasurementProfile,
    *,
    rules: JudgementRules = _NO_RULES,
    test_point: TestPoint | None = None,
    sensor: SensorParameters | None = None,
    impact: ImpactParameters | None = None,
    resting_load: float = 0.0,
) -> ComplianceVerdict:
    """Judge one blow against the limits of the body region of its test point.

    Args:
        event: the blow; judged is its force channel as recorded, zero level removed.
        limits: the limit set; None makes the verdict INCOMPLETE.
        profile: the rules of the measurement.
        rules: demands on device and documentation.
        test_point: what was tested; None takes the event's own.
        sensor: what is known of the sensor; it adds a statement, never changes the verdict.
        impact: the reconstructed contact force; a diagnostic, never changes the verdict.
        resting_load: N that lay on the device before the blow and became part of its zero
            level, so that the reading is too low by as much; above the profile's
            ``contact_end_force`` it is a fault.

    A contact that is not permitted is a FAIL. A force that is above a limit beyond doubt is a
    FAIL, however unsound the recording; otherwise an unsound recording is INVALID, and a blow
    of which region or kind of contact is not stated is INCOMPLETE. Nothing raises: a blow that
    cannot be read is INVALID.
    """
    point = event.test_point if test_point is None else test_point
    region, findings = _region_findings(point, limits)
    notes: list[str] = []

    faults, flags, reading, evaluation = _read(event, profile, rules)
    if resting_load > profile.contact_end_force:
        faults += (
            f'A load of {newtons(resting_load)} rested on the device before the blow and went '
            'into its zero level: the force reads too low.',
        )
    decisions: list[PhaseDecision] = []
    if evaluation is not None and region is not None:
        decisions = _decisions(evaluation, region, profile, certain_only=bool(faults))
    permitted = region is not None and region.contact_permitted
    if region is not None and not permitted and _touched(event, evaluation, profile):
        findings.append(_not_permitted(region, evaluation))
    findings += [_Finding(Verdict.INVALID, fault) for fault in faults]
    if region is not None:
        soft, stiff = _spring(point, region, rules)
        findings += soft
        notes += stiff
        for decision in sorted(decisions, key=lambda item: item.weight, reverse=True):
            sentence = decision.sentence(region.title)
            if _counts(decision, faults, flags):
                findings.append(_Finding(decision.verdict, sentence))
            else:
                notes.append('As far as seen: ' + sentence)
    if event.index_of(rules.force_channel):
        notes.append('The force was judged on the common grid: it is not the reference channel.')
    if evaluation is not None:
        notes += _notes(evaluation, point, profile, flags, impact)
        notes += validity_statement(event, sensor)
    if reading is not None and evaluation is not None:
        notes += filtered_peak_statement(reading, evaluation, event.contact_start)
    notes += _unstated_note(point)

    findings.sort(key=lambda item: severity(item.verdict), reverse=True)  # stable
    deciding = max(decisions, key=lambda item: item.weight, default=None)
    return ComplianceVerdict(
        stamp_ns=event.stamp_ns,
        verdict=worst(finding.verdict for finding in findings),
        scope=VerdictScope.EVENT,
        event_ids=(event.event_id,),
        reasons=tuple(finding.sentence for finding in findings) + tuple(notes),
        test_point=point,
        limit_set='' if limits is None else limits.label,
        measurement_profile=profile.label,
        decision_rule=rule_in_words(profile.guard_band),
        transient_force=Estimate() if evaluation is None else evaluation.transient,
        transient_limit=_transient_limit(region),
        quasi_static_force=Estimate() if evaluation is None else evaluation.quasi_static,
        quasi_static_limit=region.quasi_static_force if region and permitted else math.nan,
        guard_band=math.nan if deciding is None else deciding.guard_band,
        reconstructed_peak_force=_reconstructed(impact).value,
    )


def _region_findings(
    point: TestPoint, limits: LimitSet | None
) -> tuple[RegionLimits | None, list[_Finding]]:
    region: RegionLimits | None = None
    missing: list[str] = []
    if limits is None:
        missing.append('No limit set was given.')
    if not point.body_region.strip():
        missing.append('The body region of the test point is not stated.')
    elif limits is not None:
        try:
            region = limits.limits_for(point.body_region)
        except ConfigurationError:
            missing.append(
                f'Body region {point.body_region[:60]!r} is not in the limit set {limits.label}; '
                f'it has {", ".join(limits.regions)}.'
            )
    if point.contact not in (ContactKind.CONSTRAINED, ContactKind.FREE):
        missing.append('Whether the contact is constrained or free is not stated.')
    return region, [_Finding(Verdict.INCOMPLETE, sentence) for sentence in missing]


def _read(event: ImpactEvent, profile: MeasurementProfile, rules: JudgementRules) -> _Blow:
    row = event.index_of(rules.force_channel)
    if row is None:
        has = ', '.join(channel.name[:40] for channel in event.channels) or 'none'
        fault = (
            'Not a PFL measuring device: the recording has no contact force channel '
            f'{rules.force_channel!r} (it has {has}).'
        )
        return _Blow((fault,), Quality(event.quality))
    flags = channel_flags(event, row)
    unit = event.channels[row].unit
    if unit != 'N':
        fault = f'The force channel {rules.force_channel!r} is in {unit[:40]!r}; N is needed.'
        return _Blow((fault,), flags)
    try:
        reading = read_force(event, rules.force_channel)
    except InputError as error:
        return _Blow((f'The blow cannot be read: {error}.',), flags)
    evaluation = evaluate(event, reading, profile)
    faults = find_faults(event, reading, evaluation, profile, rules)
    return _Blow(faults, flags, reading, evaluation)


def _decisions(
    evaluation: ForceEvaluation,
    region: RegionLimits,
    profile: MeasurementProfile,
    *,
    certain_only: bool,
) -> list[PhaseDecision]:
    if region.transient_force is None:
        return []
    phases = (
        ('Transient', evaluation.transient, region.transient_force),
        ('Quasi-static', evaluation.quasi_static, region.quasi_static_force),
    )
    # What is to hold in spite of a fault has to be beyond doubt, whatever the profile's rule.
    banded = profile.guard_band or certain_only
    return [
        decide(phase, force, limit, evaluation.guard_band(limit) if banded else 0.0)
        for phase, force, limit in phases
        if math.isfinite(force.value)
    ]


def _counts(decision: PhaseDecision, faults: tuple[str, ...], flags: Quality) -> bool:
    """Whether a decision stands: always on a sound blow, else a FAIL beyond doubt alone."""
    if not faults:
        return True
    if decision.verdict is not Verdict.FAIL:
        return False
    # With a broken clock a force after the transient window may have been inside it.
    return decision.phase == 'Transient' or not flags & Quality.CLOCK_JUMP


def _touched(
    event: ImpactEvent, evaluation: ForceEvaluation | None, profile: MeasurementProfile
) -> bool:
    found_in = event.channels[0].name if event.channels else ''
    if event.contacts and found_in.split('.')[0] == 'force':
        return True
    return evaluation is not None and evaluation.transient.value > profile.contact_end_force


def _not_permitted(region: RegionLimits, evaluation: ForceEvaluation | None) -> _Finding:
    force = math.nan if evaluation is None else evaluation.transient.value
    seen = f'one of {newtons(force)} was recorded' if math.isfinite(force) else 'one was recorded'
    return _Finding(Verdict.FAIL, f'Contact with {region.title} is not permitted; {seen}.')


def _spring(
    point: TestPoint, region: RegionLimits, rules: JudgementRules
) -> tuple[list[_Finding], list[str]]:
    """Findings and notes on the device's spring: the force goes with the root of its stiffness."""
    ratio = point.spring_stiffness / region.stiffness
    if not math.isfinite(ratio) or abs(ratio - 1) <= rules.spring_tolerance:
        return [], []
    side, effect = ('softer', 'low') if ratio < 1 else ('stiffer', 'high')
    sentence = (
        f"The device's spring, {point.spring_stiffness / 1e3:g} N/mm, is {side} than the "
        f'{region.stiffness / 1e3:g} N/mm for {region.title} by more than '
        f'{rules.spring_tolerance:.0%}: it reads too {effect}.'
    )
    return ([_Finding(Verdict.INVALID, sentence)], []) if ratio < 1 else ([], [sentence])


def _notes(
    evaluation: ForceEvaluation,
    point: TestPoint,
    profile: MeasurementProfile,
    flags: Quality,
    impact: ImpactParameters | None,
) -> list[str]:
    notes = []
    if not math.isfinite(evaluation.quasi_static.value):
        notes.append(
            f'Contact ended {evaluation.contact_duration:.3f} s after it began, within the '
            f'transient window of {profile.transient_window:g} s: no quasi-static force.'
        )
    if flags & Quality.HELD:
        notes.append(
            f'Contact lasted beyond the longest hold of {profile.longest_hold:g} s; '
            'what the force did later is not judged.'
        )
    if point.contact is ContactKind.FREE:
        notes.append(
            'Free contact, judged by the reading as of a fixed device, which is the larger: '
            "F_free = F_fixed sqrt(m_H / (m_H + m_R)) needs the robot's effective mass m_R."
        )
    reconstructed = _reconstructed(impact)
    if math.isfinite(reconstructed.value):
        difference = reconstructed.value - evaluation.transient.value
        side = 'above' if difference > 0 else 'below'
        notes.append(
            f'The reconstructed contact force peaks at {newtons(reconstructed.value)}, '
            f'{newtons(abs(difference))} {side} the reading; a diagnostic, not judged.'
        )
    return notes


def _unstated_note(point: TestPoint) -> list[str]:
    missing = unstated(point, tuple(STATEMENTS))
    return [f'Not stated: {", ".join(missing)}.'] if missing else []


def _transient_limit(region: RegionLimits | None) -> float:
    if region is None or region.transient_force is None:
        return math.nan
    return region.transient_force


def _reconstructed(impact: ImpactParameters | None) -> Estimate:
    return impact.peak_contact_force if impact is not None and impact.valid else Estimate()
