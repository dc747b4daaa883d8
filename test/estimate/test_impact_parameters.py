import dataclasses
import functools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from impactscope.errors import ConfigurationError
from impactscope.estimate.impact_parameters import (
    ImpactEstimator,
    ImpactSettings,
    estimate_impact,
    reconstruct_contact_force,
)
from impactscope.physics.pendulum import Pendulum
from impactscope.physics.sensor_model import PAPER_SENSOR as SENSOR
from impactscope.physics.twin.bench import Bench, PendulumBlow
from impactscope.physics.twin.simulate import simulate
from impactscope.records import (
    Channel,
    Contact,
    Estimate,
    ImpactEvent,
    Quality,
    SensorParameters,
    TestPoint,
)

RATE = 10_000.0
BEFORE = 0.1
MASS, SPEED, LAYER, LAYER_DAMPING = 3.0, 0.5, 60e3, 60.0
KNOWN = SensorParameters(
    1,
    0,
    True,
    natural_frequency=Estimate(SENSOR.natural_frequency, 0.02),
    damping_ratio=Estimate(SENSOR.damping_ratio, 0.001),
    stiffness=Estimate(SENSOR.stiffness, 300.0),
)


@functools.cache
def simulated(mass=MASS, speed=SPEED, push=0.0, duration=0.4, layer=LAYER):
    """Impactor on a Kelvin layer on the sensor; pushes only. Time, f_i, f_o, accelerations."""

    def contact(y):
        squeeze, rate = y[2] - y[0], y[3] - y[1]
        return np.where(squeeze > 0, np.maximum(layer * squeeze + LAYER_DAMPING * rate, 0), 0)

    def rates(_t, y):
        f = contact(y)
        plate = (f - SENSOR.damping_constant * y[1] - SENSOR.stiffness * y[0]) / SENSOR.mass
        return [y[1], plate, y[3], (push - f) / mass]

    time = np.arange(0, duration, 1 / RATE)
    y = solve_ivp(
        rates, (0, duration), [0, 0, 0, speed], t_eval=time, max_step=1e-4, rtol=1e-8, atol=1e-11
    ).y
    f = contact(y)
    plate = (f - SENSOR.damping_constant * y[1] - SENSOR.stiffness * y[0]) / SENSOR.mass
    return time, f, SENSOR.stiffness * y[0], plate, (push - f) / mass


def blow(seed=0, *, noise=0.4, plate=True, impactor=True, point=None, flip=1.0, **case):
    rng = np.random.default_rng(seed)
    time, f_i, f_o, a_plate, a_impactor = simulated(**case)
    touching = np.flatnonzero(f_i > 0)
    start, end = 0.0, time[touching[-1]]
    quiet = int(BEFORE * RATE)
    rows, channels, stds = [], [], []
    for name, unit, values, std, wanted in (
        ('force', 'N', f_o, noise, True),
        ('acceleration.plate', 'm/s^2', flip * a_plate, 0.08, plate),
        ('acceleration.impactor', 'm/s^2', flip * a_impactor, 0.08, impactor),
    ):
        if wanted:
            whole = np.concatenate((np.zeros(quiet), values))
            rows.append(whole + rng.normal(0, std, whole.size))
            channels.append(Channel(name, unit, native_rate=RATE))
            stds.append(std)
    values = np.array(rows, np.float32)
    inside = values[0, quiet : quiet + touching[-1] + 1]
    contact = Contact(
        BEFORE + start,
        BEFORE + end,
        float(inside.max()),
        BEFORE + inside.argmax() / RATE,
        float(inside.sum() / RATE),
    )
    return ImpactEvent(
        7,
        123,
        0,
        RATE,
        tuple(channels),
        values,
        (contact,),
        contact.start,
        contact.end,
        BEFORE + time[-1],
        (0.0,) * len(rows),
        tuple(stds),
        test_point=point or TestPoint(),
    )


