"""Section 3.3 of the paper: constants of the damper layer from cyclic ramps (Fig. 12 and 13)."""

from __future__ import annotations

import dataclasses
import math
from functools import cache

import numpy as np
from scipy.optimize import brentq

from impactscope.estimate.damper_test import DamperTest, analyse_cycles
from impactscope.estimate.stiffness_test import split_strokes
from impactscope.paper.recordings import DAMPER_NOISE, DAMPER_PEAKS, damper_test
from impactscope.paper.row import Basis, PaperRow, row
from impactscope.physics.damper_layer import (
    PAPER_LAYER_RATE,
    PAPER_LAYER_SH10,
    cyclic_ramp,
)
from impactscope.physics.twin.bench import IMPACT_RATE_LAYER

__all__ = ['PAPER_PEAK_FORCE', 'damper_fit', 'damper_rows', 'peak_displacement', 'unseen_force']

PAPER_PEAK_FORCE = 175.0  # N, of the fifth cycle
_IMPACT = 30.0  # Hz
_THICKNESS = 24.62e-3  # m, of the layer, section 3.3
_INDENTER = 50e-3  # m, diameter


@cache
def damper_fit() -> DamperTest:
    """The paper's procedure on the simulated cyclic test, all five cycles at once."""
    test = damper_test()
    return analyse_cycles(test.time, test.displacement, test.force)


def _last_peak(scale: float) -> float:
    """Largest force, N, of the five cycles with displacements of ``scale`` times the paper's."""
    peaks = tuple(scale * peak for peak in DAMPER_PEAKS)
    time, displacement = cyclic_ramp(peaks, PAPER_LAYER_RATE, 20.0)
    return float(PAPER_LAYER_SH10.response(time, displacement, unilateral=True).force.max())


@cache
def peak_displacement(force: float) -> float:
    """Displacement, m, at which the fifth cycle reaches ``force`` N."""
    return DAMPER_PEAKS[-1] * float(brentq(lambda s: _last_peak(s) - force, 0.5, 2.0, xtol=1e-4))


def unseen_force() -> float:
    """Largest force, N, that the branches assumed at impact rate add to the cyclic test."""
    test = damper_test()
    quick = IMPACT_RATE_LAYER.response(test.time, test.displacement, unilateral=True)
    return float(np.abs(quick.force - test.true_force).max())


def damper_rows() -> list[PaperRow]:
    """Constants, forces, fit errors, and what the constants do not tell."""
    return [*_constant_rows(), *_force_rows(), *_meaning_rows()]


def _constant_rows() -> list[PaperRow]:
    layer, fit = PAPER_LAYER_SH10, damper_fit()
    branch = layer.branches[0]
    found = fit.branches[0]
    simulated = Basis.SIMULATED
    speed = PAPER_LAYER_RATE * 6e4
    return [
        row('3.3:rate', 'indentation speed', 'mm/min', '10', speed, basis=Basis.GIVEN),
        row(
            '3.3:strain',
            'largest compression of the layer of 24.62 mm',
            '%',
            '',
            100 * DAMPER_PEAKS[-1] / _THICKNESS,
            'at 4 mm',
        ),
        row(
            '3.3:modulus',
            'apparent modulus of the layer under the indenter of 50 mm, relaxed',
            'MPa',
            '',
            layer.equilibrium_stiffness * _THICKNESS / (math.pi / 4 * _INDENTER**2) / 1e6,
            'k_2 times thickness over area: with another indenter k_1, c_1 and k_2 change in '
            'about the ratio of the areas',
        ),
        row(
            '3.3:cycles',
            'cycles of growing displacement',
            '1',
            '5',
            len(split_strokes(damper_test().displacement)) // 2,
            basis=Basis.GIVEN,
        ),
        row(
            '3.3:c1',
            'c_1, fit over all cycles',
            'N s/mm',
            '77.9',
            found.viscosity.value / 1e3,
            f'± {2 * found.viscosity.std / 1e3:.1f} (95 %), by eq. 29 with the state carried from '
            f'cycle to cycle; load cell noise {DAMPER_NOISE:g} N',
            basis=simulated,
            tolerance=0.05 + 2e-3 * found.viscosity.std,
        ),
        row(
            '3.3:k1',
            'k_1, fit over all cycles',
            'N/mm',
            '18.84',
            found.stiffness.value / 1e3,
            f'± {2 * found.stiffness.std / 1e3:.2f} (95 %)',
            basis=simulated,
            tolerance=0.005 + 2e-3 * found.stiffness.std,
        ),
        row(
            '3.3:k2',
            'k_2, fit over all cycles',
            'N/mm',
            '38.32',
            fit.equilibrium_stiffness.value / 1e3,
            f'± {2 * fit.equilibrium_stiffness.std / 1e3:.2f} (95 %)',
            basis=simulated,
            tolerance=0.005 + 2e-3 * fit.equilibrium_stiffness.std,
        ),
        row(
            '3.3:relaxation_time',
            'τ = c_1/k_1',
            's',
            '',
            branch.relaxation_time,
            'eq. 29: k_1 = c_1/τ. An impact lasts some hundredths of a second',
        ),
    ]


