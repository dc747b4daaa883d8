"""What the fitter says of a blow, and when it says that the blow cannot tell."""

import dataclasses
import math
import re

import numpy as np
import pytest
from scipy.signal import lfilter

from impactscope.errors import ConfigurationError
from impactscope.estimate.sensor_parameters import FitterSettings, estimate_sensor
from impactscope.records import Channel, Contact, ImpactEvent, Quality, TestPoint

MASS, STIFFNESS, DAMPING = 1.67, 69_000.0, 0.07  # the paper's sensor
WN = math.sqrt(STIFFNESS / MASS)
FREQUENCY = WN / (2 * math.pi)
SPRING = TestPoint(spring_stiffness=STIFFNESS, spring_stiffness_std=700.0)


def reading(force, rate):
    """Spring force of the plate under a contact force (eq. 24), for held samples."""
    wd = WN * math.sqrt(1 - DAMPING**2)
    e = math.exp(-DAMPING * WN / rate)
    c, s = math.cos(wd / rate), math.sin(wd / rate) * DAMPING * WN / wd
    return lfilter([0, 1 - e * (c + s), e * e + e * (s - c)], [1, -2 * e * c, e * e], force)


def tap(rate=1000.0, noise=0.4, seed=1, duration=1.5, **changes):
    """An event: a tap of 5 ms at 0.1 s, contact read until the spring force first vanishes."""
    fine = 10_000.0
    time = np.arange(int(duration * fine)) / fine
    inside = (time > 0.1) & (time < 0.105)
    force = reading(np.where(inside, 400 * np.sin(math.pi * (time - 0.1) / 0.005), 0), fine)
    end = float(time[np.flatnonzero((time > 0.11) & (force <= 0))[0]])
    values = force[:: int(fine / rate)]
    values = values + noise * np.random.default_rng(seed).normal(size=values.size)
    event = ImpactEvent(
        event_id=7,
        stamp_ns=100_000_000,
        window_start_ns=0,
        sample_rate=rate,
        channels=(Channel('force', 'N', native_rate=rate),),
        values=values.astype(np.float32)[None],
        contacts=(Contact(0.1, end, float(values.max()), 0.11, 1.0),),
        contact_start=0.1,
        contact_end=end,
        event_end=duration,
        zero_level=(0.0,),
        noise_std=(noise,),
        rest_level=0.0,
        test_point=SPRING,
    )
    return dataclasses.replace(event, **changes)


def test_sensor_of_the_paper():
    result = estimate_sensor(tap())
    assert result.valid, result.reason
    assert result.reason == ''
    assert (result.event_id, result.stamp_ns, result.channel) == (7, 100_000_000, 'force')
    for estimate, truth in (
        (result.natural_frequency, FREQUENCY),
        (result.damping_ratio, DAMPING),
        (result.moving_mass, MASS),
        (result.damping_constant, 2 * DAMPING * MASS * WN),
        (result.stiffness, STIFFNESS),
        (result.spectral_damping_ratio, DAMPING),
    ):
        assert abs(estimate.value - truth) < 4 * estimate.std + 1e-9 * truth
        assert estimate.std < 0.4 * truth
    # The stiffness's 1 % is nearly all of the mass's uncertainty.
    assert result.moving_mass.std == pytest.approx(MASS * 700 / STIFFNESS, rel=0.05)
    assert result.bandwidth.value == pytest.approx(1.548 * FREQUENCY, rel=0.01)
    assert result.span_start >= result.span_end - 1.4
    assert tap().contact_end <= result.span_start < tap().contact_end + 0.002
    assert result.span_end <= 1.5
    assert result.rmse == pytest.approx(0.4, rel=0.1)


def test_intervals_cover():
    covered = []
    for seed in range(150):
        r = estimate_sensor(tap(seed=seed, noise=2.0))
        assert r.valid
        covered.append(
            (
                abs(r.natural_frequency.value - FREQUENCY) < 1.96 * r.natural_frequency.std,
                abs(r.damping_ratio.value - DAMPING) < 1.96 * r.damping_ratio.std,
            )
        )
    assert (np.mean(covered, axis=0) > 0.89).all()


def test_stiffness_from_the_settings_where_the_test_point_states_none():
    settings = FitterSettings(spring_stiffness=75_000.0, spring_stiffness_std=1500.0)
    result = estimate_sensor(tap(test_point=TestPoint()), settings)
    assert result.stiffness == (75_000.0, 1500.0)
    assert result.moving_mass.value == pytest.approx(75 / 69 * MASS, rel=0.01)
    assert estimate_sensor(tap(), settings).stiffness.value == STIFFNESS


def test_unknown_stiffness_gives_frequency_but_no_mass():
    result = estimate_sensor(tap(test_point=TestPoint()))
    assert result.valid
    assert math.isnan(result.moving_mass.value)
    assert math.isnan(result.damping_constant.value)
    assert result.natural_frequency.std < 0.1