def test_everything_is_told_with_both_accelerometers():
    _, f_i, f_o, _, _ = simulated()
    found = estimate_impact(blow(), KNOWN)
    assert found.valid
    assert found.event_id == 7
    assert found.method == 'accelerometer'
    assert found.peak_force.value == pytest.approx(f_o.max(), abs=1.5)
    assert found.peak_contact_force.value == pytest.approx(f_i.max(), rel=0.01)
    assert found.impulse.value == pytest.approx(f_i.sum() / RATE, rel=0.005)
    assert found.impact_speed.value == pytest.approx(SPEED, rel=0.02)
    assert found.effective_mass.value == pytest.approx(MASS, rel=0.02)
    assert found.transferred_energy.value == pytest.approx(
        f_o.max() ** 2 / 2 / SENSOR.stiffness, rel=0.03
    )
    assert found.contact_time.value == pytest.approx(np.count_nonzero(f_i) / RATE, abs=2e-4)


def test_without_plate_accelerometer_the_reading_is_inverted():
    _, f_i, _, _, _ = simulated()
    found = estimate_impact(blow(plate=False), KNOWN)
    assert found.method == 'inversion'
    assert abs(found.peak_contact_force.value - f_i.max()) < 3 * found.peak_contact_force.std
    assert found.peak_contact_force.value == pytest.approx(f_i.max(), rel=0.05)
    assert found.effective_mass.value == pytest.approx(MASS, rel=0.05)


def test_without_any_accelerometer_a_stated_speed_tells_the_mass():
    point = TestPoint(id='a', speed=SPEED)
    found = estimate_impact(blow(plate=False, impactor=False, point=point), KNOWN)
    assert found.impact_speed == Estimate(SPEED, pytest.approx(0.025))
    assert abs(found.effective_mass.value - MASS) < 3 * found.effective_mass.std
    given = ImpactSettings(impact_speed=SPEED, impact_speed_std=0.005)
    surer = estimate_impact(blow(plate=False, impactor=False, point=point), KNOWN, given)
    assert surer.effective_mass.std < found.effective_mass.std


def test_a_lasting_push_is_told_from_inertia():
    found = estimate_impact(blow(push=40.0, duration=0.12), KNOWN)
    assert found.effective_mass.value == pytest.approx(MASS, rel=0.03)


def test_unknown_sensor_leaves_the_reading():
    found = estimate_impact(blow(), None)
    assert found.valid
    assert found.method == 'reading'
    assert math.isnan(found.peak_contact_force.value)
    assert math.isnan(found.transferred_energy.value)
    f_o = simulated()[2]
    assert found.impulse.value == pytest.approx(blow().contacts[0].impulse, rel=0.01)
    assert found.peak_force.value == pytest.approx(f_o.max(), abs=1.5)


def test_settings_stand_in_for_a_blow_that_does_not_tell_the_sensor():
    unknown = SensorParameters(1, 0, False, 'pendulum on plate')
    constants = ImpactSettings(
        natural_frequency=SENSOR.natural_frequency,
        damping_ratio=SENSOR.damping_ratio,
        stiffness=SENSOR.stiffness,
    )
    found = estimate_impact(blow(), unknown, constants)
    assert found.method == 'accelerometer'
    assert found.peak_contact_force.value == pytest.approx(simulated()[1].max(), rel=0.01)


def test_an_accelerometer_with_the_wrong_sign_is_not_believed():
    found = estimate_impact(blow(flip=-1.0), KNOWN)
    assert found.method == 'inversion'
    assert found.effective_mass.value == pytest.approx(MASS, rel=0.05)


