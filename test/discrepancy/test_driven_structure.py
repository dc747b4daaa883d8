"""What is not linear at one place of a structure of several modes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.models.candidate_effects import candidate_effects
from impactscope.discrepancy.driven.models.mechanical_effects import Sizes, mechanical_terms
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel, inside_samples
from impactscope.discrepancy.driven.models.structure_model import (
    Place,
    StructureModel,
    damping_ratio,
    direct,
    frequency,
    shape,
)
from impactscope.discrepancy.driven.models.terms import key

RATE, SAMPLES = 400.0, 2400
MASSES = np.array([2.0, 1.0])
STIFFNESS = np.array([[15000.0, -6000.0], [-6000.0, 6000.0]])
DAMPING = 2e-4 * STIFFNESS + 0.5 * np.diag(MASSES)
FINE = 40  # steps of the truth between samples
STRENGTHS = (3.0, 6.0, 10.0, 8.0)  # N rms of the input; the last one is held out
INPUT = 'force.shaker'


def driven(rng, strength):
    """Band-limited force that begins gently, on the fine grid, shape (n FINE + 1,)."""
    white = rng.standard_normal(SAMPLES)
    band = signal.butter(4, [3.0, 40.0], 'band', fs=RATE, output='sos')
    force = signal.sosfilt(band, white) * np.minimum(1.0, np.arange(SAMPLES) / 60.0)
    force *= strength / np.std(force)
    return force, signal.resample_poly(force, FINE, 1, window=('kaiser', 8.0))


def smooth(row, law):
    """Steps of Runge and Kutta's method under a law of displacement and speed."""

    def moved(fine):
        dt, row_ = 1.0 / (RATE * FINE), np.asarray(row, float)

        def rate(y, u):
            x, v = y[:2], y[2:]
            force = -STIFFNESS @ x - DAMPING @ v - row_ * law(row_ @ x, row_ @ v)
            force[0] += u
            return np.concatenate([v, force / MASSES])

        y, found = np.zeros(4), []
        for i in range(SAMPLES):
            found.append(np.concatenate([y, rate(y, fine[i * FINE])[2:]]))
            for j in range(0, FINE, 10):  # five millionths of a cycle off at 17 Hz
                at = i * FINE + j
                u = fine[at : at + 11 : 5] if at + 10 < fine.size else np.repeat(fine[-1], 3)
                h = 10.0 * dt
                a = rate(y, u[0])
                b = rate(y + 0.5 * h * a, u[1])
                c = rate(y + 0.5 * h * b, u[1])
                d = rate(y + h * c, u[2])
                y = y + h * (a + 2.0 * b + 2.0 * c + d) / 6.0
        return np.array(found)

    return moved


def rubbed(row, force):
    """Small steps in which friction stops its place, or does as much of that as it can."""

    def moved(fine):
        dt, row_ = 1.0 / (RATE * FINE), np.asarray(row, float)
        given = dt * float(row_ @ (row_ / MASSES))
        x, v, found = np.zeros(2), np.zeros(2), []
        for i in range(SAMPLES):
            first = None
            for j in range(FINE):
                load = -STIFFNESS @ x - DAMPING @ v
                load[0] += fine[min(i * FINE + j, fine.size - 1)]
                loose = v + dt * load / MASSES
                rub = float(np.clip(-(row_ @ loose) / given, -force, force))
                after = loose + dt * rub * row_ / MASSES
                if first is None:
                    first = np.concatenate([x, v, (after - v) / dt])
                x, v = x + dt * after, after
            found.append(first)
        return np.array(found)

    return moved


def yielding(row, stiffness, slip):
    """Small steps beside a spring that yields, followed exactly along its way."""

    def moved(fine):
        dt, row_ = 1.0 / (RATE * FINE), np.asarray(row, float)
        x, v, h, found = np.zeros(2), np.zeros(2), 0.0, []
        for i in range(SAMPLES):
            for j in range(FINE):
                load = -STIFFNESS @ x - DAMPING @ v - row_ * stiffness * h
                load[0] += fine[min(i * FINE + j, fine.size - 1)]
                if j == 0:
                    found.append(np.concatenate([x, v, load / MASSES]))
                v = v + dt * load / MASSES
                x = x + dt * v
                way = dt * float(row_ @ v)
                if way * h < 0.0:
                    h += way
                else:
                    h = np.sign(way) * (slip - (slip - abs(h)) * np.exp(-abs(way) / slip))
        return np.array(found)

    return moved


