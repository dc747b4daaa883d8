"""The axis in closed loop against closed forms, and what is drawn of it."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from impactscope.errors import InputError
from impactscope.proof.__main__ import main
from impactscope.proof.axis import Law, between, follow, run_free
from impactscope.proof.bench import BENCH
from impactscope.proof.campaign_folder import campaign_file, write_campaign
from impactscope.proof.conditions import draw_scenario
from impactscope.proof.conditions_axis import OUTPUT
from impactscope.proof.detectability import AXIS_MASS, Freedom
from impactscope.proof.draw import differences, draw, solve_strength
from impactscope.proof.effect import axial
from impactscope.proof.effects import EFFECTS, effect
from impactscope.proof.measurement import (
    REFERENCE,
    input_channel,
    measure,
    noise_free,
    reference_channel,
)
from impactscope.proof.noise import Colour, Whitening
from impactscope.proof.sealed import open_sealed
from impactscope.proof.trajectories import Move, position
from impactscope.recordings import open_recording
from impactscope.records import SampleBlock

AXIS = BENCH._replace(mass=40.0, stiffness=0.0, damping=90.0)
LAW = Law(kp=12.0, kv=90.0, gain=30.0, rate=1000.0)


def axis(**stated):
    """A drawn axis with its numbers free, or stated."""
    seed = 0
    while True:
        scenario = draw_scenario(np.random.default_rng([seed, 4]), 'closed_loop')
        if (scenario.stated_axis is not None) == bool(stated):
            break
        seed += 1
    short = tuple(
        replace(b, duration=3.0, role=r)
        for b, r in zip(scenario.blows, ('fit', 'fit', 'hold_out'), strict=False)
    )
    return replace(scenario, blows=short, colours={})


def test_free_motion_under_held_forces_is_exact():
    """v' = (F - c v)/m with F constant over each sample has a closed solution."""
    force = np.random.default_rng(0).normal(0, 80, 4000).astype(np.float32).astype(float)
    motion = run_free(AXIS, LAW, force, 0.1, -0.2)
    a = math.exp(-AXIS.damping / AXIS.mass / LAW.rate)
    x, v, tau = 0.1, -0.2, AXIS.mass / AXIS.damping
    for k in range(force.size):
        assert motion.position[k] == pytest.approx(x, abs=1e-11)
        assert motion.speed[k] == pytest.approx(v, abs=1e-11)
        level = force[k] / AXIS.damping
        x, v = x + level / LAW.rate + (v - level) * tau * (1 - a), level + (v - level) * a


def test_dry_friction_stops_the_axis_where_it_should():
    """m v' = -c v - F from v0: stops after tau ln(1 + c v0/F), and stays."""
    bench = AXIS._replace(friction_forward=6.0, friction_backward=6.0)
    v0, tau = 0.3, AXIS.mass / AXIS.damping
    stop = tau * math.log(1 + AXIS.damping * v0 / 6.0)
    path = tau * v0 - 6.0 / AXIS.damping * stop
    motion = run_free(bench, LAW, np.zeros(3000), 0.0, v0)
    assert np.all(motion.speed[math.ceil(stop * 1000) :] == 0)
    assert motion.position[-1] == pytest.approx(path, abs=1e-10)
    held = run_free(bench, LAW, np.full(500, 5.999), 0.0, 0.0)
    assert np.all(held.position == 0)
    assert run_free(bench, LAW, np.full(500, 6.001), 0.0, 0.0).position[-1] > 0


def test_static_friction_holds_more_than_kinetic():
    bench = AXIS._replace(
        friction_forward=4.0, friction_backward=4.0, static_ratio=1.5, stribeck_speed=0.01
    )
    assert run_free(bench, LAW, np.full(100, 5.9), 0.0, 0.0).position[-1] == 0
    assert run_free(bench, LAW, np.full(100, 6.1), 0.0, 0.0).position[-1] > 0


