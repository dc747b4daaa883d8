"""The end of a tap: where it was read too early, the recording is cut later.

The force of a tap is not known, and its end is read from the samples. Where it is read a sample
too early, the last of the hammer's push is taken for something that the bench does of its own.
What the bench does, it goes on doing; a hammer does not.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from scipy import stats

from impactscope.discrepancy.impact.fits.least_squares import Fit, fit

__all__ = ['with_later_cuts']

_LATER = 0.5  # of the length of a tap, by which it is cut later
_AT_LEAST = 2e-3  # s
_AT_FIRST = 3e-3  # s after its end, in which a tap that was cut too early is missed
_MISSED = 1e-3  # chance of what is left there, below which it is looked at again
_PUSHED, _PUSHED_ONCE = 3.0, 3.5  # standard deviations, all at first together, and one sample
_GAIN = 20.0  # of chi-square, beyond that of the samples that a later cut leaves out
_MET = 1.15  # mean square of what is left of a tap


def with_later_cuts(baseline: Fit) -> Fit:
    """The baseline with taps cut later where only their first milliseconds are missed.

    Other than an effect, which would be seen in all that follows.
    """
    layout, model = baseline.layout, baseline.model
    taps = [i for i in layout.blows if model.data.blows[i].recording.kind == 'tap']
    early = [i for i in taps if _missed_at_first(baseline, i) and _may_push(baseline, i)]
    if not early:
        return baseline
    later = _later(baseline, early)
    cut = [i for i in early if _was_the_cut(baseline, later, i)]
    return later if cut == early else _later(baseline, cut) if cut else baseline


def _missed_at_first(found: Fit, i: int) -> bool:
    blow, layout = found.model.data.blows[i], found.layout
    power, count = 0.0, 0
    for name, channel in blow.channels.items():
        since = channel.centres[layout.masks[i, name]] - blow.settled
        left = found.residuals[layout.spans[i, name]][(since > 0.0) & (since < _AT_FIRST)]
        power += float(left @ left)
        count += left.size
    return count > 0 and float(stats.chi2.sf(power, count)) < _MISSED


def _may_push(found: Fit, i: int) -> bool:
    """Whether what is left of a tap at first may be a hammer that still pushes.

    Whatever acts within the bench, as a stop, shows in the force of the sensor as much as it slows
    the plate. What is left of force and mass times acceleration came from outside.
    """
    blow, layout, values = found.model.data.blows[i], found.layout, found.values
    left = []
    for name in ('force', 'acceleration.plate'):
        channel = blow.channels.get(name)
        if channel is None or channel.colour is not None:
            return True
        mask = layout.masks[i, name]
        since = channel.centres[mask] - blow.settled
        early = (since > 0.0) & (since < _AT_FIRST)
        missed = found.residuals[layout.spans[i, name]] * channel.std[mask]
        gain = values.get(f'gain.{name}', 1.0)
        left.append((since[early], missed[early] / gain, channel.std[mask][early] / gain))
    (time, force, noise), (moments, acceleration, spread) = left
    mass = values.get('sensor.moving_mass', math.nan)
    if time.size == 0 or moments.size == 0 or not mass > 0.0:
        return True
    outside = force + mass * np.interp(time, moments, acceleration)
    size = outside / np.hypot(noise, mass * np.interp(time, moments, spread))
    together = float(np.sum(size)) / math.sqrt(size.size)
    return bool(np.max(size) > _PUSHED_ONCE or together > _PUSHED)


def _later(found: Fit, taps: Sequence[int]) -> Fit:
    """The same fit with some taps cut later."""
    blows = list(found.model.data.blows)
    for i in taps:
        blow = blows[i]
        settled = blow.settled + max(_LATER * (blow.settled - blow.onset), _AT_LEAST)
        channels = {
            name: dataclasses.replace(
                c, used=c.used & ((c.centres < blow.onset) | (c.centres > settled))
            )
            for name, c in blow.channels.items()
        }
        blows[i] = dataclasses.replace(blow, channels=channels, settled=settled)
    data = dataclasses.replace(found.model.data, blows=tuple(blows))
    model = dataclasses.replace(found.model, data=data)
    layout = model.layout(found.layout.blows, found.layout.window)
    return fit(model, layout, found.x)


def _was_the_cut(before: Fit, after: Fit, i: int) -> bool:
    """Whether a tap is met once it is cut later, and was not before."""
    size = [f.layout.blow_spans[i].stop - f.layout.blow_spans[i].start for f in (before, after)]
    power = [_power(f, i) for f in (before, after)]
    level = power[1] / max(size[1], 1)
    gain = power[0] - power[1] - level * (size[0] - size[1])
    return bool(level < _MET and gain > _GAIN)


def _power(found: Fit, i: int) -> float:
    left = found.residuals[found.layout.blow_spans[i]]
    return float(np.sum(left**2))
