"""Prescribed motions whose residual is noise: courses, effects, and laws beyond the library."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import fft, signal
from scipy.interpolate import CubicSpline

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain as explaining
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.data.trajectory import Trajectory, _end, trajectory_of
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.noise.coloured_noise import Colour
from impactscope.discrepancy.driven.systems.prescribed_motion_ends import CONTINUED, _ends, _least
from impactscope.discrepancy.driven.systems.prescribed_motion_noise import PrescribedMotionNoise
from impactscope.discrepancy.driven.systems.prescribed_noise_limited import _noise_of, _turns
from impactscope.discrepancy.time_limit import time_left, time_limited

RATE, SAMPLES = 1000.0, 2500
STIFFNESS, DAMPING, REACH = 2e4, 400.0, 0.01
NOISE = 0.2  # N, a thousandth of the largest force


def motions(still=0.0):
    """Two fitted motions and one that is held out, with their speeds; ``still`` s at rest."""
    time = np.arange(SAMPLES) / RATE
    for size, first, second in ((1.0, 1.3, 7.0), (0.6, 2.2, 11.0), (0.8, 0.9, 5.0)):
        a, b = 2 * np.pi * first, 2 * np.pi * second
        x = size * REACH * (0.7 * np.sin(a * time) + 0.3 * np.sin(b * time + 0.5))
        v = size * REACH * (0.7 * a * np.cos(a * time) + 0.3 * b * np.cos(b * time + 0.5))
        if still:
            s = np.clip((time - still) / 0.3, 0.0, 1.0)
            x = x * s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)
            v = np.where(s > 0.0, CubicSpline(time, x)(time, 1), 0.0)
        yield time, x, v


def then_farther():
    """The same fitted motions; the one that is held out goes six times as far."""
    time, x, v = list(motions())[2]
    yield from list(motions())[:2]
    yield time, 6.0 * x, 6.0 * v


def setting_in():
    """Motions from a rest of 0.9 s that set in by the power 3/2: with a kink in their speed."""
    for time, _, _ in motions():
        moving = np.clip(time - 0.9, 0.0, None)
        turn = 2.0 * np.pi * 1.1 / 1.5 * moving
        x = REACH * np.sin(turn) * np.sqrt(moving / (moving + 0.1))
        yield time, x, CubicSpline(time, x)(time, 1)


def campaign(
    seed,
    more=lambda i, t, x, v: 0.0,
    known=(),
    still=0.0,
    courses=motions,
    noise=NOISE,
    jitter=0.05,
):
    """``jitter``: noise of the motion, over that of the force and the stiffness."""
    rng = np.random.default_rng(seed)
    entries, channels = [], {}
    for i, (time, x, v) in enumerate(courses(still) if still else courses()):
        force = STIFFNESS * x + DAMPING * v + more(i, time, x, v)
        force = force + noise * rng.standard_normal(time.size)
        moved = x + jitter * noise / STIFFNESS * rng.standard_normal(time.size)
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 2 else 'fit'})
        channels[file] = {
            'displacement.piston': ChannelSamples('displacement.piston', 'm', RATE, 0.0, moved),
            'force.damper': ChannelSamples('force.damper', 'N', RATE, 0.0, force),
        }
    bench = {
        'kind': 'prescribed_motion',
        'motion': 'displacement.piston',
        'output': 'force.damper',
    }
    data = {
        'version': 1,
        'bench': bench,
        'baseline': ['linear_spring_damper', *known],
        'recordings': entries,
    }
    return parse_campaign(data).with_samples(channels.__getitem__)


def test_course_is_right_in_the_band_of_the_motion():
    time = np.arange(3000) / RATE
    turn = 2 * np.pi * 16.0
    x = np.sin(turn * time + 0.3)
    rng = np.random.default_rng(1)
    course = trajectory_of(x + 1e-7 * rng.standard_normal(time.size), 1.0 / RATE, 0)
    expected = np.stack([x, turn * np.cos(turn * time + 0.3), -(turn**2) * x])
    for order, most in enumerate((1e-6, 1e-5, 1e-3)):
        error = np.abs(course.motion[order] - expected[order])[20:-20]
        assert np.max(error) < most * turn**order
    assert course.noise == pytest.approx(1e-7, rel=0.1)
    assert 16.0 < course.band < 200.0


def test_course_of_a_measured_speed():
    time = np.arange(3000) / RATE
    turn = 2 * np.pi * 3.0
    rng = np.random.default_rng(2)
    speed = turn * np.cos(turn * time) + 1e-6 * rng.standard_normal(time.size)
    course = trajectory_of(speed, 1.0 / RATE, 1)
    assert np.allclose(course.motion[0], np.sin(turn * time), atol=1e-5)


def test_the_ends_of_a_course_count_for_nothing():
    _, x, _ = next(motions())
    course = trajectory_of(x + 1e-6 * np.random.default_rng(3).normal(size=x.size), 1.0 / RATE, 0)
    out = _noise_of(course, 1.0 / RATE, 0).turns
    reach = 0.25 * RATE / course.band
    assert np.all(out[: int(reach)])
    assert np.all(out[-int(reach) :])
    assert np.count_nonzero(out[int(reach) + 2 : -int(reach) - 2]) < 0.05 * x.size


@pytest.mark.parametrize(('order', 'cut_off'), [(2, 200.0), (2, 270.0), (4, 150.0)])
def test_a_filter_run_both_ways_that_hardly_shows_within_recordings_is_told(order, cut_off):
    low = signal.butter(order, cut_off, fs=RATE, output='sos')
    noise = 0.005 * NOISE

    def lost(i, t, x, v):
        force = STIFFNESS * x + DAMPING * v
        return signal.sosfiltfilt(low, force) - force

    for i, (time, x, v) in enumerate(motions()):
        motion = np.stack([x, v, np.gradient(v, time)])[:, 50:-50].T
        within = lost(i, time, x, v)[50:-50]
        within = within - motion @ np.linalg.lstsq(motion, within, rcond=None)[0]
        assert np.sqrt(within @ within) < 5.0 * noise
    answer = explain_driven(campaign(5, lost, noise=noise))
    assert answer.accepted == ('low_pass_filter',)
    cutoff = answer.ranking[0].parameters['cutoff']
    assert cutoff.value == pytest.approx(cut_off, abs=4.0 * cutoff.std + 1.0)


@pytest.mark.parametrize('seed', range(4))
def test_ends_that_no_filter_explains_do_not_count(seed):
    """Whatever a recorder does to its last sample is no law of the device."""

    def jump(i, t, x, v):
        return np.where(t == t[-1], (8.0, -3.0, 5.0)[i] * NOISE * 5.0, 0.0)

    answer = explain_driven(campaign(seed, jump))
    assert answer.accepted == ()


def with_ends(measured, reach, rest=0):
    """A force whose course is told less well over ``reach`` samples; at rest for some at first."""
    turns = np.zeros(measured.size, np.bool_)
    turns[: max(reach, rest)] = turns[-reach:] = True
    known = np.zeros((3, measured.size))
    noise = PrescribedMotionNoise(
        1.0, 1e-3, 5.0, (0.0, 0.0, 0.0), 1.0 / RATE, known, turns=turns, reach=reach
    )
    return Segment('r.mcap', 'f', 'N', False, 0.0, 1.0 / RATE, measured, known, whitener=noise)


@pytest.mark.parametrize('reach', [3, 80])
def test_an_end_is_as_long_as_its_course_is_told_less_well(reach):
    """Of slow motions that is longer than any filter's memory."""
    force = 1e4 * np.sin(3.0 * np.arange(1000) / RATE)
    low = signal.butter(2, 100.0, fs=RATE, output='sos')
    passed = signal.sosfiltfilt(low, force)
    (end,) = _ends(with_ends(passed, reach, rest=200), passed - force)
    assert end.left.size == reach
    most = np.max(np.abs(end.left))
    assert end.farthest(2, 100.0, 'few turned') < 0.01 * most
    assert all(end.farthest(2, 100.0, other) > 0.3 * most for other in ('turned', 'held', 'not'))


