from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.detect import DetectorSettings, ImpactDetector
from impactscope.errors import InputError
from impactscope.measurement_profile import MeasurementProfile
from impactscope.records import Channel, ImpactEvent, Quality, SyncedBlock, TestPoint

RATE = 5000.0
NATURAL = 203.2  # rad/s
DAMPING = 0.07


def ring_down(t, amplitude, frequency=NATURAL, damping=DAMPING):
    """Free oscillation from separation at t = 0, moving in from zero."""
    damped = frequency * math.sqrt(1 - damping**2)
    wave = amplitude * np.exp(-damping * frequency * t) * np.sin(damped * t)
    return np.where(t >= 0, wave, 0.0)


def pulse(t, duration, peak):
    return np.where((t >= 0) & (t <= duration), peak * np.sin(np.pi * t / duration), 0.0)


def noise(n, sigma, seed=0):
    return np.random.default_rng(seed).normal(0.0, sigma, n)


def time_axis(duration, rate=RATE):
    return np.arange(round(duration * rate)) / rate


def blocks(values, cuts=None, *, rate=RATE, epoch=0, first=0, channels=None, oversampling=1):
    values = np.atleast_2d(np.asarray(values)).astype(np.float32)
    channels = channels or (Channel('force', 'N'),)
    step = round(rate / 50)
    edges = [0, *(cuts or range(step, values.shape[1], step)), values.shape[1]]
    for start, stop in itertools.pairwise(edges):
        if stop > start:
            yield SyncedBlock(
                stamp_ns=1_000_000_000 + round((first + start) * 1e9 / rate),
                sample_rate=rate,
                epoch=epoch,
                first_index=first + start,
                channels=channels,
                values=values[:, start:stop],
                oversampling=oversampling,
            )


def detect(values, cuts=None, *, detector=None, flush=True, **keywords) -> list[ImpactEvent]:
    detector = detector or ImpactDetector()
    events = [e for block in blocks(values, cuts, **keywords) for e in detector.push(block)]
    return events + (detector.flush() if flush else [])


def identical(a: ImpactEvent, b: ImpactEvent) -> bool:
    names = [n for n in ImpactEvent.__slots__ if n != 'values']
    return np.array_equal(a.values, b.values, equal_nan=True) and all(
        repr(getattr(a, n)) == repr(getattr(b, n)) for n in names
    )


def test_a_blow_is_one_event_with_pre_trigger_and_ring_down():
    t = time_axis(3.0)
    force = pulse(t - 1, 0.012, 80) + ring_down(t - 1.012, 60) + noise(t.size, 0.3) + 4.0
    (event,) = detect(force)
    assert event.quality is Quality.NONE
    assert event.event_id == 1
    assert event.stamp_ns == pytest.approx(2_000_000_000, abs=1_000_000)
    assert event.contact_start == pytest.approx(0.1, abs=0.001)
    assert event.window_start_ns + round(event.contact_start * 1e9) == event.stamp_ns
    assert event.zero_level[0] == pytest.approx(4.0, abs=0.05)
    assert event.noise_std[0] == pytest.approx(0.3, rel=0.05)
    assert event.rest_level == pytest.approx(0.0, abs=0.1)
    # 60 N fall to the noise of a 10 ms window's mean at exp(-zeta w t) = 0.3 / 7 / 60.
    decay = math.log(60 / (0.3 / math.sqrt(50))) / (DAMPING * NATURAL)
    assert event.event_end - event.contact_start == pytest.approx(decay, abs=0.15)
    window = event.values.shape[1] / RATE
    assert window == pytest.approx(event.event_end + MeasurementProfile().rest_hold, abs=0.011)
    assert np.array_equal(
        event.values[0],
        force.astype(np.float32)[round((event.window_start_ns / 1e9 - 1) * RATE) :][
            : event.values.shape[1]
        ],
    )


