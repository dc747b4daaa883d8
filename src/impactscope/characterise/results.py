"""Results of static tests as rows that people read: N/mm, mm, percent."""

from __future__ import annotations

from impactscope.estimate.damper_test import DamperTest
from impactscope.estimate.stiffness_test import CompressionTest
from impactscope.records import Estimate
from impactscope.report.numbers import Quantity, format_number, format_quantity

__all__ = ['damper_quantities', 'spring_quantities']


def _plain(name: str, value: float, unit: str, digits: int = 3) -> Quantity:
    return Quantity(name, format_number(value, digits), '', unit)


def spring_quantities(test: CompressionTest, mass: Estimate | None) -> list[Quantity]:
    """Rows of a spring's test; empty where it is not valid."""
    if not test.valid:
        return []
    rows = [
        format_quantity('stiffness', test.stiffness, 'N/mm', scale=1e-3),
        Quantity(
            'linear range',
            f'{1e3 * test.linear_range[0]:.3f} to {1e3 * test.linear_range[1]:.3f}',
            '',
            'mm',
        ),
        Quantity(
            'force over it', f'{test.force_range[0]:.1f} to {test.force_range[1]:.1f}', '', 'N'
        ),
        _plain('linearity error, of that force', 100 * test.linearity_error, '%'),
        _plain('hysteresis, of that force', 100 * test.hysteresis, '%'),
        _plain('energy lost in a cycle', 100 * test.energy_loss, '%'),
        _plain('RMSE about the line', test.rmse, 'N'),
        _plain('R²', test.r_squared, '', 6),
        Quantity('strokes', str(test.strokes), '', ''),
    ]
    if mass is not None:
        rows.append(format_quantity('moving mass k/(2π f_n)²', mass, 'kg'))
    return rows


def damper_quantities(test: DamperTest) -> list[Quantity]:
    """Rows of a damper layer's test; empty where it is not valid."""
    if not test.valid:
        return []
    single = len(test.branches) == 1
    rows = [
        format_quantity(
            'k2' if single else 'k_inf', test.equilibrium_stiffness, 'N/mm', scale=1e-3
        )
    ]
    for i, branch in enumerate(test.branches, 1):
        rows += [
            format_quantity(f'k{i}', branch.stiffness, 'N/mm', scale=1e-3),
            format_quantity(f'c{i}', branch.viscosity, 'N s/mm', scale=1e-3),
            format_quantity(f'c{i}/k{i}, relaxation time', branch.relaxation_time, 's'),
        ]
    rows += [
        _plain('speed of the ramps', 6e4 * test.speed, 'mm/min'),
        _plain('RMSE', test.rmse, 'N'),
        _plain('largest error', test.largest_error, 'N'),
        _plain('R²', test.r_squared, '', 6),
    ]
    rows += [
        _plain(f'RMSE of cycle {i}', value, 'N') for i, value in enumerate(test.cycle_rmse, 1)
    ]
    return rows
