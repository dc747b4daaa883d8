"""Every mechanism: described, absent at its absent value, felt elsewhere; laws as printed."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

import impactscope
from impactscope.errors import ConfigurationError
from impactscope.physics.mechanisms.ac_coupling import high_pass
from impactscope.physics.mechanisms.hysteresis import yielding_rate
from impactscope.physics.mechanisms.mechanism import Mechanism, Subsystem
from impactscope.physics.mechanisms.registry import all_mechanisms, mechanism, own_places
from impactscope.physics.mechanisms.stribeck_friction import sliding_friction
from impactscope.physics.twin import layout as at
from impactscope.physics.twin.assembly import Effect, implied_effects
from impactscope.physics.twin.bench import Bench, HammerTap, PendulumBlow
from impactscope.physics.twin.simulate import simulate

ALL = sorted(all_mechanisms())
MECHANICAL = [n for n in ALL if not all_mechanisms()[n].on_channel]
CHAIN = [n for n in ALL if all_mechanisms()[n].on_channel]
# what has no absent value: the fixture is rigid and the contact two-sided only without them
ALWAYS_THERE = {'base_compliance', 'unilateral_contact'}

VOCABULARY = {
    'coulomb_friction': 'guide',
    'asymmetric_friction': 'guide',
    'stribeck_friction': 'guide',
    'quadratic_damping': 'guide',
    'clearance': 'guide',
    'hardening_spring': 'spring',
    'softening_spring': 'spring',
    'end_stop': 'spring',
    'hysteresis': 'spring',
    'rate_dependent_damper': 'damper',
    'stiffening_damper': 'damper',
    'unilateral_contact': 'contact',
    'added_mass': 'contact',
    'velocity_squared_contact': 'contact',
    'gravity_load': 'impactor',
    'restoring_force': 'impactor',
    'external_push': 'impactor',
    'impact_speed_loss': 'impactor',
    'impactor_flexibility': 'impactor',
    'base_compliance': 'fixture',
    'low_pass_filter': 'measurement',
    'ac_coupling': 'measurement',
    'saturation': 'measurement',
    'quantisation': 'measurement',
    'mains_hum': 'measurement',
    'zero_drift': 'measurement',
    'offset': 'measurement',
    'clock_error': 'measurement',
}


NEW_EFFECT = """
from impactscope.physics.mechanisms.compiled import law
from impactscope.physics.mechanisms.mechanism import Mechanism, Parameter, Subsystem

@law
def cubic(par, own, compression, speed):
    return par[own] * speed**3

