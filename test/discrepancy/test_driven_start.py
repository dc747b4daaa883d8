"""Where fits of an axis set out from: its equation of motion."""

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven.fits.equation_error import equation_start
from impactscope.discrepancy.driven.model_selection.model_comparison import noise_floor
from impactscope.discrepancy.driven.systems.linear_baseline import linear_start

RATE, STEP = 2000.0, 2e-6
MASS, DAMPING, FRICTION = 7.0, 40.0, 8.0


def moved(travel, rng):
    """Two smooth moves with rests that are longer; encoder positions and forces."""
    time = np.arange(6000) / RATE
    x, v, a = np.zeros((3, time.size))
    for begin, way in ((0.3, 1.0), (1.9, -1.0)):
        s = np.clip((time - begin) / 0.5, 0.0, 1.0)
        x += way * travel * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        v += way * travel / 0.5 * 30.0 * s**2 * (1.0 - s) ** 2
        a += way * travel / 0.25 * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
    force = MASS * a + DAMPING * v + FRICTION * np.sign(v)
    force += 0.01 * rng.standard_normal(time.size)
    in_millimetres = (1e3 * STEP * np.round(x / STEP)).astype(np.float32)
    return 1e-3 * in_millimetres.astype(np.float64), force


@pytest.fixture
def begun():
    """An axis that stands for most of each recording."""
    rng = np.random.default_rng(3)
    channels, entries = {}, []
    for i, travel in enumerate((0.1, -0.05, 0.08)):
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 2 else 'fit'})
        x, force = moved(travel, rng)
        channels[file] = {
            'force.motor': ChannelSamples('force.motor', 'N', RATE, 0.0, force),
            'displacement.axis': ChannelSamples('displacement.axis', 'm', RATE, 0.0, x),
        }
    bench = {'kind': 'driven', 'input': 'force.motor', 'outputs': ['displacement.axis']}
    whole = {
        'version': 1,
        'bench': bench,
        'model': {'restoring': 'none'},
        'baseline': ['linear_mass_damper'],
        'recordings': entries,
    }
    return linear_start(parse_campaign(whole, 'axis').with_samples(channels.__getitem__), [])


def test_an_encoder_that_repeats_one_reading_at_rest_is_not_free_of_noise(begun):
    friction = next(t for t in begun.model.terms if t.label == 'coulomb_friction')
    found = equation_start(begun.model.numbers, (friction,), begun.segments)
    assert found['mass'] == pytest.approx(MASS, rel=0.05)
    assert found['damping'] == pytest.approx(DAMPING, rel=0.05)
    assert found['coulomb_friction.force'] == pytest.approx(FRICTION, rel=0.05)


def test_noise_of_such_a_channel_is_not_below_that_of_its_steps(begun):
    segment = begun.segments[0]
    quiet = np.zeros(segment.measured.size)
    assert noise_floor(segment, quiet) == pytest.approx(STEP / np.sqrt(12.0), rel=1e-3)


@pytest.mark.parametrize('rests', [-1.2, 0.4, 2.5])
def test_a_weight_that_hangs_far_from_the_zero_is_begun_at_its_rest(rests):
    """A leg that is let fall: in a straight spring's numbers nothing tells where it hangs."""
    time = np.arange(700) / 200.0
    angle = solve_ivp(
        lambda _t, y: (y[1], -35.0 * np.sin(y[0] - rests) - 0.9 * y[1]),
        (0.0, time[-1]),
        (rests + 1.1, 0.0),
        t_eval=time,
        rtol=1e-9,
        atol=1e-11,
    ).y[0]
    angle += 1e-3 * np.random.default_rng(5).standard_normal(time.size)
    channel = ChannelSamples('displacement.knee', 'rad', 200.0, 0.0, angle)
    whole = {
        'version': 1,
        'bench': {'kind': 'driven', 'input': 'none', 'outputs': ['displacement.knee']},
        'baseline': ['linear_sensor'],
        'recordings': [{'file': 'k.mcap'}],
    }
    campaign = parse_campaign(whole, 'leg').with_samples(lambda _file: {channel.name: channel})
    begun = linear_start(campaign, [])
    tilted = next(t for t in begun.model.terms if t.label == 'restoring_force/tilted')
    found = equation_start(begun.model.numbers, (tilted,), begun.segments)
    assert found['restoring_force/tilted.rest_angle'] == pytest.approx(rests, abs=0.06)
    assert found['stiffness'] == pytest.approx(35.0, rel=0.05)
    assert found['damping'] == pytest.approx(0.9, rel=0.1)


def test_whether_a_recording_begins_in_motion_is_judged_by_the_motion_of_all_that_are_fitted():
    """A strong recording that comes first and is held out had hidden that another one moves."""
    mass, damping, stiffness, rate = 2.0, 6.0, 12_000.0, 1000.0
    time = np.arange(2000) / rate
    shaken = np.sin(2.0 * np.pi * 9.0 * time) + np.sin(2.0 * np.pi * 14.3 * time + 1.0)
    system = signal.StateSpace(
        [[0.0, 1.0], [-stiffness / mass, -damping / mass]],
        [[0.0], [1.0 / mass]],
        [[1.0, 0.0]],
        [[0.0]],
    )
    rng = np.random.default_rng(8)
    entries, channels = [], {}
    for i, (size, begins) in enumerate(((30.0, 0.0), (3.0, 0.0), (3.0, 1.2e-4))):
        file = f'run{i}.mcap'
        force = size * shaken * np.minimum(1.0, time / 0.3) ** 2
        x = signal.lsim(system, force, time, X0=[begins, 0.0])[1]
        x = x + 1e-6 * rng.standard_normal(time.size)
        entries.append({'file': file, 'role': 'fit' if i else 'hold_out'})
        channels[file] = {
            'force.shaker': ChannelSamples('force.shaker', 'N', rate, 0.0, force),
            'displacement.plate': ChannelSamples('displacement.plate', 'm', rate, 0.0, x),
        }
    whole = {
        'version': 1,
        'bench': {'kind': 'driven', 'input': 'force.shaker', 'outputs': ['displacement.plate']},
        'model': {'modes': 1},
        'baseline': ['linear_sensor'],
        'recordings': entries,
    }
    campaign = parse_campaign(whole, 'shaken').with_samples(channels.__getitem__)
    begun = linear_start(campaign, [])
    known = [own.size for own in begun.linear.starts]
    assert known == [len(begun.model.starts(s)) for s in begun.segments]
    assert known == [0, 0, 2]
    assert begun.linear.starts[2][0] == pytest.approx(1.2e-4, rel=0.1)