def test_one_cut_off_explains_an_end_that_a_filter_made_and_none_a_spike():
    force = 1e4 * np.sin(3.0 * np.arange(1000) / RATE)
    low = signal.butter(2, 100.0, fs=RATE, output='sos')
    made = signal.sosfiltfilt(low, force) - force
    spike = np.where(np.arange(force.size) == force.size - 1, -np.max(np.abs(made)), 0.0)
    for residual, most in ((made, 0.05), (spike, 0.25)):
        (end,) = _ends(with_ends(force + residual, 8, rest=200), residual)
        share = min(_least((end,), 2, rule) for rule in CONTINUED) / np.max(np.abs(end.left))
        assert (share < most) == (residual is made)


def test_an_end_is_nothing_of_its_own_where_as_much_is_left_everywhere():
    segment = with_ends(np.ones(400), 3)
    alone, alike = np.zeros(400), np.full(400, 50.0)
    alone[-3:] = 50.0
    largest = [max(np.max(np.abs(e.left)) for e in _ends(segment, r)) for r in (alone, alike)]
    assert largest == pytest.approx([50.0, 1.0])


def test_an_end_of_next_to_nothing_is_left_alone():
    assert list(_ends(with_ends(np.ones(24), 3), np.full(24, 50.0))) == []


def test_noise_of_the_motion_is_whitened():
    rng = np.random.default_rng(3)
    noise = PrescribedMotionNoise(
        1.0, 1e-3, 100.0, (1000.0, 10.0, 0.1), 1e-3, np.zeros((3, 20000))
    )
    white = rng.standard_normal(20000)
    lines = np.arange(20000) / (2.0 * 20000 * 1e-3)
    coloured = fft.idct(fft.dct(white) / np.sqrt(1.0 - noise.share(lines)))
    assert np.allclose(noise(coloured), white, atol=1e-9)


