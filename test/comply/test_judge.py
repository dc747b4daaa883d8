import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.comply.judge import judge
from impactscope.comply.rules import JudgementRules
from impactscope.comply.severity import SEVERITY, severity, worst
from impactscope.errors import ConfigurationError
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import (
    Channel,
    ContactKind,
    Estimate,
    ImpactParameters,
    Quality,
    SensorParameters,
    TestPoint,
    Verdict,
)

PROFILE = MeasurementProfile()
BAD = [flag for flag in Quality if flag not in (Quality.NONE, Quality.HELD)]
CONSTRAINED, FREE = ContactKind.CONSTRAINED, ContactKind.FREE


# The decision, on sound blows. Hands: 280 N transient, 140 N quasi-static; w = 3 % of the limit
# and a little noise: 8.4 N and 4.2 N.
@pytest.mark.parametrize(
    ('peak', 'verdict'),
    [
        (120.0, Verdict.PASS),
        (271.0, Verdict.PASS),
        (272.5, Verdict.CONDITIONAL_PASS),
        (279.9, Verdict.CONDITIONAL_PASS),
        (280.2, Verdict.CONDITIONAL_FAIL),
        (287.5, Verdict.CONDITIONAL_FAIL),
        (289.0, Verdict.FAIL),
        (2000.0, Verdict.FAIL),
    ],
)
def test_four_states_of_the_transient_force(make_event, iso, peak, verdict):
    found = judge(make_event(peak), iso, PROFILE)
    assert found.verdict is verdict
    assert found.guard_band == pytest.approx(8.4, abs=0.05)
    assert found.transient_limit == 280
    assert found.quasi_static_limit == 140
    assert found.transient_force.value == pytest.approx(peak, abs=1e-3)
    assert math.isnan(found.quasi_static_force.value)


@pytest.mark.parametrize(
    ('plateau', 'verdict'),
    [
        (130.0, Verdict.PASS),
        (137.0, Verdict.CONDITIONAL_PASS),
        (142.0, Verdict.CONDITIONAL_FAIL),
        (150.0, Verdict.FAIL),
    ],
)
def test_the_quasi_static_force_decides_where_it_is_worse(make_event, iso, plateau, verdict):
    found = judge(make_event(200.0, plateau=plateau, hold=1.0), iso, PROFILE)
    assert found.verdict is verdict
    if verdict is not Verdict.PASS:
        assert found.reasons[0].startswith('Quasi-static force')
        assert found.guard_band == pytest.approx(4.2, abs=0.05)


def test_the_reason_is_a_sentence_with_numbers_and_units(make_event, iso):
    found = judge(make_event(312.0), iso, PROFILE)
    assert found.reasons[0] == (
        'Transient force 312.0 N is above the limit 280 N for hands and fingers by 32.0 N '
        '(guard band 8.4 N).'
    )
    assert found.limit_set == 'iso_ts_15066_2016 2026-11-20'
    assert found.measurement_profile == 'impactscope_default 1'
    assert 'ILAC-G8' in found.decision_rule
    inside = judge(make_event(283.0), iso, PROFILE)
    assert inside.reasons[0] == (
        'Transient force 283.0 N is above the limit 280 N for hands and fingers by 3.0 N, '
        'inside the guard band of 8.4 N.'
    )


@pytest.mark.parametrize(('peak', 'verdict'), [(280.0, Verdict.PASS), (280.1, Verdict.FAIL)])
def test_without_guard_band_the_limit_itself_divides(make_event, iso, peak, verdict):
    plain = dataclasses.replace(PROFILE, guard_band=False)
    found = judge(make_event(peak, zero=0.0), iso, plain)
    assert found.verdict is verdict
    assert found.guard_band == 0
    assert 'simple acceptance' in found.decision_rule


