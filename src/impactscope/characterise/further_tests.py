"""Which further test would pin a damper layer down at the rate of an impact."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import InputError
from impactscope.estimate.damper_test import DamperTest, LayerTest, rank_further_tests
from impactscope.physics.damper_layer import DamperLayer, MaxwellBranch, cyclic_ramp

__all__ = ['FurtherTest', 'rank_for_impact']

Array = NDArray[np.float64]

_QUICK_TIME = 5e-3  # s: relaxation in the middle of an impact's band
_SHARE = 0.5  # of the stiffness found, that the quick branch is supposed to have
_FORCE_NOISE = 0.5  # N, of a load cell that follows an impact


@dataclass(frozen=True, slots=True)
class FurtherTest:
    """A test that could be made next, and what it promises."""

    name: str
    quick_branch: float  # relative standard uncertainty of a branch at impact rate, the worse
    constants: float  # of the constants found so far, the worst


def rank_for_impact(found: DamperTest, time: Array, displacement: Array) -> list[FurtherTest]:
    """Candidates, best first, if a branch that relaxes within an impact is there unseen.

    ``time`` s and ``displacement`` m, shape (n_samples,), of the test made, from which ``found``
    comes. Uncertainties are Cramér-Rao bounds; infinite: the test leaves it open. Raises
    InputError where ``found`` is not valid.
    """
    if found.layer is None:
        raise InputError(f'a layer that was not identified cannot be ranked: {found.reason}')
    layer = found.layer
    stiffness = _SHARE * layer.instantaneous_stiffness
    quick = MaxwellBranch(stiffness, stiffness * _QUICK_TIME)
    supposed = DamperLayer(layer.equilibrium_stiffness, (*layer.branches, quick))
    depth = float(np.max(displacement))
    done = LayerTest(time, displacement, max(found.rmse, 1e-6))
    slowest = max(branch.relaxation_time for branch in layer.branches)
    ranked = rank_further_tests(supposed, (done,), _candidates(depth, found.speed, slowest))
    own = 1 + 2 * len(layer.branches)
    return [
        FurtherTest(name, _worst(list(stds.values())[own:]), _worst(list(stds.values())[:own]))
        for name, stds in ranked
    ]


def _worst(values: list[float]) -> float:
    return max(values, default=math.inf)


def _candidates(depth: float, speed: float, slowest: float) -> dict[str, LayerTest]:
    tests: dict[str, LayerTest] = {}
    speed = float(f'{6e4 * speed:.3g}') / 6e4  # as people set a machine
    for factor in (10, 100):
        rate = 2000 * factor * speed / depth
        time, u = cyclic_ramp((depth,) * 2, factor * speed, rate)
        name = f'two ramps at {6e4 * factor * speed:.6g} mm/min, {factor} times the speed'
        tests[name] = LayerTest(time, u, _FORCE_NOISE)
    hold = min(5 * slowest, 120.0)
    time = np.concatenate([np.arange(0, 1, 0.01), np.arange(1, 1 + hold, 0.1)])
    name = f'ramp of 1 s and hold for {hold:.0f} s'
    tests[name] = LayerTest(time, depth * np.minimum(time, 1.0), _FORCE_NOISE)
    time = np.arange(0, 1.0, 2e-4)
    shake = 0.5 * depth * np.minimum(time / 0.2, 1.0)
    shake += 0.05 * depth * np.sin(2 * np.pi * 30.0 * time) * (time > 0.2)
    tests['sine of 30 Hz about half the depth, 1 s'] = LayerTest(time, shake, _FORCE_NOISE)
    time = np.arange(0, 0.04, 5e-5)
    blow = depth * np.sin(np.pi * np.minimum(time, 0.02) / 0.02)
    tests['one indentation of 20 ms, as a blow makes it'] = LayerTest(time, blow, _FORCE_NOISE)
    return tests
