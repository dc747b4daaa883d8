"""An axis whose encoder shows the mains beside dry friction: both are found."""

import numpy as np
import pytest

from impactscope.discrepancy.campaign import ChannelSamples
from impactscope.discrepancy.campaign_description import parse_campaign
from impactscope.discrepancy.explain import explain

MASS, DAMPING, FRICTION, HUM = 60.0, 150.0, 12.0, 12e-6
RATE, STEP = 1000.0, 5e-7


def moved(x, v, force, left):
    """Position and speed after a time under a constant force; exact, friction set-valued."""
    tau = MASS / DAMPING
    while left > 0.0 and (v or abs(force) > FRICTION):
        way = np.sign(v) or np.sign(force)
        last = (force - FRICTION * way) / DAMPING  # the speed that it tends to
        time = left
        if v and last * way < 0.0:
            time = min(left, tau * np.log1p(-v / last))
        gone = np.exp(-time / tau)
        x += last * time + (v - last) * tau * (1.0 - gone)
        v = 0.0 if time < left else last + (v - last) * gone
        left -= time
    return x, v


def axis(seed, amplitude, frequency):
    """Force of a controller, and the position that it makes; friction is set-valued."""
    rng = np.random.default_rng(seed)
    count = 6000
    time = np.arange(count) / RATE
    reference = amplitude * (1.0 - np.cos(2 * np.pi * frequency * time))
    x = v = 0.0
    position, force = np.zeros(count), np.zeros(count)
    for k in range(count):
        position[k] = x
        force[k] = 4000.0 * (15.0 * (reference[k] - x) - v)
        x, v = moved(x, v, force[k], 1.0 / RATE)
    phase = rng.uniform(0.0, 2.0 * np.pi)
    shown = position + HUM * np.sin(2 * np.pi * 50.0 * time + phase)
    shown += 3e-7 * rng.standard_normal(count)
    return force, STEP * np.rint(shown / STEP), reference


@pytest.mark.slow
def test_a_hum_is_no_error_of_the_friction_beside_it():
    samples, entries = {}, []
    for i, (amplitude, frequency) in enumerate(((0.05, 0.5), (0.03, 0.9), (0.04, 0.7))):
        file = f'run{i}.mcap'
        force, position, reference = axis(i, amplitude, frequency)
        samples[file] = {
            name: ChannelSamples(name, unit, RATE, 0.0, values)
            for name, unit, values in (
                ('force.drive', 'N', force),
                ('displacement.axis', 'm', position),
                ('displacement.reference', 'm', reference),
            )
        }
        entries.append({'file': file, 'role': 'hold_out' if i == 2 else 'fit'})
    data = {
        'version': 1,
        'bench': {
            'kind': 'driven',
            'input': 'force.drive',
            'outputs': ['displacement.axis'],
            'reference': 'displacement.reference',
        },
        'model': {'restoring': 'none'},
        'baseline': ['linear_mass_damper'],
        'recordings': entries,
    }
    answer = explain(parse_campaign(data, 'axis').with_samples(samples.__getitem__))
    assert set(answer.accepted) == {'coulomb_friction', 'mains_hum'}
    found = {f.name: f.parameters for f in answer.findings}
    assert found['mains_hum']['amplitude'].value == pytest.approx(HUM, rel=0.02)
    assert found['coulomb_friction']['force'].value == pytest.approx(FRICTION, rel=0.01)
    assert answer.fit.extended.reduced_chi_square < 1.5
