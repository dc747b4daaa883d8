"""Channels whose stamps are off by milliseconds: seen by when each begins to move.

No fit leads there: a model that has to meet one channel early and another late meets neither.
"""

from __future__ import annotations

import contextlib
import dataclasses
import statistics
from collections.abc import Sequence

import numpy as np

from impactscope.discrepancy.impact.candidates.candidate import Candidate
from impactscope.discrepancy.impact.candidates.catalogue import candidates
from impactscope.discrepancy.impact.fits.growing_windows import fit_baseline
from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.discrepancy.impact.models.bench_model import ImpactModel
from impactscope.errors import ImpactscopeError

__all__ = ['lags', 'with_late_channel']

_BEGINS = 0.1  # of the peak
_SEEN = 12.0  # times the noise, that a peak must have
_LEAST = 1.5e-3  # s, of a lag that a fit from nought would not find
_LEAST_SAMPLES = 3.0
_CHANNELS = 3  # that must begin to move for one of them to be the odd one


def lags(model: ImpactModel) -> dict[int, dict[str, float]]:
    """By how much later, s, each channel of each fitted blow moves than is simulated.

    Simulated with the numbers as they are stated and the blow at its onset. Taps are passed over:
    their force is not known.
    """
    values = model.values(model.start())
    found: dict[int, dict[str, float]] = {}
    for i in model.data.fitted:
        blow = model.data.blows[i]
        if blow.recording.kind == 'tap':
            continue
        prediction = model.predict(values, i)
        found[i] = {}
        for name, channel in blow.channels.items():
            measured = np.abs(np.nan_to_num(channel.samples))
            simulated = np.abs(prediction.means[name])
            peak, top = float(np.max(measured)), float(np.max(simulated))
            if peak < _SEEN * channel.noise or top <= 0.0:
                continue
            begins = float(channel.time[int(np.argmax(measured > _BEGINS * peak))])
            expected = float(channel.centres[int(np.argmax(simulated > _BEGINS * top))])
            found[i][name] = begins - expected
    return found


def with_late_channel(baseline: Fit, baseline_names: Sequence[str]) -> list[tuple[Candidate, Fit]]:
    """The clock of the channel that is out of step, fitted from a cold start; none if none is."""
    model = baseline.model
    with contextlib.suppress(ImpactscopeError):
        found = {i: seen for i, seen in lags(model).items() if len(seen) >= _CHANNELS}
        against: dict[str, list[float]] = {}
        for seen in found.values():
            middle = statistics.median(seen.values())
            for name, lag in seen.items():
                against.setdefault(name, []).append(lag - middle)
        if not against:
            return []
        off = {name: statistics.median(values) for name, values in against.items()}
        channel = max(off, key=lambda name: abs(off[name]))
        rates = {n: c.sample_rate for b in model.data.blows for n, c in b.channels.items()}
        if abs(off[channel]) < max(_LEAST, _LEAST_SAMPLES / rates[channel]):
            return []
        clock = next(
            (
                c
                for c in candidates(baseline, baseline_names)
                if c.name == 'clock_error' and c.channel == channel and c.cost == 1
            ),
            None,
        )
        if clock is None:
            return []
        start = dataclasses.replace(clock.free[0], start=off[channel])
        late = dataclasses.replace(clock, free=(start,))
        # an early channel has set the onsets too early
        shift = max(0.0, -off[channel] if channel != 'acceleration.impactor' else 0.0)
        with contextlib.suppress(ImpactscopeError):
            return [(clock, fit_baseline(late.extend(_later(model, shift))))]
    return []


def _later(model: ImpactModel, shift: float) -> ImpactModel:
    """The model with blows that begin ``shift`` s after what was taken for their onset."""
    blows = tuple(
        dataclasses.replace(b, onset=b.onset + shift, settled=max(b.settled, b.onset + shift))
        for b in model.data.blows
    )
    free = tuple(
        dataclasses.replace(f, start=f.start + shift, lower=f.lower + shift, upper=f.upper + shift)
        if f.key.startswith('time@')
        else f
        for f in model.free
    )
    data = dataclasses.replace(model.data, blows=blows)
    return dataclasses.replace(model, data=data, free=free, solutions=[])