def test_stiffness_without_uncertainty_gives_a_mass_without():
    result = estimate_sensor(tap(test_point=TestPoint(spring_stiffness=STIFFNESS)))
    assert result.moving_mass.value == pytest.approx(MASS, rel=0.01)
    assert math.isnan(result.moving_mass.std)


def test_interpolated_samples_do_not_count():
    """A force of 1 kHz on a grid of 4 kHz tells as much as on its own."""
    own = tap(noise=1.0)
    coarse = own.values[0].astype(float)
    spectrum = np.fft.rfft(coarse)
    fine = 4 * np.fft.irfft(np.r_[spectrum, np.zeros(2 * coarse.size - spectrum.size + 1)])
    fine = fine[: 4 * coarse.size]
    gridded = tap(
        sample_rate=4000.0,
        values=fine.astype(np.float32)[None],
        channels=(Channel('force', 'N', native_rate=1000.0),),
    )
    a, b = estimate_sensor(own), estimate_sensor(gridded)
    assert b.natural_frequency.std == pytest.approx(a.natural_frequency.std, rel=0.2)
    assert b.natural_frequency.value == pytest.approx(a.natural_frequency.value, abs=0.05)


def test_named_channel():
    event = tap()
    both = dataclasses.replace(
        event,
        channels=(Channel('acceleration.plate', 'm/s^2'), Channel('force.2', 'N')),
        values=np.vstack([np.zeros_like(event.values), event.values]),
    )
    assert estimate_sensor(both, FitterSettings(channel='force.2')).valid
    missing = estimate_sensor(both, FitterSettings(channel='force.3'))
    assert not missing.valid
    assert 'force.3' in missing.reason


def with_values(change, **changes):
    event = tap()
    values = event.values.copy()
    change(values[0], event.contact_end)
    return dataclasses.replace(event, values=values, **changes)


def silence(row, end):
    row[int(end * 1000) :] = np.random.default_rng(5).normal(size=row.size - int(end * 1000))


def add_second_mode(row, end):
    time = np.arange(row.size) / 1000 - end
    row += np.where(time > 0, 60 * np.exp(-14 * time) * np.cos(2 * math.pi * 110 * time), 0)


def put_nan(row, end):
    row[int(end * 1000) + 100] = math.nan


CANNOT = {
    'held': (lambda: tap(quality=Quality.HELD), 'stayed on the plate'),
    'resting': (lambda: tap(rest_level=8.0), 'rests on the plate'),
    'silent': (lambda: with_values(silence), 'noise'),
    'second mode': (lambda: with_values(add_second_mode), '2 modes ring'),
    'missing': (lambda: with_values(put_nan), 'missing'),
    'clipped': (
        lambda: tap(channels=(Channel('force', 'N', range_min=-90.0, range_max=500.0),)),
        'clipped',
    ),
    'short': (lambda: tap(duration=0.17), 'periods|samples|tells too little'),
    'nothing after': (lambda: tap(contact_end=1.499), 'samples'),
    'contact end unknown': (lambda: tap(contact_end=math.nan), 'samples'),
    'no rate': (lambda: tap(sample_rate=0.0), 'rate'),
    'no channel': (lambda: tap(channels=(), values=np.zeros((0, 1500), np.float32)), 'channel'),
    'no samples': (lambda: tap(values=np.zeros((1, 0), np.float32)), 'samples'),
    'constant': (lambda: tap(values=np.zeros((1, 1500), np.float32)), 'vary'),
}


@pytest.mark.parametrize('case', CANNOT)
def test_cannot_tell(case):
    make, words = CANNOT[case]
    event = make()
    result = estimate_sensor(event)
    assert not result.valid
    assert re.search(words, result.reason), result.reason
    assert math.isnan(result.moving_mass.value)
    assert math.isnan(result.bandwidth.value)


def test_an_angle_oscillates_without_stiffness_or_load():
    """A level in rad is no weight on the plate, and a spring in N/m says nothing of an angle."""
    result = estimate_sensor(tap(channels=(Channel('angle', 'rad'),), rest_level=8.0))
    assert result.valid
    assert result.natural_frequency.value == pytest.approx(FREQUENCY, rel=0.01)
    assert math.isnan(result.stiffness.value)
    assert math.isnan(result.moving_mass.value)


def test_several_modes_are_given_one_by_one():
    result = estimate_sensor(with_values(add_second_mode))
    assert not result.valid
    found = sorted(mode.natural_frequency for mode in result.modes)
    truth = ((FREQUENCY, DAMPING), (110.02, 14 / (2 * math.pi * 110.02)))
    for mode, (frequency, damping) in zip(
        sorted(result.modes, key=lambda m: m.natural_frequency), truth, strict=True
    ):
        assert abs(mode.natural_frequency.value - frequency) < 4 * mode.natural_frequency.std
        assert abs(mode.damping_ratio.value - damping) < 4 * mode.damping_ratio.std
    assert result.natural_frequency in found
    assert result.r_squared > 0.98