def _force_rows() -> list[PaperRow]:
    layer, fit = PAPER_LAYER_SH10, damper_fit()
    test = damper_test()
    strokes = split_strokes(test.displacement)
    fifth = slice(strokes[-2][0], strokes[-1][1])
    assert fit.layer is not None  # noqa: S101  # the simulated test can be identified
    predicted = fit.layer.response(test.time, test.displacement, unilateral=True).force
    residual = (test.force - predicted)[fifth]
    first = layer.ramp_response(DAMPER_PEAKS[-1] / PAPER_LAYER_RATE, PAPER_LAYER_RATE)
    reached = _last_peak(1.0)
    # What the fit of the fifth cycle alone, begun from a relaxed layer, would be wrong by
    own_time = test.time[fifth] - test.time[fifth.start]
    alone = layer.response(own_time, test.displacement[fifth], unilateral=True).force
    forgotten = float(np.abs(alone - test.true_force[fifth]).max())
    return [
        row(
            '3.3:peak_displacement',
            'largest displacement of the fifth cycle, for 175 N',
            'mm',
            '4',
            1e3 * peak_displacement(PAPER_PEAK_FORCE),
            'printed as "about 4 mm"',
            tolerance=0.1,
        ),
        row(
            '3.3:peak_force',
            'force at 4 mm in the fifth cycle',
            'N',
            '175',
            reached,
            f'eq. 29 with the printed constants, whatever the cycles before: {float(first):.1f} N '
            'from the relaxed layer',
        ),
        row(
            '3.3:rms_error',
            'RMS error of the fit, fifth cycle',
            'N',
            '0.857',
            float(np.sqrt(np.mean(residual**2))),
            f'what the assumed noise of {DAMPER_NOISE:g} N leaves where the model is right; more '
            'than that is a coarser load cell or a layer that is not this model',
            basis=Basis.SIMULATED,
            comparable=False,
        ),
        row(
            '3.3:max_error',
            'largest error of the fit, fifth cycle',
            'N',
            '6.1',
            float(np.abs(residual).max()),
            f'the 6.1 N of the paper are {6.1 / 0.857:.0f} times its RMS error: no noise',
            basis=Basis.SIMULATED,
            comparable=False,
        ),
        row(
            '3.3:forgotten_state',
            'largest error if the fifth cycle is taken to begin relaxed',
            'N',
            '6.1',
            forgotten,
            'the branch relaxes over seconds: f_0 of eq. 29 carries on from cycle to cycle, and '
            'forgetting it is an error of this order where the ramp begins',
        ),
    ]


def _meaning_rows() -> list[PaperRow]:
    layer, quick = PAPER_LAYER_SH10, IMPACT_RATE_LAYER
    unseen = unseen_force()
    slow = dataclasses.replace(layer, branches=())
    return [
        row(
            '3.3:stiffness_at_impact',
            'stiffness of this layer at 30 Hz',
            'N/mm',
            '',
            abs(complex(layer.dynamic_stiffness(_IMPACT))) / 1e3,
            'k_1 + k_2: a mere spring',
        ),
        row(
            '3.3:loss_at_impact',
            'its loss factor at 30 Hz',
            '1',
            '',
            float(layer.loss_factor(_IMPACT)),
            'nearly lossless. The "excellent match" at 10 mm/min does not assure the model at '
            'impact rate',
        ),
        row(
            '3.3:unseen_branches',
            f'what branches that give a loss factor of {float(quick.loss_factor(_IMPACT)):.1f} at '
            '30 Hz add at 10 mm/min',
            'N',
            '',
            unseen,
            f'near the noise: a test at 10 mm/min cannot see them, nor tell '
            f'{layer.instantaneous_stiffness / 1e3:.0f} from '
            f'{quick.instantaneous_stiffness / 1e3:.0f} N/mm at impact rate',
        ),
        row(
            '3.3:relaxed_share',
            'k_2 alone at 4 mm',
            'N',
            '',
            slow.equilibrium_stiffness * DAMPER_PEAKS[-1],
            'what is left of the force when the layer is held',
        ),
    ]
