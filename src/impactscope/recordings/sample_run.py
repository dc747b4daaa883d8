"""Runs of samples from topics that carry one sample a message."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ['COLUMNS', 'SAMPLE_TYPES', 'SampleRun', 'decode_runs', 'runs_from_messages']

_XYZ = ('x', 'y', 'z')


def _vectors(*names: str) -> tuple[str, ...]:
    return tuple(f'{name}.{axis}' for name in names for axis in _XYZ)


@dataclass(frozen=True, slots=True)
class _Layout:
    """After the header come ``doubles`` float64; ``picks`` are those that are kept."""

    doubles: int
    picks: tuple[int, ...]
    columns: tuple[str, ...]


_LAYOUTS = {
    'geometry_msgs/msg/WrenchStamped': _Layout(
        6, (0, 1, 2, 3, 4, 5), _vectors('wrench.force', 'wrench.torque')
    ),
    'geometry_msgs/msg/AccelStamped': _Layout(
        6, (0, 1, 2, 3, 4, 5), _vectors('accel.linear', 'accel.angular')
    ),
    'geometry_msgs/msg/PointStamped': _Layout(3, (0, 1, 2), _vectors('point')),
    # orientation (4), covariance (9), angular velocity (3), covariance (9),
    # linear acceleration (3), covariance (9)
    'sensor_msgs/msg/Imu': _Layout(
        37, (25, 26, 27, 13, 14, 15), _vectors('linear_acceleration', 'angular_velocity')
    ),
}

SAMPLE_TYPES = frozenset(_LAYOUTS)
COLUMNS: dict[str, tuple[str, ...]] = {name: item.columns for name, item in _LAYOUTS.items()}
"""What each column of a run's values is: the path of the field in the message."""


@dataclass(frozen=True, slots=True, eq=False)
class SampleRun:
    """Consecutive messages of one topic, one sample each, as arrays in order of log time."""

    topic: str
    type: str  # one of SAMPLE_TYPES
    stamps_ns: NDArray[np.int64]  # header stamps, shape (n_samples,)
    log_ns: NDArray[np.int64]  # when they were recorded, shape (n_samples,)
    values: NDArray[np.float64]  # SI units, shape (n_samples, n_columns), see COLUMNS
    frame_id: str

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns of ``values``."""
        return COLUMNS[self.type]


_GOOD, _NEW_FRAME, _MALFORMED = 0, 1, 2


@njit(cache=True)  # type: ignore[untyped-decorator]
def _extract(
    octets: NDArray[np.uint8],
    offset: NDArray[np.int64],
    length: NDArray[np.int64],
    doubles: int,
    picks: NDArray[np.int64],
    stamps_ns: NDArray[np.int64],
    values: NDArray[np.uint8],
    status: NDArray[np.uint8],
) -> None:
    """Read header stamp and picked doubles of little-endian CDR; values as bytes (n, 8 k)."""
    frame = -1
    frame_size = np.int64(0)
    for i in range(len(offset)):
        status[i] = 2
        at = offset[i]
        size = length[i]
        if size < 16 or octets[at] != 0 or octets[at + 1] != 1:
            continue
        second = np.int64(0)
        nanosecond = np.int64(0)
        name_size = np.int64(0)
        for k in range(4):
            second |= np.int64(octets[at + 4 + k]) << np.int64(8 * k)
            nanosecond |= np.int64(octets[at + 8 + k]) << np.int64(8 * k)
            name_size |= np.int64(octets[at + 12 + k]) << np.int64(8 * k)
        if name_size > size:
            continue
        body = 4 + (12 + name_size + 7) // 8 * 8  # doubles are aligned to 8 after the 4 octets
        if body + 8 * doubles > size:
            continue
        if second >= 1 << 31:
            second -= 1 << 32
        stamps_ns[i] = second * 1_000_000_000 + nanosecond
        for j in range(len(picks)):
            source = at + body + 8 * picks[j]
            for k in range(8):
                values[i, 8 * j + k] = octets[source + k]
        same = frame >= 0 and name_size == frame_size
        if same:
            for k in range(name_size):
                if octets[frame + k] != octets[at + 16 + k]:
                    same = False
                    break
        status[i] = 0 if same else 1
        frame = at + 16
        frame_size = name_size


def decode_runs(
    topic: str,
    type_name: str,
    octets: NDArray[np.uint8],
    offset: NDArray[np.int64],
    length: NDArray[np.int64],
    log_ns: NDArray[np.int64],
) -> list[SampleRun] | None:
    """Runs of the messages at these offsets, split where ``frame_id`` changes.

    Returns None where a message is not little-endian CDR of this layout.
    """
    layout = _LAYOUTS[type_name]
    count = len(offset)
    stamps_ns = np.empty(count, np.int64)
    values = np.empty((count, len(layout.picks)), np.float64)
    status = np.empty(count, np.uint8)
    picks = np.array(layout.picks, np.int64)
    raw = values.view(np.uint8)
    _extract(octets, offset, length, layout.doubles, picks, stamps_ns, raw, status)
    if (status == _MALFORMED).any():
        return None
    starts = np.flatnonzero(status == _NEW_FRAME).tolist()
    runs = []
    for first, last in zip(starts, [*starts[1:], count], strict=True):
        at = int(offset[first])
        size = int.from_bytes(octets[at + 12 : at + 16].tobytes(), 'little')
        name = octets[at + 16 : at + 16 + size].tobytes().rstrip(b'\0')
        part = slice(first, last)
        runs.append(
            SampleRun(
                topic,
                type_name,
                stamps_ns[part],
                log_ns[part],
                values[part],
                name.decode('utf-8', 'replace'),
            )
        )
    return runs


def _getters(type_name: str) -> Callable[[Any], tuple[float, ...]]:
    return operator.attrgetter(*COLUMNS[type_name])


def runs_from_messages(
    topic: str, type_name: str, messages: list[tuple[int, Any]]
) -> list[SampleRun]:
    """Runs of deserialised messages, given as (log time ns, message); the general way."""
    get = _getters(type_name)
    groups: list[tuple[str, list[tuple[int, Any]]]] = []
    for item in messages:
        frame = str(item[1].header.frame_id)
        if not groups or groups[-1][0] != frame:
            groups.append((frame, []))
        groups[-1][1].append(item)
    runs = []
    for frame, items in groups:
        stamps = [m.header.stamp.sec * 1_000_000_000 + m.header.stamp.nanosec for _, m in items]
        runs.append(
            SampleRun(
                topic,
                type_name,
                np.array(stamps, np.int64),
                np.array([log for log, _ in items], np.int64),
                np.array([get(m) for _, m in items], np.float64),
                frame,
            )
        )
    return runs