# Contact that is not permitted.
@pytest.mark.parametrize('region', ['skull_forehead', 'face'])
@pytest.mark.parametrize('peak', [5.0, 60.0, 500.0])
def test_contact_that_is_not_permitted_fails_whatever_the_force(
    make_event, make_point, iso, region, peak
):
    event = make_event(peak, point=make_point(body_region=region), quality=Quality.TORN)
    found = judge(event, iso, PROFILE)
    assert found.verdict is Verdict.FAIL
    assert 'is not permitted' in found.reasons[0]
    assert math.isnan(found.transient_limit)


def test_it_fails_even_where_no_sample_is_finite(make_event, make_point, iso):
    def erase(values, t):
        values[:] = np.nan

    event = make_event(edit=erase, point=make_point(body_region='face'))
    assert judge(event, iso, PROFILE).verdict is Verdict.FAIL


# A certain FAIL beats INVALID; nothing less does.
@pytest.mark.parametrize('flag', BAD)
@pytest.mark.parametrize('on_channel', [True, False])
def test_a_flagged_blow_fails_above_the_guard_band_and_is_invalid_below(
    make_event, iso, flag, on_channel
):
    flags = {'channel_quality' if on_channel else 'quality': flag}

    def cut(values, t):  # TORN alone can be shown to be harmless: the record goes on long enough
        if flag is Quality.TORN:
            values[:, t > 0.13] = np.nan

    above = judge(make_event(300.0, edit=cut, **flags), iso, PROFILE)
    assert above.verdict is Verdict.FAIL
    inside = judge(make_event(284.0, edit=cut, **flags), iso, PROFILE)
    assert inside.verdict is Verdict.INVALID
    assert any(reason.startswith('As far as seen: Transient force') for reason in inside.reasons)
    assert judge(make_event(50.0, edit=cut, **flags), iso, PROFILE).verdict is Verdict.INVALID


def test_a_quasi_static_fail_is_not_certain_where_the_clock_jumped(make_event, iso):
    blow = {'plateau': 200.0, 'hold': 1.0}
    found = judge(make_event(200.0, **blow), iso, PROFILE)
    assert found.verdict is Verdict.FAIL
    found = judge(make_event(200.0, quality=Quality.CLOCK_JUMP, **blow), iso, PROFILE)
    assert found.verdict is Verdict.INVALID


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('at', [0.0, 0.09, 0.12, 0.3, 0.6])
def test_a_lost_sample_in_the_judged_span_is_never_passed(make_event, iso, value, at):
    def pierce(values, t):
        values[0, np.argmin(np.abs(t - at))] = value

    found = judge(make_event(100.0, edit=pierce), iso, PROFILE)
    assert found.verdict is Verdict.INVALID
    assert 'missing or not finite' in found.reasons[0]


def test_a_gap_that_is_seen_to_lie_outside_does_no_harm(make_event, iso):
    def pierce(values, t):
        values[0, t > 0.68] = np.nan

    event = make_event(100.0, edit=pierce, channel_quality=Quality.GAP_BEFORE)
    assert judge(event, iso, PROFILE).verdict is Verdict.PASS


def test_a_sample_at_the_range_is_clipped_without_any_flag(make_event, iso):
    found = judge(make_event(250.0, range_max=250.0, range_min=-50.0, zero=0.0), iso, PROFILE)
    assert found.verdict is Verdict.INVALID
    assert 'upper end of the range, 250 N' in found.reasons[0]
    found = judge(make_event(300.0, range_max=300.0, range_min=-50.0, zero=0.0), iso, PROFILE)
    assert found.verdict is Verdict.FAIL


def test_clipping_at_the_lower_end_hides_no_larger_force(make_event, iso):
    limits = {'range_min': 0.0, 'range_max': 500.0, 'zero': 0.0}
    event = make_event(100.0, channel_quality=Quality.CLIPPED, **limits)
    assert judge(event, iso, PROFILE).verdict is Verdict.PASS
    event = make_event(100.0, channel_quality=Quality.CLIPPED, range_min=0.0, zero=0.0)
    assert judge(event, iso, PROFILE).verdict is Verdict.INVALID  # the upper end is not known