@pytest.mark.parametrize(
    'change',
    [
        {'restoring': 300.0, 'cubic': 5e4},
        {'base_mass': 160.0, 'base_frequency': 25.0, 'base_damping': 0.05},
        {'ripple': 20.0, 'ripple_pitch': 0.02, 'gravity_load': 3.0},
        {'quadratic_forward': 90.0, 'quadratic_backward': 40.0},
    ],
)
def test_other_physics_agrees_with_a_general_solver(change):
    p = AXIS._replace(**change)
    count = 400
    t = np.arange(count) / LAW.rate
    force = 60 * np.sin(2 * np.pi * 2 * t)
    motion = run_free(p, LAW, force, 0.0, 0.1)

    def slopes(_, y, f):
        x, v, b, u = y
        drag = p.quadratic_forward if v > 0 else p.quadratic_backward
        total = f + p.gravity_load - p.damping * v - drag * v * abs(v)
        total -= p.restoring * x + p.cubic * x**3
        total += p.ripple * math.sin(2 * math.pi * x / p.ripple_pitch)
        base = 0.0
        if p.base_mass:
            w = 2 * math.pi * p.base_frequency
            base = -total / p.base_mass - w * w * b - 2 * p.base_damping * w * u
        return v, total / p.mass - base, u, base

    state, worst = np.array([0.0, 0.1, 0.0, 0.0]), 0.0
    for k in range(count - 1):
        ends, held = t[k : k + 2], (force[k],)
        state = solve_ivp(slopes, ends, state, args=held, rtol=1e-10, atol=1e-13).y[:, -1]
        worst = max(worst, abs(state[0] - motion.position[k + 1]))
    assert worst < 2e-9


def test_the_recorded_force_leads_the_axis_along_the_same_way():
    """The loop closed by its record: what is compared is what was commanded."""
    bench = AXIS._replace(friction_forward=9.0, friction_backward=7.0, gravity_load=4.0)
    t = np.arange(6000) / LAW.rate
    loop = follow(bench, LAW, position((Move(1.5, 1.0, 0.2, 0.3),), t), np.zeros(t.size), 1000)
    again = run_free(bench, LAW, loop.force, loop.position[0], loop.speed[0])
    assert np.abs(again.position - loop.position).max() < 1e-12
    moved = position((Move(0.5, 1.0, 0.2, 0.3),), np.arange(5000) / LAW.rate)
    stiff = LAW.gain * LAW.kv
    commanded = stiff * (LAW.kp * (moved - loop.position) - loop.speed)
    assert np.abs(commanded - loop.force).max() < 1e-4
    assert abs(loop.position[-1] - 0.2) < 9.0 / (stiff * LAW.kp) + 1e-3


def test_an_unstable_loop_is_told():
    wild = LAW._replace(kv=1e5)
    with pytest.raises(InputError, match='runs away'):
        follow(AXIS, wild, np.full(5000, 0.1), np.zeros(5000), 0)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.2, 2.0), st.floats(-0.5, 0.5), st.floats(0.0, 0.5), st.floats(0, 1))
def test_moves_start_and_end_at_rest_where_they_should(duration, distance, ramp, start):
    move = Move(start, duration, distance, ramp)
    t = np.array([0.0, start, start + duration / 2, start + duration, start + duration + 1])
    x = position((move,), t)
    assert x == pytest.approx([0, 0, distance / 2, distance, distance], abs=1e-12)
    fine = np.linspace(start, start + duration, 2001)
    assert np.all(np.diff(position((move,), fine)) * distance >= -1e-15)


def test_positions_between_samples_are_those_of_the_motion():
    fine = LAW._replace(rate=4000.0)
    t = np.arange(4000) / fine.rate
    force = np.repeat(50 * np.sin(2 * np.pi * np.arange(1000) / 700), 4)
    slow, quick = (
        run_free(AXIS, law, f, 0.0, 0.0) for law, f in ((LAW, force[::4]), (fine, force))
    )
    assert np.abs(between(slow, LAW.rate, t) - quick.position)[:-4].max() < 1e-9


