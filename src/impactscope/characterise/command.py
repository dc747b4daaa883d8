"""What ``impactscope characterise`` does: constants of a spring or a damper from its test."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from impactscope.characterise.further_tests import FurtherTest, rank_for_impact
from impactscope.characterise.page import write_damper_page, write_spring_page
from impactscope.characterise.results import damper_quantities, spring_quantities
from impactscope.characterise.static_test import (
    DISPLACEMENT,
    FORCE,
    read_static_test,
)
from impactscope.errors import ConfigurationError
from impactscope.estimate.damper_test import DamperTest, analyse_cycles
from impactscope.estimate.stiffness_test import CompressionTest, analyse_compression, moving_mass
from impactscope.recordings import ColumnMapping
from impactscope.records import Estimate
from impactscope.report.numbers import Quantity
from impactscope.version import __version__

__all__ = ['UNUSABLE', 'main']

UNUSABLE = 4  # exit code: the file was read, the data cannot tell


def main(
    kind: Literal['spring', 'damper'],
    file: Path,
    console: Console,
    *,
    mapping: ColumnMapping | None = None,
    inputs: Sequence[str] = (),
    force: str = FORCE,
    displacement: str = DISPLACEMENT,
    touch: float = 0.0,
    force_uncertainty: float = 0.005,
    displacement_uncertainty: float = 0.005,
    tolerance: float = 0.01,
    frequency: Estimate | None = None,
    branches: int = 1,
    json_file: Path | None = None,
    report: Path | None = None,
) -> int:
    """Analyse a static test, print the result, write JSON and page where asked for.

    ``touch`` m; the uncertainties are relative standard ones of the machine's channels. For a
    spring: ``tolerance`` is the deviation from a straight line that the linear range may have,
    ``frequency`` the sensor's undamped natural frequency in Hz, from which its moving mass
    follows. For a damper: ``branches`` 1 to 3, or 0 for as many as the data supports. Returns 0,
    or 4 where the data cannot tell. Raises as :func:`read_static_test` does, and
    ConfigurationError for values out of range or a file that cannot be written.
    """
    _check(force_uncertainty, displacement_uncertainty, tolerance, touch, branches, frequency)
    test = read_static_test(
        file, mapping, force=force, displacement=displacement, touch=touch, inputs=inputs
    )
    console.print(f'[bold]{escape(test.name)}[/bold]: {test.time.size} samples, '
                  f'{test.time[-1]:.4g} s')  # fmt: skip
    for note in test.notes:
        console.print(f'note: {escape(note)}')
    machine = {
        'force_uncertainty': force_uncertainty,
        'displacement_uncertainty': displacement_uncertainty,
    }
    if kind == 'spring':
        spring = analyse_compression(test.displacement, test.force, tolerance=tolerance, **machine)
        mass = moving_mass(spring.stiffness, frequency) if spring.valid and frequency else None
        quantities = spring_quantities(spring, mass)
        content = _spring_json(spring, mass)
        valid, reason = spring.valid, spring.reason
    else:
        damper = analyse_cycles(
            test.time, test.displacement, test.force, branches=branches or None, **machine
        )
        further = rank_for_impact(damper, test.time, test.displacement) if damper.valid else []
        quantities = damper_quantities(damper)
        content = _damper_json(damper, further)
        valid, reason = damper.valid, damper.reason
    if valid:
        console.print(_printed(quantities))
        if kind == 'damper':
            _print_damper(damper, further, console)
    else:
        console.print(f'[bold magenta]unusable:[/] {escape(reason)}')
    try:
        if json_file is not None:
            whole = {
                'schema_version': 1,
                'software_version': __version__,
                'kind': kind,
                'source': {'name': test.name, 'sha256': test.sha256, 'notes': list(test.notes)},
                'machine': machine,
                'valid': valid,
                'reason': reason,
                **content,
            }
            text = json.dumps(_finite(whole), indent=1, ensure_ascii=False, allow_nan=False)
            json_file.write_text(text + '\n', encoding='utf-8')
            console.print(f'results: [bold]{escape(str(json_file))}[/bold]')
        if report is not None:
            if kind == 'spring':
                write_spring_page(test, spring, quantities, machine, report)
            else:
                write_damper_page(test, damper, quantities, further, machine, report)
            console.print(f'report: [bold]{escape(str(report))}[/bold]')
    except OSError as error:
        raise ConfigurationError(
            f'{error.filename} cannot be written: {error.strerror}'
        ) from error
    return 0 if valid else UNUSABLE


def _check(
    force_uncertainty: float,
    displacement_uncertainty: float,
    tolerance: float,
    touch: float,
    branches: int,
    frequency: Estimate | None,
) -> None:
    for name, value in (
        ('force uncertainty', force_uncertainty),
        ('displacement uncertainty', displacement_uncertainty),
    ):
        if not 0 <= value < 1:
            raise ConfigurationError(f'{name} is {value!r}; a share from 0 to below 1 is needed')
    if not 0 < tolerance < 1:
        raise ConfigurationError(f'tolerance is {tolerance!r}; a share between 0 and 1 is needed')
    if not math.isfinite(touch):
        raise ConfigurationError(f'touch is {touch!r} m; it must be finite')
    if branches not in (0, 1, 2, 3):
        raise ConfigurationError(f'branches is {branches!r}; 1, 2, 3 or 0 is needed')
    if frequency is not None and not frequency.value > 0:
        raise ConfigurationError(f'frequency is {frequency.value!r} Hz; it must be above zero')


def _printed(quantities: list[Quantity]) -> Table:
    table = Table()
    for name, side in (('quantity', 'left'), ('value ± U (k = 2)', 'right'), ('unit', 'left')):
        table.add_column(name, justify='right' if side == 'right' else 'left')
    for item in quantities:
        value = f'{item.value} ± {item.uncertainty}' if item.uncertainty else item.value
        table.add_row(escape(item.name), value, escape(item.unit))
    return table


def _print_damper(damper: DamperTest, further: list[FurtherTest], console: Console) -> None:
    if damper.correlation is not None:
        names = list(_names(len(damper.branches)))
        table = Table(
            'correlation', *names, caption='of the fit; the gains of the machine left out'
        )
        for name, line in zip(names, damper.correlation, strict=True):
            table.add_row(name, *(f'{value:+.2f}' for value in line))
        console.print(table)
    if damper.warning:
        console.print(f'[bold yellow]one rate:[/] {escape(damper.warning)}')
    table = Table(
        'further test, best first', 'quick branch', 'these constants',
        title='What would pin the layer down at impact rate', title_justify='left',
        caption='relative standard uncertainty to expect, if a branch of 5 ms is there unseen',
    )  # fmt: skip
    for item in further:
        table.add_row(escape(item.name), _share(item.quick_branch), _share(item.constants))
    console.print(table)


def _share(value: float) -> str:
    return f'{100 * value:.2g} %' if value < 1 else 'open'


def _names(branches: int) -> tuple[str, ...]:
    """Short names in the order of the correlation matrix."""
    if branches == 1:
        return ('k2', 'k1', 'c1')
    return ('k_inf', *(f'{letter}{i}' for i in range(1, branches + 1) for letter in 'kc'))


def _estimate(estimate: Estimate) -> dict[str, float]:
    return {'value': estimate.value, 'std': estimate.std}


def _spring_json(spring: CompressionTest, mass: Estimate | None) -> dict[str, Any]:
    return {
        'stiffness': _estimate(spring.stiffness),
        'linear_range': list(spring.linear_range),
        'force_range': list(spring.force_range),
        'linearity_error': spring.linearity_error,
        'hysteresis': spring.hysteresis,
        'energy_loss': spring.energy_loss,
        'rmse': spring.rmse,
        'r_squared': spring.r_squared,
        'strokes': spring.strokes,
        'moving_mass': _estimate(mass) if mass is not None else None,
    }


def _damper_json(damper: DamperTest, further: list[FurtherTest]) -> dict[str, Any]:
    return {
        'equilibrium_stiffness': _estimate(damper.equilibrium_stiffness),
        'branches': [
            {
                'stiffness': _estimate(branch.stiffness),
                'viscosity': _estimate(branch.viscosity),
                'relaxation_time': _estimate(branch.relaxation_time),
            }
            for branch in damper.branches
        ],
        'correlation': damper.correlation.tolist() if damper.correlation is not None else None,
        'correlation_of': list(_names(len(damper.branches))) if damper.branches else [],
        'rmse': damper.rmse,
        'largest_error': damper.largest_error,
        'r_squared': damper.r_squared,
        'cycle_rmse': list(damper.cycle_rmse),
        'speed': damper.speed,
        'warning': damper.warning,
        'further_tests': [
            {
                'name': item.name,
                'quick_branch_std': item.quick_branch,
                'constants_std': item.constants,
            }
            for item in further
        ],
    }


def _finite(value: Any) -> Any:
    """Plain JSON: what is not finite becomes null."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
