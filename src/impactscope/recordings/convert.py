"""Files of columns to recordings."""

from __future__ import annotations

import dataclasses
import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import InputError
from impactscope.records import NANOSECONDS, Quality, SampleBlock
from impactscope.version import __version__

from .column_files import ColumnFile, read_columns
from .column_mapping import ColumnMapping, ColumnSpec
from .even_grid import BACKWARDS_REMEDY, NO_TIME_REMEDY, even_grid, refuse_unordered
from .info import file_sha256
from .units import to_si
from .writer import RecordingWriter

__all__ = ['Conversion', 'convert']

BLOCK_DURATION = 0.02  # s of samples in a block, as drivers publish them
_RESAMPLE = (
    '; resample: true (--resample) puts them on an even grid, with values between the samples '
    'that a switched input never had; where rows are evenly sampled and only stamps scatter, as '
    'in bursts, give sample_rate (--sample-rate) in place of the time column'
)
_LEAST_OF_A_RATE = 8  # numbers in a column by which a rate of its own is told
_MOST_ODD_ROWS = 20  # at the beginning that are looked for
_SMALL_WANDER = 3.0  # sample periods, within which stamps that scatter leave evenly sampled rows


@dataclass(frozen=True, slots=True)
class Conversion:
    """What a conversion made."""

    path: Path
    channels: tuple[str, ...]
    rates: tuple[float, ...]  # Hz, of each channel
    counts: tuple[int, ...]  # samples of each channel
    quality: Quality  # all flags that were set
    notes: tuple[str, ...] = ()  # what was seen in the columns

    @property
    def sample_rate(self) -> float:
        """That of the fastest channel, Hz."""
        return max(self.rates)

    @property
    def samples(self) -> int:
        """Those of the longest channel."""
        return max(self.counts)


@dataclass(frozen=True, slots=True, eq=False)
class _Series:
    """Samples of one channel at an even rate, in SI units."""

    spec: ColumnSpec
    values: NDArray[np.float64]  # shape (n,)
    rate: float  # Hz
    delay: float = 0.0  # s, of its first sample after the file's first row
    step: int = 1  # rows of the file from one sample to the next

    def time_ns(self, index: int, start_ns: int) -> int:
        """Time of a sample, where the file's first row is at ``start_ns``."""
        delay = round(self.delay * NANOSECONDS)
        return start_ns + delay + round(index * NANOSECONDS / self.rate)

    def blocks(self, start_ns: int) -> Iterator[SampleBlock]:
        """Its samples in blocks, in order."""
        size = max(1, round(self.rate * BLOCK_DURATION))
        for first in range(0, self.values.size, size):
            yield _block(self, first, first + size, start_ns)


def convert(
    source: str | Path,
    destination: str | Path,
    mapping: ColumnMapping,
    *,
    time_tolerance: float = 0.1,
    compression: str = 'zstd',
    overwrite: bool = False,
) -> Conversion:
    """Write the channels of a file of columns to an MCAP file of SampleBlocks, in SI units.

    Where the mapping says ``resample``, samples of uneven times are brought to an even grid. A
    column with a number on every n-th row only is a channel of its own, n times lower rate.
    The same input gives the same file, to the byte. Where the data comes from stands in the
    metadata ``provenance``: what the mapping states, the source's name and its SHA-256.

    Args:
        source: text, NumPy, MATLAB or JSON file.
        destination: of the recording.
        mapping: which column is which channel.
        time_tolerance: how far a sample time may be from the uniform one, in sample periods.
        compression: of the chunks: 'zstd', 'lz4' or 'none'.
        overwrite: whether an existing recording is replaced.

    Raises MissingChannelError for a column that is not there, InputError where times are not
    uniform, run backwards or contradict the rate, or columns differ in length, and
    RecordingError where a file cannot be read or written. Nothing is written then.
    """
    source = Path(source)
    file = read_columns(
        source,
        skip_rows=mapping.skip_rows,
        delimiter=mapping.delimiter,
        transpose=mapping.transpose,
    )
    channels = [(spec, spec.in_si(file.column(spec.column))) for spec in mapping.channels]
    count = len(channels[0][1])
    for spec, values in channels:
        if len(values) != count:
            raise InputError(
                f'column {spec.column!r} of {source.name!r} has {len(values)} rows, '
                f'column {channels[0][0].column!r} has {count}'
            )
    if count == 0:
        raise InputError(f'{source.name!r} holds no samples')
    times, notes = None, []
    if mapping.time is not None:
        times = _times(file, mapping, count)
        rows = _rows_in_use(times, [values for _, values in channels])
        if rows < count:
            notes.append(f'{count - rows} rows at the end hold no time and no number: left out')
            times, channels = times[:rows], [(spec, v[:rows]) for spec, v in channels]
    resampling: dict[str, str] = {}
    if mapping.resample and times is not None:
        series, resampling['resampled'] = _on_even_grids(file, mapping, channels, times)
    else:
        series = _at_even_rows(channels, _sample_rate(file, mapping, times, time_tolerance))
    provenance = {
        **mapping.provenance,
        **resampling,
        'source_file': source.name,
        'source_sha256': file_sha256(source),
        'converter': f'impactscope {__version__}',
        **{f'column.{s.channel}': f'{s.column} [{s.unit}]' for s in mapping.channels},
    }
    flags = Quality.NONE
    with RecordingWriter(
        destination,
        metadata={'provenance': provenance},
        compression=compression,
        flush_interval=0,
        overwrite=overwrite,
    ) as writer:
        if mapping.test_point is not None:
            point = mapping.test_point
            if point.start_ns == 0:
                point = dataclasses.replace(point, start_ns=mapping.start_ns)
            writer.write_test_point(point, log_ns=mapping.start_ns)
        blocks = (one.blocks(mapping.start_ns) for one in series)
        for block in heapq.merge(*blocks, key=lambda block: block.received_ns):
            flags |= block.quality
            writer.write_block(block)
        for one in series:
            end = one.values.size
            writer.write_block(_block(one, end, end, mapping.start_ns))
    return Conversion(
        Path(destination),
        tuple(one.spec.channel for one in series),
        tuple(one.rate for one in series),
        tuple(one.values.size for one in series),
        flags,
        (*notes, *(note for one in series for note in _seen(one, mapping.resample))),
    )


