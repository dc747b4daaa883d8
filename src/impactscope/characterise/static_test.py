"""Force and displacement of a test on a compression machine, from a recording or columns."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError, InputError, MissingChannelError
from impactscope.inputs import inputs_of, recorded_items, scan_channels
from impactscope.recordings import (
    ColumnMapping,
    ColumnSpec,
    file_sha256,
    open_recording,
    read_columns,
    to_si,
)
from impactscope.records import NANOSECONDS, Quality, SampleBlock

__all__ = ['DISPLACEMENT', 'FORCE', 'StaticTest', 'read_static_test']

Array = NDArray[np.float64]

FORCE, DISPLACEMENT = 'force', 'displacement.crosshead'
_UNITS = {FORCE: 'N', DISPLACEMENT: 'm'}
_RECORDINGS = {'.mcap', '.db3', '.zst'}
_FEWEST = 20
_LITTLE = 0.03  # of the largest force: what counts as none yet
_LATE = 0.06  # of the travel: later than this a straight spring's force cannot begin


@dataclass(frozen=True, slots=True, eq=False)
class StaticTest:
    """One test; arrays of shape (n_samples,), both growing with compression."""

    name: str
    time: Array  # s, from the first sample
    displacement: Array  # m, of the crosshead
    force: Array  # N
    sha256: str = ''  # of the file; empty for a folder
    notes: tuple[str, ...] = field(default_factory=tuple)  # what was done to the data, in words


def read_static_test(
    path: Path,
    mapping: ColumnMapping | None = None,
    *,
    force: str = FORCE,
    displacement: str = DISPLACEMENT,
    touch: float = 0.0,
    inputs: Sequence[str] = (),
) -> StaticTest:
    """Read a test from an MCAP or rosbag2 recording, or with a ``mapping`` from columns.

    ``force`` and ``displacement`` name the channels; ``inputs`` are topics of a recording with one
    sample a message, each as ``kind topic axis channel`` (wrench, point, ...); ``touch`` m is the
    crosshead's displacement at first touch, which becomes zero. Samples that are not finite or
    clipped are left out, a record of which both signs are reversed is turned round; ``notes`` say
    so. Raises ConfigurationError where columns are given without mapping or a unit is wrong,
    MissingChannelError where a channel is not there, InputError where samples contradict each
    other or hold no test, RecordingError where the file cannot be read.
    """
    path = Path(path)
    if path.is_dir() or path.suffix in _RECORDINGS:
        if mapping is not None:
            raise ConfigurationError(f'{path.name!r} is a recording: it needs no column mapping')
        channels, notes = _from_recording(path, force, displacement, inputs)
    elif inputs:
        raise ConfigurationError(f'{path.name!r} is no recording: it has no topics to name')
    elif mapping is None:
        raise ConfigurationError(
            f'{path.name!r} is no recording: say which columns are {force!r} and '
            f'{displacement!r}, as in --channel {force}=2:N --channel {displacement}=1:mm '
            '--time-column 0:s'
        )
    else:
        channels, notes = _from_columns(path, mapping, force, displacement)
    (time, f), (time_u, u) = channels
    time, u, f = _on_one_base(time, f, time_u, u, path.name)
    for channel, values in (('force', f), ('displacement', u)):
        if not np.ptp(values) > 0:
            raise InputError(
                f'{path.name!r}: the {channel} does not vary: {values[0]:.4g} all along'
            )
    if abs(f.min()) > abs(f.max()) and abs(u.min()) > abs(u.max()):
        u, f = -u, -f
        notes.append('force and displacement are negative in compression: both were turned round')
    time, u, f = _from_touch(time, u - touch, f) if touch else (time, u, f)
    notes += _late_touch(u, f)
    digest = '' if path.is_dir() else file_sha256(path)
    return StaticTest(path.name, time - time[0], u, f, digest, tuple(notes))


def _from_touch(time: Array, u: Array, f: Array) -> tuple[Array, Array, Array]:
    """Without the approach, so that the layer is not taken to be stretched at the beginning."""
    touching = np.flatnonzero(u >= 0)
    if not touching.size:
        raise InputError(
            f'the displacement never reaches the touch given: {u.max():.4g} m is left'
        )
    start = max(int(touching[0]) - 1, 0)
    u = u[start:].copy()
    u[0] = max(u[0], 0.0)
    return time[start:], u, f[start:]


def _late_touch(u: Array, f: Array) -> list[str]:
    """A remark where the force begins long after the displacement."""
    top = int(np.argmax(u))
    rising_u, rising_f = u[: top + 1], f[: top + 1]
    above = np.flatnonzero(rising_f > _LITTLE * f.max())
    if not above.size:
        return []
    if rising_u[above[0]] - float(u.min()) < _LATE * float(np.ptp(u)):
        return []
    return [
        f'the force begins only at a displacement of {1e3 * rising_u[above[0]]:.3g} mm: if that '
        'is the first touch, give it as --touch'
    ]


def _on_one_base(
    time: Array, f: Array, time_u: Array, u: Array, name: str
) -> tuple[Array, Array, Array]:
    """Time, displacement and force at the force's sample times, where both are known."""
    for channel, times in (('force', time), ('displacement', time_u)):
        if times.size < _FEWEST:
            raise InputError(
                f'{name!r} holds {times.size} samples of {channel} that can be used; '
                f'{_FEWEST} are needed'
            )
        back = np.flatnonzero(np.diff(times) <= 0)
        if back.size:
            raise InputError(
                f'{name!r}: the time of {channel} does not advance '
                f'({times[back[0]]:.9g} s, then {times[back[0] + 1]:.9g} s)'
            )
    if time.size == time_u.size and np.array_equal(time, time_u):
        return time, u, f
    inside = (time >= time_u[0]) & (time <= time_u[-1])
    if int(inside.sum()) < _FEWEST:
        raise InputError(f'{name!r}: force and displacement were not recorded at the same time')
    # A crosshead runs straight between samples but for its turning points.
    return time[inside], np.interp(time[inside], time_u, u), f[inside]