@given(st.lists(st.integers(1, 14_999), max_size=40))
@settings(max_examples=25, deadline=None)
def test_events_do_not_depend_on_how_the_stream_is_cut(cuts):
    t = time_axis(3.0)
    second = 1.3 + 0.001
    force = pulse(t - second, 0.012, 80) + ring_down(t - second - 0.012, 60)
    values = np.stack([force + noise(t.size, 0.3), noise(t.size, 1.0, 1)])
    channels = (Channel('force', 'N'), Channel('acceleration.plate', 'm/s^2'))
    whole = detect(values, [], channels=channels)
    cut = detect(values, sorted(set(cuts)), channels=channels)
    assert len(whole) == len(cut) == 1
    assert identical(whole[0], cut[0])


def test_an_event_comes_out_of_the_push_that_completes_it():
    t = time_axis(3.0)
    force = pulse(t - 1, 0.012, 80) + ring_down(t - 1.012, 60) + noise(t.size, 0.3)
    detector = ImpactDetector()
    for block in blocks(force):
        for event in detector.push(block):
            end = event.window_start_ns + event.values.shape[1] * 1e9 / RATE
            block_start = block.stamp_ns
            assert block_start - 1 <= end <= block_start + block.values.shape[1] * 1e9 / RATE + 1
            return
    pytest.fail('no event')


def test_noise_with_outliers_is_no_blow():
    rng = np.random.default_rng(5)
    force = rng.normal(0, 1, 60 * 5000)
    force[rng.integers(0, force.size, 300)] += rng.choice([-50.0, 50.0], 300)
    assert detect(force) == []


def test_slow_drift_is_followed():
    t = time_axis(30.0)
    force = 20 * np.sin(2 * np.pi * t / 40) + noise(t.size, 1.0) + pulse(t - 20, 0.015, 10)
    (event,) = detect(force)
    assert event.stamp_ns == pytest.approx(21_000_000_000, abs=5_000_000)
    assert event.zero_level[0] == pytest.approx(20 * math.sin(math.pi), abs=0.3)


def test_ring_down_half_waves_are_no_contacts_and_a_bounce_is():
    t = time_axis(3.0)
    force = pulse(t - 1, 0.012, 80) + ring_down(t - 1.012, -60) + noise(t.size, 0.2)
    (event,) = detect(force)
    assert len(event.contacts) == 1
    bounce = force + pulse(t - 1.15, 0.012, 50) + ring_down(t - 1.162, -40)
    (event,) = detect(bounce)
    assert len(event.contacts) == 2
    assert event.contacts[1].start == pytest.approx(0.25, abs=0.004)


def resting(t, weight):
    """A blow after which the impactor stays on the plate, swinging about its weight."""
    late = np.maximum(t - 0.012, 0)
    swing = np.exp(-20 * late) * np.cos(150 * late)
    return np.where(t >= 0.012, weight * (1 - swing), 0.0) + pulse(t, 0.012, 80)


def test_a_weight_that_stays_is_held_and_its_removal_is_no_blow():
    t = time_axis(12.0)
    force = resting(t - 1, 8.0) + noise(t.size, 0.3)
    gone = t >= 8.0
    force[gone] -= 8.0 * (1 - np.exp(-14 * (t[gone] - 8)) * np.cos(203 * (t[gone] - 8)))
    force += pulse(t - 10, 0.012, 60)
    first, second = detect(force)
    assert Quality.HELD in first.quality
    assert first.contact_end - first.contact_start == pytest.approx(5.0, abs=1e-9)
    assert first.rest_level == pytest.approx(8.0, abs=0.1)
    assert Quality.HELD not in second.quality
    assert second.stamp_ns == pytest.approx(11_000_000_000, abs=3_000_000)
    assert second.zero_level[0] == pytest.approx(0.0, abs=0.1)


