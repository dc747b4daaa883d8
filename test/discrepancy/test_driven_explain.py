"""Campaigns with a known answer: what is left out is found, and nothing where nothing is."""

import json

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.errors import ConfigurationError, InputError, MissingChannelError

RATE = 200.0


def campaign(bench, baseline, recordings, **rest):
    """``recordings``: (role, {channel: (unit, samples)}), all at one rate."""
    entries = [{'file': f'r{i}.mcap', 'role': role} for i, (role, _) in enumerate(recordings)]
    parsed = parse_campaign(
        {'version': 1, 'bench': bench, 'baseline': baseline, 'recordings': entries, **rest}
    )
    channels = {
        f'r{i}.mcap': {
            name: ChannelSamples(name, unit, RATE, 0.0, np.asarray(values, dtype=float))
            for name, (unit, values) in parts.items()
        }
        for i, (_, parts) in enumerate(recordings)
    }
    return parsed.with_samples(channels.__getitem__)


def noise_force(rng, samples, size):
    sections = signal.butter(4, [1.0, 20.0], 'band', fs=RATE, output='sos')
    force = signal.sosfilt(sections, rng.standard_normal(samples))
    return size * force / np.std(force)


def simulated(force, law, states=2):
    """Reference solution by scipy: ``law(u, y)`` gives the rates; band-limited input."""
    time = np.arange(force.size) / RATE
    factor = 8
    fine = signal.resample_poly(force, factor, 1)
    grid = np.arange(fine.size) / (RATE * factor)
    solution = solve_ivp(
        lambda t, y: law(np.interp(t, grid, fine), y),
        (0.0, time[-1]),
        np.zeros(states),
        t_eval=time,
        max_step=1.0 / RATE,
        rtol=1e-6,
        atol=1e-10,
    )
    return solution.y[0]


M, C, K = 2.0, 10.0, 4000.0  # 7 Hz


def driven(rng, law, sizes=(30.0, 45.0), samples=1000, noise=0.01, states=2, **rest):
    parts = []
    for size, role in zip(sizes, ('fit', 'hold_out'), strict=True):
        force = noise_force(rng, samples, size)
        position = simulated(force, law, states)
        position = position + noise * np.std(position) * rng.standard_normal(samples)
        channels = {'force.shaker': ('N', force), 'displacement.mass': ('m', position)}
        parts.append((role, channels))
    bench = {'kind': 'driven', 'input': 'force.shaker', 'outputs': ['displacement.mass']}
    return campaign(bench, ['linear_sensor'], parts, **rest)


def test_nothing_is_found_where_nothing_is_missing():
    rng = np.random.default_rng(11)
    answer = explain_driven(driven(rng, lambda u, y: (y[1], (u - C * y[1] - K * y[0]) / M)))
    assert answer.accepted == ()
    assert not answer.mismatch.detected
    assert not answer.unexplained
    assert answer.mismatch.p_value > 1e-3
    for name, true in (('mass', M), ('damping', C), ('stiffness', K)):
        estimate = answer.baseline_parameters[name]
        assert abs(estimate.value - true) < 4 * estimate.std + 2e-3 * true


def test_hardening_spring():
    cubic = 4e6

    def law(u, y):
        return y[1], (u - C * y[1] - K * y[0] - cubic * y[0] ** 3) / M

    answer = explain_driven(driven(np.random.default_rng(12), law))
    assert answer.accepted == ('hardening_spring',)
    found = answer.ranking[0].parameters['cubic']
    assert found.unit == 'N/m^3'
    assert abs(found.value - cubic) < 4 * found.std + 0.01 * cubic
    channel = 'displacement.mass'
    held_out = next(t for t in answer.traces if t.held_out)
    left = float(np.sqrt(np.mean((held_out.measured - held_out.extended) ** 2)))
    assert left < 1.1 * 0.01 * np.std(held_out.measured)  # the noise that was added
    assert answer.fit.baseline.held_out_rmse[channel] > 3 * answer.fit.noise_floor[channel]
    assert answer.mismatch.regions
    json.dumps(answer.to_json(), allow_nan=False)