def _rows_in_use(times: NDArray[np.float64], columns: list[NDArray[np.float64]]) -> int:
    """Rows up to the last that has a time or a number: shorter runs beside longer ones end so."""
    held = np.isfinite(times) | np.any(np.isfinite(columns), axis=0)
    return int(np.flatnonzero(held)[-1]) + 1 if np.count_nonzero(held) > 1 else len(times)


def _times(file: ColumnFile, mapping: ColumnMapping, count: int) -> NDArray[np.float64]:
    """The column of times in s, shape (count,)."""
    assert mapping.time is not None  # noqa: S101 - asked for only then
    times = file.seconds(mapping.time, mapping.time_unit)
    if len(times) != count or count < 2:
        raise InputError(
            f'{file.path.name!r} has {len(times)} times and {count} samples; '
            'as many and two are needed'
        )
    return times


_Column = tuple[ColumnSpec, NDArray[np.float64]]


def _rows_of(values: NDArray[np.float64]) -> tuple[int, int]:
    """First row with a sample, and rows from one to the next; (0, 1) unless more than one.

    A column has a lower rate than its table where every number stands on an n-th row and most
    of these have one, from the first of them to the last.
    """
    filled = np.flatnonzero(np.isfinite(values))
    if filled.size < _LEAST_OF_A_RATE:
        return 0, 1
    step = int(np.gcd.reduce(np.diff(filled)))
    most = 2 * step * filled.size > filled[-1] - filled[0]
    return (int(filled[0]) % step, step) if most else (0, 1)


def _at_even_rows(channels: list[_Column], rate: float) -> list[_Series]:
    """Columns of a table whose rows are even at ``rate`` in Hz."""
    found = []
    for spec, values in channels:
        first, step = _rows_of(values)
        found.append(_Series(spec, values[first::step], rate / step, first / rate, step))
    return found


def _on_even_grids(
    file: ColumnFile,
    mapping: ColumnMapping,
    channels: list[_Column],
    times: NDArray[np.float64],
) -> tuple[list[_Series], str]:
    """Columns of uneven times on an even grid for each rate, and what was done."""
    rows = [_rows_of(values) for _, values in channels]
    found: dict[str, _Series] = {}
    told = []
    try:
        refuse_unordered(times)
        for first, step in dict.fromkeys(rows):
            chosen = [c for c, own in zip(channels, rows, strict=True) if own == (first, step)]
            columns = [values[first::step] for _, values in chosen]
            there = np.any(np.isfinite(columns), axis=0)
            asked = None if mapping.sample_rate is None else mapping.sample_rate / step
            own_times = times[first::step][there]
            grid = even_grid(own_times, [c[there] for c in columns], asked)
            delay = float(own_times[0] - times[0])
            for (spec, _), values in zip(chosen, grid.columns, strict=True):
                found[spec.channel] = _Series(spec, values, grid.rate, delay, step)
            told.append(
                f'{grid.rate:.9g} Hz, {grid.repeated} repeated stamps, {grid.lost} lost samples'
            )
    except InputError as error:
        raise InputError(f'{file.path.name!r}: {error}') from error
    return [found[spec.channel] for spec, _ in channels], '; '.join(told)


def _seen(series: _Series, resampled: bool) -> Iterator[str]:
    """What a user is to know of a channel: its own rate, and samples that are no numbers."""
    name, count = repr(series.spec.channel), series.values.size
    if series.step > 1:
        yield (
            f'{name} has a number on one row in {series.step} only: it is written at '
            f'{series.rate:.6g} Hz'
        )
    filled = np.flatnonzero(np.isfinite(series.values))
    if filled.size < count:
        scattered = filled.size > 1 and 2 * filled.size < filled[-1] - filled[0]
        remedy = (
            '; its numbers stand on uneven rows: converted by itself with --resample it gets an '
            'even rate'
        )
        yield (
            f'{name}: {count - filled.size} of {count} samples are no numbers'
            f'{remedy if scattered and not resampled else ""}'
        )


