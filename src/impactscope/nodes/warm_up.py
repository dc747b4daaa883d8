"""Compiled code is loaded before the first block comes, so that no blow has to wait for it."""

from __future__ import annotations

import numpy as np

from impactscope.detect import ImpactDetector
from impactscope.estimate import Fitter, estimate_impact
from impactscope.estimate.modes import fit_modes
from impactscope.records import Channel, ImpactEvent, SampleBlock, SyncedBlock
from impactscope.synchronise import Synchroniser, SynchroniserSettings

__all__ = ['warm_up_detector', 'warm_up_fitter', 'warm_up_synchroniser']

RATE = 2000.0  # Hz


def _blow() -> np.ndarray:
    """A tap and its ring-down, in noise: enough to reach every compiled function."""
    time = np.arange(round(3 * RATE)) / RATE
    ringing = np.exp(-14.0 * (time - 1.0)) * np.sin(202.0 * (time - 1.0))
    force = 60.0 * np.where(time >= 1.0, ringing, 0.0)
    force += np.random.default_rng(1).normal(0.0, 0.2, time.size)
    return force.astype(np.float32)


def warm_up_synchroniser() -> None:
    """Run two channels of different rates and phases through the synchroniser."""
    stage = Synchroniser(SynchroniserSettings(('a', 'b')))
    values = _blow()[:400]
    for name, rate, shift_ns in (('a', RATE, 0), ('b', 3 * RATE, 12_345)):
        stage.push(SampleBlock(name, 'N', rate, 10**18 + shift_ns, 0, values))
    stage.flush()


def warm_up_detector() -> list[ImpactEvent]:
    """Run a blow through the detector; returns its event."""
    values = _blow()
    channels = (Channel('force', 'N', native_rate=RATE),)
    stage = ImpactDetector()
    events = stage.push(SyncedBlock(10**18, RATE, 0, 0, channels, values[None, :]))
    return [*events, *stage.flush()]


def warm_up_fitter() -> None:
    """Fit a blow, as one oscillation and as modes."""
    fit_modes(_blow()[round(RATE) :], RATE)
    for event in warm_up_detector():
        for sensor in Fitter().push(event):
            estimate_impact(event, sensor)