_Channel = tuple[Array, Array]  # times s, values in SI


def _from_columns(
    path: Path, mapping: ColumnMapping, force: str, displacement: str
) -> tuple[list[_Channel], list[str]]:
    specs = {spec.channel: spec for spec in mapping.channels}
    for name in (force, displacement):
        if name not in specs:
            raise MissingChannelError(
                f'the mapping has no channel {name!r}; it has {", ".join(specs)}'
            )
    file = read_columns(
        path,
        skip_rows=mapping.skip_rows,
        delimiter=mapping.delimiter,
        transpose=mapping.transpose,
    )
    values = [
        _in_si(file.column(specs[name].column), specs[name], unit)
        for name, unit in ((force, _UNITS[FORCE]), (displacement, _UNITS[DISPLACEMENT]))
    ]
    count = values[0].size
    if mapping.time is not None:
        time = file.seconds(mapping.time, mapping.time_unit)
    else:
        assert mapping.sample_rate is not None  # noqa: S101  # the mapping checks it
        time = np.arange(count) / mapping.sample_rate
    if not count == values[1].size == time.size:
        raise InputError(
            f'{path.name!r}: columns of {time.size} times, {count} forces and '
            f'{values[1].size} displacements; as many of each are needed'
        )
    good = np.isfinite(values[0]) & np.isfinite(values[1]) & np.isfinite(time)
    notes = [f'{count - int(good.sum())} rows without a number were left out']
    chosen = [(time[good], v[good]) for v in values]
    return chosen, notes if not good.all() else []


def _in_si(values: Array, spec: ColumnSpec, unit: str) -> Array:
    if to_si(spec.unit)[0] != unit:
        raise ConfigurationError(
            f'channel {spec.channel!r} is in {spec.unit!r}; a unit of {unit} is needed'
        )
    return spec.in_si(values)


def _from_recording(
    path: Path, force: str, displacement: str, written: Sequence[str]
) -> tuple[list[_Channel], list[str]]:
    wanted = {force: _UNITS[FORCE], displacement: _UNITS[DISPLACEMENT]}
    with open_recording(path, tolerate_damage=True) as recording:
        inputs = inputs_of(recording, written)
        present = scan_channels(recording, inputs)
        for name, unit in wanted.items():
            if name not in present:
                kind = 'wrench TOPIC force.z' if unit == 'N' else 'point TOPIC point.z'
                raise MissingChannelError(
                    f'{path.name!r} has no channel {name!r}; its channels are '
                    f'{", ".join(present)}. A topic with one sample a message is named as '
                    f"--input '{kind} {name}'"
                )
        blocks = [
            item
            for item in recorded_items(recording, inputs)
            if isinstance(item, SampleBlock) and item.values.size and item.channel in wanted
        ]
        notes = [f'the recording is damaged: {damage}' for damage in recording.damage]
    if not blocks:
        raise InputError(f'{path.name!r} holds no samples')
    # One origin for both, so that seconds keep their digits.
    origin = min(block.stamp_ns for block in blocks)
    return [
        _joined(
            (block for block in blocks if block.channel == name), unit, origin, path.name, notes
        )
        for name, unit in wanted.items()
    ], notes


def _joined(
    blocks: Iterator[SampleBlock], unit: str, origin: int, name: str, notes: list[str]
) -> _Channel:
    """Times and values of one channel; what cannot be believed is left out."""
    times: list[Array] = []
    values: list[Array] = []
    left_out, epoch, channel = 0, -1, ''
    for block in blocks:
        channel = block.channel
        if block.unit != unit:
            raise ConfigurationError(
                f'channel {channel!r} of {name!r} is in {block.unit!r}; {unit} is needed'
            )
        if epoch not in (-1, block.epoch):
            raise InputError(
                f'channel {channel!r} of {name!r} was started anew in the middle of the test'
            )
        epoch = block.epoch
        v = block.values.astype(np.float64)
        good = np.isfinite(v)
        if block.quality & Quality.CLIPPED:
            known = math.isfinite(block.range_min) or math.isfinite(block.range_max)
            good &= (v > block.range_min) if math.isfinite(block.range_min) else known
            good &= (v < block.range_max) if math.isfinite(block.range_max) else known
        left_out += int((~good).sum())
        start = (block.stamp_ns - origin) / NANOSECONDS
        times.append((start + np.arange(v.size) / block.sample_rate)[good])
        values.append(v[good])
    if left_out:
        notes.append(f'{left_out} samples of {channel} were clipped or no numbers: left out')
    empty = np.zeros(0)
    return np.concatenate([*times, empty]), np.concatenate([*values, empty])
