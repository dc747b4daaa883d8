"""The viscoelastic layer on the plate: generalised Maxwell model with any number of branches.

Source: Samarathunga et al., Machines 2024, 12, 26, section 2.3.2, eq. 11 to 14 and 29. A spring
``k2`` stands beside Maxwell branches, each a spring ``k`` in series with a dashpot ``c``; one
branch is the paper's standard linear solid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from impactscope.errors import ConfigurationError, InputError

__all__ = [
    'PAPER_LAYER_RATE',
    'PAPER_LAYER_SH10',
    'DamperLayer',
    'LayerResponse',
    'MaxwellBranch',
    'cyclic_ramp',
]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MaxwellBranch:
    """Spring in series with a dashpot; both above zero, or ConfigurationError."""

    stiffness: float  # k, N/m
    viscosity: float  # c, N s/m

    def __post_init__(self) -> None:
        for name, value in (('stiffness', self.stiffness), ('viscosity', self.viscosity)):
            if not (math.isfinite(value) and value > 0):
                raise ConfigurationError(
                    f'Maxwell branch: {name} is {value!r}; it must be above zero'
                )

    @property
    def relaxation_time(self) -> float:
        """c/k, s."""
        return self.viscosity / self.stiffness


@dataclass(frozen=True, slots=True, eq=False)
class LayerResponse:
    """What a prescribed displacement does to the layer, sample by sample."""

    force: Array  # N, shape (n,)
    branch_forces: Array  # N, shape (n_branches, n)
    surface: Array  # m, shape (n,): the layer's own deformation; the indenter's while touching


@dataclass(frozen=True, slots=True)
class DamperLayer:
    """Generalised Maxwell layer (Fig. 5). Raises ConfigurationError for a stiffness <= 0."""

    equilibrium_stiffness: float  # k2, N/m: what is left when all branches have relaxed
    branches: tuple[MaxwellBranch, ...] = ()
    name: str = 'damper'
    origin: str = ''  # where the constants come from, in a sentence

    def __post_init__(self) -> None:
        if not (math.isfinite(self.equilibrium_stiffness) and self.equilibrium_stiffness > 0):
            raise ConfigurationError(
                f'damper layer: equilibrium_stiffness is {self.equilibrium_stiffness!r}; '
                'it must be above zero'
            )

    @property
    def instantaneous_stiffness(self) -> float:
        """Stiffness against a deformation too quick for any branch to relax, N/m."""
        return self.equilibrium_stiffness + sum(b.stiffness for b in self.branches)

    def dynamic_stiffness(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Complex stiffness F_i/U, N/m, at frequency in Hz, any shape (eq. 13 and 14).

        Its real part is the storage stiffness, its imaginary part the loss stiffness.
        """
        s = 2j * np.pi * np.asarray(frequency, np.float64)
        total = np.full(s.shape, self.equilibrium_stiffness, np.complex128)
        for branch in self.branches:
            total += branch.viscosity * s / (1 + branch.relaxation_time * s)
        return total

    def loss_factor(self, frequency: ArrayLike) -> Array:
        """Loss over storage stiffness at frequency in Hz: near 0, the layer is a mere spring."""
        stiffness = self.dynamic_stiffness(frequency)
        return np.asarray(stiffness.imag / stiffness.real)

    def relaxation(self, time: ArrayLike) -> Array:
        """Force per step of deformation, N/m, at ``time`` s >= 0 after the step; any shape."""
        t = np.asarray(time, np.float64)
        total = np.full(t.shape, self.equilibrium_stiffness)
        for branch in self.branches:
            total += branch.stiffness * np.exp(-t / branch.relaxation_time)
        return total

    def ramp_response(
        self,
        time: ArrayLike,
        speed: float,
        *,
        displacement: float = 0.0,
        branch_forces: tuple[float, ...] | None = None,
    ) -> Array:
        """Force, N, on a ramp of ``speed`` m/s from a given state (eq. 29); shape of ``time``.

        ``displacement`` m and ``branch_forces`` N (one a branch, the f_0 of eq. 29) hold at
        time 0. Raises InputError where their number does not fit.
        """
        t = np.asarray(time, np.float64)
        start = branch_forces if branch_forces is not None else (0.0,) * len(self.branches)
        if len(start) != len(self.branches):
            raise InputError(
                f'damper layer: {len(start)} branch forces for {len(self.branches)} branches'
            )
        force = self.equilibrium_stiffness * (displacement + speed * t)
        for branch, f0 in zip(self.branches, start, strict=True):
            steady = branch.viscosity * speed
            force = force + steady + (f0 - steady) * np.exp(-t / branch.relaxation_time)
        return np.asarray(force)

    def response(
        self,
        time: ArrayLike,
        displacement: ArrayLike,
        *,
        branch_forces: tuple[float, ...] | None = None,
        unilateral: bool = False,
    ) -> LayerResponse:
        """Response to a displacement that runs straight between samples; exact there.

        ``time`` s (strictly rising) and ``displacement`` m have shape (n,). All state is
        carried from sample to sample, so from cycle to cycle. With ``unilateral`` the indenter
        can push but not pull: where the layer recovers more slowly than the indenter leaves,
        the force is zero and the free surface creeps back (implicit midpoint rule) until it is
        met again. Raises InputError on shapes, order or non-finite values.
        """
        t = np.ascontiguousarray(time, np.float64)
        u = np.ascontiguousarray(displacement, np.float64)
        if t.ndim != 1 or t.shape != u.shape or t.size == 0:
            raise InputError(
                f'damper layer: time {t.shape} and displacement {u.shape} must be equal, 1-D'
            )
        if not (np.isfinite(t).all() and np.isfinite(u).all() and (np.diff(t) > 0).all()):
            raise InputError('damper layer: time must rise and all samples must be finite')
        start = branch_forces if branch_forces is not None else (0.0,) * len(self.branches)
        if len(start) != len(self.branches):
            raise InputError(
                f'damper layer: {len(start)} branch forces for {len(self.branches)} branches'
            )
        k = np.array([b.stiffness for b in self.branches], np.float64)
        tau = np.array([b.relaxation_time for b in self.branches], np.float64)
        state = np.array(start, np.float64)
        force, forces, surface = _respond(
            t, u, self.equilibrium_stiffness, k, tau, state, unilateral
        )
        return LayerResponse(force, forces, surface)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _respond(
    t: Array,
    u: Array,
    k_inf: float,
    k: Array,
    tau: Array,
    start: Array,
    unilateral: bool,
) -> tuple[Array, Array, Array]:
    n, branches = t.size, k.size
    force, surface = np.empty(n), np.empty(n)
    forces = np.empty((branches, n))
    f = start.copy()
    free = np.empty(branches)
    w = k_inf + k.sum()
    s = u[0]
    for j in range(n):
        if j > 0:
            h = t[j] - t[j - 1]
            pushed, total = u[j], k_inf * u[j]
            for i in range(branches):
                e = math.exp(-h / tau[i])
                free[i] = f[i] * e + k[i] * (pushed - s) * (1 - e) * tau[i] / h
                total += free[i]
            if unilateral and total < 0:
                # Nothing holds the surface: k_inf s + sum f = 0 decides where it creeps.
                # Implicit midpoint in the dashpots' elongations z = s - f/k.
                above, below = 0.0, 1.0
                for i in range(branches):
                    r = 0.5 * h / tau[i]
                    above += k[i] / w * (s - f[i] / k[i]) / (1 + r)
                    below -= k[i] / w * r / (1 + r)
                middle, s_next = above / below, 0.0
                for i in range(branches):
                    z = s - f[i] / k[i]
                    r = 0.5 * h / tau[i]
                    free[i] = 2 * (z + r * middle) / (1 + r) - z
                    s_next += k[i] / w * free[i]
                s = s_next
                for i in range(branches):
                    f[i] = k[i] * (s - free[i])
                total = 0.0
            else:
                s = pushed
                for i in range(branches):
                    f[i] = free[i]
        else:
            total = k_inf * s + f.sum()
        force[j], surface[j] = total, s
        for i in range(branches):
            forces[i, j] = f[i]
    return force, forces, surface


