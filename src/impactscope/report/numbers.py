"""Numbers as people read them: values with expanded uncertainty, rounded after the GUM.

JCGM 100:2008 (GUM), 7.2.6: an uncertainty is given with at most two significant digits, and
the value to the same decimal place. Expanded uncertainties here use the coverage factor 2
(about 95 % for a normal distribution).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime

from impactscope.records import Estimate

__all__ = [
    'COVERAGE_FACTOR',
    'NOT_KNOWN',
    'Quantity',
    'format_estimate',
    'format_given',
    'format_number',
    'format_quantity',
    'format_stamp',
    'readable_estimate',
]

COVERAGE_FACTOR = 2.0
NOT_KNOWN = 'not known'
UNCERTAINTY_DIGITS = 2
FIXED_POINT_DECIMALS = 9  # beyond, powers of ten read better
FIXED_POINT_LARGEST = 1e9
PREFIXES = {  # of SI units, largest first: what to divide by, and how the unit is then called
    'm': ((1.0, 'm'), (1e-3, 'mm'), (1e-6, 'µm'), (1e-9, 'nm')),
    's': ((1.0, 's'), (1e-3, 'ms'), (1e-6, 'µs'), (1e-9, 'ns')),
    'N': ((1.0, 'N'), (1e-3, 'mN'), (1e-6, 'µN')),
    'kg': ((1.0, 'kg'), (1e-3, 'g'), (1e-6, 'mg')),
}
PREFIXED_BELOW = 0.1  # of the unit: there a prefix reads better
EARLIEST_CALENDAR_NS = 631_152_000_000_000_000  # 1990; earlier stamps are a simulation's own


@dataclass(frozen=True, slots=True)
class Quantity:
    """One row of a table of results, ready to print."""

    name: str
    value: str
    uncertainty: str  # expanded, k = 2; empty where there is no value
    unit: str
    relative: str = ''  # expanded uncertainty over value, in percent
    note: str = ''


def _exponent(value: float) -> int:
    """Decimal exponent of the leading digit; ``value`` finite and not zero."""
    return int(f'{abs(value):.15e}'.partition('e')[2])


def _rounded_exponent(value: float, digits: int) -> int:
    """Decimal exponent of ``value`` after rounding to ``digits`` significant digits."""
    return int(f'{abs(value):.{digits - 1}e}'.partition('e')[2])


def _fixed(value: float, decimals: int) -> str:
    """Fixed point; a negative number of decimals rounds to tens, hundreds, ..."""
    text = f'{round(value, decimals):.{max(decimals, 0)}f}'
    return text[1:] if text.startswith('-') and not text.strip('-0.') else text


def format_number(value: float, digits: int = 4) -> str:
    """``value`` with ``digits`` significant digits; NaN reads 'not known'.

    >>> format_number(0.068234)
    '0.06823'
    >>> format_number(140.0)
    '140.0'
    """
    if math.isnan(value):
        return NOT_KNOWN
    if math.isinf(value):
        return 'infinite' if value > 0 else '-infinite'
    if value == 0:
        return '0'
    decimals = digits - 1 - _rounded_exponent(value, digits)
    if decimals > FIXED_POINT_DECIMALS or abs(value) >= FIXED_POINT_LARGEST:
        return f'{value:.{digits - 1}e}'
    return _fixed(value, decimals)


def format_given(value: float) -> str:
    """A value that was given, not measured, with the digits it has; NaN reads 'not known'.

    >>> format_given(140.0)
    '140'
    """
    return NOT_KNOWN if math.isnan(value) else f'{value:.6g}'


def format_estimate(
    estimate: Estimate, scale: float = 1.0, coverage: float = COVERAGE_FACTOR
) -> tuple[str, str]:
    """Value and expanded uncertainty as texts, to the same decimal place.

    ``scale`` converts from the record's unit to the printed one. An unknown value gives
    ('not estimated', ''); an unknown uncertainty is called so.

    >>> format_estimate(Estimate(32.3412, 0.0583))
    ('32.34', '0.12')
    """
    value = estimate.value * scale
    expanded = estimate.std * abs(scale) * coverage
    if not math.isfinite(value):
        return 'not estimated', ''
    if not math.isfinite(expanded) or expanded < 0:
        return format_number(value), NOT_KNOWN
    if expanded == 0:
        return format_number(value), '0'
    decimals = UNCERTAINTY_DIGITS - 1 - _rounded_exponent(expanded, UNCERTAINTY_DIGITS)
    largest = max(abs(value), expanded)
    if decimals > FIXED_POINT_DECIMALS or largest >= FIXED_POINT_LARGEST:
        digits = max(_exponent(value) + decimals, 0) if value else 0
        return f'{value:.{digits}e}', f'{expanded:.{UNCERTAINTY_DIGITS - 1}e}'
    return _fixed(value, decimals), _fixed(expanded, decimals)


def readable_estimate(value: float, std: float, unit: str) -> tuple[str, str, str]:
    """Value, expanded uncertainty and unit as texts; small ones in mm, µs, mN, g and so on.

    >>> readable_estimate(5.152e-7, 1.5e-8, 'm')
    ('0.515', '0.030', 'µm')
    """
    size = max(abs(value), 0.0 if math.isnan(std) else COVERAGE_FACTOR * std)
    known = PREFIXES.get(unit, ((1.0, '' if unit in ('1', 'text', 'bool') else unit),))
    fitting = (p for p in known if size >= PREFIXED_BELOW * p[0])
    scale, name = known[0] if not size > 0.0 else next(fitting, known[-1])
    if std == 0.0 and math.isfinite(value):  # a choice, such as the order of a filter
        return format_given(value / scale), '', name
    return *format_estimate(Estimate(value, std), 1.0 / scale), name


def format_quantity(
    name: str, estimate: Estimate, unit: str, *, scale: float = 1.0, note: str = ''
) -> Quantity:
    """A row for one estimate; ``scale`` converts from its SI unit to ``unit``."""
    value, uncertainty = format_estimate(estimate, scale)
    relative = ''
    if math.isfinite(estimate.value) and math.isfinite(estimate.std) and estimate.value:
        ratio = COVERAGE_FACTOR * estimate.std / abs(estimate.value)
        if math.isfinite(ratio):
            relative = f'{format_number(100 * ratio, 2)} %'
    return Quantity(name, value, uncertainty, unit if uncertainty else '', relative, note)


def format_stamp(stamp_ns: int) -> str:
    """Date and time (UTC) of a stamp, or seconds where the clock is a simulation's own."""
    if stamp_ns < EARLIEST_CALENDAR_NS:
        return f'{stamp_ns / 1e9:.3f} s (clock of the recording)'
    seconds, rest = divmod(stamp_ns, 1_000_000_000)
    try:
        moment = datetime.fromtimestamp(seconds, tz=UTC)
    except (ValueError, OverflowError, OSError):
        return f'{stamp_ns} ns (no calendar date)'
    return f'{moment:%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} UTC'