def test_nothing_is_found_and_noise_is_left():
    answer = explain_driven(campaign(11))
    assert answer.accepted == ()
    assert answer.fit.extended.held_out_rmse['force.damper'] == pytest.approx(NOISE, rel=0.05)


@pytest.mark.parametrize('seed', [1, 3])
def test_what_a_smoothed_course_has_lost_of_the_motion_is_no_finding(seed):
    """Its noise hides a kink that the force shows, and whatever rounds the force explains that."""
    answer = explain_driven(campaign(seed, courses=setting_in))
    assert answer.accepted == ()
    assert any('followed more closely' in note for note in answer.notes)


def test_weak_hardening():
    cubic = 1e6
    answer = explain_driven(campaign(12, lambda i, t, x, v: cubic * x**3))
    assert answer.accepted == ('hardening_spring',)
    found = answer.ranking[0].parameters['cubic']
    assert abs(found.value - cubic) < 4.0 * found.std
    assert found.std < 0.2 * cubic
    assert answer.ranking[0].probability < 1.0


def test_friction_turns_with_the_speed():
    answer = explain_driven(campaign(13, lambda i, t, x, v: 0.1 * np.sign(v)))
    assert answer.accepted == ('coulomb_friction',)
    found = answer.ranking[0].parameters['force']
    assert abs(found.value - 0.1) < 4.0 * found.std


@pytest.mark.parametrize('seed', [1, 2])
def test_what_only_a_recording_held_out_shows_clearly_is_sought(seed):
    """A hardening of 30 mN among 200 N of fitted motions, and of 5 N in one that goes farther."""
    answer = explain_driven(campaign(seed, lambda i, t, x, v: 3e4 * x**3, courses=then_farther))
    assert answer.accepted == ('hardening_spring',)
    found = answer.ranking[0].parameters['cubic']
    assert abs(found.value - 3e4) < 4.0 * found.std


