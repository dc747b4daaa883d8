"""The verdict over all repetitions at a test point: the worst of them, never better."""

from __future__ import annotations

import math
from collections.abc import Sequence

from impactscope.comply.decision import newtons, rule_in_words
from impactscope.comply.limits import LimitSet
from impactscope.comply.rules import JudgementRules, unstated
from impactscope.comply.severity import severity, worst
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import (
    ComplianceVerdict,
    Estimate,
    TestPoint,
    Verdict,
    VerdictScope,
)

__all__ = ['judge_test_point', 'repetitions_needed']

_UNJUDGED = (Verdict.INVALID, Verdict.INCOMPLETE)


def repetitions_needed(test_point: TestPoint, profile: MeasurementProfile) -> int:
    """A plan may ask for more repetitions than the profile, not for fewer."""
    return max(profile.repetitions, test_point.repetitions_planned)


def judge_test_point(
    test_point: TestPoint,
    blows: Sequence[ComplianceVerdict],
    limits: LimitSet | None,
    profile: MeasurementProfile,
    rules: JudgementRules,
    *,
    ended: bool = True,
) -> ComplianceVerdict:
    """Judge a test point by the verdicts on its blows, in order.

    The largest force is judged, which is the worst of the blows' verdicts. Fewer judged blows
    than needed, or a required statement that is missing, make it INCOMPLETE unless something
    worse applies. ``ended`` False says that the recording stopped while it was open.
    """
    needed = repetitions_needed(test_point, profile)
    judged = [blow for blow in blows if blow.verdict not in _UNJUDGED]
    findings: list[tuple[Verdict, str]] = []
    ranked = sorted(blows, key=_weight, reverse=True)
    findings += [
        (blow.verdict, f'Event {blow.event_ids[0]}: {blow.reasons[0]}')
        for rank, blow in enumerate(ranked)
        if rank == 0 or blow.verdict is not Verdict.PASS
    ]
    if not blows:
        findings.append((Verdict.INCOMPLETE, 'No blow was recorded at the test point.'))
    elif len(judged) < needed:
        findings.append(
            (
                Verdict.INCOMPLETE,
                f'{len(judged)} of the {needed} repetitions needed could be judged'
                + (f' ({len(blows)} were recorded).' if len(blows) > len(judged) else '.'),
            )
        )
    missing = unstated(test_point, rules.required_statements)
    if missing:
        findings.append((Verdict.INCOMPLETE, f'Not stated: {", ".join(missing)}.'))
    if len({(blow.test_point.body_region, blow.test_point.contact) for blow in blows}) > 1:
        findings.append(
            (Verdict.INVALID, 'The repetitions disagree on body region or kind of contact.')
        )
    findings.sort(key=lambda item: severity(item[0]), reverse=True)

    transient = _largest([blow.transient_force for blow in blows])
    quasi_static = _largest([blow.quasi_static_force for blow in blows])
    head = ranked[0] if ranked else None
    spread, notes = _spread(judged, transient, quasi_static)
    if not ended:
        notes.append('The recording ended while the test point was open; judged as ended there.')
    last_ns = max((blow.stamp_ns for blow in blows), default=test_point.start_ns)
    return ComplianceVerdict(
        stamp_ns=test_point.end_ns or last_ns,
        verdict=worst(verdict for verdict, _ in findings),
        scope=VerdictScope.TEST_POINT,
        event_ids=tuple(blow.event_ids[0] for blow in blows),
        reasons=tuple(sentence for _, sentence in findings) + tuple(notes),
        test_point=test_point,
        limit_set='' if limits is None else limits.label,
        measurement_profile=profile.label,
        decision_rule=rule_in_words(profile.guard_band),
        transient_force=transient,
        transient_limit=math.nan if head is None else head.transient_limit,
        quasi_static_force=quasi_static,
        quasi_static_limit=math.nan if head is None else head.quasi_static_limit,
        guard_band=math.nan if head is None else head.guard_band,
        spread=spread,
        reconstructed_peak_force=_largest(
            [Estimate(blow.reconstructed_peak_force) for blow in blows]
        ).value,
    )


def _weight(blow: ComplianceVerdict) -> tuple[int, float]:
    """Orders blows: the one that decides has the largest weight."""
    shares = (
        blow.transient_force.value / blow.transient_limit,
        blow.quasi_static_force.value / blow.quasi_static_limit,
    )
    share = max((share for share in shares if math.isfinite(share)), default=0.0)
    return severity(blow.verdict), share


def _largest(forces: Sequence[Estimate]) -> Estimate:
    known = [force for force in forces if math.isfinite(force.value)]
    return max(known, key=lambda force: force.value, default=Estimate())


def _spread(
    blows: Sequence[ComplianceVerdict], transient: Estimate, quasi_static: Estimate
) -> tuple[float, list[str]]:
    """Largest minus smallest repetition of the force nearest its limit; NaN for fewer than two."""
    if len(blows) < 2:
        return math.nan, []
    limit = blows[0]
    by_transient = transient.value / limit.transient_limit
    by_quasi_static = quasi_static.value / limit.quasi_static_limit
    decides_late = by_quasi_static > by_transient  # false for NaN
    forces = [
        (blow.quasi_static_force if decides_late else blow.transient_force).value for blow in blows
    ]
    forces = [force for force in forces if math.isfinite(force)]
    if len(forces) < 2:
        return math.nan, []
    spread = max(forces) - min(forces)
    phase = 'quasi-static' if decides_late else 'transient'
    return spread, [
        f'The {phase} force of {len(forces)} repetitions lies between {newtons(min(forces))} '
        f'and {newtons(max(forces))} (spread {newtons(spread)}).'
    ]