def test_hysteresis_of_bouc_and_wen():
    """A hidden state: the benchmark of Noël and Schoukens (2016), in its form of exponent one."""
    share, closing, leaning = 2000.0, 500.0, -300.0

    def law(u, y):
        x, v, z = y
        rate = v - closing * abs(v) * z - leaning * v * abs(z)
        return v, (u - C * v - K * x - share * z) / M, rate

    answer = explain_driven(driven(np.random.default_rng(13), law, noise=0.003, states=3))
    assert 'hysteresis' in answer.accepted
    channel = 'displacement.mass'
    before = answer.fit.baseline.held_out_rmse[channel]
    assert answer.fit.extended.held_out_rmse[channel] < 0.25 * before


def test_more_modes_are_no_nonlinear_effect():
    """A linear structure with two modes, said to have one."""
    second = 2.0 * np.pi * 23.0

    def law(u, y):
        x1, v1, x2, v2 = y
        return v1, (u - C * v1 - K * x1) / M, v2, u / 3.0 - 2.0 * v2 - second**2 * x2

    rng = np.random.default_rng(19)
    parts = []
    for role in ('fit', 'hold_out'):
        force = noise_force(rng, 1000, 30.0)
        # the second mode's share is added as a second solution of the same input
        one = simulated(force, lambda u, y: law(u, (*y, 0.0, 0.0))[:2])
        two = simulated(force, lambda u, y: law(u, (0.0, 0.0, *y))[2:])
        position = one + 4.0 * two
        position = position + 0.003 * np.std(position) * rng.standard_normal(1000)
        parts.append((role, {'force.shaker': ('N', force), 'displacement.mass': ('m', position)}))
    bench = {'kind': 'driven', 'input': 'force.shaker', 'outputs': ['displacement.mass']}
    answer = explain_driven(campaign(bench, ['linear_sensor'], parts, model={'modes': 1}))
    assert answer.accepted == ('further_modes',)
    found = answer.ranking[0].parameters
    frequencies = [v.value for k, v in found.items() if k.startswith('frequency')]
    assert min(abs(f - 23.0) for f in frequencies) < 0.1
    assert min(abs(f - np.sqrt(K / M) / (2 * np.pi)) for f in frequencies) < 0.05


def test_free_pendulum_needs_sine_and_friction():
    omega2, friction = 120.0, 1.5
    parts = []
    rng = np.random.default_rng(14)
    for x0, role in ((1.2, 'fit'), (0.9, 'hold_out')):
        time = np.arange(900) / RATE
        # Steep tanh: an independent stand-in for set-valued friction while it swings.
        solution = solve_ivp(
            lambda _t, y: (y[1], -omega2 * np.sin(y[0]) - friction * np.tanh(y[1] / 0.002)),
            (0.0, time[-1]),
            (x0, 0.0),
            t_eval=time,
            method='LSODA',
            rtol=1e-7,
            atol=1e-9,
        )
        angle = solution.y[0] + 2e-3 * rng.standard_normal(time.size)
        parts.append((role, {'displacement.angle': ('rad', angle)}))
    bench = {'kind': 'driven', 'input': 'none', 'outputs': ['displacement.angle']}
    answer = explain_driven(campaign(bench, ['linear_sensor'], parts))
    assert set(answer.accepted) == {'restoring_force', 'coulomb_friction'}
    force = next(f for f in answer.ranking if f.name == 'coulomb_friction').parameters['force']
    assert force.value == pytest.approx(friction, rel=0.03)


def slider(x, stiffness, limit, gap):
    """Spring, play and slider, written down sample by sample on its own."""
    place, force = 0.0, []
    for value in x:
        stretch = value - place
        taut = np.sign(stretch) * max(abs(stretch) - gap / 2, 0.0)
        pull = np.clip(stiffness * taut, -limit, limit)
        place += taut - pull / stiffness
        force.append(pull)
    return np.array(force)