def test_a_slip_of_the_plate_below_the_contact_force_is_no_blow():
    t = time_axis(6.0)
    force = np.where(t > 2, 0.8, 0.0) + noise(t.size, 0.05) + pulse(t - 4, 0.012, 50)
    detector = ImpactDetector()
    (event,) = detect(force, detector=detector)
    assert event.stamp_ns == pytest.approx(5_000_000_000, abs=2_000_000)
    assert event.zero_level[0] == pytest.approx(0.8, abs=0.02)
    assert detector.statistics.without_contact == 1


def test_clamping_for_seconds_is_one_contact():
    t = time_axis(6.0)
    push = np.interp(t, [1.0, 1.1, 1.3, 3.8, 3.85], [0, 180, 120, 110, 0])
    (event,) = detect(push + noise(t.size, 0.5))
    (contact,) = event.contacts
    assert contact.end - contact.start == pytest.approx(2.85, abs=0.005)
    assert contact.peak_force == pytest.approx(180, abs=2)
    assert event.quality is Quality.NONE


def test_a_new_blow_before_rest_overlaps():
    profile = MeasurementProfile(longest_ring_down=4.0)
    t = time_axis(6.0)
    slow = {'frequency': NATURAL, 'damping': 0.01}
    force = pulse(t - 1, 0.012, 80) + ring_down(t - 1.012, 60, **slow) + noise(t.size, 0.05)
    force += pulse(t - 2.2, 0.012, 80) + ring_down(t - 2.212, 60, **slow)
    first, second = detect(force, detector=ImpactDetector(profile=profile))
    assert Quality.OVERLAPPING in first.quality
    assert Quality.OVERLAPPING in second.quality


def test_the_end_of_the_stream_tears_an_open_event():
    t = time_axis(1.05)
    force = pulse(t - 1, 0.012, 80) + ring_down(t - 1.012, 60) + noise(t.size, 0.3)
    (event,) = detect(force)
    assert Quality.TORN in event.quality
    detector = ImpactDetector()
    assert detect(force, detector=detector, flush=False) == []
    end = SyncedBlock(0, RATE, 0, t.size, (Channel('force', 'N'),), np.empty((1, 0), np.float32))
    assert Quality.TORN in detector.push(end)[0].quality


def test_a_new_epoch_closes_an_open_event_and_learns_anew():
    t = time_axis(1.05)
    force = pulse(t - 1, 0.012, 80) + ring_down(t - 1.012, 60) + noise(t.size, 0.3)
    detector = ImpactDetector()
    assert detect(force, detector=detector, flush=False) == []
    events = detect(noise(5000, 5.0) + 100, detector=detector, epoch=1)
    assert [e.quality for e in events] == [Quality.TORN]


def test_cold_start():
    t = time_axis(1.0, 25600.0)
    force = pulse(t - 0.0007, 0.0004, 80) + noise(t.size, 0.02)
    (event,) = detect(force, rate=25600.0)
    assert event.quality is Quality.COLD_START
    assert event.contact_start == pytest.approx(0.0007, abs=1e-4)
    assert event.noise_std[0] == pytest.approx(0.02, rel=0.1)


def test_a_channel_still_ringing_at_the_end_of_the_stream_is_torn_by_itself():
    t = time_axis(1.0, 25600.0)
    force = pulse(t - 0.0007, 0.0004, 80) + noise(t.size, 0.02)
    answer = 300 * np.exp(-7 * t) * np.sin(2 * np.pi * 900 * t) * (t > 0.0007)
    channels = (Channel('force.hammer', 'N'), Channel('acceleration.structure', 'm/s^2'))
    values = np.stack([force, answer + noise(t.size, 0.01, 1)])
    (event,) = detect(values, rate=25600.0, channels=channels)
    assert event.quality is Quality.COLD_START
    assert event.channels[1].quality is Quality.TORN
    assert event.values.shape[1] == t.size
    assert math.isnan(event.noise_std[1])
    assert event.event_end < 0.1


