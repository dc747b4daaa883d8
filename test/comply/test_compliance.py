import dataclasses
import math
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from impactscope.comply.compliance import Compliance, final_verdicts, judge_recording
from impactscope.comply.rules import JudgementRules
from impactscope.comply.severity import severity, worst
from impactscope.errors import ConfigurationError
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import ContactKind, Quality, TestPoint, Verdict, VerdictScope

PROFILE = MeasurementProfile()
SECOND = 1_000_000_000


def blows_of(make_event, point, peaks, **changes):
    return [
        make_event(peak, point=point, event_id=number, stamp_ns=(1 + number) * SECOND, **changes)
        for number, peak in enumerate(peaks, 1)
    ]


def run(stage, point, events):
    """Open the test point, take the blows, end it: the verdicts in order."""
    found = stage.take_test_point(point)
    for event in events:
        found += stage.push(event)
    return found + stage.take_test_point(dataclasses.replace(point, end_ns=100 * SECOND))


def test_three_repetitions_pass_and_the_largest_is_judged(make_event, make_point, iso):
    point = make_point()
    found = run(Compliance(iso, PROFILE), point, blows_of(make_event, point, [100, 130, 110]))
    assert [v.scope for v in found] == [VerdictScope.EVENT] * 3 + [VerdictScope.TEST_POINT]
    verdict = found[-1]
    assert verdict.verdict is Verdict.PASS
    assert verdict.event_ids == (1, 2, 3)
    assert verdict.transient_force.value == pytest.approx(130, abs=1e-3)
    assert verdict.spread == pytest.approx(30, abs=1e-3)
    assert verdict.stamp_ns == 100 * SECOND
    assert verdict.reasons[0].startswith('Event 2: Transient force 130.0 N is below the limit')
    assert any('between 100.0 N and 130.0 N (spread 30.0 N)' in r for r in verdict.reasons)
    assert judge_recording(found) is Verdict.PASS


def test_one_failure_fails_the_test_point(make_event, make_point, iso):
    point = make_point()
    found = run(Compliance(iso, PROFILE), point, blows_of(make_event, point, [100, 400, 110]))
    assert [v.verdict for v in found] == [
        Verdict.PASS,
        Verdict.FAIL,
        Verdict.PASS,
        Verdict.FAIL,
    ]
    assert found[-1].reasons[0].startswith('Event 2: Transient force 400.0 N is above')


def test_the_spread_is_of_the_force_nearest_its_limit(make_event, make_point, iso):
    point = make_point()
    events = blows_of(make_event, point, [150, 150, 150], plateau=100, hold=1.0)
    events[1] = dataclasses.replace(events[1], values=events[1].values * 0.9)
    found = run(Compliance(iso, PROFILE), point, events)[-1]
    assert found.spread == pytest.approx(0.1 * (100 + 1.5), abs=0.01)
    assert 'quasi-static force of 3 repetitions' in ' '.join(found.reasons)


@pytest.mark.parametrize(
    ('peaks', 'planned', 'verdict'),
    [
        ([], 0, Verdict.INCOMPLETE),
        ([100], 0, Verdict.INCOMPLETE),
        ([100, 100], 0, Verdict.INCOMPLETE),
        ([100, 400], 0, Verdict.FAIL),
        ([100, 100, 100], 5, Verdict.INCOMPLETE),
        ([100, 100], 2, Verdict.INCOMPLETE),  # a plan cannot ask for less than the profile
        ([100] * 5, 5, Verdict.PASS),
        ([100, 100, 275], 0, Verdict.CONDITIONAL_PASS),
        ([100, 275], 0, Verdict.INCOMPLETE),
        ([100, 284], 0, Verdict.CONDITIONAL_FAIL),
    ],
)
def test_repetitions_needed(make_event, make_point, iso, peaks, planned, verdict):
    point = make_point(repetitions_planned=planned)
    found = run(Compliance(iso, PROFILE), point, blows_of(make_event, point, peaks))
    assert found[-1].verdict is verdict