MECHANISM = Mechanism(
    name='cubic_damping',
    subsystem=Subsystem.GUIDE,
    sentence='Damping grows with the third power of the speed.',
    equation='c3 v^3',
    parameters=(Parameter('coefficient', 'N s^3/m^3', 0.0, 1e6, (100.0,), absent=0.0),),
    source='none',
    test='ring-down',
    guide_term=cubic,
)
"""


def values_for(kind: Mechanism) -> dict[str, float]:
    """A plainly visible strength: the last start value of each parameter, or the first where
    less is more.
    """
    less_is_more = ('travel', 'cutoff')
    return {p.name: p.start[0 if p.name in less_is_more else -1] for p in kind.parameters}


def blow_with(*effects: Effect):
    bench, blow = Bench(), PendulumBlow()
    names = {e.name for e in effects}
    base = [e for e in implied_effects(bench, blow) if e.name not in names]
    return simulate(bench, blow, mechanisms=[*base, *effects], duration=0.2)


def test_the_vocabulary_is_covered():
    assert {name: kind.subsystem.value for name, kind in all_mechanisms().items()} == VOCABULARY


@pytest.mark.parametrize('name', ALL)
def test_each_is_described_for_people_and_for_a_search(name):
    kind = mechanism(name)
    assert kind.name == name
    assert kind.sentence.endswith('.')
    assert kind.equation
    assert kind.source
    assert kind.test
    assert all(relative in VOCABULARY for relative in kind.kin)
    for parameter in kind.parameters:
        assert parameter.lower < parameter.upper
        assert parameter.start
        for value in parameter.start:
            assert parameter.lower <= value <= parameter.upper
    if kind.on_channel:
        assert kind.subsystem is Subsystem.MEASUREMENT
        assert kind.enter is None
        assert kind.distort or kind.retime
    else:
        assert kind.enter or kind.guide_term or kind.contact_term


@pytest.mark.parametrize('name', [n for n in MECHANICAL if n not in ALWAYS_THERE])
def test_mechanical_ones_vanish_at_their_absent_values_and_show_elsewhere(name):
    kind = mechanism(name)
    plain = [e for e in implied_effects(Bench(), PendulumBlow()) if e.name != name]
    without = simulate(Bench(), PendulumBlow(), mechanisms=plain, duration=0.2)
    absent = blow_with(Effect(name, kind.absent_values()))
    there = blow_with(Effect(name, values_for(kind)))
    np.testing.assert_array_equal(absent['force'], without['force'])
    assert np.abs(there['force'] - without['force']).max() > 0.1


def test_a_rigid_fixture_is_the_limit_of_a_compliant_one():
    rigid = blow_with()
    values = {'frequency': 2000.0, 'mass': 1000.0, 'damping_ratio': 0.1}
    stiff = blow_with(Effect('base_compliance', values))
    soft = blow_with(Effect('base_compliance', {'frequency': 60.0, 'mass': 5.0}))
    assert np.abs(stiff['force'] - rigid['force']).max() < 0.05
    assert np.abs(soft['acceleration.base']).max() > 5.0


def test_without_unilateral_contact_the_impactor_is_glued_on():
    bench, blow = Bench(), PendulumBlow()
    glued = simulate(bench, blow, mechanisms={'gravity_load': {}}, duration=0.3)
    assert len(glued.contacts) == 1
    assert glued.contact_force.min() < -10.0


@pytest.mark.parametrize('name', CHAIN)
def test_chain_effects_vanish_at_their_absent_values(name):
    kind = mechanism(name)
    samples = np.random.default_rng(3).standard_normal(500).cumsum()
    values = kind.values(kind.absent_values())
    if kind.distort is not None:
        np.testing.assert_array_equal(kind.distort(samples, 1000.0, values), samples)
        changed = kind.distort(100 * samples, 1000.0, kind.values(values_for(kind)))
        assert not np.array_equal(changed, 100 * samples)
    if kind.retime is not None:
        np.testing.assert_array_equal(kind.retime(samples, values), samples)


@pytest.mark.parametrize('zero_phase', [0, 1])
def test_low_pass_has_its_gain_at_the_cutoff(zero_phase):
    kind, rate, cutoff = mechanism('low_pass_filter'), 5000.0, 100.0
    t = np.arange(20_000) / rate
    wave = np.sin(2 * math.pi * cutoff * t)
    out = kind.distort(wave, rate, {'cutoff': cutoff, 'order': 4, 'zero_phase': zero_phase})
    middle = slice(8000, 12_000)
    expected = 0.5 if zero_phase else math.sqrt(0.5)
    assert math.sqrt(2) * out[middle].std() == pytest.approx(expected, rel=1e-4)
    delayed = np.argmax(signal.correlate(out[middle], wave[middle])) - 3999
    assert (delayed == 0) == bool(zero_phase)


def test_ac_coupling_takes_corners_that_a_slow_channel_cannot_show():
    """A search may ask a channel of 1 kHz for a corner of as much."""
    kind, samples = mechanism('ac_coupling'), np.random.default_rng(1).standard_normal(200)
    out = [kind.distort(samples, 1000.0, {'corner': c}) for c in (490.0, 500.0, 1000.0)]
    assert all(np.array_equal(o, out[0]) for o in out)
    assert np.std(out[0]) < np.std(samples)


@given(share=st.floats(1e-8, 0.49), rate=st.floats(10.0, 1e6))
def test_the_high_pass_is_butterworths(share, rate):
    wanted = signal.butter(1, share * rate, btype='high', fs=rate)
    for mine, its in zip(high_pass(share * rate, rate), wanted, strict=True):
        np.testing.assert_allclose(mine, its, rtol=1e-12)


def test_ac_coupling_forgets_a_step_with_its_time_constant():
    kind, rate, corner = mechanism('ac_coupling'), 10_000.0, 1.0
    step = np.r_[np.full(10, 3.0), np.full(20_000, 8.0)]
    out = kind.distort(step, rate, {'corner': corner})
    assert np.abs(out[:10]).max() < 1e-9
    tau = 1 / (2 * math.pi * corner)
    assert out[10 + round(tau * rate)] == pytest.approx(5.0 / math.e, rel=1e-2)


def test_clock_error_shifts_and_stretches_stamps():
    true = mechanism('clock_error').retime(np.array([0.0, 10.0]), {'offset': 1e-3, 'drift': 5e-5})
    np.testing.assert_allclose(true * (1 + 5e-5) + 1e-3, [0.0, 10.0], atol=1e-15)


def test_stribeck_friction_runs_from_static_to_kinetic_and_opposes():
    at_rest = sliding_friction(5.0, 5.0, 2.0, 2.0, 0.01, 0.0, 1)
    fast = sliding_friction(5.0, 5.0, 2.0, 2.0, 0.01, 1.0, 1)
    back = sliding_friction(5.0, 4.0, 2.0, 1.5, 0.01, -1.0, -1)
    assert (at_rest, fast, back) == pytest.approx((-5.0, -2.0, 1.5))


def test_yielding_saturates_and_unloads_elastically():
    assert yielding_rate(1.0, 0.0, 1e-3) == 1.0
    assert yielding_rate(1.0, 1e-3, 1e-3) == pytest.approx(0.0)
    assert yielding_rate(-1.0, 1e-3, 1e-3) == -1.0


def test_nonsense_is_refused():
    friction = mechanism('coulomb_friction')
    with pytest.raises(ConfigurationError, match='force is not given'):
        friction.values({})
    with pytest.raises(ConfigurationError, match='unknown parameter'):
        friction.values({'force': 1.0, 'colour': 3.0})
    with pytest.raises(ConfigurationError, match='gremlin'):
        mechanism('gremlin')
    with pytest.raises(ConfigurationError, match='whole'):
        mechanism('low_pass_filter').values({'cutoff': 10.0, 'order': 2.5})
    with pytest.raises(ConfigurationError, match='below kinetic_force'):
        blow_with(
            Effect('stribeck_friction', {'static_force': 1.0, 'kinetic_force': 2.0, 'speed': 0.1})
        )
    with pytest.raises(ConfigurationError, match='does not act on a channel'):
        blow_with(Effect('coulomb_friction', {'force': 1.0}, channel='force'))
    with pytest.raises(ConfigurationError, match='needs an impactor'):
        simulate(Bench(), HammerTap(), mechanisms={'gravity_load': {'force': 1.0}})


def test_a_layer_takes_six_branches_and_no_more():
    more = [Effect('rate_dependent_damper', {'stiffness': 1e3, 'damping': 10.0})] * 3
    with pytest.raises(ConfigurationError, match='6 branches'):
        blow_with(*more)


def test_own_parameters_stand_apart():
    places = sorted(own_places().values())
    assert len(set(places)) == len(places) >= 2
    assert places[0] >= at.OWN
    assert places[-1] + at.OWN_WIDTH <= at.N_PARAMETERS


@pytest.mark.slow
def test_adding_an_effect_is_adding_one_file(tmp_path):
    """A file with a law of its own, in a copy of the package, acts without any other change."""
    package = Path(impactscope.__file__).parent
    copy = tmp_path / 'impactscope'
    shutil.copytree(
        package / 'physics', copy / 'physics', ignore=shutil.ignore_patterns('__pycache__')
    )
    for module in ('__init__', 'errors', 'records'):
        shutil.copy(package / f'{module}.py', copy)
    (copy / 'physics/mechanisms/cubic_damping.py').write_text(NEW_EFFECT)
    code = (
        'import numpy as np\n'
        'from impactscope.physics.twin import layout as at\n'
        'from impactscope.physics.twin.assembly import Effect, assemble\n'
        'from impactscope.physics.twin.bench import Bench, HammerTap\n'
        'from impactscope.physics.twin.equations import UNTRACKED, derivative\n'
        'state, rate = np.zeros(at.N_STATES), np.zeros(at.N_STATES)\n'
        'state[at.V] = 0.5\n'
        'for effects in ((), (Effect("cubic_damping", {"coefficient": 2000.0}),)):\n'
        '    par = assemble(Bench(damper=None), HammerTap(), effects)\n'
        '    derivative(par, 0.0, state, at.GONE, UNTRACKED, rate)\n'
        '    print(par[at.PLATE_MASS] * rate[at.V], rate[at.LOST])\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', code],
        env={**os.environ, 'PYTHONPATH': str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    plain, more = (np.array(line.split(), float) for line in done.stdout.splitlines())
    np.testing.assert_allclose(more - plain, [-2000.0 * 0.5**3, 2000.0 * 0.5**4])