def test_friction_and_play_under_a_prescribed_motion():
    rng = np.random.default_rng(15)
    parts = []
    for size, role in ((0.02, 'fit'), (0.013, 'hold_out')):
        time = np.arange(1600) / RATE
        x = size * np.sin(2 * np.pi * 0.8 * time)
        force = slider(x, 4e5, 1000.0, 0.004) + 20.0 * rng.standard_normal(time.size)
        parts.append((role, {'displacement.piston': ('m', x), 'force.device': ('N', force)}))
    bench = {
        'kind': 'prescribed_motion',
        'motion': 'displacement.piston',
        'output': 'force.device',
    }
    answer = explain_driven(campaign(bench, ['linear_spring_damper'], parts))
    assert set(answer.accepted) == {'coulomb_friction', 'clearance'}
    gap = next(f for f in answer.ranking if f.name == 'clearance').parameters['gap']
    assert gap.value == pytest.approx(0.004, rel=0.05)


def chain(rng, part, samples=1200):
    parts = []
    for role in ('fit', 'hold_out'):
        raw = np.cumsum(rng.standard_normal(samples))
        sections = signal.butter(2, [0.3, 60.0], 'band', fs=RATE, output='sos')
        raw = signal.sosfilt(sections, raw)
        raw = raw / np.std(raw)
        out = part(raw) + 1e-3 * rng.standard_normal(samples)
        channels = {'acceleration.raw': ('m/s^2', raw), 'acceleration.out': ('m/s^2', out)}
        parts.append((role, channels))
    bench = {'kind': 'chain', 'input': 'acceleration.raw', 'output': 'acceleration.out'}
    return campaign(bench, [], parts)


@pytest.mark.parametrize(('order', 'both'), [(2, False), (4, True)])
def test_low_pass_of_a_chain(order, both):
    sections = signal.butter(order, 12.0, fs=RATE, output='sos')
    filtered = signal.sosfiltfilt if both else signal.sosfilt
    answer = explain_driven(chain(np.random.default_rng(16), lambda x: filtered(sections, x)))
    assert answer.accepted == ('low_pass_filter',)
    found = answer.ranking[0].parameters
    assert found['cutoff'].value == pytest.approx(12.0, rel=2e-3)
    assert found['order'].value == order
    assert found['zero_phase'].value == both


def test_a_chain_without_anything_in_it():
    answer = explain_driven(chain(np.random.default_rng(17), lambda x: x))
    assert answer.accepted == ()


def test_delay_and_saturation_of_a_chain():
    def part(x):
        late = np.interp(np.arange(x.size) - 1.0, np.arange(x.size), x)
        return np.clip(late, -1.5, 1.5)

    answer = explain_driven(chain(np.random.default_rng(18), part))
    assert set(answer.accepted) == {'clock_error', 'saturation'}


def test_channels_that_are_not_there_and_baselines_that_are_not_known():
    bench = {'kind': 'driven', 'input': 'force.shaker', 'outputs': ['displacement.mass']}
    position = {'displacement.mass': ('m', np.sin(np.arange(100.0)))}
    with pytest.raises(MissingChannelError, match=r'force\.shaker'):
        explain_driven(campaign(bench, ['linear_sensor'], [('fit', position)]))
    both = {**position, 'force.shaker': ('N', np.ones(100))}
    with pytest.raises(ConfigurationError, match='phlogiston'):
        explain_driven(campaign(bench, ['phlogiston'], [('fit', both)]))
    still = {**both, 'displacement.mass': ('m', np.zeros(100))}
    with pytest.raises(InputError, match='zero throughout'):
        explain_driven(campaign(bench, ['linear_sensor'], [('fit', still)]))
    short = {name: (unit, values[:20]) for name, (unit, values) in both.items()}
    with pytest.raises(InputError, match='20 samples'):
        explain_driven(campaign(bench, ['linear_sensor'], [('fit', short)]))


def test_acceleration_cannot_be_a_prescribed_motion():
    bench = {'kind': 'prescribed_motion', 'motion': 'acceleration.x', 'output': 'force.x'}
    channels = {'acceleration.x': ('m/s^2', np.ones(200)), 'force.x': ('N', np.ones(200))}
    with pytest.raises(InputError, match='acceleration'):
        explain_driven(campaign(bench, [], [('fit', channels)]))
