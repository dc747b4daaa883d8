"""Scales of the recorded motion from which candidates start: sizes, speeds, frequencies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.physics.twin import layout as at

__all__ = ['LARGEST_FREQUENCY', 'MotionScales']

Array = NDArray[np.float64]

LARGEST_FREQUENCY = 3000.0
"""Hz, up to which a part may ring."""

_RINGING = 0.3  # s after the onset in which resonances are looked for


class MotionScales:
    """What the recordings are like: sizes, speeds, frequencies."""

    def __init__(self, fit: Fit) -> None:
        model, values = fit.model, fit.values
        self.model = model
        self.there: set[str] = set()
        self.travel, self.speed = 1e-6, 1e-6
        self.peak: dict[str, float] = {}
        for i in model.data.fitted:
            blow = model.data.blows[i]
            if blow.recording.kind != 'tap':
                self.there.add('impactor')
                damped = blow.recording.damper and 'damper.parallel_stiffness' in values
                self.there.add('damper' if damped else 'bare')
            rows = model.predict(values, i).rows
            self.travel = max(self.travel, float(np.max(rows[:, at.PLATE_POSITION])))
            self.speed = max(self.speed, float(np.max(np.abs(rows[:, at.PLATE_VELOCITY]))))
            for name, channel in blow.channels.items():
                peak = float(np.max(np.abs(channel.means)))
                self.peak[name] = max(self.peak.get(name, 0.0), peak)
        self.rates = {
            name: channel.sample_rate
            for blow in model.data.blows
            for name, channel in blow.channels.items()
        }
        self.resonances = {name: _resonances(fit, name) for name in model.data.channels}


def _resonances(fit: Fit, channel: str, count: int = 3) -> tuple[float, ...]:
    """Frequencies at which the residual of a channel is strongest, Hz."""
    total: Array | None = None
    step = 0.2 / LARGEST_FREQUENCY
    grid = np.geomspace(8.0, LARGEST_FREQUENCY, 270)
    for i in fit.layout.blows:
        blow = fit.model.data.blows[i]
        if channel not in blow.channels or (i, channel) not in fit.layout.spans:
            continue
        mask = fit.layout.masks[i, channel]
        residual = fit.residuals[fit.layout.spans[i, channel]]
        time = blow.channels[channel].centres[mask]
        after = (time > blow.onset) & (time < blow.onset + _RINGING)
        if np.count_nonzero(after) < 32:
            continue
        x, t = np.clip(residual[after], -50.0, 50.0), time[after]
        even = np.interp(t[0] + step * np.arange(round(_RINGING / step)), t, x - np.mean(x))
        spectrum = np.abs(np.fft.rfft(even, 4 * even.size)) ** 2
        power = np.interp(grid, np.fft.rfftfreq(4 * even.size, step), spectrum)
        total = power if total is None else total + power
    if total is None:
        return ()
    tops, _ = signal.find_peaks(total)
    tops = tops[np.argsort(total[tops])[::-1]][:count]
    return tuple(float(grid[j]) for j in tops)
