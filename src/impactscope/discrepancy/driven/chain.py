"""What stands between two channels of a measuring chain; no mechanics.

The order of the parts is that of a chain: gain, delay, filters, additions, and at last the
converter, which cuts off. Filters are Butterworth's; source: ISO 6487 and SAE J211-1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impactscope.discrepancy.driven.fitting import FINE, Fit, fit
from impactscope.discrepancy.driven.measuring import MAINS, ORDERS, passed_on
from impactscope.discrepancy.driven.model import Segment
from impactscope.discrepancy.driven.recordings import Cut
from impactscope.discrepancy.driven.terms import Number, Term

__all__ = ['ChainModel', 'linear_chain']

Array = NDArray[np.float64]

LONGEST_DELAY = 0.1  # of a recording


def _delayed(samples: Array, delay: float, period: float) -> Array:
    """Samples later by ``delay`` s, band-limited; the ends are held."""
    n = samples.size
    pad = min(n, 64 + int(2.0 * abs(delay) / period))
    held = np.concatenate([np.full(pad, samples[0]), samples, np.full(pad, samples[-1])])
    length = 1 << (held.size - 1).bit_length()
    held = np.concatenate([held, np.linspace(held[-1], held[0], length - held.size)])
    spectrum = np.fft.rfft(held)
    turn = np.exp(-2j * math.pi * np.fft.rfftfreq(length, period) * delay)
    return np.asarray(np.fft.irfft(spectrum * turn, length)[pad : pad + n])


@dataclass(frozen=True, eq=False)
class ChainModel:
    """A chain of parts; ``drive`` is the input channel, shape (n,)."""

    numbers: tuple[Number, ...]
    terms: tuple[Term, ...]

    def starts(self, segment: Segment) -> tuple[Number, ...]:  # noqa: ARG002
        """A chain begins with its first sample."""
        return ()

    @property
    def drifts(self) -> bool:
        """Nothing accumulates here."""
        return False

    def predict(
        self,
        values: Mapping[str, float],
        terms: tuple[Term, ...],
        start: Array,  # noqa: ARG002
        segment: Segment,
    ) -> Array:
        """Output channel, shape (n,)."""
        parts = {t.name: t for t in terms}
        y = segment.drive * values.get('gain', 1.0) * values.get('wrong_parameter.ratio', 1.0)
        delay = values.get('clock_error.offset', 0.0)
        if delay != 0.0:
            y = _delayed(y, delay, segment.period)
        return passed_on(y, parts, values, segment.period, segment.begin)

    def motion(
        self,
        values: Mapping[str, float],  # noqa: ARG002
        terms: tuple[Term, ...],  # noqa: ARG002
        start: Array,  # noqa: ARG002
        segment: Segment,  # noqa: ARG002
    ) -> tuple[Array, Array]:
        """Nothing moves in a chain."""
        return np.zeros(0), np.zeros(0)


def linear_chain(cuts: Sequence[Cut]) -> tuple[ChainModel, list[Segment], Fit]:
    """The output as the input, times a gain where the units differ; with candidates."""
    segments = []
    for c in cuts:
        assert c.drive is not None  # noqa: S101 - a chain always has an input
        segments.append(
            Segment(
                c.recording,
                c.channel,
                c.unit,
                c.held_out,
                c.begin,
                1.0 / c.rate,
                c.output,
                c.drive,
                noise=c.noise,
            )
        )
    fitted = [s for s in segments if not s.held_out]
    drive = np.concatenate([s.drive for s in fitted])
    output = np.concatenate([s.measured for s in fitted])
    below = float(drive @ drive)
    gain = float(drive @ output) / below if below > 0.0 else 1.0
    same = cuts[0].unit == cuts[0].drive_unit
    numbers: tuple[Number, ...] = ()
    if not same:
        scale = abs(gain) or 1.0
        numbers = (Number('gain', f'{cuts[0].unit}/{cuts[0].drive_unit}', (gain,), scale),)
    terms = _terms(cuts, output, gain, same)
    model = ChainModel(numbers, terms)
    return model, segments, fit(model, (), segments, {}, tolerance=FINE)


def _terms(cuts: Sequence[Cut], output: Array, gain: float, same: bool) -> tuple[Term, ...]:
    unit, rate = cuts[0].unit, cuts[0].rate
    channel = cuts[0].channel
    longest = max(c.output.size for c in cuts) / rate
    spread = float(np.std(output)) or 1.0
    peak = float(np.max(np.abs(output))) or 1.0

    def term(
        name: str, sentence: str, equation: str, test: str, *numbers: Number, variant: str = ''
    ) -> Term:
        source = 'ISO 6487; SAE J211-1' if name == 'low_pass_filter' else 'the measuring chain'
        return Term(
            name,
            'measurement',
            sentence,
            equation,
            source,
            test,
            numbers,
            variant,
            channel=channel,
        )

    found = []
    for order in ORDERS:
        for kind in ('causal', 'zero'):
            both = kind == 'zero'
            how = 'forwards and backwards' if both else 'forwards'
            found.append(
                term(
                    'low_pass_filter',
                    f'A low-pass of order {order} that runs {how} stands in the channel.',
                    f'Butterworth of order {order}, {how}',
                    'a hard tap in both channels',
                    Number(
                        'cutoff',
                        'Hz',
                        (0.01 * rate, 0.03 * rate, 0.1 * rate, 0.25 * rate),
                        0.01 * rate,
                        1.0 / longest,
                        0.499 * rate,
                    ),
                    variant=f'{kind}-{order}',
                )
            )
    found.append(
        term(
            'ac_coupling',
            'The channel is AC coupled: slow signals fade.',
            'first-order high-pass at the corner frequency',
            'a load that stays',
            Number('corner', 'Hz', (1.0 / longest, 10.0 / longest), 1.0 / longest, 0.0, rate / 4),
        )
    )
    found.append(
        term(
            'clock_error',
            'The channel comes late (or early).',
            'y(t - offset)',
            'a hard tap in both channels',
            Number(
                'offset',
                's',
                (1.0 / rate, 5.0 / rate, 30.0 / rate, -2.0 / rate),
                1.0 / rate,
                -LONGEST_DELAY * longest,
                LONGEST_DELAY * longest,
            ),
        )
    )
    found.append(
        term(
            'offset',
            'The channel has a constant offset.',
            'y + value',
            'the quiet before a blow',
            Number('value', unit, (0.1 * spread, -0.1 * spread), 0.01 * spread),
        )
    )
    found.append(
        term(
            'zero_drift',
            'The zero of the channel drifts.',
            'y + r t',
            'quiet before against quiet after a blow',
            Number('rate', f'{unit}/s', (0.1 * spread / longest,), 0.01 * spread / longest),
        )
    )
    found.extend(
        term(
            'mains_hum',
            'Mains hum is added.',
            'A sin(2 pi f t + phase)',
            'the quiet before a blow: a line in the spectrum',
            Number('sine', unit, (0.05 * spread, 0.0), 0.01 * spread),
            Number('cosine', unit, (0.0, 0.05 * spread), 0.01 * spread),
            Number('frequency', 'Hz', (mains,), 0.02 / longest, 0.98 * mains, 1.02 * mains),
            variant='' if mains == MAINS[0] else f'{mains:g}Hz',
        )
        for mains in MAINS
        if mains < 0.5 * rate
    )
    found.append(
        term(
            'saturation',
            'The channel saturates: larger values are cut off.',
            'clip to +-limit',
            'the hardest blow: a flat top',
            Number('limit', unit, (0.999 * peak, 0.8 * peak), 0.02 * peak, 0.0, 1.001 * peak),
        )
    )
    if same:
        found.append(
            term(
                'wrong_parameter',
                "The channel's gain is not what is stated.",
                'ratio y',
                'a known load in both channels',
                Number('ratio', '1', (gain, 1.01), 0.01),
            )
        )
    return tuple(found)