def test_a_stream_that_begins_inside_a_blow_is_torn():
    t = time_axis(1.5)
    force = pulse(t + 0.006, 0.012, 80) + ring_down(t - 0.006, 60) + noise(t.size, 0.3)
    (event,) = detect(force)
    assert event.quality == Quality.COLD_START | Quality.TORN
    assert event.contact_start == 0


def test_gap_clipping_and_missing_channels_are_flagged():
    t = time_axis(3.0)
    force = pulse(t - 1, 0.012, 80) + ring_down(t - 1.012, 60) + noise(t.size, 0.3)
    plate = np.full(t.size, np.nan)
    channels = (
        Channel('force', 'N', range_min=-70.0, range_max=70.0),
        Channel('acceleration.plate', 'm/s^2'),
    )
    force = np.clip(force, -70, 70)
    (event,) = detect(np.stack([force, plate]), channels=channels)
    assert event.quality == Quality.CLIPPED
    assert event.channels[1].quality == Quality.MISSING
    assert math.isnan(event.zero_level[1])
    force[5100:5110] = np.nan
    (event,) = detect(force)
    assert event.quality == Quality.MISSING


def test_lost_samples_are_bridged_with_nan_and_flagged():
    t = time_axis(3.0)
    force = pulse(t - 1, 0.012, 80) + ring_down(t - 1.012, 60) + noise(t.size, 0.3)
    detector = ImpactDetector()
    events = detect(force[:5200], detector=detector, flush=False)
    events += detect(force[5250:], detector=detector, first=5250)
    (event,) = events
    assert event.quality == Quality.GAP_BEFORE
    assert np.isnan(event.values).sum() == 50
    assert detector.statistics.lost == 50
    assert event.values.shape[1] / RATE > event.event_end


def test_a_clock_jump_is_flagged():
    t = time_axis(3.0)
    force = pulse(t - 1, 0.012, 80) + ring_down(t - 1.012, 60) + noise(t.size, 0.3)
    detector = ImpactDetector()
    events = []
    for block in blocks(force):
        late = block.first_index >= 5200
        moved = SyncedBlock(
            block.stamp_ns + 50_000_000 * late, *[getattr(block, n) for n in block.__slots__[1:]]
        )
        events += detector.push(moved)
    assert [e.quality for e in events] == [Quality.CLOCK_JUMP]


def test_the_latest_test_point_that_holds_is_taken():
    t = time_axis(3.0)
    force = pulse(t - 1, 0.012, 80) + ring_down(t - 1.012, 60) + noise(t.size, 0.3)
    detector = ImpactDetector()
    detector.take_test_point(TestPoint(id='a', start_ns=0))
    detector.take_test_point(TestPoint(id='b', start_ns=1_500_000_000))
    detector.take_test_point(TestPoint(id='c', start_ns=2_500_000_000))
    detector.take_test_point(TestPoint(id='a', start_ns=0, end_ns=1_400_000_000))
    (event,) = detect(force, detector=detector)
    assert event.test_point.id == 'b'


def test_the_trigger_channel_by_name_and_either_sign():
    t = time_axis(3.0)
    push = -pulse(t - 1, 0.005, 30) + noise(t.size, 0.3)
    channels = (Channel('force', 'N'), Channel('acceleration.plate', 'm/s^2'))
    chosen = DetectorSettings(channel='acceleration.plate', polarity=0)
    (event,) = detect(
        np.stack([noise(t.size, 1.0, 3), push]),
        channels=channels,
        detector=ImpactDetector(chosen),
    )
    assert [c.name for c in event.channels] == ['acceleration.plate', 'force']
    assert event.contact_start == pytest.approx(0.1, abs=0.001)


