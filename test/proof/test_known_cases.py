"""Exact solutions hold themselves, and both simulators hold against them."""

import numpy as np
import pytest

from impactscope.errors import ConfigurationError
from impactscope.proof.__main__ import main
from impactscope.proof.bench import Pendulum
from impactscope.proof.bench_mujoco import FEATURES, pendulum_speed, simulate_mujoco
from impactscope.proof.known_cases import KNOWN_CASES, agreement, simulate


def test_the_integrator_agrees_far_below_a_tenth_of_the_noise():
    table = agreement(simulate)
    assert {row.case for row in table} == {case.name for case in KNOWN_CASES}
    assert max(row.in_noise for row in table) < 0.01


def test_a_wrong_simulator_is_told():
    def heavier(case):
        samples = simulate(case)
        return {name: 1.001 * values for name, values in samples.items()}

    assert max(row.in_noise for row in agreement(heavier)) > 1


def test_a_wrong_simulator_has_its_exit_code(tmp_path, monkeypatch, capsys):
    (tmp_path / 'shaky.py').write_text(
        'from impactscope.proof.known_cases import simulate\n'
        'def wrong(case):\n'
        '    return {n: 1.01 * v for n, v in simulate(case).items()}\n'
    )
    monkeypatch.syspath_prepend(tmp_path)
    arguments = ['agreement', '--features', 'cubic', '--simulator']
    assert main([*arguments, 'impactscope.proof.known_cases:simulate']) == 0
    assert main([*arguments, 'shaky:wrong']) == 1
    assert 'hardening spring' in capsys.readouterr().out


def test_cases_beyond_a_simulator_are_left_out():
    cases = {row.case for row in agreement(simulate, frozenset({'cubic'}))}
    assert 'hardening spring' in cases
    assert 'compliant fixture' not in cases


@pytest.mark.parametrize('case', KNOWN_CASES, ids=lambda c: c.name)
def test_exact_solutions_satisfy_newton(case):
    """Acceleration is the second difference of position, where both are exact."""
    exact = case.exact(case.times)
    if not {'displacement.plate', 'acceleration.plate'} <= set(exact):
        return
    x, a = exact['displacement.plate'], exact['acceleration.plate']
    step = case.times[1] - case.times[0]
    second = (x[2:] - 2 * x[1:-1] + x[:-2]) / step**2
    usual = np.quantile(np.abs(second - a[1:-1]), 0.97)  # but for kinks inside the stencil
    assert usual < 0.01 * np.abs(a).max()


def test_mujoco_agrees_with_a_tenth_of_the_noise():
    assert max(r.in_noise for r in agreement(simulate_mujoco, FEATURES)) < 0.1


@pytest.mark.parametrize('orientation', ['vertical', 'horizontal'])
def test_mujoco_pendulum_has_the_speed_of_the_paper(orientation):
    pendulum = Pendulum()
    expected = pendulum.speed(0.2, 16, orientation)
    assert pendulum_speed(pendulum, 0.2, 16, orientation) == pytest.approx(expected, rel=1e-6)


def test_mujoco_refuses_what_it_cannot_express():
    case = next(c for c in KNOWN_CASES if c.name == 'hardening spring')
    with pytest.raises(ConfigurationError):
        simulate_mujoco(case)