def test_another_channel_s_flag_is_not_the_force_s(make_event, iso):
    accelerometer = Channel('acceleration.plate', 'm/s^2', quality=Quality.CLIPPED)
    event = make_event(100.0, extra=(accelerometer,), quality=Quality.CLIPPED)
    assert judge(event, iso, PROFILE).verdict is Verdict.PASS
    event = make_event(100.0, extra=(accelerometer,), quality=Quality.CLIPPED | Quality.TORN)
    assert judge(event, iso, PROFILE).verdict is Verdict.PASS  # recorded to the end
    event = make_event(100.0, extra=(accelerometer,), quality=Quality.CLOCK_JUMP)
    assert judge(event, iso, PROFILE).verdict is Verdict.INVALID


def test_a_record_that_ends_while_contact_lasts_is_invalid_flag_or_not(make_event, iso):
    event = make_event(100.0, plateau=50.0, hold=1.0, length=1.136)
    found = judge(dataclasses.replace(event, contact_end=1.135), iso, PROFILE)
    assert found.verdict is Verdict.INVALID
    assert 'while contact lasts' in found.reasons[0]


def test_a_load_held_for_the_longest_hold_is_judged_and_said_so(make_event, iso):
    event = make_event(100.0, plateau=20.0, hold=5.0, length=5.1, quality=Quality.HELD)
    event = dataclasses.replace(event, contact_end=5.1)
    found = judge(event, iso, PROFILE)
    assert found.verdict is Verdict.PASS
    assert found.quasi_static_force.value == pytest.approx(20, abs=1e-3)
    assert any('longest hold of 5 s' in reason for reason in found.reasons)


def wired_the_wrong_way(values, t):
    """The blow reads negative; half a period later the plate swings to the other side."""
    values[0] = -values[0] + 0.8 * np.roll(values[0], int(np.argmax(t > 0.018)))


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'unit': 'lbf'}, "is in 'lbf'; N is needed"),
        ({'unit': ''}, 'N is needed'),
        ({'name': 'force.hammer'}, 'Not a PFL measuring device'),
        ({'name': 'displacement.angle', 'unit': 'rad'}, 'Not a PFL measuring device'),
        ({'native_rate': 200.0}, 'sampled at 200 Hz'),
        ({'native_rate': math.nan, 'rate': 500.0}, 'sampled at 500 Hz'),
        ({'native_rate': math.inf}, 'sampled at inf Hz'),
        ({'zero': math.nan, 'edit': lambda v, t: v.fill(100.0)}, 'zero level'),
        ({'noise': math.nan}, 'noise of the force is not known'),
        ({'peak': 2.0}, 'No contact force is seen'),
        ({'edit': lambda v, t: np.negative(v, out=v)}, 'the sign of the channel is in doubt'),
        ({'edit': wired_the_wrong_way}, 'the sign of the channel is in doubt'),
    ],
)
def test_what_cannot_be_judged_is_invalid_with_the_reason(make_event, iso, changes, reason):
    found = judge(make_event(**changes), iso, PROFILE)
    assert found.verdict is Verdict.INVALID
    assert reason in ' '.join(found.reasons)


def test_not_a_measuring_device_comes_first_where_nothing_is_stated_either(make_event, iso):
    event = make_event(900.0, name='force.hammer', point=TestPoint())
    found = judge(event, iso, PROFILE)
    assert found.verdict is Verdict.INVALID
    assert found.reasons[0].startswith('Not a PFL measuring device')


