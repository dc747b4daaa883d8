"""A free swing tells numbers per mass; the mass or the spring makes forces of them."""

import functools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.findings.free_swing import unit_per_mass

RATE, CHANNEL = 100.0, 'displacement.boom'
MASS, STIFFNESS, DAMPING, DRAG = 2.4, 82.0, 0.4, 6.0


@functools.cache
def swing(begin, seed, drag=DRAG, cubic=0.0):
    time = np.arange(900) / RATE
    solution = solve_ivp(
        lambda _t, y: (
            y[1],
            -(STIFFNESS * y[0] + cubic * y[0] ** 3 + DAMPING * y[1] + drag * abs(y[1]) * y[1])
            / MASS,
        ),
        (0.0, time[-1]),
        (begin, 0.0),
        t_eval=time,
        rtol=1e-10,
        atol=1e-12,
    )
    return solution.y[0] + 2e-5 * np.random.default_rng(seed).standard_normal(time.size)


@functools.cache
def answer(step=0.0, unit='m', zero=0.0, drag=DRAG, cubic=0.0, **sensor):
    channel = CHANNEL if unit == 'm' else 'angle.boom'
    channels, entries = {}, []
    for i, begin in enumerate((0.1, 0.06, 0.08)):
        file = f'r{i}.mcap'
        entries.append({'file': file, 'role': 'hold_out' if i == 2 else 'fit'})
        values = zero + swing(begin, i, drag, cubic)
        values = step * np.rint(values / step) if step else values
        channels[file] = {channel: ChannelSamples(channel, unit, RATE, 0.0, values)}
    whole = {
        'version': 1,
        'bench': {'kind': 'driven', 'input': 'none', 'outputs': [channel]},
        'sensor': sensor,
        'baseline': ['linear_sensor'],
        'recordings': entries,
    }
    return explain_driven(parse_campaign(whole, 'boom').with_samples(channels.__getitem__))


@pytest.mark.parametrize(
    ('sensor', 'scale', 'units'),
    [
        ({}, 1.0 / MASS, ('1/m', '1/s^2', '1/s')),
        ({'moving_mass': MASS}, 1.0, ('N s^2/m^2', 'N/m', 'N s/m')),
        ({'stiffness': 82}, 1.0, ('N s^2/m^2', 'N/m', 'N s/m')),
    ],
)
def test_forces_where_mass_or_spring_is_stated(sensor, scale, units):
    found = answer(**sensor)
    assert found.accepted == ('quadratic_damping',)
    drag = found.findings[0].parameters['coefficient']
    assert abs(drag.value - scale * DRAG) < 4.0 * drag.std < 0.05 * scale * DRAG
    spring, damper = (found.extended_parameters[n] for n in ('stiffness', 'damping'))
    assert (drag.unit, spring.unit, damper.unit) == units
    assert spring.value == pytest.approx(scale * STIFFNESS, rel=1e-3)
    assert damper.value == pytest.approx(scale * DAMPING, rel=0.05)


def test_an_uncertain_mass_makes_forces_uncertain():
    spread = {'value': MASS, 'std': 0.2 * MASS}
    sure, unsure = answer(moving_mass=MASS), answer(moving_mass=Stated(spread))
    first, second = (a.findings[0].parameters['coefficient'] for a in (sure, unsure))
    assert second.value == first.value
    assert second.std == pytest.approx(np.hypot(first.std, 0.2 * first.value))


@pytest.mark.parametrize('name', ['stiffness', 'damping'])
def test_a_stated_number_is_held_against_the_mass(name):
    true = {'stiffness': STIFFNESS, 'damping': DAMPING}[name]
    right = answer(moving_mass=MASS, **{name: Stated({'value': true, 'std': 0.02 * true})})
    assert right.accepted == ('quadratic_damping',)
    wrong = answer(moving_mass=MASS, **{name: Stated({'value': 1.2 * true, 'std': 0.01 * true})})
    assert wrong.accepted == ('quadratic_damping', 'wrong_parameter')
    finding = next(f for f in wrong.ranking if f.name == 'wrong_parameter')
    assert finding.parameters['name'].value == name
    assert finding.parameters['ratio'].value == pytest.approx(1.0 / 1.2, rel=0.02)
    assert 'over' in finding.sentence
    assert wrong.model['corrected'][f'sensor.{name}'] == pytest.approx(true, rel=0.02)


@pytest.mark.parametrize(('unit', 'steps'), [('m', ('quantisation',)), ('rad', ())])
def test_steps_of_what_reads_an_angle_are_its_noise(unit, steps):
    assert answer(4e-5, unit).accepted == ('quadratic_damping', *steps)


class Stated(dict):
    """A stated number with its uncertainty, to be a key of what was answered."""

    def __hash__(self):
        return hash(tuple(sorted(self.items())))


@pytest.mark.parametrize(
    ('cubic', 'name'), [(-900.0, 'softening_spring'), (900.0, 'hardening_spring')]
)
def test_an_even_spring_counted_from_elsewhere_is_not_uneven(cubic, name):
    """A load and a spring that is softer to one side would say the same with a number more."""
    found = answer(zero=0.01, drag=0.0, cubic=cubic)
    assert set(found.accepted) == {name, 'offset'}
    told = {f.name: f.parameters for f in found.findings}
    zero, bend = told['offset']['value'], told[name]['cubic']
    assert zero.unit == 'm'
    assert abs(zero.value - 0.01) < 4.0 * zero.std + 1e-6
    assert abs(bend.value - cubic / MASS) < 4.0 * bend.std + 0.01 * abs(cubic / MASS)


@pytest.mark.parametrize(
    ('unit', 'plain'),
    [
        ('rad/s^2', 'rad/s^2'),
        ('m/s^2/m', '1/s^2'),
        ('rad/s^2 s/rad', '1/s'),
        ('m/s^2 s^2/m^2', '1/m'),
        ('rad/s^2/rad^3', '1/(rad^2 s^2)'),
        ('m/s^2 s^2/m', '1'),
        ('N s/m', 'N s/m'),
        ('rad/s^2 s/m', 'rad/s^2 s/m'),
    ],
)
def test_units_of_numbers_per_mass_are_cancelled(unit, plain):
    assert unit_per_mass(unit) == plain
