"""Constants of a viscoelastic layer from a compression test, and what that test cannot tell.

Source: Samarathunga et al., Machines 2024, 12, 26, section 3.3, eq. 29, Fig. 12 and 13. All cycles
are fitted at once with the layer's state carried from cycle to cycle, since the branch relaxes
over seconds; while the indenter has left the layer behind, the force is zero and tells nothing.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares, nnls

from impactscope.errors import InputError
from impactscope.estimate.stiffness_test import split_strokes
from impactscope.physics.damper_layer import DamperLayer, MaxwellBranch
from impactscope.records import Estimate

__all__ = [
    'BranchEstimate',
    'DamperTest',
    'LayerTest',
    'analyse_cycles',
    'layer_information',
    'rank_further_tests',
]

Array = NDArray[np.float64]

_UNKNOWN = Estimate()
_FEWEST_SAMPLES = 40
_IMPACT_FREQUENCY = 30.0  # Hz, about that of a blow on a sensor
_PLAUSIBLE = (1e2, 1e8)  # N/m
_WORST = 0.5  # relative uncertainty of a constant beyond which it is not told
_TRIED = 24  # relaxation times per decade grid


@dataclass(frozen=True, slots=True)
class BranchEstimate:
    """One Maxwell branch."""

    stiffness: Estimate  # k, N/m
    viscosity: Estimate  # c, N s/m
    relaxation_time: Estimate  # s


@dataclass(frozen=True, slots=True, eq=False)
class DamperTest:
    """What a test of a layer tells. NaN and None where it could not be told."""

    valid: bool
    reason: str  # why not, in words; empty where valid
    warning: str = ''  # where the constants hold, and where they do not
    layer: DamperLayer | None = None
    equilibrium_stiffness: Estimate = _UNKNOWN  # k2, N/m
    branches: tuple[BranchEstimate, ...] = ()
    correlation: Array | None = None  # of log k2, log k1, log c1, ...; shape (p, p)
    rmse: float = math.nan  # N
    largest_error: float = math.nan  # N
    r_squared: float = math.nan
    cycle_rmse: tuple[float, ...] = ()  # N, cycle by cycle
    speed: float = math.nan  # m/s, median of the ramps'


@dataclass(frozen=True, slots=True, eq=False)
class LayerTest:
    """A test that could be made: displacement m over time s, both shape (n_samples,)."""

    time: Array
    displacement: Array
    force_noise: float = 0.5  # N, standard deviation


def analyse_cycles(
    time: ArrayLike,
    displacement: ArrayLike,
    force: ArrayLike,
    *,
    branches: int | None = 1,
    force_uncertainty: float = 0.005,
    displacement_uncertainty: float = 0.005,
) -> DamperTest:
    """Identify a layer from a compression test of any number of cycles.

    ``time`` s, ``displacement`` m of the indenter and ``force`` N have shape (n_samples,), from
    the untouched layer on, growing with compression. ``branches`` None takes as many, up to
    three, as the Bayesian information criterion supports. The uncertainties given are relative
    standard ones of the machine's channels. Raises InputError where the arrays do not fit.
    """
    t, u, f = (np.asarray(x, np.float64) for x in (time, displacement, force))
    if not t.shape == u.shape == f.shape or t.ndim != 1:
        raise InputError(f'damper test: time {t.shape}, displacement {u.shape}, force {f.shape}')
    kept = np.isfinite(t) & np.isfinite(u) & np.isfinite(f)
    t, u, f = t[kept], u[kept], f[kept]
    reason = _unusable(t, u, f)
    if reason:
        return DamperTest(False, reason)
    counts = (branches,) if branches is not None else (1, 2, 3)
    fits = [_fit(t, u, f, count) for count in counts]
    best = min(fits, key=lambda fit: fit.criterion)
    gain = math.hypot(force_uncertainty, displacement_uncertainty)
    stds = np.sqrt(np.diag(best.covariance))
    layer = _layer(best.parameters)
    if not np.isfinite(stds).all() or stds.max() > _WORST:
        worst = _names(len(layer.branches))[int(np.argmax(np.nan_to_num(stds, nan=np.inf)))]
        return DamperTest(
            False,
            f'the test does not tell {worst}: its relative uncertainty is {stds.max():.2g}; '
            'ramps much faster, or holds much longer, than the relaxation are needed',
        )
    if not _PLAUSIBLE[0] < layer.instantaneous_stiffness < _PLAUSIBLE[1]:
        return DamperTest(
            False,
            f'a stiffness of {layer.instantaneous_stiffness:.4g} N/m is that of no damper '
            'layer: check the units (N, m)',
        )
    total = f - f.mean()
    r_squared = 1 - float(best.residual @ best.residual) / float(total @ total)
    if r_squared < 0.9:
        return DamperTest(False, f'the model does not describe the record: R² {r_squared:.2f}')
    found = tuple(_branch(branch, i, best, gain) for i, branch in enumerate(layer.branches))
    k2 = layer.equilibrium_stiffness
    scatter = stds[:, None] * stds[None, :]
    strokes = split_strokes(u)
    cycles = [
        (strokes[i][0], strokes[min(i + 1, len(strokes) - 1)][1])
        for i in range(0, len(strokes), 2)
    ]
    speed = float(np.median(np.abs(np.diff(u) / np.diff(t))))
    return DamperTest(
        True,
        '',
        _warning(layer, t, speed),
        layer,
        Estimate(k2, k2 * math.hypot(stds[0], gain)),
        found,
        best.covariance / scatter,
        float(np.sqrt(np.mean(best.residual**2))),
        float(np.abs(best.residual).max()),
        r_squared,
        tuple(float(np.sqrt(np.mean(best.residual[a:b] ** 2))) for a, b in cycles),
        speed,
    )


def layer_information(layer: DamperLayer, test: LayerTest) -> Array:
    """Fisher information of a test on the logarithms of k2, k1, c1, k2', c2', ...; shape (p, p).

    The diagonal's inverse roots are relative uncertainties if all else were known; those of the
    inverse matrix are what the test can reach (Cramér-Rao).
    """
    jacobian = _jacobian(_parameters(layer), test.time, test.displacement)
    return np.asarray(jacobian.T @ jacobian / test.force_noise**2)


def rank_further_tests(
    layer: DamperLayer, done: tuple[LayerTest, ...], candidates: Mapping[str, LayerTest]
) -> list[tuple[str, dict[str, float]]]:
    """Which further test would pin the layer down: best first.

    For each candidate, made after those ``done``, the relative standard uncertainty to expect
    of each constant (Cramér-Rao, inf where it stays open); ranked by the worst of them. Include
    in ``layer`` a branch that may be there: a test at one rate leaves it open by decades.
    """
    size = 1 + 2 * len(layer.branches)
    known = np.zeros((size, size))
    for test in done:
        known += layer_information(layer, test)
    names = _names(len(layer.branches))
    ranked = []
    for name, test in candidates.items():
        stds = _reachable(known + layer_information(layer, test))
        ranked.append((name, dict(zip(names, (float(s) for s in stds), strict=True))))
    return sorted(ranked, key=lambda item: max(item[1].values()))


def _reachable(information: Array) -> Array:
    """Roots of the inverse's diagonal; inf where the information is singular."""
    values, vectors = np.linalg.eigh(information)
    least = values.max() * 1e-13
    open_ = values <= least
    stds = np.sqrt((vectors[:, ~open_] ** 2 / values[~open_]).sum(axis=1))
    stds[(vectors[:, open_] ** 2).sum(axis=1) > 1e-6] = math.inf
    return np.asarray(stds)


