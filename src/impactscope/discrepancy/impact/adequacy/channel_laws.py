"""Laws of a channel that no mechanism has: echoes, resonances, bent scales, limits, cross-talk.

Each is one number of one channel, taken along what a fit says the channel reads: so few that a
weak one stands out, where the picture of everything a chain might do has to be strong.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from impactscope.discrepancy.impact.adequacy.bench_laws import Law
from impactscope.discrepancy.impact.data.binning import BinnedChannel
from impactscope.discrepancy.impact.fits.least_squares import Fit
from impactscope.physics.slew_limit import behind

__all__ = ['chain_laws', 'channel_shapes']

Array = NDArray[np.float64]

_ECHOES = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0)  # ms
_RESONANCES = (0.03, 0.05, 0.08, 0.13, 0.2, 0.3)  # of the sampling rate
_QUALITY = 5.0
_SLEW = (0.95, 0.85, 0.7, 0.55, 0.4)  # of the steepest rate of any blow: limits that are tried


def chain_laws(fit: Fit) -> list[Law]:
    """What each law would change of the residuals of a fit, to first order."""
    layout, model, values = fit.layout, fit.model, fit.values
    columns: dict[str, Array] = {}
    read = {i: model.predict(values, i).means for i in layout.blows}
    steepest: dict[str, float] = {}  # change from sample to sample of any blow
    for i, means in read.items():
        for name, channel in model.data.blows[i].channels.items():
            rate = float(np.max(np.abs(np.diff(_samples(means[name], channel))), initial=0.0))
            steepest[name] = max(steepest.get(name, 0.0), rate)
    for i, means in read.items():
        blow = model.data.blows[i]
        for name, channel in blow.channels.items():
            mask, span = layout.masks[i, name], layout.spans[i, name]
            if not mask.any():
                continue
            for label, shape in channel_shapes(means[name], channel, steepest[name]):
                part = (shape / channel.std)[mask]
                column = columns.setdefault(f'{label} in {name}', np.zeros(layout.size))
                column[span] = model.whitened(part, i, name, layout)
            for other, its in means.items():
                if other != name:
                    across = np.interp(channel.centres, blow.channels[other].centres, its)
                    part = (across / channel.std)[mask]
                    label = f'cross-talk from {other} in {name}'
                    column = columns.setdefault(label, np.zeros(layout.size))
                    column[span] = model.whitened(part, i, name, layout)
    return [Law(label, column[:, None]) for label, column in columns.items() if np.any(column)]


def channel_shapes(
    means: Array, channel: BinnedChannel, steepest: float
) -> Iterator[tuple[str, Array]]:
    """Label and change of a channel by each law, shape (n_bins,) as ``means``.

    ``steepest``: largest change of the channel from sample to sample, of any blow.
    """
    peak = max(float(np.max(np.abs(means))), channel.noise)
    yield 'a scale that is bent alike both ways', means**3 / peak**2
    yield 'a scale that is bent one way', means**2 / peak
    samples = _samples(means, channel)
    for share in _SLEW:
        short = behind(samples, share * steepest)
        yield f'a rate that is limited to {share:.0%} of the steepest', _binned(short, channel)
    rate = channel.sample_rate
    for delay in _ECHOES:
        late = round(1e-3 * delay * rate)
        if 0 < late < samples.size:
            echo = np.concatenate([np.zeros(late), samples[:-late]])
            yield f'an echo after {delay:g} ms', _binned(echo, channel)
    for share in _RESONANCES:
        b, a = signal.iirpeak(share * rate, _QUALITY, fs=rate)
        rung = signal.lfilter(b, a, samples)
        yield f'a resonance at {share * rate:.0f} Hz', _binned(rung, channel)


def _samples(means: Array, channel: BinnedChannel) -> Array:
    return np.interp(channel.time, channel.centres, means)


def _binned(samples: Array, channel: BinnedChannel) -> Array:
    return np.asarray(np.add.reduceat(samples, channel.edges) / channel.counts)
