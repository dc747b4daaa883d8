"""Joints with a weight, findings that say nothing, and outputs that no oscillator explains."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.driven import explain_driven
from impactscope.discrepancy.driven.findings.explains_nothing import leaves_most_as_noise
from impactscope.discrepancy.driven.findings.subject import Subject
from impactscope.discrepancy.driven.fits.simulation_error import Fit
from impactscope.discrepancy.driven.models.terms import Number, Term
from impactscope.discrepancy.driven.search.beam_search import _there

RATE = 100.0
WEIGHT, ANGLE, FRICTION = 11.0, 1.2, 1.4  # N m, rad at which it hangs, N m
DAMPING, INERTIA = 2.0, 1.0


def course(seed, seconds=20.0):
    """Angle, speed and acceleration of a joint, away from the sensor's zero."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    x, v, a = np.full(t.size, -1.6), np.zeros(t.size), np.zeros(t.size)
    for size, turn in ((0.6, 0.7), (0.3, 1.4), (0.15, 2.6)):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        x += size * np.sin(turn * t + phase)
        v += size * turn * np.cos(turn * t + phase)
        a -= size * turn**2 * np.sin(turn * t + phase)
    return x, v, a


def explained(bench, baseline, load, **more):
    entries = [{'file': 'a'}, {'file': 'b', 'role': 'hold_out'}]
    data = {'version': 1, 'bench': bench, 'baseline': baseline, 'recordings': entries, **more}
    campaign = parse_campaign(data)

    def channels(file):
        made = load(0 if file == 'a' else 1)
        return {n: ChannelSamples(n, unit, RATE, 0.0, v) for n, (v, unit) in made.items()}

    return explain_driven(campaign.with_samples(channels))


@pytest.mark.parametrize('ripple', [0.0, 0.25])  # N m, of the gear: nothing in the library
def test_the_weight_of_a_link_is_found_wherever_it_hangs(ripple):
    def load(seed):
        x, v, a = course(seed)
        torque = WEIGHT * np.sin(x - ANGLE) + FRICTION * np.tanh(v / 0.01)
        torque += DAMPING * v + INERTIA * a + ripple * np.sin(23.0 * x)
        noise = 0.05 * np.random.default_rng(seed).standard_normal(x.size)
        return {'displacement.joint': (x, 'rad'), 'torque.motor': (torque + noise, 'N m')}

    bench = {
        'kind': 'prescribed_motion',
        'motion': 'displacement.joint',
        'output': 'torque.motor',
    }
    answer = explained(bench, ['linear_mass_spring_damper'], load)
    named = set(answer.accepted) - {'unknown'}
    assert named == {'restoring_force', 'coulomb_friction'}
    weight = next(f for f in answer.ranking if f.name == 'restoring_force').parameters
    friction = next(f for f in answer.ranking if f.name == 'coulomb_friction').parameters
    assert weight['stiffness'].value == pytest.approx(WEIGHT, rel=0.1)
    assert weight['stiffness'].unit == 'N m/rad'
    assert weight['rest_angle'].value == pytest.approx(ANGLE, abs=0.1)
    assert friction['force'].value == pytest.approx(FRICTION, rel=0.15)


def test_an_output_that_no_oscillator_explains_is_called_so():
    def load(seed):
        rng = np.random.default_rng(10 + seed)
        other = np.convolve(rng.standard_normal(1500), np.hanning(25), 'same')
        return {'force': (rng.standard_normal(1500), 'N'), 'displacement': (1e-3 * other, 'm')}

    bench = {'kind': 'driven', 'input': 'force', 'outputs': ['displacement']}
    answer = explained(bench, ['linear_sensor'], load)
    assert answer.accepted == ('unknown',)
    assert answer.mismatch.p_value < 1e-3
    assert any('not the answer to force alone' in note for note in answer.notes)


@pytest.mark.parametrize(
    ('name', 'value', 'std', 'there'),
    [
        ('coefficient', 37.0, 18.0, True),
        ('coefficient', 18.6, 18.0, False),
        ('offset', -0.0105, 0.0105, False),
        ('rate', 2e-4, 4e-4, False),
        ('coefficient', 0.1, 0.3, False),
        ('corner', 1e-4, 4e-4, False),
    ],
)
def test_an_amount_below_its_own_uncertainty_names_nothing(name, value, std, there):
    number = Number(name, '1', (1.0,), 1.0)
    term = Term('effect', 'guide', '', '', '', '', (number,))
    made = Fit((term,), {f'effect.{name}': value}, {f'effect.{name}': std}, (), (), 1, '')
    assert _there(made, term) is there


def test_noise_is_not_most_of_a_channel():
    """An answer is not taken whose findings leave more than half of what was measured."""

    def load(seed):
        x, v, a = course(seed, 4.0)
        return {'displacement.joint': (x, 'rad'), 'torque.motor': (v + a, 'N m')}

    bench = {'kind': 'prescribed_motion', 'motion': 'displacement.joint', 'output': 'torque.motor'}
    answer = explained(bench, ['linear_mass_spring_damper'], load)
    noise = np.random.default_rng(0).standard_normal(answer.traces[0].measured.size)
    for share, empty in ((0.3, False), (0.7, True)):
        traces = tuple(
            dataclasses.replace(t, extended=t.measured - share * np.std(t.measured) * noise)
            for t in answer.traces
        )
        found = dataclasses.replace(answer, accepted=('hardening_spring',), traces=traces)
        assert leaves_most_as_noise(found) is empty


def test_a_coupling_whose_corner_may_as_well_be_none_is_not_named():
    """Level of a tank: it begins full and its sensor's zero is far below."""

    def load(seed):
        rng = np.random.default_rng(20 + seed)
        drive = np.repeat(rng.uniform(1.0, 5.0, 30), 40)
        level, made = 9.0, []
        for u in drive:
            level = min(level + 0.02 * u - 0.02 * np.sqrt(max(level, 0.0)), 10.0)
            made.append(level)
        made = np.asarray(made) + 0.01 * rng.standard_normal(drive.size)
        return {'voltage.pump': (drive, 'V'), 'displacement.level': (made, 'V')}

    bench = {'kind': 'driven', 'input': 'voltage.pump', 'outputs': ['displacement.level']}
    answer = explained(bench, ['linear_sensor'], load)
    for finding in answer.ranking[: len(answer.accepted)]:
        corner = finding.parameters.get('corner')
        assert corner is None or corner.value > corner.std


def test_another_form_of_what_the_baseline_has_is_no_finding():
    def term(name, variant='', channel=''):
        return SimpleNamespace(name=name, label=f'{name}/{variant}', channel=channel)

    tilted, plain = term('restoring_force', 'tilted'), term('restoring_force')
    friction, here, there = (
        term('coulomb_friction'),
        term('offset', '', 'x'),
        term('offset', '', 'v'),
    )
    baseline = SimpleNamespace(terms=(tilted, here))
    best = SimpleNamespace(terms=(plain, here, friction, there))
    subject = Subject(*[None] * 4, SimpleNamespace(baseline=baseline, best=best), None, ())
    assert subject.new_terms == (friction, there)