def test_an_event_that_contradicts_itself_is_invalid_and_raises_nothing(make_event, iso):
    event = make_event()
    for changes in (
        {'values': np.zeros((3, 4), np.float32)},
        {'sample_rate': math.nan},
        {'contact_start': math.nan},
        {'zero_level': (), 'noise_std': ()},
        {'channels': ()},
        {'contacts': ()},
    ):
        found = judge(dataclasses.replace(event, **changes), iso, PROFILE)
        assert found.verdict is Verdict.INVALID or 'contacts' in changes


# What is not stated.
@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'body_region': ''}, 'body region of the test point is not stated'),
        ({'body_region': '  '}, 'body region of the test point is not stated'),
        ({'body_region': 'tail'}, "'tail' is not in the limit set"),
        ({'contact': ContactKind.UNKNOWN}, 'constrained or free is not stated'),
    ],
)
def test_what_a_judgement_needs_is_incomplete_without(
    make_event, make_point, iso, changes, reason
):
    found = judge(make_event(100.0, point=make_point(**changes)), iso, PROFILE)
    assert found.verdict is Verdict.INCOMPLETE
    assert reason in found.reasons[0]


def test_nothing_known_at_all_is_incomplete(make_event, iso):
    found = judge(make_event(point=TestPoint()), iso, PROFILE)
    assert found.verdict is Verdict.INCOMPLETE
    found = judge(make_event(1000.0), None, PROFILE)
    assert found.verdict is Verdict.INCOMPLETE
    assert found.reasons[0] == 'No limit set was given.'


def test_a_force_above_the_limit_fails_whichever_kind_of_contact_it_was(
    make_event, make_point, iso
):
    point = make_point(contact=ContactKind.UNKNOWN)
    assert judge(make_event(400.0, point=point), iso, PROFILE).verdict is Verdict.FAIL


def test_what_is_only_to_be_reported_is_named(make_event, make_point, iso):
    point = make_point(robot='', speed=math.nan, spring_stiffness=math.nan)
    found = judge(make_event(point=point), iso, PROFILE)
    assert found.verdict is Verdict.PASS
    assert found.reasons[-1] == "Not stated: robot, speed, stiffness of the device's spring."


def test_free_contact_is_judged_by_the_fixed_reading_and_says_so(make_event, make_point, iso):
    free = judge(make_event(290.0, point=make_point(contact=FREE)), iso, PROFILE)
    fixed = judge(make_event(290.0, point=make_point(contact=CONSTRAINED)), iso, PROFILE)
    assert free.verdict is fixed.verdict is Verdict.FAIL
    assert any('m_H / (m_H + m_R)' in reason for reason in free.reasons)
    assert not any('m_R' in reason for reason in fixed.reasons)


def test_a_spring_that_is_too_soft_cannot_pass_and_a_stiff_one_is_noted(
    make_event, make_point, iso
):
    def found(stiffness, peak=100.0):
        point = make_point(spring_stiffness=stiffness)
        return judge(make_event(peak, point=point), iso, PROFILE)

    assert found(69e3).verdict is Verdict.PASS  # the paper's spring, sold as 75 N/mm
    assert found(60e3).verdict is Verdict.INVALID
    assert 'softer than the 75 N/mm for hands and fingers' in found(60e3).reasons[0]
    assert found(60e3, peak=400.0).verdict is Verdict.FAIL
    assert found(150e3).verdict is Verdict.PASS
    assert any('stiffer' in reason for reason in found(150e3).reasons)


# Diagnostics never change a verdict.
def test_the_validity_statement_says_how_far_the_sensor_misreads(make_event, iso):
    def statement(width, damping=0.07):
        sensor = SensorParameters(
            1, 0, True, natural_frequency=Estimate(32.37), damping_ratio=Estimate(damping)
        )
        event = make_event(100.0, width=width)
        found = judge(event, iso, PROFILE, sensor=sensor)
        assert found.verdict is judge(event, iso, PROFILE).verdict
        return next(reason for reason in found.reasons if reason.startswith('Validity'))

    assert 'under-reads, by a factor of 0.57' in statement(0.005)
    assert 'over-reads, by a factor of 1.60' in statement(0.0255)
    assert 'under-reads, by a factor of 0.81' in statement(0.030, damping=1.0)
    assert '30.0 ms' in statement(0.030)