@pytest.mark.parametrize('seed', [13, 31])
def test_friction_of_a_motion_that_starts_from_rest(seed):
    """Which sign it has at rest is the noise's own; near the ends the speed is known less well."""
    answer = explain_driven(campaign(seed, lambda i, t, x, v: 4.0 * np.sign(v), still=0.35))
    assert answer.accepted == ('coulomb_friction',)
    found = answer.ranking[0].parameters
    assert 'turning_speed' not in found
    assert abs(found['force'].value - 4.0) < 4.0 * found['force'].std < 0.1
    assert 0.8 < answer.fit.extended.reduced_chi_square < 1.2
    assert 0.8 < answer.fit.extended.held_out_reduced_chi_square < 1.2


def test_friction_beside_a_wrong_zero_may_differ_by_direction():
    answer = explain_driven(campaign(14, lambda i, t, x, v: 0.3 * np.sign(v) + 1.0))
    assert set(answer.accepted) == {'coulomb_friction', 'offset'}
    for finding in answer.ranking[:2]:
        assert 'asymmetric_friction' in finding.confused_with


def test_a_peak_at_rest_is_found_where_the_baseline_has_plain_friction():
    def friction(i, t, x, v):
        return np.sign(v) * (1.0 + 0.3 * np.exp(-((v / 0.02) ** 2)))

    answer = explain_driven(campaign(15, friction, known=['coulomb_friction']))
    assert answer.accepted == ('stribeck_friction',)
    found = answer.ranking[0].parameters
    assert found['kinetic_force'].value == pytest.approx(1.0, abs=4 * found['kinetic_force'].std)
    assert found['static_force'].value == pytest.approx(1.3, abs=4 * found['static_force'].std)


def test_plain_friction_of_the_baseline_needs_no_peak():
    made = campaign(16, lambda i, t, x, v: np.sign(v), known=['coulomb_friction'])
    assert explain_driven(made).accepted == ()


@pytest.mark.parametrize(
    'law',
    [
        lambda i, t, x, v: 5.0 * np.maximum(v, 0.0) ** 2,
        lambda i, t, x, v: 30.0 * x * np.sin(2 * np.pi * 13.0 * t),
        lambda i, t, x, v: 40.0 * np.abs(x) * np.sign(v),
        lambda i, t, x, v: (20.0, -25.0, 10.0)[i] * x,
    ],
    ids=['one way', 'swings', 'grows', 'differs'],
)
def test_laws_beyond_the_library_are_unknown(law):
    assert explain_driven(campaign(14, law)).accepted == ('unknown',)


def test_hum_has_a_phase_of_its_own_in_each_recording():
    def hum(i, t, x, v):
        return 0.08 * np.sin(2 * np.pi * 50.01 * t + 2.1 * i)

    answer = explain_driven(campaign(15, hum))
    assert answer.accepted == ('mains_hum',)
    found = answer.ranking[0].parameters['amplitude']
    assert abs(found.value - 0.08) < 4.0 * found.std


def test_a_hum_that_a_closer_course_hides_in_noise_asks_for_none():
    """A smooth course lets no noise of 50 Hz through; one that is followed closer does."""

    def hum(i, t, x, v):
        return 0.08 * np.sin(2 * np.pi * 50.01 * t + 2.1 * i)

    answer = explain_driven(campaign(15, hum, jitter=0.25))
    assert answer.accepted == ('mains_hum',)
    assert not any('followed more closely' in note for note in answer.notes)


def test_a_motion_as_broad_as_its_spectrum_leaves_no_noise_to_read():
    samples = np.random.default_rng(6).standard_normal(400)
    course = trajectory_of(samples, 1.0 / RATE, 0)
    assert course.colour is None
    assert np.all(np.isfinite(course.motion))


@pytest.mark.parametrize(('period', 'spacing'), [(2e-4, 2e-4 * 915 / 48), (1e-3, 1e-3 * 962 / 37)])
def test_samples_that_end_at_a_knot_but_for_rounding(period, spacing):
    assert np.all(np.isfinite(_end(spacing, period, 0)))