def test_raw_samples_stand_at_multiples_of_the_oversampling():
    t = time_axis(3.0)
    force = pulse(t - 1, 0.012, 80) + ring_down(t - 1.012, 60) + noise(t.size, 0.3)
    plain = detect(force)[0]
    fine = np.repeat(force, 4)
    fine[1::4] = np.nan
    event = detect(fine, rate=4 * RATE, oversampling=4)[0]
    assert event.oversampling == 4
    assert np.array_equal(event.values[0, ::4][: plain.values.shape[1]], plain.values[0])
    assert event.contacts[0].start == pytest.approx(plain.contacts[0].start, abs=1e-12)
    assert event.contacts[0].impulse == plain.contacts[0].impulse


def test_a_block_that_contradicts_itself_is_refused():
    block = SyncedBlock(0, RATE, 0, 0, (Channel('a', 'N'),), np.zeros((2, 5), np.float32))
    with pytest.raises(InputError, match='2 rows for 1 channels'):
        ImpactDetector().push(block)


def test_memory_is_bounded():
    detector = ImpactDetector()
    rng = np.random.default_rng(1)
    chunk = rng.normal(0, 1, 100).astype(np.float32)
    for i in range(3000):
        detector.push(
            SyncedBlock(round(i * 2e7), RATE, 0, i * 100, (Channel('f', 'N'),), chunk[None])
        )
    assert detector._scan._history.values.size < 4 * 8192


def swing(duration, *, rate=1000.0, period=0.65, amplitude=1.2, decay=0.3, start=0.0, phase=0.7):
    t = time_axis(duration, rate)
    wave = amplitude * np.exp(-decay * (t - start)) * np.cos(2 * np.pi * (t - start) / period)
    wave = np.where(t >= start, wave, amplitude)
    if start == 0.0:
        wave = amplitude * np.exp(-decay * t) * np.cos(2 * np.pi * t / period + phase)
    return np.round(wave / 0.005) * 0.005  # steps of an encoder


ANGLE = (Channel('displacement.angle', 'rad'),)


@pytest.mark.parametrize('phase', [0.0, 0.7, 1.6, 3.14, 4.5])
def test_a_swing_that_runs_from_the_start_is_followed_to_its_end(phase):
    """Where it turns it looks quiet for a moment; that is neither rest nor noise."""
    values = swing(5.0, phase=phase)
    (event,) = detect(values, rate=1000.0, channels=ANGLE)
    assert Quality.COLD_START in event.quality
    assert Quality.TORN in event.quality
    assert event.values.shape[1] > 4300
    assert event.noise_std[0] < 0.01
    assert abs(event.zero_level[0]) < 0.3
    assert len(event.contacts) == 1  # further half-waves press on nothing


def test_a_swing_let_go_after_quiet_is_followed_to_rest():
    values = swing(14.0, start=1.0, decay=1.5)
    events = detect(values, rate=1000.0, channels=ANGLE, detector=swinging())
    assert len(events) == 1
    assert events[0].event_end - events[0].contact_start > 2.0
    assert not events[0].quality & (Quality.TORN | Quality.COLD_START)


def swinging():
    return ImpactDetector(DetectorSettings(polarity=0))


def test_a_swing_without_end_is_cut_and_memory_stays_bounded():
    profile = MeasurementProfile()
    values = swing(40.0, decay=0.0)
    events = detect(values, rate=1000.0, channels=ANGLE, detector=swinging())
    longest = profile.longest_hold + profile.longest_ring_down + profile.pre_trigger
    assert events
    assert all(event.values.shape[1] <= 1000 * (longest + 0.2) for event in events)


@given(st.lists(st.integers(1, 4999), max_size=20, unique=True).map(sorted))
@settings(max_examples=15, deadline=None)
def test_a_swing_does_not_depend_on_how_the_stream_is_cut(cuts):
    values = swing(5.0)
    (whole,) = detect(values, rate=1000.0, channels=ANGLE)
    (event,) = detect(values, cuts, rate=1000.0, channels=ANGLE)
    assert np.array_equal(event.values, whole.values)
    assert event.contacts == whole.contacts
    assert event.zero_level == whole.zero_level