def test_uncertainties_are_calibrated():
    # Gains are exact here: only noise and the sensor's constants, drawn anew each time, act.
    rng = np.random.default_rng(5)
    exact = ImpactSettings(force_uncertainty=0.0, acceleration_uncertainty=0.0)
    f_i = simulated()[1]
    truth = {
        'peak_contact_force': f_i.max(),
        'impulse': f_i.sum() / RATE,
        'impact_speed': SPEED,
        'effective_mass': MASS,
    }
    scores = {name: [] for name in truth}
    for seed in range(120):
        sensor = dataclasses.replace(
            KNOWN,
            natural_frequency=Estimate(rng.normal(SENSOR.natural_frequency, 0.02), 0.02),
            damping_ratio=Estimate(rng.normal(SENSOR.damping_ratio, 0.001), 0.001),
            stiffness=Estimate(rng.normal(SENSOR.stiffness, 300.0), 300.0),
        )
        found = estimate_impact(blow(seed), sensor, exact)
        for name, value in truth.items():
            estimate = getattr(found, name)
            scores[name].append((estimate.value - value) / estimate.std)
    for name, z in scores.items():
        assert np.mean(np.abs(z) < 1.96) > 0.9, name
        if name != 'impact_speed':  # its allowance for the layer's lag does not scatter
            assert np.std(z) > 0.4, name  # not wildly cautious either
    assert found.impact_speed.std < 0.03 * SPEED


@settings(max_examples=10, deadline=None)
@given(st.sampled_from([1.0, 2.0, 6.0]), st.sampled_from([0.3, 0.8]))
def test_mass_and_speed_of_any_impactor(mass, speed):
    found = estimate_impact(blow(mass=mass, speed=speed), KNOWN)
    assert found.effective_mass.value == pytest.approx(mass, rel=0.05)
    assert found.impact_speed.value == pytest.approx(speed, rel=0.05)


def test_stage_and_function_agree():
    event = blow()
    stage = ImpactEstimator()
    assert stage.push((event, KNOWN)) == [estimate_impact(event, KNOWN)]
    assert stage.flush() == []


def test_reconstruction_covers_the_grid():
    event = blow(plate=False)
    found = reconstruct_contact_force(event, KNOWN)
    assert found is not None
    assert found.force.shape == found.std.shape == (event.values.shape[1],)
    at = found.peak.time.value
    assert at == pytest.approx(BEFORE + simulated()[1].argmax() / RATE, abs=2e-3)


def _without(event, **changes):
    return dataclasses.replace(event, **changes)


def test_what_is_no_force_event_says_so():
    event = blow()
    values = event.values.copy()
    values[0, int(0.105 * RATE)] = np.nan
    force = event.channels[0]
    rest = event.channels[1:]
    tiny = Contact(0.1, 0.1002, 100.0, 0.1, 0.01)
    cases = [
        (_without(event, contacts=()), 'no contact'),
        (_without(event, values=values), 'missing'),
        (
            _without(event, channels=(dataclasses.replace(force, unit='m/s^2'), *rest)),
            'not a force',
        ),
        (
            _without(event, channels=(dataclasses.replace(force, quality=Quality.CLIPPED), *rest)),
            'clipped',
        ),
        (_without(event, contacts=(tiny,)), 'shorter'),
        (_without(event, noise_std=(200.0, 0.1, 0.1)), 'noise'),
    ]
    for broken, reason in cases:
        found = estimate_impact(broken, KNOWN)
        assert not found.valid
        assert reason in found.reason
        assert math.isnan(found.peak_force.value)
        assert reconstruct_contact_force(broken, KNOWN) is None
    lost = estimate_impact(event, KNOWN, ImpactSettings(force_channel='force.hammer'))
    assert "'force.hammer'" in lost.reason


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 9),
    st.sampled_from([0.0, -1.0, 1e-6, 1e6, math.nan]),
    st.floats(-0.5, 1.0),
    st.floats(-0.5, 1.5),
)
def test_no_record_however_broken_raises(seed, factor, start, end):
    event = blow(seed)
    values = event.values.copy()
    values[seed % 3, 1000 + 7 * seed :] *= np.float32(factor)
    contact = dataclasses.replace(event.contacts[0], start=start, end=end)
    for broken in (
        _without(event, values=values),
        _without(event, contacts=(contact,)),
        _without(event, contact_start=start, contact_end=end, event_end=end),
        _without(event, values=values[:, : 40 + 100 * seed]),
        _without(event, noise_std=(), zero_level=(), oversampling=seed + 1),
    ):
        for sensor in (None, KNOWN):
            found = estimate_impact(broken, sensor)
            assert found.valid == (found.reason == '')


