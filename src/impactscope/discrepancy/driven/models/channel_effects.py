"""The effects of a measuring chain, with ladders of values to start from; one table for all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impactscope.discrepancy.driven.models.terms import Number, Term

__all__ = ['MAINS', 'ORDERS', 'channel_terms']

ORDERS = (1, 2, 3, 4, 5, 6, 7, 8)
ORDERS_SEEN_FROM_FAR = (1, 2)  # of filters without delay, from far below the cut-off
MAINS = (50.0, 60.0)  # Hz
MAINS_VARIATION = 0.01  # EN 50160: of the frequency of an interconnected grid, either way
HARMONICS = (2, 3)
CLOCKS = 1e-3  # largest drift of a clock that is looked for
FADES = 0.003  # least corner times recording of a coupling with a memory of its own
DELAY = 0.02  # s
TAP = 'a hard tap in both channels'
FLAT = (0.999, 0.99, 0.97, 0.93, 0.85, 0.7, 0.5)  # of the largest sample: where it may be cut off
_LOWEST_FLAT = 0.25  # likewise: single samples may stand out of it, but not all of the signal


def _ladder(low: float, high: float, steps: int) -> tuple[float, ...]:
    return tuple(float(v) for v in np.geomspace(low, high, steps))


def channel_terms(
    channel: str,
    unit: str,
    rate: float,
    longest: float,
    noise: float,
    peak: float,
    *,
    delays: Sequence[float] = (),
    gain: bool = False,
    recordings: int = 1,
    ends: tuple[int, int] = (0, 0),
    tag: str = '',
) -> list[Term]:
    """Effects of the chain behind a channel.

    Args:
        channel: its name.
        unit: of its samples.
        rate: samples a second.
        longest: recording, s.
        noise: standard deviation of a sample.
        peak: largest sample.
        delays: s, from which a clock's offset is looked for besides.
        gain: whether a wrong gain would show.
        recordings: their number, fitted and held out.
        ends: how many of them begin, and how many end in motion: a filter holds what was before,
            and one that runs backwards what came after.
        tag: tells the effects of several channels apart.
    """
    mark = f'@{tag}' if tag else ''

    def term(
        name: str,
        variant: str,
        words: tuple[str, str, str],
        *numbers: Number,
        amounts: tuple[str, ...] = (),
        source: str = 'the measuring chain',
        own: int = 0,
        looks: float = 1.0,
    ) -> Term:
        sentence, equation, test = words
        return Term(
            name,
            'parameter' if name == 'wrong_parameter' else 'measurement',
            sentence,
            equation,
            source,
            test,
            numbers,
            f'{variant}{mark}',
            channel=channel,
            output=True,
            amounts=amounts,
            own=own,
            looks=looks,
        )

    slow = _ladder(0.01 / longest, 0.004 * rate, 9)
    cuts = _ladder(min(60.0, 0.01 * rate), 0.45 * rate, 10)
    far = _ladder(0.3 * rate, 5.0 * rate, 4)
    corner = Number('corner', 'Hz', slow, slow[0], 0.0, 0.25 * rate)
    late = 0.2 / rate
    most = max(DELAY, *(3.0 * abs(d) for d in delays)) if delays else DELAY
    offset = Number('offset', 's', (late, *delays), late, -most, most)
    drift = Number('drift', '1', (1e-5, -1e-5), 1e-5, -CLOCKS, CLOCKS)
    small = 0.1 * noise
    found = [
        term(
            'low_pass_filter',
            f'{kind}-{order}',
            (
                f'A low-pass of order {order} that runs {how} stands in the channel.',
                f'Butterworth of order {order}, {how}',
                'a hard tap, beside an unfiltered channel',
            ),
            Number('cutoff', 'Hz', cuts, 100.0, 0.1 / longest, 0.499 * rate),
            source='ISO 6487; SAE J211-1',
            own=order * (ends[0] if kind == 'causal' else sum(ends)),
        )
        for order in ORDERS
        for kind, how in (('causal', 'forwards'), ('zero', 'forwards and backwards'))
    ]
    found.append(
        term(
            'low_pass_filter',
            'smoothing-1',
            (
                'Exponential smoothing, a low-pass of order 1 of samples, stands in the channel.',
                'y += (1 - exp(-2 pi f_c / rate)) (u - y)',
                'a hard tap, beside an unfiltered channel',
            ),
            Number('cutoff', 'Hz', cuts, 100.0, 0.1 / longest, 0.499 * rate),
            source='Brown (1963), simple exponential smoothing',
            own=ends[0],
        )
    )
    found += [
        term(
            'low_pass_filter',
            f'analogue-{order}',
            (
                f'A low-pass of order {order} stands before the samples are taken.',
                f'Butterworth of order {order}, forwards, before sampling',
                'a hard tap, beside an unfiltered channel',
            ),
            Number('cutoff', 'Hz', far, 100.0, 0.2 * rate, 10.0 * rate),
            source='ISO 6487; SAE J211-1',
        )
        for order in ORDERS
    ]
    found += [
        term(
            'low_pass_filter',
            f'analogue_zero-{order}',
            (
                f'A low-pass of order {order} that runs forwards and backwards stands before the '
                'samples are taken.',
                f'Butterworth of order {order}, forwards and backwards, before sampling',
                'a hard tap, beside an unfiltered channel',
            ),
            Number('cutoff', 'Hz', far, 100.0, 0.2 * rate, 10.0 * rate),
            source='ISO 6487; SAE J211-1',
        )
        for order in ORDERS_SEEN_FROM_FAR
    ]
    coupled = (
        'The channel is AC coupled: slow signals fade.',
        'first-order high-pass at the corner frequency',
        'a load that stays',
    )
    found.append(term('ac_coupling', 'output', coupled, corner, amounts=('corner',)))
    fast = tuple(sorted({max(c, FADES / longest) for c in slow}))
    running = Number('corner', 'Hz', fast, fast[0], FADES / longest, 0.25 * rate)
    found.append(term('ac_coupling', 'output-running', coupled, running, own=recordings))
    found.append(
        term(
            'clock_error',
            'output',
            ("The channel's clock is off: it comes late or early.", 'stamp = t + offset', TAP),
            offset,
            amounts=('offset',),
        )
    )
    taps = f'{TAP} at the beginning and at the end'
    found.append(
        term(
            'clock_error',
            'output-drift',
            (
                "The channel's clock is off and runs at another rate.",
                'stamp = t (1 + drift) + offset',
                taps,
            ),
            offset,
            drift,
            amounts=('offset', 'drift'),
        )
    )
    found.append(
        term(
            'clock_error',
            'output-rate',
            ("The channel's clock runs at another rate.", 'stamp = t (1 + drift)', taps),
            Number('drift', '1', (1e-5,), 1e-5, -CLOCKS, CLOCKS),
            amounts=('drift',),
        )
    )
    found.append(
        term(
            'offset',
            'output',
            ('The channel has a constant offset.', 'y + value', 'the quiet before a blow'),
            Number('value', unit, (small,), small),
            amounts=('value',),
        )
    )
    found.append(
        term(
            'zero_drift',
            'output',
            (
                'The zero of the channel drifts.',
                'y + r t',
                'quiet before against quiet after a blow',
            ),
            Number('rate', f'{unit}/s', (small / longest,), small / longest),
            amounts=('rate',),
        )
    )
    for mains in MAINS:
        if mains < 0.45 * rate:
            lower, upper = (1.0 - MAINS_VARIATION) * mains, (1.0 + MAINS_VARIATION) * mains
            spaced = (mains + 0.25 * k / longest for k in range(-4, 5))
            near = tuple(f for f in spaced if lower <= f <= upper)
            line = Number('frequency', 'Hz', near, 0.1 / longest, lower, upper)
            orders = ('', *(f'_{k}' for k in HARMONICS if k * mains < 0.45 * rate))
            for several in (False, True) if len(orders) > 1 else (False,):
                names = [f'amplitude{k}' for k in (orders if several else orders[:1])]
                found.append(
                    term(
                        'mains_hum',
                        f'output-{mains:g}Hz' + ('-harmonics' if several else ''),
                        (
                            'Mains hum is added' + (' with its harmonics.' if several else '.'),
                            'A sin(2 pi f t + phase)' + (' and multiples' if several else ''),
                            'the quiet before a blow: a line in the spectrum',
                        ),
                        *(Number(n, unit, (small,), small, 0.0) for n in names),
                        line,
                        amounts=tuple(names),
                        own=recordings * len(names),
                        looks=max(2.0 * (line.upper - line.lower) * longest, 1.0),
                    )
                )
    found.append(
        term(
            'saturation',
            'output',
            (
                'The channel saturates: larger values are cut off.',
                'clip to +-limit',
                'the hardest blow: a flat top',
            ),
            Number(
                'limit',
                unit,
                tuple(peak * s for s in FLAT),
                0.01 * peak,
                _LOWEST_FLAT * peak,
                1.001 * peak,
            ),
        )
    )
    if gain:
        found.append(
            term(
                'wrong_parameter',
                'gain',
                (
                    "The channel's gain is not what is stated.",
                    'ratio y',
                    'a known load in both channels',
                ),
                Number('excess', '1', (1e-3,), 1e-3, -2.0),
                amounts=('excess',),
            )
        )
    return found