def _names(branches: int) -> list[str]:
    names = ['equilibrium stiffness']
    for i in range(1, branches + 1):
        names += [f'stiffness of branch {i}', f'viscosity of branch {i}']
    return names


def _unusable(t: Array, u: Array, f: Array) -> str:
    if t.size < _FEWEST_SAMPLES:
        return f'{t.size} samples; at least {_FEWEST_SAMPLES} are needed'
    if not (np.diff(t) > 0).all():
        return 'time does not rise from sample to sample'
    strokes = split_strokes(u)
    travel = float(np.ptp(u))
    if not travel > 0 or u[strokes[0][1] - 1] - u[strokes[0][0]] < 0.05 * travel:
        return 'the displacement does not begin with a ramp into the layer'
    shortest = min(b - a for a, b in strokes)
    if shortest < 5:
        return 'the displacement is no ramp: it turns within five samples'
    if not np.ptp(f) > 0:
        return f'the force does not vary: {f[0]:.4g} N all along'
    if float(np.corrcoef(u, f)[0, 1]) < 0.5:
        return 'the force does not grow with the displacement: check channels and signs'
    return ''


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    parameters: Array  # logarithms
    covariance: Array  # of them
    residual: Array
    criterion: float


def _parameters(layer: DamperLayer) -> Array:
    values = [layer.equilibrium_stiffness]
    for branch in layer.branches:
        values += [branch.stiffness, branch.viscosity]
    return np.log(values)


def _layer(parameters: Array) -> DamperLayer:
    values = np.exp(parameters)
    pairs = zip(values[1::2], values[2::2], strict=True)
    return DamperLayer(
        float(values[0]), tuple(MaxwellBranch(float(k), float(c)) for k, c in pairs)
    )