def _block(series: _Series, first: int, end: int, start_ns: int) -> SampleBlock:
    spec, values = series.spec, series.values[first:end]
    quality = Quality.NONE
    if not np.isfinite(values).all():
        quality |= Quality.NOT_FINITE
    if (values <= spec.range_min).any() or (values >= spec.range_max).any():
        quality |= Quality.CLIPPED
    with np.errstate(over='ignore'):  # beyond float32 a value becomes inf
        samples = values.astype(np.float32)
    if not np.isfinite(samples).all():
        quality |= Quality.NOT_FINITE
    return SampleBlock(
        channel=spec.channel,
        unit=to_si(spec.unit)[0],
        sample_rate=series.rate,
        stamp_ns=series.time_ns(first, start_ns),
        first_index=first,
        values=samples,
        received_ns=series.time_ns(first + len(values), start_ns),
        quality=quality,
        range_min=spec.range_min,
        range_max=spec.range_max,
        frame_id=spec.frame_id,
    )


def _sample_rate(
    file: ColumnFile,
    mapping: ColumnMapping,
    times: NDArray[np.float64] | None,
    tolerance: float,
) -> float:
    """Rate in Hz: as given, or of the time column, which must be uniform."""
    name = file.path.name
    if times is None:
        if mapping.sample_rate is None:
            raise InputError(f'{name!r} has no column of times, and no sample rate is given')
        return mapping.sample_rate
    count = len(times)
    fault = _fault_of(times, mapping.sample_rate, tolerance)
    if not fault:
        return _rate_of(times, mapping.sample_rate)
    for odd in range(1, min(_MOST_ODD_ROWS, count // 10) + 1):
        if _fault_of(times[odd:], mapping.sample_rate, tolerance):
            continue
        rate = _rate_of(times[odd:], mapping.sample_rate)
        if abs(times[0] - (times[odd] - odd / rate)) * rate <= tolerance:
            break  # it is a later one that is out of step
        raise InputError(f'{name!r}: {_odd_beginning(file, odd, rate)}')
    raise InputError(f'{name!r}{fault}')


def _rate_of(times: NDArray[np.float64], rate: float | None) -> float:
    """``rate``, or where it is None that of even times in s, in Hz."""
    if rate is None:
        rate = (len(times) - 1) / float(times[-1] - times[0])
        rounded = float(f'{rate:.9g}')  # 25600, not 25599.999999999996
        if math.isclose(rate, rounded, rel_tol=1e-9):
            rate = rounded
    return rate


def _fault_of(times: NDArray[np.float64], rate: float | None, tolerance: float) -> str:
    """Why times in s are not even at a rate in Hz, or at any; empty where they are."""
    bad = np.flatnonzero(~np.isfinite(times))
    if bad.size:
        return f', row {bad[0]}: the time is {times[bad[0]]}; {NO_TIME_REMEDY}'
    back = np.flatnonzero(np.diff(times) <= 0)
    if back.size:
        row = int(back[0]) + 1
        stands = times[row] == times[row - 1]
        return (
            f', row {row}: the time does not advance '
            f'({times[row - 1]:.9g} s, then {times[row]:.9g} s)'
            f'{_RESAMPLE if stands else f"; {BACKWARDS_REMEDY}"}'
        )
    rate = _rate_of(times, rate)
    deviation = np.abs(times - times[0] - np.arange(len(times)) / rate)
    worst = int(np.argmax(deviation))
    if deviation[worst] > tolerance / rate:
        return (
            f': times are not uniform at {rate:.9g} Hz: row {worst} comes '
            f'{deviation[worst]:.3g} s, {deviation[worst] * rate:.2g} sample periods, from where '
            'even rows would have it'
            f'{_RESAMPLE}. {_regularity(times)}'
        )
    return ''


def _regularity(times: NDArray[np.float64]) -> str:
    """What rising times in s tell of their rows: even ones, or samples that are missing."""
    intervals = np.diff(times)
    usual = float(np.median(intervals))
    odd = int(np.count_nonzero(np.abs(intervals - usual) > 0.5 * usual))
    rows = np.arange(len(times))
    wander = times - np.polynomial.Polynomial.fit(rows, times, 1)(rows)
    periods = float(np.ptp(wander)) * (len(times) - 1) / float(times[-1] - times[0])
    return (
        f'Here {odd} of {len(intervals)} intervals are more than half off the usual {usual:.3g} s'
        f', and rows wander by {periods:.2g} periods from evenly sampled ones'
        + (', which they may be' if odd and periods < _SMALL_WANDER else '')
    )


def _odd_beginning(file: ColumnFile, rows: int, rate: float) -> str:
    """That the first rows of a file are out of step, and how to leave them out."""
    lines = file.first_row - 1 + rows
    how = f' with --skip-rows {lines} (skip_rows in a mapping)' if file.first_row else ''
    return (
        f'the first {rows} of its times are out of step, all others are even at {rate:.9g} Hz: '
        f'leave so many rows out{how}'
        if rows > 1
        else f'its first time is out of step, all others are even at {rate:.9g} Hz: leave the '
        f'first row out{how}'
    )