def test_a_hammer_makes_the_other_channels_ring():
    """The response is fitted, not the blow; a channel that is named is taken by its name."""
    event = tap()
    pulse = np.zeros_like(event.values)
    pulse[0, 100:110] = 50.0
    struck = dataclasses.replace(
        event,
        channels=(Channel('force.hammer', 'N'), Channel('acceleration.plate', 'm/s^2')),
        values=np.vstack([pulse, event.values]),
    )
    result = estimate_sensor(struck)
    assert result.valid
    assert result.channel == 'acceleration.plate'
    assert not estimate_sensor(struck, FitterSettings(channel='force.hammer')).valid


def test_a_swing_of_large_angles_says_how_it_depends_on_the_amplitude():
    """A pendulum from 1.2 rad, integrated: its small swings are at 1.5 Hz."""
    rate, w, decay = 1000.0, 2 * math.pi * 1.5, 0.35
    angle, speed, values = 1.2, 0.0, []
    for _ in range(5000):
        values.append(angle)
        for _ in range(10):
            speed -= (w**2 * math.sin(angle) + 2 * decay * speed) / (10 * rate)
            angle += speed / (10 * rate)
    noisy = np.array(values) + 1e-3 * np.random.default_rng(2).normal(size=5000)
    event = tap(
        values=noisy.astype(np.float32)[None],
        channels=(Channel('displacement.angle', 'rad'),),
        contacts=(Contact(0.0, 0.2, 1.2, 0.0, 0.1),),
        contact_start=0.0,
        contact_end=0.2,
        event_end=5.0,
    )
    result = estimate_sensor(event)
    assert result.linearity_p_value < 1e-6
    assert result.frequency_slope.value < -10 * result.frequency_slope.std
    assert result.small_amplitude_frequency.value == pytest.approx(1.5, rel=0.01)
    assert abs(result.natural_frequency.value - 1.5) < 2 * result.natural_frequency.std


@pytest.mark.parametrize('friction', [0.3, 1.0, 4.0])
def test_dry_friction_is_no_confident_wrong_number(friction):
    """Exact decay of a plate with Coulomb friction in N in its guide, let go at 60 N."""
    damping, rate = 0.07, 1000.0
    wd = WN * math.sqrt(1 - damping**2)
    half = math.pi / wd
    time = np.arange(1200) / rate
    force, turn, begin = np.zeros(1200), 60.0, 0.0
    while abs(turn) > friction and begin < time[-1]:
        level = math.copysign(friction, turn)
        inside = (time >= begin) & (time < begin + half)
        u = time[inside] - begin
        swing = np.cos(wd * u) + damping * WN / wd * np.sin(wd * u)
        force[inside] = level + (turn - level) * np.exp(-damping * WN * u) * swing
        turn = level - (turn - level) * math.exp(-damping * WN * half)
        begin += half
    force[time >= begin] = turn
    for seed in range(10):
        noise = 0.2 * np.random.default_rng(seed).normal(size=1300)
        values = np.r_[np.linspace(0, 60, 100), force] + noise
        event = tap(
            values=values.astype(np.float32)[None],
            contacts=(Contact(0.0, 0.1, 60.0, 0.1, 1.0),),
            contact_end=0.1,
        )
        result = estimate_sensor(event)
        assert result.r_squared > 0.95
        assert result.damping_ratio.value > 1.1 * damping
        if friction > 3:  # over in two swings: nothing shows how the damping varies
            assert not result.valid
            assert math.isnan(result.damping_ratio.std)
            assert 'linear' in result.reason
        else:
            assert result.damping_ratio.value - damping < 2 * result.damping_ratio.std


def test_overlapping_event_uses_nothing_of_the_next():
    event = tap(noise=0.2)
    values = event.values.copy()
    values[0, 700:] += 300
    spoilt = dataclasses.replace(event, values=values, quality=Quality.OVERLAPPING, event_end=0.69)
    result = estimate_sensor(spoilt)
    assert result.valid
    assert result.span_end < 0.69


@pytest.mark.parametrize(
    'bad',
    [
        {'settle': -1.0},
        {'spring_stiffness': 0.0},
        {'spring_stiffness': -5.0},
        {'least_snr': math.inf},
        {'fewest_periods': math.nan},
    ],
)
def test_settings_out_of_range_are_refused(bad):
    with pytest.raises(ConfigurationError, match=next(iter(bad))):
        FitterSettings(**bad)


def test_fast_sampling_gives_the_figures_of_its_own_samples():
    slow, fast = estimate_sensor(tap(noise=2.0)), estimate_sensor(tap(rate=10_000.0, noise=2.0))
    assert fast.valid
    assert fast.rmse == pytest.approx(2.0, rel=0.03)
    assert fast.r_squared == pytest.approx(slow.r_squared, abs=0.02)
    assert fast.amplitude.value == pytest.approx(slow.amplitude.value, rel=0.02)
    assert fast.damping_ratio.std == pytest.approx(
        slow.damping_ratio.std / math.sqrt(10), rel=0.15
    )
    assert abs(fast.damping_ratio.value - DAMPING) < 4 * fast.damping_ratio.std
    assert fast.span_start == pytest.approx(slow.span_start, abs=0.002)
    assert fast.span_end <= 1.5
