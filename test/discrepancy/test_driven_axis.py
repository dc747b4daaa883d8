"""Axes in closed loop whose encoder steps, and a spring that yields."""

import re

import numpy as np
import pytest
from numba import njit
from scipy import signal
from scipy.interpolate import CubicSpline

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.data.recordings import cuts, first_state, rests
from impactscope.discrepancy.driven.models.candidate_effects import candidate_effects
from impactscope.discrepancy.driven.models.mechanical_effects import Sizes
from impactscope.discrepancy.driven.noise.spectral_whitening import (
    counting_share,
    stepped,
    whitening,
)
from impactscope.discrepancy.driven.systems.linear_oscillator import linear_oscillator

RATE, FINE = 500.0, 200
MASS, DAMPING, STEP = 60.0, 150.0, 5e-6
STIFF, SPEED_GAIN = 25.0, 1800.0  # of the controller, 1/s and N s/m


def course(seconds, amplitude, rng):
    """Points with smooth moves between them and short rests."""
    made = [np.zeros(10)]
    place = 0.0
    while sum(m.size for m in made) < seconds * RATE:
        aim = rng.uniform(-1.0, 1.0) * amplitude
        s = np.linspace(0.0, 1.0, int(RATE * rng.uniform(0.4, 0.9)))
        made.append(place + (aim - place) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
        made.append(np.full(int(0.15 * RATE), aim))
        place = aim
    return np.concatenate(made)[: int(seconds * RATE)]


NO_SPRING = (0.0, 0.0, 0.0, np.inf)  # linear, cubic, of a stop, its travel
NO_BASE = (np.inf, 0.0, 0.0)  # mass, stiffness, damping
EVEN = (0.0, 1.0)  # force of a cogging, and its period
FREE = (0.0, 0.0, 1.0)  # friction of a tight spot, its place and width


@njit
def pulled_back(x, spring):
    """Force at a position that the axis is said not to have."""
    linear, cubic, stop, travel = spring
    beyond = max(abs(x) - travel, 0.0)
    return linear * x + cubic * x**3 + stop * np.sign(x) * beyond


@njit
def axis(
    reference, friction, load, spring, base, cogging, drag=0.0, uneven=0.0, fading=0.0, tight=FREE
):
    """Encoder positions and commanded forces; exact sliding at small steps, friction implicit.

    ``spring``: see ``pulled_back``; ``base``: on which drive and guide stand; ``cogging``: force
    and period along the position; ``drag``: of the square of the speed, N s^2/m^2;
    ``uneven``: growth of the friction with the distance from the middle, N/m; ``fading``: share
    of the friction that is gone at the end; ``tight``: friction of a tight spot, its place and
    its width.
    """
    step = 1.0 / (RATE * FINE)
    keep = np.exp(-step * DAMPING / MASS)
    push = (1.0 - keep) / DAMPING
    under, stiffness, damping = base
    x = reference[0] - load / (SPEED_GAIN * STIFF)  # where the controller holds the load
    v = speed = sway = sway_speed = 0.0
    last = STEP * np.rint(x / STEP)
    positions = np.empty(reference.size)
    forces = np.empty(reference.size)
    for i in range(reference.size):
        read = STEP * np.rint(x / STEP)
        speed += 0.5 * ((read - last) * RATE - speed)
        last = read
        force = SPEED_GAIN * (STIFF * (reference[i] - read) - speed)
        positions[i] = read
        forces[i] = force
        for _ in range(FINE):
            pull = force - load - pulled_back(x, spring)
            pull -= cogging[0] * np.sin(2.0 * np.pi * x / cogging[1] + 0.7) + drag * v * abs(v)
            if under < np.inf:
                beside = -(pull - DAMPING * v + stiffness * sway + damping * sway_speed) / under
                pull -= MASS * beside
                sway_speed += step * beside
                sway += step * sway_speed
            free = keep * v + push * pull
            rub = friction * (1.0 - fading * i / reference.size) + uneven * abs(x)
            rub += tight[0] * np.exp(-(((x - tight[1]) / tight[2]) ** 2))
            new = np.sign(free) * max(abs(free) - push * rub, 0.0)
            x += 0.5 * step * (v + new)
            v = new
    return positions, forces


def low_passed(positions, cutoff):
    """Positions behind an analogue low-pass of order 1, of any cut-off."""
    time = np.arange(positions.size)
    fine = CubicSpline(time, positions)(np.arange(20 * positions.size) / 20.0)
    low = signal.butter(1, cutoff, fs=20.0 * RATE)
    begin = signal.lfilter_zi(*low) * fine[0]
    return signal.lfilter(*low, fine, zi=begin)[0][::20]


def closed_loop(
    seed,
    friction=0.0,
    sensor=None,
    load=0.0,
    late=0,
    hum=0.0,
    spring=NO_SPRING,
    base=NO_BASE,
    wander=0.0,
    keep=0.97,
    smooth=0.0,
    before=0.0,
    shaky=0.0,
    cogging=EVEN,
    farther=1.0,
    drag=0.0,
    ripple=0.0,
    uneven=0.0,
    tight=FREE,
    fading=0.0,
    begin=0,
    end=None,
    seconds=4.0,
):
    rng = np.random.default_rng(seed)
    channels, entries = {}, []
    for i in range(3):
        file = f'r{i}.mcap'
        reference = course(seconds, 0.05 * (farther if i == 2 else 1.0), rng)
        positions, forces = axis(
            reference, friction, load, spring, base, cogging, drag, uneven, fading, tight
        )
        positions = np.concatenate([np.full(late, positions[0]), positions])[: positions.size]
        if before:  # sampling
            positions = low_passed(positions, before)
            positions = positions + rng.normal(scale=0.3 * STEP, size=positions.size)
        if smooth:
            positions = signal.filtfilt(*signal.butter(1, smooth, fs=RATE), positions)
            positions = positions + rng.normal(scale=STEP, size=positions.size)
        if wander:
            slow = signal.lfilter(
                [np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.normal(size=3000 + forces.size)
            )
            positions = positions + wander * slow[3000:]
        time = np.arange(forces.size) / RATE
        if ripple:  # the controller is too slow to follow it
            phase = rng.uniform(0.0, 6.0)
            positions = positions + ripple * np.sin(2.0 * np.pi * 50.05 * time + phase)
            positions = STEP * np.rint(positions / STEP)
        forces = forces + hum * np.sin(2.0 * np.pi * 50.05 * time + rng.uniform(0.0, 6.0))
        if shaky:
            forces = forces + rng.normal(scale=shaky, size=forces.size)
        entries.append({'file': file, 'role': 'hold_out' if i == 2 else 'fit'})
        channels[file] = {
            n: ChannelSamples(n, u, RATE, 0.0, samples[begin:end])
            for n, u, samples in (
                ('displacement.axis', 'm', positions),
                ('displacement.reference', 'm', reference),
                ('force.drive', 'N', forces),
            )
        }
    data = {
        'version': 1,
        'bench': {
            'kind': 'driven',
            'input': 'force.drive',
            'outputs': ['displacement.axis'],
            'reference': 'displacement.reference',
            'controller': {'kp': STIFF, 'kv': SPEED_GAIN},
        },
        'model': {'restoring': 'none'},
        'baseline': ['linear_mass_damper'],
        'sensor': sensor or {},
        'recordings': entries,
    }
    return parse_campaign(data).with_samples(channels.__getitem__)


def test_nothing_is_missing_on_an_axis_whose_encoder_steps():
    answer = explain_driven(closed_loop(1))
    assert answer.accepted == ()
    mass = answer.extended_parameters['mass']
    assert abs(mass.value - MASS) < 4.0 * mass.std


def test_slow_noise_sets_no_axis_in_motion():
    """A speed read from its first samples would move the mass as long as friction allows."""
    campaign = closed_loop(3, wander=3e-4)
    parts = cuts(campaign, ['displacement.axis'], 'force.drive', [])
    told = [first_state(c.output, 1.0 / RATE, 9)[1] for c in parts]
    assert max(abs(v) for v in told) > 0.02
    _, segments, made = linear_oscillator(parts, spring=False, held=True)
    assert max(made.rms(i) for i in range(len(segments))) < 3.0 * 3e-4


@pytest.mark.parametrize('hum', [0.0, 3.0])
def test_an_axis_is_on_its_way_when_a_recording_begins(hum):
    """A slow one moves by few of its encoder's steps while its speed is read."""
    campaign = closed_loop(2, begin=140, hum=hum)
    parts = cuts(campaign, ['displacement.axis'], 'force.drive', [])
    _, segments, made = linear_oscillator(parts, spring=False, held=True)
    assert max(abs(s.state[1]) for s in segments) > 0.02
    assert max(made.rms(i) for i in range(len(segments))) < 3.0 * max(STEP, 6e-6 * hum)
    answer = explain_driven(campaign)
    assert answer.accepted == (('mains_hum',) if hum else ())


def test_dry_friction_of_an_axis():
    answer = explain_driven(closed_loop(2, friction=12.0, seconds=2.0))
    assert answer.accepted == ('coulomb_friction',)
    force = answer.findings[0].parameters['force']
    assert abs(force.value - 12.0) < 4.0 * force.std + 0.01
    floor = answer.fit.noise_floor['displacement.axis']
    assert answer.fit.extended.held_out_rmse['displacement.axis'] < 1.5 * floor


def test_a_soft_stop_may_be_far_weaker_than_what_accelerates_an_axis():
    """A weak one is scaled from where it starts, but not to less than a thousandth of that."""
    sizes = Sizes(position=0.05, speed=0.2, force=80.0, stiffness=80.0 / 0.05)
    terms = candidate_effects(
        sizes, (60.0, 150.0, sizes.stiffness), ('x', 'm'), RATE, 4.0, 1e-6, 0.05, kind='axis'
    )
    stops = [t for t in terms if t.name == 'end_stop']
    assert len(stops) == 2  # on one side, and on each
    for stop in stops:
        stiffness = next(n for n in stop.numbers if n.name == 'stiffness')
        assert stiffness.lower + 1e-3 * stiffness.scale < 1e-6 * sizes.stiffness
        assert max(stiffness.starts) == pytest.approx(sizes.stiffness)


def test_a_weak_cogging_is_no_slow_noise():
    """The motion adds it up; what is left looks like noise that falls with the frequency."""
    answer = explain_driven(closed_loop(6, cogging=(0.02, 9.3e-3), seconds=2.0))
    assert answer.accepted == ('unknown',)
    law = re.search(r'a force that repeats every (\S+) m', answer.unexplained_description)
    assert law is not None
    assert float(law[1]) == pytest.approx(9.3e-3, rel=0.01)


@pytest.mark.parametrize(('friction', 'fading'), [(0.004, 0.8), (0.002, 0.9)])
def test_friction_that_fades_is_friction_and_something_unknown(friction, fading):
    """The weaker one was even friction in slow noise: what fades was looked for alone."""
    answer = explain_driven(closed_loop(5, friction=friction, fading=fading))
    assert answer.accepted == ('coulomb_friction', 'unknown')
    assert 'a friction that changes in time' in answer.unexplained_description


def test_a_tight_spot_is_told_by_its_place():
    answer = explain_driven(closed_loop(6, tight=(0.05, 0.012, 0.004), seconds=3.0))
    assert 'unknown' in answer.accepted
    law = re.search(r'friction about (\S+) m of the position', answer.unexplained_description)
    assert law is not None
    assert float(law[1]) == pytest.approx(0.012, abs=0.001)


def test_a_cogging_of_many_teeth_is_not_nothing():
    """Its period is a hundredth of the motion; 52 times the encoder's noise is left of it."""
    answer = explain_driven(closed_loop(7, cogging=(0.1, 1.3e-3)))
    assert answer.accepted == ('unknown',)
    assert 'a force that repeats every 0.0013 m' in answer.unexplained_description


@pytest.mark.slow
def test_a_weak_spring_is_no_coupling_of_a_position():
    """Of a mass with a damper they are one law where the coupling fades within no recording."""
    weak = (0.1, 0.0, 0.0, np.inf)
    answer = explain_driven(closed_loop(10, spring=weak, drag=4.0, wander=1.2e-5, keep=0.0))
    assert set(answer.accepted) == {'quadratic_damping', 'restoring_force'}
    spring = next(f for f in answer.ranking if f.name == 'restoring_force')
    assert 'ac_coupling' in spring.confused_with
    assert (
        abs(spring.parameters['stiffness'].value - 0.1) < 4.0 * spring.parameters['stiffness'].std
    )


def test_a_force_that_is_measured_though_it_is_commanded():
    """Its noise adds up to far more than the encoder's steps, and is no effect."""
    answer = explain_driven(closed_loop(4, shaky=0.1))
    assert answer.accepted == ()
    assert any('force has noise' in note for note in answer.notes)
    mass = answer.extended_parameters['mass']
    assert abs(mass.value - MASS) < 4.0 * mass.std


def test_the_weight_of_a_vertical_axis():
    answer = explain_driven(closed_loop(5, load=400.0, seconds=2.0))
    assert answer.accepted == ('offset',)
    assert answer.findings[0].parameters['value'].value == pytest.approx(-400.0, rel=1e-3)


def test_an_encoder_that_comes_late():
    answer = explain_driven(closed_loop(6, late=3, seconds=2.0))
    assert answer.accepted == ('clock_error',)
    assert answer.findings[0].parameters['offset'].value == pytest.approx(3.0 / RATE, rel=0.01)


@pytest.mark.parametrize('cutoff', [150.0, 300.0])
def test_a_low_pass_far_above_the_motion_is_a_clock_or_a_low_pass(cutoff):
    """Also above half the rate, where it stands before the samples are taken."""
    answer = explain_driven(closed_loop(6, before=cutoff))
    (name,) = answer.accepted
    found = answer.findings[0]
    assert {name, *found.confused_with} == {'clock_error', 'low_pass_filter'}
    (other,) = [f for f in answer.ranking if f.name in found.confused_with]
    assert 0.2 < other.probability < found.probability + 1e-9


def test_a_low_pass_of_the_encoder_that_runs_both_ways():
    """Its order shows although its delay does not."""
    answer = explain_driven(closed_loop(15, smooth=12.0))
    assert answer.accepted == ('low_pass_filter',)
    told = answer.findings[0].parameters
    assert (told['order'].value, told['zero_phase'].value) == (1.0, 1.0)
    assert abs(told['cutoff'].value - 12.0) < 4.0 * told['cutoff'].std + 0.05


def test_a_spring_that_the_axis_is_said_not_to_have():
    answer = explain_driven(closed_loop(11, spring=(40.0, 0.0, 0.0, np.inf), seconds=2.0))
    assert answer.accepted == ('restoring_force',)
    assert answer.findings[0].subsystem == 'impactor'
    stiffness = answer.findings[0].parameters['stiffness']
    assert abs(stiffness.value - 40.0) < 4.0 * stiffness.std
    assert stiffness.std < 4.0


def test_a_spring_that_grows_with_the_cube():
    answer = explain_driven(closed_loop(12, spring=(0.0, 4e5, 0.0, np.inf), seconds=2.0))
    assert answer.accepted == ('hardening_spring',)
    cubic = answer.findings[0].parameters['cubic']
    assert abs(cubic.value - 4e5) < 4.0 * cubic.std


def test_a_stop_on_each_side():
    answer = explain_driven(closed_loop(13, spring=(0.0, 0.0, 3e3, 0.02), seconds=2.0))
    assert answer.accepted == ('end_stop',)
    travel = answer.findings[0].parameters['travel']
    assert travel.value == pytest.approx(0.02, abs=4.0 * travel.std)


@pytest.mark.parametrize('stiffness', [5.0, 30.0])
def test_a_stop_that_is_just_reached_is_told_though_it_is_known_roughly(stiffness):
    """A recording held out presses into it: what is missed there is no noise, nor unknown."""
    campaign = closed_loop(8, spring=(0.0, 0.0, stiffness, 0.034), farther=1.3)
    answer = explain_driven(campaign)
    assert answer.accepted == ('end_stop',)
    assert answer.fit.extended.held_out_reduced_chi_square > 100.0


@pytest.mark.parametrize(
    ('seed', 'soft', 'stop', 'travel', 'seconds'),
    [(32, 0.2, 1.0, 0.03, 2.0), (37, 1.0, 2.0, 0.025, 2.0), (115, 0.08, 1.12, 0.028, 4.0)],
)
def test_a_stop_beside_a_spring_that_the_axis_is_said_not_to_have(
    seed, soft, stop, travel, seconds
):
    """Found alone a stop begins half-way, so as to be a spring, too, and leaves what looks like
    a cubic one, or like a friction that differs by direction. A cubic spring alone may even stand
    far before each of both, and nothing that is found beside it helps."""
    answer = explain_driven(closed_loop(seed, spring=(soft, 0.0, stop, travel), seconds=seconds))
    assert answer.accepted == ('restoring_force', 'end_stop')
    told = {f.name: f.parameters for f in answer.findings}
    for name, number, true in (
        ('restoring_force', 'stiffness', soft),
        ('end_stop', 'stiffness', stop),
        ('end_stop', 'travel', travel),
    ):
        found = told[name][number]
        assert abs(found.value - true) < 4.0 * found.std


def test_a_base_that_the_drive_pushes_back():
    """The encoder reads the axis against the base, which rings at 9 Hz."""
    under = 400.0
    stiffness = under * (2.0 * np.pi * 9.0) ** 2
    base = under, stiffness, 2.0 * 0.02 * np.sqrt(under * stiffness)
    answer = explain_driven(closed_loop(14, base=base, seconds=2.0))
    assert answer.accepted == ('base_compliance',)
    told = answer.findings[0].parameters
    assert told['frequency'].value == pytest.approx(9.0, rel=0.01)
    assert told['mass'].value == pytest.approx(under, rel=0.1)


def on_a_base(frequency, mass, seconds):
    stiffness = mass * (2.0 * np.pi * frequency) ** 2
    base = mass, stiffness, 2.0 * 0.02 * np.sqrt(mass * stiffness)
    return closed_loop(14, base=base, seconds=seconds)


@pytest.mark.parametrize(('frequency', 'mass'), [(30.0, 60.0), (60.0, 30.0)])
def test_a_base_as_light_as_the_axis_is_no_play(frequency, mass):
    """From a heavy base at any frequency a fit comes to the wrong one, which a play beats."""
    answer = explain_driven(on_a_base(frequency, mass, 2.0))
    assert answer.accepted == ('base_compliance',)
    told = answer.findings[0].parameters
    assert told['frequency'].value == pytest.approx(frequency, rel=0.02)
    assert told['mass'].value == pytest.approx(mass, rel=0.05)


@pytest.mark.parametrize(('frequency', 'mass'), [(60.0, 300.0), (40.0, 1000.0)])
def test_a_base_of_which_the_stiffness_shows_alone_may_ring_anywhere(frequency, mass):
    answer = explain_driven(on_a_base(frequency, mass, 4.0))
    assert answer.accepted == ('base_compliance',)
    told = answer.findings[0].parameters
    assert abs(told['frequency'].value - frequency) < 2.0 * told['frequency'].std
    assert told['frequency'].std > 0.2 * frequency
    assert abs(told['mass'].value - mass) < 2.0 * told['mass'].std


def test_a_filter_of_an_axis_cut_out_of_its_motion_holds_what_was_outside():
    """It moves slowly there for its way, and by a thousand times the encoder's noise."""
    answer = explain_driven(closed_loop(9, smooth=10.0, begin=230, end=1730))
    assert answer.accepted == ('low_pass_filter',)
    told = answer.findings[0].parameters
    assert (told['order'].value, told['zero_phase'].value) == (1.0, 1.0)
    assert told['cutoff'].value == pytest.approx(10.0, rel=0.01)


def test_hum_of_the_recorded_force():
    """The axis has not felt it: its motion lacks the answer to it."""
    answer = explain_driven(closed_loop(7, hum=15.0, seconds=2.0))
    assert answer.accepted == ('mains_hum',)
    found = answer.findings[0]
    assert found.channel == 'force.drive'
    assert found.parameters['amplitude'].unit == 'N'
    assert found.parameters['amplitude'].value == pytest.approx(15.0, rel=0.1)
    assert found.parameters['frequency'].value == pytest.approx(50.05, abs=0.02)


@pytest.mark.parametrize('ripple', [1e-5, 8e-5])
def test_a_hum_of_the_encoder_beside_dry_friction(ripple):
    """Slight against what friction does, but far more than noise."""
    answer = explain_driven(closed_loop(3, friction=9.0, ripple=ripple, seconds=2.0))
    assert set(answer.accepted) == {'coulomb_friction', 'mains_hum'}
    found = {f.name: f.parameters for f in answer.findings}
    assert found['coulomb_friction']['force'].value == pytest.approx(9.0, rel=0.01)
    assert found['mains_hum']['amplitude'].value == pytest.approx(ripple, rel=0.05)
    assert not answer.unexplained


@pytest.mark.parametrize(('seed', 'dropped'), [(1, ''), (11, 'clock_error')])
def test_what_friction_leaves_that_grows_with_the_distance_is_said(seed, dropped):
    """Dry friction takes most of it; what else an error of its law brings is no finding."""
    answer = explain_driven(closed_loop(seed, friction=3.0, uneven=150.0))
    assert answer.accepted == ('coulomb_friction',)
    assert answer.unexplained
    said = answer.unexplained_description
    assert said.startswith('More than noise is left')
    assert 'times the noise' in said
    assert ' Hz, and largest from ' in said
    assert any(dropped in note for note in answer.notes) or not dropped


def test_a_stated_damping_that_is_wrong():
    answer = explain_driven(closed_loop(3, sensor={'moving_mass': MASS, 'damping': 200.0}))
    assert answer.accepted == ('wrong_parameter',)
    found = answer.findings[0].parameters
    assert found['name'].value == 'damping'
    assert found['ratio'].value == pytest.approx(0.75, rel=0.01)


def test_a_damping_that_is_stated_as_none_is_wrong_by_no_factor():
    answer = explain_driven(closed_loop(3, sensor={'moving_mass': MASS, 'damping': 0.0}))
    assert answer.accepted == ('wrong_parameter',)
    assert answer.findings[0].parameters['name'].value == 'damping'


def test_a_gain_that_is_wrong_is_no_two_numbers_of_the_machine():
    """A force that is stated too small makes all that it moves too light by the same factor."""
    heavier = {
        'moving_mass': {'value': 1.25 * MASS, 'std': 0.01 * MASS},
        'damping': {'value': 1.25 * DAMPING, 'std': 0.04 * DAMPING},
    }
    answer = explain_driven(closed_loop(3, sensor=heavier))
    assert answer.accepted == ('wrong_parameter',)
    (found,) = answer.findings
    assert found.parameters['name'].value == 'gain.force.drive'
    assert found.parameters['ratio'].value == pytest.approx(1.25, rel=0.02)
    saved = answer.model['corrected']  # as it goes with the force that was recorded
    assert saved['sensor.moving_mass'] == pytest.approx(MASS, rel=0.01)
    assert saved['sensor.damping'] == pytest.approx(DAMPING, rel=0.03)


@pytest.mark.parametrize(('seed', 'seconds'), [(21, 4.0), (23, 2.0)])
def test_an_encoder_that_wanders_slowly_is_nothing_that_is_missing(seed, seconds):
    """Its noise forgets within a second: slower than noise is taken for noise at first."""
    answer = explain_driven(closed_loop(seed, wander=5e-6, keep=0.998, seconds=seconds))
    assert answer.accepted == ()
    assert not answer.unexplained


def test_noise_too_faintly_slow_to_be_told_is_no_force_that_repeats():
    """What it adds up to looks like a law among many, and is likelier noise."""
    answer = explain_driven(closed_loop(4, wander=2e-7, keep=0.999))
    assert answer.accepted == ()
    assert not answer.unexplained


def test_what_begins_at_rest():
    time = np.arange(40) / RATE
    noise = 1e-6 * np.random.default_rng(4).standard_normal(40)
    assert rests(0.3 + 2.0 * time**2 + noise, 24)
    assert not rests(0.3 + 0.01 * time + noise, 24)


def test_a_reading_that_stays_tells_once():
    samples = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 2.0])
    filtering = stepped(samples, 0.5, 1.0)
    power = filtering(np.ones(7)) ** 2
    np.testing.assert_allclose([power[:4].sum(), power[4], power[5:].sum()], 4.0, rtol=1e-3)
    assert filtering.share == pytest.approx(3.0 / 7.0)
    assert counting_share([filtering, whitening(np.ones(9))]) == pytest.approx(3.0 / 7.0)
    assert stepped(np.arange(5.0), 0.5, 1.0) is None