def test_an_invalid_repetition_makes_it_invalid_unless_another_fails(make_event, make_point, iso):
    point = make_point()
    events = blows_of(make_event, point, [100, 100, 100, 100])
    events[2] = dataclasses.replace(events[2], quality=Quality.CLOCK_JUMP)
    found = run(Compliance(iso, PROFILE), point, events)[-1]
    assert found.verdict is Verdict.INVALID
    assert found.reasons[0].startswith('Event 3: The clock jumped')
    few = run(Compliance(iso, PROFILE), point, events[1:])[-1]
    assert '2 of the 3 repetitions needed could be judged (3 were recorded).' in few.reasons
    failing = blows_of(make_event, point, [500])[0]
    events.append(dataclasses.replace(failing, event_id=9, stamp_ns=50 * SECOND))
    assert run(Compliance(iso, PROFILE), point, events)[-1].verdict is Verdict.FAIL


def test_a_test_point_whose_documentation_is_missing_is_incomplete(make_event, make_point, iso):
    point = make_point(robot='', damper=' ', spring_stiffness=math.nan)
    events = blows_of(make_event, point, [100, 100, 100])
    found = run(Compliance(iso, PROFILE), point, events)
    assert {v.verdict for v in found[:3]} == {Verdict.PASS}
    assert found[-1].verdict is Verdict.INCOMPLETE
    assert (
        "Not stated: robot, stiffness of the device's spring, damper layer." in found[-1].reasons
    )
    lenient = Compliance(iso, PROFILE, JudgementRules(required_statements=()))
    assert run(lenient, point, events)[-1].verdict is Verdict.PASS


def test_repetitions_started_one_by_one_belong_together(make_event, make_point, iso):
    stage = Compliance(iso, PROFILE)
    ends = []
    for number in (1, 2, 3):
        point = make_point(repetition=number, start_ns=number * 10 * SECOND)
        assert stage.take_test_point(point) == []
        (blow,) = stage.push(
            make_event(
                100 + number, point=point, event_id=number, stamp_ns=(number * 10 + 1) * SECOND
            )
        )
        assert blow.verdict is Verdict.PASS
        ends += stage.take_test_point(
            dataclasses.replace(point, end_ns=(number * 10 + 5) * SECOND)
        )
    assert [end.verdict for end in ends] == [
        Verdict.INCOMPLETE,
        Verdict.INCOMPLETE,
        Verdict.PASS,
    ]
    assert ends[-1].event_ids == (1, 2, 3)
    assert len(final_verdicts(ends)) == 1
    assert stage.flush() == []


def test_a_blow_that_arrives_after_the_end_revises_the_verdict(make_event, make_point, iso):
    point = make_point()
    events = blows_of(make_event, point, [100, 100, 100, 400])
    stage = Compliance(iso, PROFILE)
    found = run(stage, point, events[:3])
    late = stage.push(events[3])
    assert [v.verdict for v in late] == [Verdict.FAIL, Verdict.FAIL]
    assert late[1].scope is VerdictScope.TEST_POINT
    assert late[1].event_ids == (1, 2, 3, 4)
    assert judge_recording(found + late) is Verdict.FAIL
    assert [v.verdict for v in final_verdicts(found + late)] == [Verdict.FAIL]


def test_a_latched_test_point_that_comes_again_gives_no_second_verdict(
    make_event, make_point, iso
):
    point = make_point(speed=float('nan'))
    stage = Compliance(iso, PROFILE)
    assert len(run(stage, point, blows_of(make_event, point, [100] * 3))) == 4
    again = dataclasses.replace(point, end_ns=100 * SECOND, speed=float('nan'))
    assert stage.take_test_point(again) == []


def test_a_blow_that_comes_again_is_no_repetition(make_event, make_point, iso):
    point = make_point()
    (event,) = blows_of(make_event, point, [100])
    found = run(Compliance(iso, PROFILE), point, [event, event, event])
    assert found[-1].verdict is Verdict.INCOMPLETE
    assert found[-1].event_ids == (1,)