def test_gaps_in_accelerometers_are_survived():
    event = blow()
    values = event.values.copy()
    values[1:, 1050] = np.nan
    found = estimate_impact(_without(event, values=values), KNOWN)
    assert found.valid
    assert found.method == 'inversion'
    assert math.isnan(found.impact_speed.value)


def test_unknown_noise_and_zero_are_found_from_the_record():
    event = _without(blow(), noise_std=(math.nan,) * 3, zero_level=(math.nan,) * 3)
    known, found = estimate_impact(blow(), KNOWN), estimate_impact(event, KNOWN)
    assert found.peak_contact_force.value == pytest.approx(
        known.peak_contact_force.value, rel=1e-2
    )
    assert found.peak_force.std == pytest.approx(known.peak_force.std, rel=0.2)


@pytest.mark.parametrize(
    'wrong', [{'force_uncertainty': -0.1}, {'force_uncertainty': math.nan}, {'stiffness': -1.0}]
)
def test_settings_are_checked(wrong):
    with pytest.raises(ConfigurationError, match=next(iter(wrong))):
        ImpactSettings(**wrong)


@functools.cache
def resting(distance=0.1):
    """Pendulum blow on the bare vertical bench, the pendulum lifted off after 2 s."""
    duration = 2.6
    found = simulate(
        Bench(damper=None),
        PendulumBlow(Pendulum(mass_distance=distance), math.radians(10), lift_time=2.0),
        duration=duration,
        sample_rate=2000.0,
    )
    quiet = np.zeros(200)
    force = np.concatenate([quiet, found['force']])
    force += np.random.default_rng(4).normal(0, 0.3, force.size)
    return force.astype(np.float32), found.contacts


def rested(**point):
    force, contacts = resting()
    end = 0.1 + contacts[-1].end
    whole = Contact(0.1, end, float(force.max()), 0.1 + contacts[0].start, 1.0)
    return ImpactEvent(
        event_id=1,
        stamp_ns=0,
        window_start_ns=0,
        sample_rate=2000.0,
        channels=(Channel('force', 'N', native_rate=2000.0),),
        values=force[None],
        contacts=(whole,),
        contact_start=0.1,
        contact_end=end,
        event_end=2.5,
        zero_level=(0.0,),
        noise_std=(0.3,),
        rest_level=0.0,
        test_point=TestPoint(**point),
    )


def test_an_impactor_that_stays_is_weighed_by_its_common_oscillation():
    found = estimate_impact(rested(), KNOWN)
    truth = Pendulum(mass_distance=0.1).equivalent_mass
    assert abs(found.coupled_mass.value - truth) < 4 * found.coupled_mass.std
    assert found.coupled_mass.std < 0.05 * truth
    total = SENSOR.mass + truth
    common = math.sqrt(SENSOR.stiffness / total) / (2 * math.pi)
    assert found.coupled_frequency.value == pytest.approx(common, rel=0.01)


def test_with_a_damper_layer_between_them_it_is_not():
    assert math.isnan(estimate_impact(rested(damper='SH10'), KNOWN).coupled_mass.value)
    assert math.isnan(estimate_impact(rested()).coupled_mass.value)  # sensor not known
    assert math.isnan(estimate_impact(blow(), KNOWN).coupled_mass.value)  # nothing stays


def test_without_the_sensor_the_reading_weighs_nothing():
    """What the plate took of the impulse is missing in the reading: no mass follows from it."""
    assert math.isfinite(estimate_impact(blow(), KNOWN).effective_mass.value)
    blind = estimate_impact(blow())
    assert blind.method == 'reading'
    assert math.isnan(blind.effective_mass.value)