@pytest.mark.parametrize('noise', [0.0, 0.1, 0.2, 0.5])
def test_readings_of_a_rest_share_what_noise_does_not_dither_away(noise):
    """The mean error of a rest is one number, however often the reading goes to and fro."""
    rng = np.random.default_rng(3)
    rests = np.repeat(rng.uniform(0.0, 1e3, 400), 100)
    samples = np.rint(rests + noise * rng.standard_normal(rests.size))
    filtering = stepped(samples, np.sqrt(noise**2 + 1.0 / 12.0), 1.0)
    white = filtering(samples - rests).reshape(400, 100)
    seen = filtering(np.ones(rests.size)).reshape(400, 100)
    mean = np.sum(white * seen, axis=1) / np.linalg.norm(seen, axis=1)
    assert np.mean(mean**2) < 1.4


def bouc_wen(force, rate):
    """Positions, Runge and Kutta of order 4, ``force`` with 20 values in a sample."""

    def slopes(state, u):
        y, v, z = state
        hidden = 5e4 * v - 1e3 * (0.8 * abs(v) * z - 1.1 * v * abs(z))
        return np.array([v, (u - 5e4 * y - 10.0 * v - z) / 2.0, hidden])

    state, found, h = np.zeros(3), [], 1.0 / (10.0 * rate)
    for k in range(0, force.size - 2, 2):
        if k % 20 == 0:
            found.append(state[0])
        one = slopes(state, force[k])
        two = slopes(state + 0.5 * h * one, force[k + 1])
        three = slopes(state + 0.5 * h * two, force[k + 1])
        four = slopes(state + h * three, force[k + 2])
        state = state + h / 6.0 * (one + 2.0 * two + 2.0 * three + four)
    return np.array(found)