@pytest.mark.parametrize('order', [1, 2])
def test_a_filter_without_delay_is_sought_in_its_own_order(order):
    def smoothed(i, t, x, v):
        force = STIFFNESS * x + DAMPING * v
        sections = signal.butter(order, 60.0, fs=RATE, output='sos')
        return signal.sosfiltfilt(sections, force) - force

    answer = explain_driven(campaign(16, smoothed))
    assert answer.accepted == ('low_pass_filter',)
    found = answer.ranking[0].parameters
    assert (found['order'].value, found['zero_phase'].value) == (order, 1.0)
    assert found['cutoff'].value == pytest.approx(60.0, rel=0.05)


def relaxing(stiffness, time):
    """Force of a spring and dashpot in series, at rest before a recording; by small steps."""

    def force(i, t, x, v):
        fine = 50
        inner = np.arange(fine * (t.size - 1) + 1) / (fine * RATE)
        speed = CubicSpline(t, v)(inner)
        keep = np.exp(-1.0 / (fine * RATE * time))
        middle = 0.5 * (speed[1:] + speed[:-1])
        fed = np.concatenate([[0.0], stiffness * time * (1.0 - keep) * middle])
        return signal.lfilter([1.0], [1.0, -keep], fed)[::fine]

    return force


@pytest.mark.parametrize('time', [0.01, 0.03, 0.3])
def test_a_device_that_relaxes(time):
    stiffness = 0.02 * STIFFNESS
    answer = explain_driven(campaign(31, relaxing(stiffness, time)))
    assert answer.accepted == ('rate_dependent_damper',)
    assert not answer.unexplained
    found = answer.ranking[0].parameters
    assert set(found) == {'stiffness', 'damping'}
    assert found['damping'].unit == 'N s/m'
    for name, true in (('stiffness', stiffness), ('damping', stiffness * time)):
        assert abs(found[name].value - true) < 4.0 * found[name].std
    ratio = answer.fit.extended.held_out_rmse['force.damper'] / NOISE
    assert ratio < 1.05