@pytest.mark.parametrize(
    'sensor',
    [
        None,
        SensorParameters(1, 0, False, natural_frequency=Estimate(32.0)),
        SensorParameters(1, 0, True),
        SensorParameters(1, 0, True, natural_frequency=Estimate(0.0), damping_ratio=Estimate(-1)),
    ],
)
def test_an_unknown_sensor_gives_no_statement(make_event, iso, sensor):
    found = judge(make_event(), iso, PROFILE, sensor=sensor)
    assert not any(reason.startswith('Validity') for reason in found.reasons)


def test_the_reconstructed_force_is_a_diagnostic(make_event, iso):
    impact = ImpactParameters(1, 0, True, peak_contact_force=Estimate(500.0, 3.0))
    found = judge(make_event(200.0), iso, PROFILE, impact=impact)
    assert found.verdict is Verdict.PASS
    assert found.reconstructed_peak_force == 500.0
    assert any('300.0 N above the reading' in reason for reason in found.reasons)
    wrong = dataclasses.replace(impact, valid=False)
    assert math.isnan(judge(make_event(), iso, PROFILE, impact=wrong).reconstructed_peak_force)


# Properties.
peaks = st.floats(4, 2000)
flags = st.integers(0, 1023).map(Quality)
regions = st.sampled_from(
    ['hands_fingers', 'chest', 'abdomen', 'neck', 'face', 'skull_forehead', 'lower_legs']
)


@given(peak=peaks, channel=flags, whole=flags, region=regions)
def test_no_bad_flag_is_ever_passed(make_event, make_point, iso, peak, channel, whole, region):
    point = make_point(body_region=region, spring_stiffness=math.nan)
    event = make_event(peak, channel_quality=channel, quality=whole, point=point)
    verdict = judge(event, iso, PROFILE).verdict
    harmless = Quality.HELD | Quality.TORN  # a record that goes on past the blow shows TORN is
    if (channel | whole) & ~harmless:
        assert verdict in (Verdict.INVALID, Verdict.FAIL)
    if region in ('face', 'skull_forehead'):
        assert verdict is Verdict.FAIL


@given(
    low=peaks,
    factor=st.floats(1, 10),
    whole=flags,
    contact=st.sampled_from(ContactKind),
    guard=st.booleans(),
    plateau=st.floats(0, 1),
)
def test_a_larger_force_never_improves_the_verdict(
    make_event, make_point, iso, low, factor, whole, contact, guard, plateau
):
    profile = dataclasses.replace(PROFILE, guard_band=guard)
    point = make_point(contact=contact)
    ranks = [
        severity(
            judge(
                make_event(peak, plateau=plateau * peak, hold=0.7, quality=whole, point=point),
                iso,
                profile,
            ).verdict
        )
        for peak in (low, low * factor)
    ]
    assert ranks[0] <= ranks[1]


@given(peak=peaks, data=st.data())
@settings(max_examples=60)
def test_a_nan_anywhere_in_the_judged_span_is_never_passed(make_event, iso, peak, data):
    event = make_event(peak, edit=None)
    span = int((0.1 + 0.5) * event.sample_rate)
    at = data.draw(st.sets(st.integers(0, span), min_size=1, max_size=5))
    event.values[0, list(at)] = data.draw(st.sampled_from([np.nan, np.inf, -np.inf]))
    assert judge(event, iso, PROFILE).verdict in (Verdict.INVALID, Verdict.FAIL)