def test_a_drawn_axis_follows_its_reference_and_records_what_acts():
    for seed in range(12):
        scenario = draw_scenario(np.random.default_rng(seed), 'closed_loop')
        assert 3 <= len(scenario.blows) <= 6
        assert 1 <= sum(b.role == 'hold_out' for b in scenario.blows) <= 2
        blow = scenario.blows[-1]
        assert 3.0 <= blow.duration <= 25.0
        assert 500 <= blow.law.rate <= 2000
        way = noise_free(blow, scenario)[OUTPUT]
        reference = reference_channel(blow)
        assert np.ptp(way) > 0.2 * np.ptp(reference)
        samples = measure(blow, scenario, np.random.default_rng(1))
        assert set(samples) == {OUTPUT, 'force.drive', REFERENCE}
        assert np.all(samples['force.drive'] == input_channel(blow, blow.law.rate))
        assert np.all(samples['force.drive'] == samples['force.drive'].astype(np.float32))
        step = scenario.colours[OUTPUT].step * scenario.noise[OUTPUT]
        assert np.abs(np.remainder(samples[OUTPUT] / step + 0.5, 1) - 0.5).max() < 1e-6


def test_the_campaign_file_is_that_of_an_axis_in_closed_loop():
    for stated in ({}, {'stated': True}):
        scenario = axis(**stated)
        told = yaml.safe_load(yaml.safe_dump(campaign_file(scenario)))
        assert told['bench']['kind'] == 'driven'
        assert told['bench']['input'] == 'force.drive'
        assert told['bench']['reference'] == REFERENCE
        assert set(told['bench']['controller']) == {'kp', 'kv', 'gain'}
        assert told['model'] == {'restoring': 'none'}
        assert told['baseline'] == ['linear_mass_damper']
        assert ('sensor' in told) == bool(stated)


@pytest.mark.parametrize('field', ['mass', 'damping', 'drive_gain'])
def test_what_an_axis_may_re_tune_hides(field):
    """Under the recorded force a heavier axis is found out only where its mass is stated."""
    free = axis()
    turned = free.with_bench(lambda b: {field: getattr(b.bench, field) * 1.05})
    assert Freedom(free).detectability(turned) < 0.05
    if field == 'mass':
        stated = axis(stated=True)
        heavy = stated.with_bench(lambda b: {field: getattr(b.bench, field) * 1.05})
        assert 2 < Freedom(stated).detectability(heavy) <= 1.01 * 0.05 / AXIS_MASS


@pytest.mark.parametrize('key', ['coulomb_friction', 'torque_ripple', 'gravity_load:axis'])
def test_the_size_of_an_effect_is_that_of_a_general_fit(key):
    """The baseline under the recorded force is linear: least squares, spelled out here."""
    clean = axis()
    chosen = effect(key)
    aux = chosen.setup(np.random.default_rng(3), clean)
    freedom = Freedom(clean)
    strength, size = solve_strength(freedom, chosen, aux, 20.0)
    assert size == pytest.approx(20, rel=0.08)
    truth = chosen.apply(clean, strength, aux)
    std = clean.noise[OUTPUT]
    columns, target = [], []
    fitted = [b for b in truth.blows if b.role == 'fit']
    for blow in fitted:
        force = input_channel(blow, blow.law.rate)
        start = noise_free(blow, truth)[OUTPUT][0]

        def way(m, c, x, v, force=force, law=blow.law, start=start):
            p = clean.blows[0].bench
            bench = p._replace(mass=p.mass * (1 + m), damping=p.damping * (1 + c))
            return run_free(bench, law, force, start + x, v).position / std

        own = way(0, 0, 0, 0)
        target.append(noise_free(blow, truth)[OUTPUT] / std - own)
        slopes = [
            (way(*(1e-5 * s for s in unit)) - own) / 1e-5
            for unit in ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
        ]
        columns.append(slopes)
    rows = []
    for i, slopes in enumerate(columns):
        blank = [np.zeros_like(slopes[0])] * 2
        rest = [s for j in range(len(columns)) for s in (slopes[2:] if j == i else blank)]
        rows.append(np.stack([*slopes[:2], *rest], 1))
    matrix, whole = np.concatenate(rows), np.concatenate(target)
    scaled = matrix / np.linalg.norm(matrix, axis=0)
    left = whole - scaled @ np.linalg.lstsq(scaled, whole, rcond=None)[0]
    assert np.linalg.norm(left) == pytest.approx(size, rel=0.02)


