"""How far the plain recording of the EMPS axis determines what PULSES will show.

    IMPACTSCOPE_DATA=FOLDER python benchmarks/emps_identifiability.py

The law is the one that the search finds: mass, viscous and Coulomb friction, offset. Its numbers
are fitted to the plain recording; their covariance allows for coloured residuals (scatter of the
gradient over blocks). Numbers drawn from it predict PULSES in open loop. Beside that stands what
the same law reaches when it is fitted to PULSES itself, or to both: what the law can carry and
the plain recording cannot tell.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import os
import runpy
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impactscope.campaign_files import load_campaign
from impactscope.discrepancy.driven.data.recordings import cuts
from impactscope.discrepancy.driven.fits.simulation_error import (
    FINE,
    Fit,
    counted,
    fit,
    numbers_of,
)
from impactscope.discrepancy.driven.models.model import Segment
from impactscope.discrepancy.driven.models.oscillator_model import OscillatorModel
from impactscope.discrepancy.driven.models.terms import Term
from impactscope.discrepancy.driven.systems.linear_oscillator import linear_oscillator
from impactscope.discrepancy.single_thread import single_threaded

Array = NDArray[np.float64]
LAW = ('coulomb_friction', 'offset')
BLOCKS = (12, 24, 48)
STEP = 1e-4
WANTED = 5.0  # mm


def campaigns(folder: Path, scratch: Path, machines: Sequence[str]) -> dict[str, Path]:
    """Campaign folders of published measurements, by machine; what is not there is left out."""
    script = Path(__file__).resolve().parents[1] / 'scripts' / 'real_machines.py'
    made: dict[str, Path] = runpy.run_path(str(script))['make'](folder, scratch, tuple(machines))
    return made


def _slopes(model: OscillatorModel, terms: tuple[Term, ...], made: Fit, segment: Segment) -> Array:
    """Derivatives of the predicted position by each number, shape (n, k)."""
    none = np.zeros(0)
    base = model.predict(made.values, terms, none, segment)
    columns = []
    for name, number in numbers_of(model, terms):
        step = STEP * number.scale
        moved = {**made.values, name: made.values[name] + step}
        columns.append((model.predict(moved, terms, none, segment) - base) / step)
    return np.stack(columns, axis=1)


def covariance(slopes: Array, residual: Array, blocks: int) -> Array:
    """Covariance of the numbers, with the gradient's scatter over blocks of samples, (k, k)."""
    inverse = np.linalg.inv(slopes.T @ slopes)
    edges = np.linspace(0, residual.size, blocks + 1).astype(int)
    parts = np.array([slopes[a:b].T @ residual[a:b] for a, b in itertools.pairwise(edges)])
    return np.asarray(inverse @ (parts.T @ parts) @ inverse)


def _error(
    model: OscillatorModel, terms: tuple[Term, ...], values: dict[str, float], s: Segment
) -> float:
    residual = s.measured - model.predict(values, terms, np.zeros(0), s)
    return 1e3 * float(np.sqrt(np.mean(residual**2)))


def report(folder: Path, draws: int) -> None:
    """Print the analysis of the campaign in a folder."""
    campaign = load_campaign(folder)
    parts = cuts(campaign, ['displacement.axis'], 'force.drive', [])
    model, segments, linear = linear_oscillator(parts, spring=False, held=True)
    terms = tuple(t for t in model.terms if t.name in LAW)
    swapped = [dataclasses.replace(s, held_out=not s.held_out) for s in segments]
    together = [dataclasses.replace(s, held_out=False) for s in segments]
    start = {**linear.values, 'coulomb_friction.force': 20.0, 'offset.value': 3.0}
    plain = fit(model, terms, segments, start, tolerance=FINE)
    pulses = fit(model, terms, swapped, plain.values, tolerance=FINE)
    both = fit(model, terms, together, plain.values, tolerance=FINE)
    print('\nemps: what the plain recording can tell of PULSES (same law, added numbers: 2)')
    print(f'  {"fitted to":<10}{"plain":>9}{"PULSES":>9}  mm rms of the open-loop position')
    for name, made in (('plain', plain), ('PULSES', pulses), ('both', both)):
        numbers = ', '.join(
            f'{k.rsplit(".", 1)[0]} {v:.4g} +- {made.std[k]:.2g}' for k, v in made.values.items()
        )
        print(f'  {name:<10}{1e3 * made.rms(0):9.2f}{1e3 * made.rms(1):9.2f}  {numbers}')
    here, there = (_slopes(model, terms, plain, s) for s in segments)
    counts = np.stack([counted(model, j, segments[0]) for j in here.T], axis=1)
    residual = counted(model, plain.residuals[0], segments[0])
    names = [k for k, _ in numbers_of(model, terms)]
    centre = np.array([plain.values[k] for k in names])
    for blocks in BLOCKS:
        spread = covariance(counts, residual, blocks)
        sigma = np.sqrt(np.mean(np.einsum('ij,jk,ik->i', there, spread, there)))
        rng = np.random.default_rng(blocks)
        errors = np.array(
            [
                _error(model, terms, dict(zip(names, values, strict=True)), segments[1])
                for values in rng.multivariate_normal(centre, spread, draws)
            ]
        )
        low, middle, high = np.quantile(errors, [0.05, 0.5, 0.95])
        print(
            f'  covariance from {blocks} blocks: PULSES uncertain by {1e3 * sigma:.1f} mm rms '
            f'(1 sigma); {draws} draws: {low:.1f}, {middle:.1f}, {high:.1f} mm (5, 50, 95 %), '
            f'{np.count_nonzero(errors < WANTED)} below {WANTED:g} mm'
        )
    change = [abs(pulses.values[k] - plain.values[k]) for k in names]
    print(
        '  from plain to PULSES: '
        + ', '.join(f'{k.rsplit(".", 1)[0]} {d:.2g}' for k, d in zip(names, change, strict=True))
        + f'; 0.1 N of offset moves PULSES by {1e2 * np.sqrt(np.mean(there[:, -1] ** 2)):.1f} mm'
        ' rms'
    )


def main(argv: list[str] | None = None) -> int:
    """Print the analysis; nothing is done without the published measurements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='fewer draws')
    options = parser.parse_args(argv)
    folder = os.environ.get('IMPACTSCOPE_DATA', '')
    if not folder or not (Path(folder) / 'emps').is_dir():
        print('IMPACTSCOPE_DATA names no folder with the EMPS measurements: nothing done')
        return 0
    with tempfile.TemporaryDirectory() as scratch, single_threaded():
        made = campaigns(Path(folder), Path(scratch), ('emps',))
        report(made['emps'], 30 if options.quick else 200)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