@given(peak=peaks, scale=st.floats(0.2, 5))
def test_force_and_limits_scaled_alike_give_the_same_verdict(
    make_event, make_point, iso, iso_mapping, peak, scale
):
    import copy

    from impactscope.comply.limits import LimitSet

    mapping = copy.deepcopy(iso_mapping)
    mapping['regions']['hands_fingers']['quasi_static_force'] = 140 * scale
    scaled = LimitSet.from_mapping(mapping)
    profile = dataclasses.replace(PROFILE, contact_end_force=0.0)
    near = [280 * edge + sign for edge in (0.97, 1.0, 1.03) for sign in (-0.5, 0.5)]
    for force in (peak, *near):
        plain = judge(make_event(force, noise=0.0, zero=0.0), iso, profile)
        other = judge(make_event(force * scale, noise=0.0, zero=0.0), scaled, profile)
        assert plain.verdict is other.verdict


def test_worst_follows_the_order_of_severity():
    assert worst([]) is Verdict.INCOMPLETE
    for place, verdict in enumerate(SEVERITY):
        assert worst(SEVERITY[place:]) is verdict
        assert worst(reversed(SEVERITY[place:])) is verdict
    assert SEVERITY[0] is Verdict.FAIL
    assert SEVERITY[-1] is Verdict.PASS
    assert set(SEVERITY) == set(Verdict)


@pytest.mark.parametrize(
    'values',
    [
        {'force_channel': ''},
        {'minimum_sample_rate': 0.0},
        {'minimum_sample_rate': math.nan},
        {'spring_tolerance': -0.1},
        {'spring_tolerance': math.nan},
        {'required_statements': ('colour',)},
    ],
)
def test_rules_out_of_range_are_refused(values):
    with pytest.raises(ConfigurationError):
        JudgementRules(**values)


def test_a_torn_blow_passes_only_where_its_record_was_seen_through(make_event, iso):
    seen = {'quality': Quality.TORN}
    assert judge(make_event(100.0, **seen), iso, PROFILE).verdict is Verdict.PASS
    short = judge(make_event(100.0, length=0.4, **seen), iso, PROFILE)
    assert short.verdict is Verdict.INVALID
    assert 'began or ended inside the blow' in short.reasons[0]
    event = make_event(100.0, **seen)  # the stream began with the blow
    late = dataclasses.replace(
        event,
        values=event.values[:, 200:],
        contact_start=0.0,
        contact_end=event.contact_end - 0.1,
    )
    assert judge(late, iso, PROFILE).verdict is Verdict.INVALID


def test_a_jump_of_the_clock_counts_whoever_else_saw_it(make_event, iso):
    accelerometer = Channel('acceleration.plate', 'm/s^2', quality=Quality.CLOCK_JUMP)
    event = make_event(100.0, extra=(accelerometer,), quality=Quality.CLOCK_JUMP)
    assert judge(event, iso, PROFILE).verdict is Verdict.INVALID


def test_only_what_is_beyond_doubt_fails_an_unsound_blow_whatever_the_profile_says(
    make_event, iso
):
    plain = dataclasses.replace(PROFILE, guard_band=False)
    assert judge(make_event(284.0), iso, plain).verdict is Verdict.FAIL
    clipped = make_event(284.0, quality=Quality.CLIPPED)
    assert judge(clipped, iso, plain).verdict is Verdict.INVALID
    clipped = make_event(300.0, quality=Quality.CLIPPED)
    assert judge(clipped, iso, plain).verdict is Verdict.FAIL


def test_a_force_beside_the_reference_channel_is_judged_on_the_grid(make_event, iso):
    event = make_event(300.0, extra=(Channel('acceleration.plate', 'm/s^2'),), oversampling=2)
    turned = dataclasses.replace(
        event,
        channels=event.channels[::-1],
        values=event.values[::-1],
        zero_level=event.zero_level[::-1],
        noise_std=event.noise_std[::-1],
    )
    found = judge(turned, iso, PROFILE)
    assert found.verdict is Verdict.FAIL
    assert found.transient_force.value == pytest.approx(300, abs=1e-3)
    assert any('on the common grid' in reason for reason in found.reasons)