def cyclic_ramp(
    peaks: tuple[float, ...], speed: float, sample_rate: float, *, lowest: float = 0.0
) -> tuple[Array, Array]:
    """Time s and displacement m, each shape (n,), of ramps up to each peak and back.

    ``speed`` m/s, ``sample_rate`` Hz, ``lowest`` m is where each cycle ends. The protocol of
    the paper's Fig. 12: five cycles of growing displacement at 10 mm/min. Raises
    ConfigurationError unless speed and rate are above zero and every peak above ``lowest``.
    """
    if not (speed > 0 and sample_rate > 0 and peaks and min(peaks) > lowest >= 0):
        raise ConfigurationError(
            f'cyclic ramp: peaks {peaks!r} m above {lowest!r} m, speed {speed!r} m/s and rate '
            f'{sample_rate!r} Hz must be above zero'
        )
    corners = [0.0]
    for peak in peaks:
        corners += [peak, lowest]
    turns = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(corners)) / speed)))
    time = np.arange(int(turns[-1] * sample_rate) + 1) / sample_rate
    return time, np.interp(time, turns, corners)


PAPER_LAYER_RATE = 10e-3 / 60
"""m/s, the 10 mm/min of the paper's compression test."""

PAPER_LAYER_SH10 = DamperLayer(38.32e3, (MaxwellBranch(18.84e3, 77.9e3),))
"""SH10 damper, 24.62 mm, as identified in the paper (section 3.3).

Warning: it holds at 10 mm/min. Its one branch relaxes in 4.1 s, so at 30 Hz this model is a
nearly lossless spring of 57 N/mm, which the real layer is not: add branches found at impact rate.
"""