def _predict(parameters: Array, t: Array, u: Array) -> Array:
    return _layer(parameters).response(t, u, unilateral=True).force


def _jacobian(parameters: Array, t: Array, u: Array) -> Array:
    """Derivatives of the force to the logarithms, central differences, shape (n, p)."""
    step = 1e-4
    columns = []
    for i in range(parameters.size):
        shift = np.zeros(parameters.size)
        shift[i] = step
        up, down = _predict(parameters + shift, t, u), _predict(parameters - shift, t, u)
        columns.append((up - down) / (2 * step))
    return np.array(columns).T


def _fit(t: Array, u: Array, f: Array, branches: int) -> _Fit:
    solution = least_squares(
        lambda p: _predict(p, t, u) - f,
        _start(t, u, f, branches),
        jac=lambda p: _jacobian(p, t, u),
        x_scale='jac',
        max_nfev=60,
    )
    residual = f - _predict(solution.x, t, u)
    jacobian = _jacobian(solution.x, t, u)
    n, size = jacobian.shape
    energy = float(residual @ residual)
    variance = energy / (n - size)
    # Errors of a model go together from sample to sample: fewer of them count as independent.
    lag = float(np.clip(residual[1:] @ residual[:-1] / energy, 0, 0.999)) if energy > 0 else 0.0
    inflation = (1 + lag) / (1 - lag)
    scale = np.linalg.norm(jacobian, axis=0)
    if not (scale > 0).all():
        covariance = np.full((size, size), math.inf)
    else:
        inverse = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale), rcond=1e-14)
        covariance = variance * inflation * inverse / np.outer(scale, scale)
    independent = max(n / inflation, size + 2.0)
    criterion = independent * math.log(max(energy / n, 1e-300)) + size * math.log(independent)
    return _Fit(solution.x, covariance, residual, criterion)


def _start(t: Array, u: Array, f: Array, branches: int) -> Array:
    """Best of a grid of relaxation times, the stiffnesses by linear least squares.

    Samples without force are left out; the layer is taken as glued to the indenter there.
    """
    touching = f > 0.02 * f.max()
    step, duration = float(np.median(np.diff(t))), float(t[-1] - t[0])
    grid = np.geomspace(2 * step, duration, _TRIED if branches == 1 else _TRIED // 2)
    unit = {
        tau: DamperLayer(1.0, (MaxwellBranch(1.0, tau),)).response(t, u).branch_forces[0]
        for tau in grid
    }
    best, start = math.inf, np.zeros(0)
    for taus in itertools.combinations(grid, branches):
        design = np.column_stack([u, *(unit[tau] for tau in taus)])[touching]
        stiffness, misfit = nnls(design, f[touching])
        if misfit < best:
            floor = 1e-3 * stiffness.max()
            k = np.maximum(stiffness, floor)
            pairs = itertools.chain.from_iterable(
                (k[i + 1], k[i + 1] * tau) for i, tau in enumerate(taus)
            )
            best, start = misfit, np.log([k[0], *pairs])
    return start


def _branch(branch: MaxwellBranch, index: int, fit: _Fit, gain: float) -> BranchEstimate:
    at = 1 + 2 * index
    variance = fit.covariance
    k_std, c_std = math.sqrt(variance[at, at]), math.sqrt(variance[at + 1, at + 1])
    ratio = variance[at, at] + variance[at + 1, at + 1] - 2 * variance[at, at + 1]
    tau = branch.relaxation_time
    return BranchEstimate(
        Estimate(branch.stiffness, branch.stiffness * math.hypot(k_std, gain)),
        Estimate(branch.viscosity, branch.viscosity * math.hypot(c_std, gain)),
        Estimate(tau, tau * math.sqrt(max(ratio, 0.0))),  # a common gain leaves it alone
    )


def _warning(layer: DamperLayer, t: Array, speed: float) -> str:
    """Where the constants hold: processes between the test's length and its quickest branch."""
    quickest = min(branch.relaxation_time for branch in layer.branches)
    step = float(np.median(np.diff(t)))
    highest = 1 / (2 * math.pi * max(min(quickest, 1e3), step)) * 10
    if highest >= _IMPACT_FREQUENCY:
        return ''
    stiffness = abs(complex(layer.dynamic_stiffness(_IMPACT_FREQUENCY)))
    loss = float(layer.loss_factor(_IMPACT_FREQUENCY))
    return (
        f'Found at {speed * 6e4:.3g} mm/min, these constants hold up to about {highest:.2g} Hz. '
        f'At {_IMPACT_FREQUENCY:g} Hz this model is a spring of {stiffness / 1e3:.3g} N/mm with '
        f'a loss factor of {loss:.1g}; a real layer has quicker losses that one slow rate does '
        'not show. Test at impact rate as well.'
    )
