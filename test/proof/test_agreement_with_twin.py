"""Two simulators that share no code, the twin and the examination's, agree on known motions."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from impactscope.errors import ConfigurationError
from impactscope.physics.twin.simulate import simulate_at
from impactscope.proof.bench import Pulse
from impactscope.proof.known_cases import KNOWN_CASES

FILE = Path(__file__).parents[2] / 'benchmarks' / 'agreement.py'
_spec = importlib.util.spec_from_file_location('benchmark_agreement', FILE)
bench = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(bench)

CASES = {case.name: case for case in KNOWN_CASES}


def expressible(case):
    try:
        bench.describe(case)
    except ConfigurationError:
        return False
    return True


EXPRESSIBLE = [case for case in KNOWN_CASES if expressible(case)]


def worst(table):
    return max(row.in_noise for row in table)


def test_the_twin_expresses_most_known_cases():
    assert 3 * len(EXPRESSIBLE) >= 2 * len(KNOWN_CASES)


@pytest.mark.parametrize('case', EXPRESSIBLE, ids=lambda c: c.name)
def test_agreement_within_a_tenth_of_the_noise(case):
    exact, examination = bench.compare(case)
    assert {row.channel for row in exact} == set(case.exact(case.times))
    assert {row.channel for row in examination} == set(bench.COLUMNS)
    assert worst(exact) < 0.1
    assert worst(examination) < 0.1


@pytest.mark.parametrize('case', EXPRESSIBLE, ids=lambda c: c.name)
def test_what_is_left_is_the_error_of_integration(case):
    """A law that differed would stay as the tolerance falls."""
    exact = case.exact(case.times)
    assert worst(bench.differences(case, bench.simulate_with_twin(case, 1e-11), exact)) < 1e-3


@pytest.mark.parametrize(
    ('name', 'mechanism'),
    [
        ('dry friction, to rest', 'coulomb_friction'),
        ('hardening spring', 'hardening_spring'),
        ('softening spring', 'softening_spring'),
        ('clearance', 'clearance'),
        ('impact, together', 'gravity_load'),
        ('bouncing on a layer', 'unilateral_contact'),
        ('compliant fixture', 'base_compliance'),
    ],
)
def test_a_twin_without_the_mechanism_is_told(name, mechanism, monkeypatch):
    def without(case):
        sensor, blow, effects = describe(case)
        assert mechanism in {effect.name for effect in effects}
        return sensor, blow, tuple(e for e in effects if e.name != mechanism)

    describe = bench.describe
    monkeypatch.setattr(bench, 'describe', without)
    assert min(worst(table) for table in bench.compare(CASES[name])) > 1


@pytest.mark.parametrize('name', ['half-sine blow', 'impact, together'])
def test_simulate_gives_what_was_compared(name):
    """Cases at rest before the blow go through the public way as well."""
    case = CASES[name]
    described, blow, effects = bench.describe(case)
    public = simulate_at(described, blow, case.times, mechanisms=effects)
    compared = bench.simulate_with_twin(case)
    for channel, values in public.channels.items():
        np.testing.assert_array_equal(values, compared[channel])


@pytest.mark.parametrize(
    'change',
    [
        {'description': {**CASES['free decay'].description, 'fractional': 3.0}},
        {'description': {**CASES['free decay'].description, 'branch_stiffness': 1e4}},
        {'description': {**CASES['free decay'].description, 'gravity_load': 13.0}},
        {'pulses': (Pulse(0.0, 0.005, 300.0, 1.5),)},
        {'pulses': (Pulse(0.0, 0.005, 300.0), Pulse(0.1, 0.005, 300.0))},
    ],
    ids=['stranger', 'lone branch', 'no impactor', 'power', 'two taps'],
)
def test_nothing_of_a_case_is_passed_over(change):
    with pytest.raises(ConfigurationError):
        bench.describe(replace(CASES['free decay'], **change))


def test_the_table_names_every_case_and_what_is_not_expressible(monkeypatch, capsys):
    stranger = replace(
        CASES['free decay'],
        name='creep',
        description={**CASES['free decay'].description, 'fractional': 3.0},
    )
    monkeypatch.setattr(bench, 'KNOWN_CASES', (*EXPRESSIBLE, stranger))
    assert bench.main([]) == 0
    printed = capsys.readouterr().out
    assert all(case.name in printed for case in EXPRESSIBLE)
    assert 'not expressible: creep' in printed
    assert 'fractional' in printed


def test_a_difference_has_its_exit_code(monkeypatch, capsys):
    def loud(case):
        return {name: 1.001 * values for name, values in simulate(case).items()}

    simulate = bench.simulate_with_twin
    monkeypatch.setattr(bench, 'simulate_with_twin', loud)
    assert bench.main([]) == 1
    assert 'free decay' in capsys.readouterr().out