def test_a_pull_that_starts_within_its_first_samples():
    """A piece of three samples tells no course: it must not go anywhere between them."""
    rate, speed, count = 50.0, 4e-3, 2000
    begin = np.array([0.0, 0.9, 19.3, 75.0, 149.2, 228.0, 309.4, 392.2, 474.8, 556.3]) * 1e-6
    there = np.concatenate([begin, begin[-1] + speed / rate * np.arange(1, count // 2)])
    x = np.concatenate([there, there[-1] - speed / rate * np.arange(1, count // 2)])
    x = x + 1.5e-8 * np.random.default_rng(5).standard_normal(x.size)
    course = trajectory_of(x, 1.0 / rate, 0)
    assert np.max(np.abs(course.motion[0] - x)) < speed / rate
    assert np.max(np.abs(course.motion[1])) < 2.0 * speed


def joint(seed, friction=lambda v: 0.0):
    """A joint's torque on motions that begin and end anywhere; it has no spring."""
    rng = np.random.default_rng(seed)
    entries, channels = [], {}
    time = np.arange(3000) / 500.0
    for i in range(4):
        turns = 2 * np.pi * rng.uniform(0.15, 1.4, 6)
        phases, sizes = rng.uniform(0, 2 * np.pi, 6), rng.uniform(0.1, 0.4, 6)
        waves = turns[:, None] * time + phases[:, None]
        angle = sizes @ np.sin(waves)
        speed, acceleration = (sizes * turns) @ np.cos(waves), -(sizes * turns**2) @ np.sin(waves)
        torque = 0.42 * acceleration + 1.9 * speed + friction(speed)
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 2 else 'fit'})
        noisy = torque + 0.045 * rng.standard_normal(time.size)
        angle = angle + 2e-7 * rng.standard_normal(time.size)
        channels[file] = {
            'angle.joint': ChannelSamples('angle.joint', 'rad', 500.0, 0.0, angle),
            'torque.joint': ChannelSamples('torque.joint', 'N m', 500.0, 0.0, noisy),
        }
    data = {
        'version': 1,
        'bench': {'kind': 'prescribed_motion', 'motion': 'angle.joint', 'output': 'torque.joint'},
        'model': {'restoring': 'none'},
        'baseline': ['linear_mass_damper'],
        'recordings': entries,
    }
    return explain_driven(parse_campaign(data).with_samples(channels.__getitem__))


def test_nothing_is_missing_where_a_joint_has_no_spring():
    answer = joint(21)
    assert answer.accepted == ()
    assert answer.fit.baseline.held_out_rmse['torque.joint'] < 0.05
    numbers = answer.baseline_parameters
    assert set(numbers) == {'damping', 'mass'}
    assert numbers['mass'].value == pytest.approx(0.42, abs=3 * numbers['mass'].std)


def test_friction_of_a_joint_without_spring_that_falls_with_the_speed():
    def friction(v):
        return np.sign(v) * (1.1 + 0.1 * np.exp(-((v / 0.05) ** 2)))

    answer = joint(22, friction)
    assert answer.accepted == ('stribeck_friction',)
    found = answer.ranking[0].parameters
    for name, true in (('kinetic_force', 1.1), ('static_force', 1.2)):
        assert abs(found[name].value - true) < 3 * found[name].std


def test_friction_is_not_asked_for_where_a_motion_rests():
    speed = np.concatenate([np.zeros(400), np.sin(np.linspace(0.0, 20.0, 1600)), np.zeros(400)])
    rng = np.random.default_rng(23)
    speed += 1e-4 * rng.standard_normal(speed.size)
    acceleration = np.gradient(speed, 1e-3)
    course = Trajectory(np.stack([speed, speed, acceleration]), 1e-4, 500.0, np.zeros((3, 2400)))
    rests = _turns(course, 1e-3, 1, 0)
    assert np.mean(rests[:400]) > 0.9
    assert np.mean(rests[400:2000]) < 0.02


def test_a_rest_tells_nothing_of_the_level_behind_it():
    """Slow noise is met anew there: one sample stood for all of the rest, noise and all."""
    rng = np.random.default_rng(8)
    colour = Colour(0.1, ((4.0, 1e-4),))
    rested = np.zeros(3000, dtype=bool)
    rested[:800] = rested[1500:1700] = True
    rested[2500] = True  # a sample on which the motion turns is bridged
    noise = PrescribedMotionNoise(
        1.0, 0.0, 100.0, (1.0, 0.0, 0.0), 1e-3, np.zeros((3, 3000)), turns=rested
    ).knowing(colour, 3000)
    residual = 2.0 + 0.3 * rng.standard_normal(3000)
    white = noise(residual)
    assert not np.any(white[rested])
    np.testing.assert_allclose(white[800:1500], noise.slow(residual[800:1500]))
    np.testing.assert_allclose(white[1700:2500], noise.slow(residual[1700:2500]))
    assert np.mean(white[1710:] ** 2) == pytest.approx(0.9, abs=0.15)
    assert noise.counted(3000) == 1999


def test_a_search_to_the_noise_leaves_half_the_time_to_the_search_for_machines(monkeypatch):
    now = [0.0]
    left = SimpleNamespace(rmse={'force.damper': 99.0}, held_out_rmse={'force.damper': 99.0})
    unsure = SimpleNamespace(
        accepted=('offset', 'unknown'), fit=SimpleNamespace(extended=left), notes=()
    )

    def endless(*_):
        while time_left('more'):
            now[0] += 1.0
        return unsure, False

    monkeypatch.setattr(explaining, 'motion_answer', endless)
    with time_limited(100.0, lambda: now[0]):
        answer = explain_driven(campaign(1, lambda i, t, x, v: 60.0 * np.tanh(v / 0.05)))
    assert 'coulomb_friction' in answer.accepted
    assert now[0] == pytest.approx(35.0, abs=1.0)  # of the 70 s of a search
