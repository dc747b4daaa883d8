"""Recordings in place of the paper's own, which are not public: the twin makes them.

All are the same at every run: the seeds are fixed. Noise and resolution are those of the twin's
default measuring chain (0.4 N on the force, 10 kHz); the paper states neither.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from impactscope.estimate.free_vibration_span import FreeVibration, choose_span
from impactscope.estimate.spectrum import SpectralEstimate, estimate_from_spectrum
from impactscope.paper import published
from impactscope.physics.damper_layer import PAPER_LAYER_RATE, PAPER_LAYER_SH10, cyclic_ramp
from impactscope.physics.pendulum import Orientation, Pendulum
from impactscope.physics.twin.bench import Bench, DamperLayer, HammerTap, PendulumBlow
from impactscope.physics.twin.measurement import DEFAULT_CHAIN, read
from impactscope.physics.twin.simulate import Simulation, simulate

__all__ = [
    'DAMPER_NOISE',
    'DAMPER_PEAKS',
    'SPRING_NOISE',
    'SPRING_TRAVEL',
    'TAP_FORCES',
    'RampTest',
    'TapRecording',
    'damper_test',
    'pendulum_blow',
    'spring_test',
    'tap',
]

Array = NDArray[np.float64]

RATE = 10_000.0  # Hz
TAP_FORCES = (60.0, 70.0, 80.0, 90.0, 100.0)  # N: five gentle strokes of a plastic hammer
TAP_DURATION = 4e-3  # s
TAP_AT = 0.05  # s
TAP_LENGTH = 1.05  # s
BLOW_AT = 0.05
SPRING_TRAVEL = 3e-3  # m, of the compression test: within the sensor's 500 N
SPRING_NOISE = 0.2  # N, of the testing machine's load cell: an assumption
DAMPER_NOISE = 0.2
DAMPER_PEAKS = (0.8e-3, 1.6e-3, 2.4e-3, 3.2e-3, 4.0e-3)  # m, five growing cycles up to 4 mm
TEST_RATE = 10.0  # Hz, of the testing machine's samples


@dataclass(frozen=True, slots=True, eq=False)
class TapRecording:
    """A hammer tap on the bare plate and what is estimated from it; arrays (n_samples,)."""

    time: Array  # s
    force: Array  # N
    acceleration: Array  # m/s², of the plate
    free: FreeVibration
    spectrum: SpectralEstimate

    @property
    def span(self) -> slice:
        """Samples of the free vibration."""
        return slice(self.free.start, self.free.stop)


@cache
def tap(peak: float, friction: float = 0.0, seed: int = 1) -> TapRecording:
    """A tap of ``peak`` N on a guide with ``friction`` N of dry friction, as recorded."""
    effects = {'coulomb_friction': {'force': friction}} if friction else {}
    clean = simulate(
        Bench(damper=None),
        HammerTap(peak, TAP_DURATION),
        mechanisms=effects,
        duration=TAP_LENGTH,
        sample_rate=RATE,
        contact_time=TAP_AT,
    )
    rng = np.random.default_rng((seed, round(peak), round(1e3 * friction)))
    force, plate = (
        read(clean[name], DEFAULT_CHAIN[name], rng) for name in ('force', 'acceleration.plate')
    )
    free = choose_span(force, RATE, earliest=TAP_AT + TAP_DURATION)
    spectrum = estimate_from_spectrum(force[free.start :], RATE)
    return TapRecording(clean.time, force, plate, free, spectrum)


@cache
def pendulum_blow(
    mass_distance: float,
    orientation: Orientation = Orientation.VERTICAL,
    layer: DamperLayer | None = None,
    *,
    kept: bool = False,
    duration: float = 2.0,
    angle: float = published.RELEASE_ANGLE,
) -> Simulation:
    """A pendulum blow, without noise.

    ``kept``: the pendulum stays on the plate after first touch, as section 3.2 of the paper
    assumes; otherwise contact only pushes.
    """
    pendulum = Pendulum(mass_distance=mass_distance)
    return simulate(
        Bench(damper=layer, orientation=orientation),
        PendulumBlow(pendulum, angle),
        mechanisms={'gravity_load': {}} if kept else None,
        duration=duration,
        sample_rate=RATE,
        contact_time=BLOW_AT,
    )


@dataclass(frozen=True, slots=True, eq=False)
class RampTest:
    """A test on the compression machine; all arrays of shape (n_samples,)."""

    time: Array  # s
    displacement: Array  # m
    force: Array  # N, with the load cell's noise
    true_force: Array  # N


def _machine(peaks: tuple[float, ...], speed: float) -> tuple[Array, Array]:
    return cyclic_ramp(peaks, speed, TEST_RATE)


@cache
def spring_test(cycles: int = 1, seed: int = 7) -> RampTest:
    """Compression (or cycles) of the sensor's spring at 1 mm/min (Fig. 7)."""
    time, displacement = _machine((SPRING_TRAVEL,) * cycles, published.SPRING_TEST_SPEED)
    force = published.SPRING_STIFFNESS * displacement
    noise = SPRING_NOISE * np.random.default_rng((seed, cycles)).standard_normal(time.size)
    return RampTest(time, displacement, force + noise, force)


@cache
def damper_test(peaks: tuple[float, ...] = DAMPER_PEAKS, seed: int = 13) -> RampTest:
    """Cyclic ramps on the SH10 layer at 10 mm/min, by the paper's constants (Fig. 12).

    The indenter does not pull: near zero it leaves the layer, which recovers over seconds.
    """
    time, displacement = _machine(peaks, PAPER_LAYER_RATE)
    response = PAPER_LAYER_SH10.response(time, displacement, unilateral=True)
    noise = DAMPER_NOISE * np.random.default_rng(seed).standard_normal(time.size)
    return RampTest(time, displacement, response.force + noise, response.force)