LINEAR = smooth([1.0, 0.0], lambda _z, _v: 0.0)


def campaign(seed, moved, outputs, input_noise=0.0, known=()):
    """``outputs``: columns of positions, speeds and accelerations of both masses, by channel."""
    rng = np.random.default_rng(seed)
    unit = ('m', 'm', 'm/s', 'm/s', 'm/s^2', 'm/s^2')
    runs = []
    for strength in STRENGTHS:
        force, fine = driven(rng, strength)
        runs.append((force, moved(fine)))
    files = [f'r{i}.mcap' for i in range(len(runs))]
    noise = {n: 0.01 * max(np.std(made[:, c]) for _, made in runs) for n, c in outputs.items()}
    channels = {}
    for file, (force, made) in zip(files, runs, strict=True):
        recorded = force + input_noise * rng.standard_normal(SAMPLES)
        channels[file] = {INPUT: ChannelSamples(INPUT, 'N', RATE, 0.0, recorded)}
        for name, column in outputs.items():
            values = made[:, column] + noise[name] * rng.standard_normal(SAMPLES)
            channels[file][name] = ChannelSamples(name, unit[column], RATE, 0.0, values)
    parsed = parse_campaign(
        {
            'version': 1,
            'bench': {'kind': 'driven', 'input': INPUT, 'outputs': list(outputs)},
            'model': {'modes': 2},
            'baseline': ['linear_sensor', *known],
            'recordings': [
                {'file': f, 'role': 'hold_out' if f == files[-1] else 'fit'} for f in files
            ],
        }
    )
    return parsed.with_samples(channels.__getitem__)


BOTH = {'displacement.root': 0, 'displacement.tip': 1}
HARD = smooth([1.0, -1.0], lambda z, _v: 3e6 * z**3)


@pytest.mark.parametrize('outputs', [BOTH, {'acceleration.root': 4}, {'acceleration.tip': 5}])
def test_nothing_is_found_on_a_structure_that_is_linear(outputs):
    answer = explain_driven(campaign(1, LINEAR, outputs))
    assert answer.accepted == ()
    assert any('not linear' in note for note in answer.notes)


@pytest.mark.parametrize('seed', [2, 3, 4])
def test_noise_of_the_input_moves_a_structure_and_is_nothing_missing(seed):
    answer = explain_driven(campaign(seed, LINEAR, {'displacement.root': 0}, input_noise=0.3))
    assert answer.accepted == ()


def test_a_spring_that_hardens_between_two_masses_is_told_with_its_place():
    answer = explain_driven(campaign(2, HARD, BOTH))
    assert answer.accepted == ('hardening_spring',)
    found = answer.ranking[0]
    assert 'between displacement.root and displacement.tip' in found.sentence
    cubic = found.parameters['cubic']
    assert abs(cubic.value - 3e6) < max(4.0 * cubic.std, 3e4)
    held_out = answer.fit.extended.held_out_rmse
    assert all(held_out[c] < 1.1 * answer.fit.noise_floor[c] for c in held_out)


def test_what_was_found_at_a_place_is_no_finding_once_it_is_in_the_baseline():
    known = {'name': 'hardening_spring', 'values': {'cubic': 2.9e6}}
    answer = explain_driven(campaign(2, HARD, BOTH, known=[known]))
    assert answer.accepted == ()
    held_out = answer.fit.baseline.held_out_rmse
    assert all(held_out[c] < 1.1 * answer.fit.noise_floor[c] for c in held_out)


def test_dry_friction_at_the_tip_is_told_with_its_force():
    answer = explain_driven(campaign(3, rubbed([0.0, 1.0], 0.3), BOTH))
    assert answer.accepted == ('coulomb_friction',)
    found = answer.ranking[0]
    assert 'at displacement.tip' in found.sentence
    force = found.parameters['force']
    assert abs(force.value - 0.3) < max(4.0 * force.std, 6e-3)


def test_a_spring_that_yields_between_two_masses_is_told_by_stiffness_and_yield():
    answer = explain_driven(campaign(8, yielding([1.0, -1.0], 600.0, 4e-4), BOTH))
    assert answer.accepted == ('hysteresis',)
    found = answer.ranking[0].parameters
    assert abs(found['stiffness'].value - 600.0) < 4.0 * found['stiffness'].std
    slip = found['yield_displacement']
    assert abs(slip.value - 4e-4) < 4.0 * slip.std