def test_the_benchmark_of_bouc_and_wen():
    """Noël and Schoukens (2016), with their numbers: half of the stiffness yields."""
    rate, count = 750.0, 2048
    channels = {}
    for i in range(2):
        rng = np.random.default_rng(10 + i)
        lines = np.fft.rfftfreq(count, 1.0 / rate)
        band = (lines > 5.0) & (lines < 150.0)
        spectrum = np.zeros(10 * count + 1, complex)
        spectrum[: lines.size][band] = np.exp(2j * np.pi * rng.random(np.count_nonzero(band)))
        force = np.fft.irfft(spectrum, 20 * count)
        force *= 50.0 / np.std(force)
        force *= np.clip(np.arange(force.size) / 2000.0, 0.0, 1.0)
        moved = bouc_wen(force, rate)
        channels[f'r{i}.mcap'] = {
            'force.shaker': ChannelSamples(
                'force.shaker', 'N', rate, 0.0, force[::20][: moved.size]
            ),
            'displacement.mass': ChannelSamples('displacement.mass', 'm', rate, 0.0, moved),
        }
    data = {
        'version': 1,
        'bench': {'kind': 'driven', 'input': 'force.shaker', 'outputs': ['displacement.mass']},
        'baseline': ['linear_sensor'],
        'recordings': [{'file': 'r0.mcap'}, {'file': 'r1.mcap', 'role': 'hold_out'}],
    }
    answer = explain_driven(parse_campaign(data).with_samples(channels.__getitem__))
    assert answer.accepted[0] == 'hysteresis'
    found = answer.findings[0].parameters
    assert found['share'].value == pytest.approx(0.5, abs=0.05)
    held_out = next(t for t in answer.traces if t.held_out)
    left = float(np.sqrt(np.mean((held_out.measured - held_out.extended) ** 2)))
    assert left < 2e-5  # of 6.6e-4 m
