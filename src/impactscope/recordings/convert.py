"""Files of columns to recordings."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import InputError
from impactscope.records import NANOSECONDS, Quality, SampleBlock
from impactscope.version import __version__

from .column_files import ColumnFile, read_columns
from .column_mapping import ColumnMapping, ColumnSpec
from .even_grid import BACKWARDS_REMEDY, EvenGrid, even_grid
from .info import file_sha256
from .units import to_si
from .writer import RecordingWriter

__all__ = ['Conversion', 'convert']

BLOCK_DURATION = 0.02  # s of samples in a block, as drivers publish them
_RESAMPLE = '; resample: true (--resample) puts them on an even grid'


@dataclass(frozen=True, slots=True)
class Conversion:
    """What a conversion made."""

    path: Path
    channels: tuple[str, ...]
    sample_rate: float  # Hz
    samples: int  # a channel
    quality: Quality  # all flags that were set


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

    Where the mapping says ``resample``, samples of uneven times are brought to an even grid.
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
    channels = [(spec, _in_si(file.column(spec.column), spec)) for spec in mapping.channels]
    count = len(channels[0][1])
    for spec, values in channels:
        if len(values) != count:
            raise InputError(
                f'column {spec.column!r} of {source.name!r} has {len(values)} rows, '
                f'column {channels[0][0].column!r} has {count}'
            )
    resampling: dict[str, str] = {}
    if mapping.resample:
        grid = _on_even_grid(file, mapping, [values for _, values in channels])
        rate, count = grid.rate, grid.columns[0].size
        channels = list(zip(mapping.channels, grid.columns, strict=True))
        resampling['resampled'] = (
            f'{rate:.9g} Hz, {grid.repeated} repeated stamps, {grid.lost} lost samples'
        )
    else:
        rate = _sample_rate(file, mapping, count, time_tolerance)
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
        size = max(1, round(rate * BLOCK_DURATION))
        for first in range(0, count, size):
            for spec, values in channels:
                block = _block(spec, values[first : first + size], first, rate, mapping.start_ns)
                flags |= block.quality
                writer.write_block(block)
        for spec, values in channels:
            writer.write_block(_block(spec, values[:0], count, rate, mapping.start_ns))
    names = tuple(spec.channel for spec in mapping.channels)
    return Conversion(Path(destination), names, rate, count, flags)


def _in_si(values: NDArray[np.float64], spec: ColumnSpec) -> NDArray[np.float64]:
    return values * (spec.scale * to_si(spec.unit)[1])


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


def _on_even_grid(
    file: ColumnFile, mapping: ColumnMapping, columns: list[NDArray[np.float64]]
) -> EvenGrid:
    times = _times(file, mapping, len(columns[0]))
    try:
        return even_grid(times, columns, mapping.sample_rate)
    except InputError as error:
        raise InputError(f'{file.path.name!r}: {error}') from error


def _time(index: int, rate: float, start_ns: int) -> int:
    return start_ns + round(index * NANOSECONDS / rate)


def _block(
    spec: ColumnSpec, values: NDArray[np.float64], first: int, rate: float, start_ns: int
) -> SampleBlock:
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
        sample_rate=rate,
        stamp_ns=_time(first, rate, start_ns),
        first_index=first,
        values=samples,
        received_ns=_time(first + len(values), rate, start_ns),
        quality=quality,
        range_min=spec.range_min,
        range_max=spec.range_max,
        frame_id=spec.frame_id,
    )


def _sample_rate(file: ColumnFile, mapping: ColumnMapping, count: int, tolerance: float) -> float:
    """Rate in Hz: as given, or of the time column, which must be uniform."""
    name = file.path.name
    if mapping.time is None:
        if mapping.sample_rate is None or count == 0:
            raise InputError(f'{name!r} holds no samples')
        return mapping.sample_rate
    times = _times(file, mapping, count)
    bad = np.flatnonzero(~np.isfinite(times))
    if bad.size:
        raise InputError(f'{name!r}, row {bad[0]}: the time is {times[bad[0]]}')
    back = np.flatnonzero(np.diff(times) <= 0)
    if back.size:
        row = int(back[0]) + 1
        stands = times[row] == times[row - 1]
        raise InputError(
            f'{name!r}, row {row}: the time does not advance '
            f'({times[row - 1]:.9g} s, then {times[row]:.9g} s)'
            f'{_RESAMPLE if stands else f"; {BACKWARDS_REMEDY}"}'
        )
    rate = mapping.sample_rate
    if rate is None:
        rate = (count - 1) / float(times[-1] - times[0])
        rounded = float(f'{rate:.9g}')  # 25600, not 25599.999999999996
        if math.isclose(rate, rounded, rel_tol=1e-9):
            rate = rounded
    deviation = np.abs(times - times[0] - np.arange(count) / rate)
    worst = int(np.argmax(deviation))
    if deviation[worst] > tolerance / rate:
        raise InputError(
            f'{name!r}: times are not uniform at {rate:.9g} Hz: row {worst} is '
            f'{deviation[worst]:.3g} s off, {deviation[worst] * rate:.2g} sample periods'
            f'{_RESAMPLE}'
        )
    return rate
