"""Deserialised messages to records, whatever version of the definition they follow.

Fields that an older recording lacks take the record's default; fields that a newer one adds
are left aside.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from impactscope.records import NANOSECONDS, ContactKind, Quality, SampleBlock, TestPoint

from .definitions import TEST_POINT_TYPE, reference_store

__all__ = ['block_from_message', 'encode_test_point', 'test_point_from_message']


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * NANOSECONDS + int(time.nanosec) if time is not None else 0


def block_from_message(message: Any) -> SampleBlock:
    """Raises AttributeError, TypeError or ValueError where a field is of another kind."""
    header = getattr(message, 'header', None)
    return SampleBlock(
        channel=str(getattr(message, 'channel', '')),
        unit=str(getattr(message, 'unit', '')),
        sample_rate=float(getattr(message, 'sample_rate', math.nan)),
        stamp_ns=_nanoseconds(getattr(header, 'stamp', None)),
        first_index=int(getattr(message, 'first_index', 0)),
        values=np.array(getattr(message, 'values', ()), dtype=np.float32),
        epoch=int(getattr(message, 'epoch', 0)),
        device_time_ns=int(getattr(message, 'device_time_ns', -1)),
        received_ns=_nanoseconds(getattr(message, 'received', None)),
        quality=Quality(int(getattr(message, 'quality', 0))),
        range_min=float(getattr(message, 'range_min', math.nan)),
        range_max=float(getattr(message, 'range_max', math.nan)),
        frame_id=str(getattr(header, 'frame_id', '')),
    )


def test_point_from_message(message: Any) -> TestPoint:
    """Raises AttributeError, TypeError or ValueError where a field is of another kind."""
    values: dict[str, Any] = {}
    for item in dataclasses.fields(TestPoint):
        kind: Any = type(item.default)
        if item.name == 'contact' or item.name.endswith('_ns') or not hasattr(message, item.name):
            continue
        values[item.name] = kind(getattr(message, item.name))
    try:
        values['contact'] = ContactKind(int(getattr(message, 'contact', 0)))
    except ValueError:  # a kind that a later version added: not known here
        values['contact'] = ContactKind.UNKNOWN
    values['start_ns'] = _nanoseconds(getattr(message, 'start', None))
    values['end_ns'] = _nanoseconds(getattr(message, 'end', None))
    return TestPoint(**values)


def encode_test_point(point: TestPoint) -> bytes:
    """Serialise a test point (CDR, little endian)."""
    store = reference_store()
    time = store.types['builtin_interfaces/msg/Time']
    values = {
        item.name: getattr(point, item.name)
        for item in dataclasses.fields(TestPoint)
        if not item.name.endswith('_ns')
    }
    values['contact'] = int(point.contact)
    values['start'] = time(*divmod(point.start_ns, NANOSECONDS))
    values['end'] = time(*divmod(point.end_ns, NANOSECONDS))
    message = store.types[TEST_POINT_TYPE](**values)
    return bytes(store.serialize_cdr(message, TEST_POINT_TYPE))