def test_every_effect_of_an_axis_can_be_seen():
    scenario = replace(axis(stated=True), colours={OUTPUT: Colour(step=0.5)})
    freedom = Freedom(scenario)
    seen = set()
    for chosen in EFFECTS:
        if chosen.family == 'look-alike' or not chosen.fits(scenario):
            continue
        aux = chosen.setup(np.random.default_rng(2), scenario)
        aux = {n: v for n, v in aux.items() if n != 'zero_phase'} | {'zero_phase': 0}
        strength = 0.9 * chosen.high
        size = freedom.detectability(chosen.apply(scenario, strength, aux), linear=True)
        assert size > 1, chosen.key
        seen.add(chosen.name)
    assert {'coulomb_friction', 'stribeck_friction', 'end_stop', 'base_compliance'} <= seen
    assert {'torque_ripple', 'fading_friction', 'position_dependent_friction'} <= seen
    assert not {'clearance', 'hysteresis', 'offset', 'impact_speed_loss'} & seen
    assert sum(e.family == 'parameter' and e.fits(scenario) for e in EFFECTS) == 3


@pytest.mark.parametrize('category', ['single', 'outside', 'parameter'])
def test_an_axis_can_conceal(category):
    drawn = draw(np.random.default_rng(3), category=category, kind='closed_loop', classes=False)
    assert axial(drawn.truth)
    assert drawn.stated.stated_axis is not None or category != 'parameter'
    assert drawn.detectability > 0


def test_clean_axes_alone_are_drawn_and_sealed(tmp_path):
    arguments = ['--seed', '5', '--campaigns', '1', '--jobs', '1', '--output', str(tmp_path)]
    command = ['generate', '--only', 'clean', '--kind', 'closed_loop', '--no-classes', *arguments]
    assert main(command) == 0
    answer = open_sealed(tmp_path / 'answers.sealed')['campaigns']['campaign_0000']
    assert answer['kind'] == 'closed_loop'
    assert answer['parts'] == []
    assert answer['tolerated'] == ['quantisation']
    text = (tmp_path / 'campaigns' / 'campaign_0000' / 'campaign.yaml').read_text()
    assert 'colour' not in text
    assert 'step' not in text


@pytest.mark.parametrize('colour', [Colour(step=0.7), Colour(0.0, (0.8,), (1.0,), 0.4)])
def test_a_clean_campaign_on_disk_is_its_baseline_to_the_noise(tmp_path, colour):
    """Read back, led through the closed solution, whitened: chi-square of its noise."""
    drawn = axis(stated=True)
    scenario = replace(drawn, colours={OUTPUT: colour})
    write_campaign(tmp_path / 'c', scenario, scenario, np.random.default_rng(4))
    bench, std = scenario.blows[0].bench, scenario.noise[OUTPUT]
    chi_square, count = 0.0, 0
    for path in sorted((tmp_path / 'c').glob('*.mcap')):
        parts: dict[str, list[SampleBlock]] = {}
        with open_recording(path) as recording:
            for _, _, block in recording.records(None):
                parts.setdefault(block.channel, []).append(block)
        read = {n: np.concatenate([b.values for b in p]).astype(float) for n, p in parts.items()}
        rate = parts[OUTPUT][0].sample_rate
        tau = bench.mass / bench.damping
        decay = math.exp(-1 / (tau * rate))
        level = bench.drive_gain * read['force.drive'] / bench.damping
        speed = lfilter([1], [1, -decay], np.append(0.0, level[:-1] * (1 - decay)))
        way = np.cumsum(level / rate + (speed - level) * tau * (1 - decay))
        left = (read[OUTPUT] - np.append(0.0, way[:-1])) / std
        seen = np.ones(left.size, dtype=bool)
        chi_square += float(np.sum(Whitening(colour, seen)(left) ** 2))
        count += left.size
    assert abs(chi_square - count) < 4 * math.sqrt(2 * count)


def test_a_zero_of_the_drive_looks_like_a_weight_and_is_never_drawn():
    scenario = axis()
    weight, zero = effect('gravity_load:axis'), effect('offset:drive')
    freedom = Freedom(scenario)
    strength, _ = solve_strength(freedom, weight, {}, 20.0)
    truth = weight.apply(scenario, strength, {})
    near = differences(np.random.default_rng(0), freedom, truth, {weight.key})
    assert near['offset'] < 0.05
    assert zero.family not in {e.family for e in EFFECTS if e is not zero}