def test_a_blow_without_test_point_is_given_the_one_that_was_open(make_event, make_point, iso):
    stage = Compliance(iso, PROFILE)
    stage.take_test_point(make_point())
    (verdict,) = stage.push(make_event(100, point=TestPoint()))
    assert verdict.verdict is Verdict.PASS
    assert verdict.test_point.id == 'P1'
    (verdict,) = stage.push(make_event(100, point=TestPoint(), stamp_ns=SECOND // 2))
    assert verdict.verdict is Verdict.INCOMPLETE  # before it began


def test_a_test_point_announced_with_its_end_waits_for_its_blows(make_event, make_point, iso):
    point = make_point(end_ns=100 * SECOND)
    stage = Compliance(iso, PROFILE)
    assert stage.take_test_point(point) == []
    found = []
    for event in blows_of(make_event, point, [100, 100, 100]):
        found += stage.push(event)
    assert [v.verdict for v in final_verdicts(found)] == [Verdict.PASS]
    assert stage.flush() == []
    stage.take_test_point(point)
    (verdict,) = stage.flush()
    assert verdict.verdict is Verdict.INCOMPLETE
    assert not any('still open' in r or 'was open' in r for r in verdict.reasons)


def test_flush_judges_what_is_open_says_so_and_starts_afresh(make_event, make_point, iso):
    point = make_point()
    stage = Compliance(iso, PROFILE)
    stage.take_test_point(point)
    for event in blows_of(make_event, point, [100, 100, 100]):
        stage.push(event)
    (verdict,) = stage.flush()
    assert verdict.verdict is Verdict.PASS
    assert 'The recording ended while the test point was open' in ' '.join(verdict.reasons)
    assert verdict.stamp_ns == 4 * SECOND
    assert stage.flush() == []
    stage.take_test_point(point)
    (verdict,) = stage.flush()
    assert verdict.verdict is Verdict.INCOMPLETE
    assert verdict.reasons[0] == 'No blow was recorded at the test point.'


def test_repetitions_that_contradict_each_other_are_invalid(make_event, make_point, iso):
    point = make_point()
    other = make_point(body_region='chest', spring_stiffness=math.nan)
    events = blows_of(make_event, point, [100, 100, 100])
    events[1] = dataclasses.replace(events[1], test_point=other)
    found = run(Compliance(iso, PROFILE), point, events)[-1]
    assert found.verdict is Verdict.INVALID
    assert 'disagree' in found.reasons[0]


def test_a_recording_without_blows_is_incomplete(make_event, make_point, iso):
    assert judge_recording([]) is Verdict.INCOMPLETE
    (stray,) = Compliance(iso, PROFILE).push(make_event(point=TestPoint()))
    assert judge_recording([stray]) is Verdict.INCOMPLETE


quality = st.sampled_from([Quality.NONE, Quality.NONE, Quality.CLIPPED, Quality.COLD_START])
blow_lists = st.lists(st.tuples(st.sampled_from([50, 275, 284, 400]), quality), max_size=5)


@given(
    blows=blow_lists,
    contact=st.sampled_from(ContactKind),
    region=st.sampled_from(['hands_fingers', 'face', 'tail', '']),
)
def test_a_test_point_is_never_better_than_its_worst_blow_and_passes_in_full_only(
    make_event, make_point, iso, blows, contact, region
):
    point = make_point(contact=contact, body_region=region)
    events = [
        make_event(peak, rate=1000.0, quality=flags, point=point, event_id=n, stamp_ns=n * SECOND)
        for n, (peak, flags) in enumerate(blows, 2)
    ]
    found = run(Compliance(iso, PROFILE), point, events)
    whole, single = found[-1], [v.verdict for v in found[:-1]]
    assert severity(whole.verdict) >= severity(worst(single))
    assert severity(judge_recording(found)) >= severity(whole.verdict)
    if whole.verdict is Verdict.PASS:
        assert len(single) >= PROFILE.repetitions
        assert set(single) == {Verdict.PASS}
    if region in ('', 'tail') or contact is ContactKind.UNKNOWN:
        assert whole.verdict not in (Verdict.PASS, Verdict.CONDITIONAL_PASS)


CONFIG = Path(__file__).parents[2] / 'config' / 'measurement_profiles' / 'default.yaml'


def test_the_shipped_profile_is_the_default():
    assert MeasurementProfile.from_mapping(yaml.safe_load(CONFIG.read_text())) == PROFILE


def test_a_profile_with_an_unknown_rule_is_refused():
    mapping = yaml.safe_load(CONFIG.read_text()) | {'transient_windw': 0.5}
    with pytest.raises(ConfigurationError, match='transient_windw'):
        MeasurementProfile.from_mapping(mapping)