def test_a_stop_on_one_side_of_the_tip_is_told():
    stop = smooth([0.0, 1.0], lambda z, _v: 1500.0 * max(z - 4e-3, 0.0))
    answer = explain_driven(campaign(4, stop, BOTH))
    assert answer.accepted == ('end_stop',)
    travel = answer.ranking[0].parameters['travel']
    assert abs(travel.value - 4e-3) < max(4.0 * travel.std, 1e-4)


def test_friction_where_no_output_is_has_its_name():
    answer = explain_driven(campaign(5, rubbed([1.0, -1.0], 0.4), {'acceleration.root': 4}))
    assert answer.accepted == ('coulomb_friction',)
    assert 'no output shows' in answer.ranking[0].sentence


def test_drag_at_an_output_far_from_the_input_has_its_name():
    drag = smooth([0.0, 1.0], lambda _z, v: 20.0 * abs(v) * v)
    answer = explain_driven(campaign(6, drag, {'acceleration.tip': 5}))
    assert answer.accepted == ('quadratic_damping',)


VALUES = {
    'coulomb_friction': (0.4,),
    'asymmetric_friction': (0.5, 0.3),
    'stribeck_friction': (0.3, 0.2, 0.05),
    'quadratic_damping': (4.0,),
    'hardening_spring': (2e6,),
    'asymmetric_spring': (1e5,),
    'end_stop': (2e-3, 3000.0),
    'hysteresis': (800.0, 500.0),
}


SIZES = Sizes(3e-3, 0.15, 5.0, 4000.0)
ALONE = {'mass': 1.6, 'damping': 3.0, 'stiffness': 4000.0}


def shaken():
    force, _ = driven(np.random.default_rng(7), 4.0)
    drive = inside_samples(force, 8, held=False)
    return Segment('r', 'c', 'm', False, 0.0, 1.0 / RATE, np.zeros(force.size), drive)


def alone(plain, term=None, numbers=None):
    """Positions of a mass on its spring with an effect."""
    terms = () if term is None else (term,)
    model = OscillatorModel((), terms, False, 1.0, 1.0)
    return model.predict({**plain, **(numbers or {})}, terms, np.zeros(0), shaken())


def of_one_mode(plain, term, numbers):
    """Positions of a structure of one mode, the same mass on the same spring, with an element."""
    omega = np.sqrt(plain['stiffness'] / plain['mass'])
    values = {
        frequency(0): omega / (2.0 * np.pi),
        damping_ratio(0): plain['damping'] / (2.0 * plain['mass'] * omega),
        shape(0, 'c'): 1.0 / np.sqrt(plain['mass']),
        direct('c'): 0.0,
        **numbers,
    }
    place = {term.variant: Place('at c', 'c')}
    structure = StructureModel((), (term,), ('c',), 'c', 1, place)
    return structure.predict(values, (term,), np.zeros(0), shaken())


@pytest.mark.parametrize('name', VALUES)
def test_one_mode_with_an_element_moves_as_the_mass_on_its_spring_does(name):
    known = mechanical_terms(SIZES, spring=True, driven=True, angle=False)
    term = next(t for t in known if t.name == name and not t.variant)
    numbers = {key(term, n): v for n, v in zip(term.numbers, VALUES[name], strict=True)}
    expected = alone(ALONE, term, numbers)
    found = of_one_mode(ALONE, term, numbers)
    assert np.max(np.abs(found - expected)) < 1e-3 * np.max(np.abs(expected))
    linear = alone(ALONE)
    assert np.max(np.abs(linear - expected)) > 0.02 * np.max(np.abs(expected))


def test_an_element_that_yields_is_a_share_of_a_spring_that_does():
    found = candidate_effects(SIZES, (1.6, 3.0, 4000.0), ('c', 'm'), RATE, 1.0, 1e-5, 3e-3)
    term = next(t for t in found if t.name == 'hysteresis')
    slip = {f'{term.label}.yield_displacement': 1e-3}
    expected = alone(ALONE, term, {**slip, f'{term.label}.share': 0.2})
    rest = {**ALONE, 'stiffness': 0.8 * ALONE['stiffness']}
    yielding = {**slip, f'{term.label}.stiffness': 0.2 * ALONE['stiffness']}
    found = of_one_mode(rest, term, yielding)
    assert np.max(np.abs(found - expected)) < 1e-3 * np.max(np.abs(expected))
    linear = alone(ALONE)
    assert np.max(np.abs(linear - expected)) > 0.02 * np.max(np.abs(expected))
