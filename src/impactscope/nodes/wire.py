"""One sample out of a serialised standard message, without building the message.

At 10,000 messages a second, building objects costs more than everything else together.
The layout is that of CDR: four bytes of encapsulation, the header's stamp and frame, then,
aligned to 8, the doubles of the body in the order of the message's definition.
"""

from __future__ import annotations

import struct
from typing import Any

from geometry_msgs.msg import AccelStamped, PointStamped, WrenchStamped
from sensor_msgs.msg import Imu

from impactscope.errors import ConfigurationError, InputError
from impactscope.records import NANOSECONDS

__all__ = ['KINDS', 'StampedValueReader']

_AXES = {axis: index for index, axis in enumerate('xyz')}
# kind -> message type, part of the message -> position of its x among the body's doubles
KINDS: dict[str, tuple[Any, dict[str, int]]] = {
    'wrench': (WrenchStamped, {'force': 0, 'torque': 3}),
    'accel': (AccelStamped, {'linear': 0, 'angular': 3}),
    'point': (PointStamped, {'point': 0}),
    'imu': (Imu, {'angular_velocity': 13, 'linear_acceleration': 25}),
}


class StampedValueReader:
    """Reads stamp (ns) and one component of messages of one kind.

    Raises ConfigurationError for a kind or axis that there is not, such as ``force.w``.
    """

    def __init__(self, kind: str, axis: str) -> None:
        if kind not in KINDS:
            raise ConfigurationError(f'kind of input {kind!r}; known are {", ".join(KINDS)}')
        self.message_type, parts = KINDS[kind]
        part, _, letter = axis.partition('.')
        if part not in parts or letter not in _AXES:
            raise ConfigurationError(
                f'axis {axis!r} of {kind}; known are '
                f'{", ".join(f"{name}.{letter}" for name in parts for letter in _AXES)}'
            )
        self._offset = 8 * (parts[part] + _AXES[letter])

    def __call__(self, data: bytes) -> tuple[int, float]:
        """Stamp in ns and value; raises InputError for a message that is cut short."""
        try:
            order = '<' if data[1] == 1 else '>'
            sec, nanosec, length = struct.unpack_from(order + 'iII', data, 4)
            body = (12 + length + 7) // 8 * 8 + 4  # aligned to 8, counted after encapsulation
            (value,) = struct.unpack_from(order + 'd', data, body + self._offset)
        except (struct.error, IndexError) as error:
            raise InputError(f'a message of {len(data)} bytes is cut short') from error
        return sec * NANOSECONDS + nanosec, value
