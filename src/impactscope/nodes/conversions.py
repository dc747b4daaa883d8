"""Records to messages and back, field by field, without loss.

Sample arrays cross as ``array.array`` built from bytes: generated setters take that without
looking at each element, and NumPy views it without a copy.
"""

from __future__ import annotations

import array
import dataclasses
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from std_msgs.msg import Header

from impactscope import msg, records
from impactscope.records import NANOSECONDS

__all__ = ['time_message', 'time_ns', 'to_message', 'to_record']


def time_message(stamp_ns: int) -> Time:
    """Integer nanoseconds as a time message; before 1970 is zero, which means: not known."""
    sec, nanosec = divmod(max(stamp_ns, 0), NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


def time_ns(time: Time) -> int:
    """A time message as integer nanoseconds."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def _floats(values: NDArray[np.float32]) -> array.array[float]:
    return array.array('f', np.ascontiguousarray(values, dtype=np.float32).tobytes())


def _estimate(value: records.Estimate) -> msg.Estimate:
    return msg.Estimate(value=float(value.value), std=float(value.std))


def _mode(value: records.Mode) -> msg.Mode:
    return msg.Mode(**{name: _estimate(getattr(value, name)) for name in _names(value)})


def _mode_record(value: msg.Mode) -> records.Mode:
    estimates = (getattr(value, item.name) for item in dataclasses.fields(records.Mode))
    return records.Mode(*(records.Estimate(e.value, e.std) for e in estimates))


def _channel(value: records.Channel) -> msg.Channel:
    return msg.Channel(
        name=value.name,
        unit=value.unit,
        frame_id=value.frame_id,
        native_rate=float(value.native_rate),
        range_min=float(value.range_min),
        range_max=float(value.range_max),
        quality=int(value.quality),
    )


def _channel_record(value: msg.Channel) -> records.Channel:
    return records.Channel(
        value.name,
        value.unit,
        value.frame_id,
        value.native_rate,
        value.range_min,
        value.range_max,
        records.Quality(value.quality),
    )


def _block(record: records.SampleBlock) -> msg.SampleBlock:
    return msg.SampleBlock(
        header=Header(stamp=time_message(record.stamp_ns), frame_id=record.frame_id),
        channel=record.channel,
        unit=record.unit,
        sample_rate=float(record.sample_rate),
        device_time_ns=record.device_time_ns,
        received=time_message(record.received_ns),
        epoch=record.epoch,
        first_index=record.first_index,
        quality=int(record.quality) & 0x1F,
        range_min=float(record.range_min),
        range_max=float(record.range_max),
        values=_floats(record.values),
    )


def _block_record(message: msg.SampleBlock) -> records.SampleBlock:
    return records.SampleBlock(
        channel=message.channel,
        unit=message.unit,
        sample_rate=message.sample_rate,
        stamp_ns=time_ns(message.header.stamp),
        first_index=message.first_index,
        values=np.asarray(message.values, dtype=np.float32),
        epoch=message.epoch,
        device_time_ns=message.device_time_ns,
        received_ns=time_ns(message.received),
        quality=records.Quality(message.quality),
        range_min=message.range_min,
        range_max=message.range_max,
        frame_id=message.header.frame_id,
    )


def _synced(record: records.SyncedBlock) -> msg.SyncedBlock:
    return msg.SyncedBlock(
        header=Header(
            stamp=time_message(record.stamp_ns),
            frame_id=record.channels[0].frame_id if record.channels else '',
        ),
        sample_rate=float(record.sample_rate),
        epoch=record.epoch,
        first_index=record.first_index,
        oversampling=record.oversampling,
        channels=[_channel(channel) for channel in record.channels],
        samples=record.values.shape[1],
        values=_floats(record.values),
    )


def _matrix(message: msg.SyncedBlock | msg.ImpactEvent) -> NDArray[np.float32]:
    values = np.asarray(message.values, dtype=np.float32)
    return values.reshape(len(message.channels), message.samples)


def _synced_record(message: msg.SyncedBlock) -> records.SyncedBlock:
    return records.SyncedBlock(
        stamp_ns=time_ns(message.header.stamp),
        sample_rate=message.sample_rate,
        epoch=message.epoch,
        first_index=message.first_index,
        channels=tuple(_channel_record(channel) for channel in message.channels),
        values=_matrix(message),
        oversampling=message.oversampling,
    )


def _contact(value: records.Contact) -> msg.Contact:
    return msg.Contact(**{name: float(getattr(value, name)) for name in _names(value)})


def _contact_record(value: msg.Contact) -> records.Contact:
    return records.Contact(
        value.start, value.end, value.peak_force, value.peak_time, value.impulse
    )


def _names(record: Any) -> list[str]:
    return [item.name for item in dataclasses.fields(record)]


_TIMES = {'start_ns': 'start', 'end_ns': 'end'}


def _test_point(record: records.TestPoint) -> msg.TestPoint:
    message = msg.TestPoint()
    for name in _names(record):
        value = getattr(record, name)
        if name in _TIMES:
            setattr(message, _TIMES[name], time_message(value))
        else:
            kind = type(getattr(message, name))
            setattr(message, name, kind(value))
    return message


def _test_point_record(message: msg.TestPoint) -> records.TestPoint:
    values: dict[str, Any] = {}
    for item in dataclasses.fields(records.TestPoint):
        if item.name in _TIMES:
            values[item.name] = time_ns(getattr(message, _TIMES[item.name]))
        else:
            values[item.name] = getattr(message, item.name)
    try:
        values['contact'] = records.ContactKind(values['contact'])
    except ValueError:  # a kind that a later version added: not known here, so not judged
        values['contact'] = records.ContactKind.UNKNOWN
    return records.TestPoint(**values)


def _event(record: records.ImpactEvent) -> msg.ImpactEvent:
    return msg.ImpactEvent(
        header=Header(
            stamp=time_message(record.stamp_ns),
            frame_id=record.channels[0].frame_id if record.channels else '',
        ),
        event_id=record.event_id,
        window_start=time_message(record.window_start_ns),
        sample_rate=float(record.sample_rate),
        oversampling=record.oversampling,
        channels=[_channel(channel) for channel in record.channels],
        samples=record.values.shape[1],
        values=_floats(record.values),
        quality=int(record.quality),
        contacts=[_contact(contact) for contact in record.contacts],
        contact_start=float(record.contact_start),
        contact_end=float(record.contact_end),
        event_end=float(record.event_end),
        zero_level=array.array('d', record.zero_level),
        noise_std=array.array('d', record.noise_std),
        rest_level=float(record.rest_level),
        test_point=_test_point(record.test_point),
    )


def _event_record(message: msg.ImpactEvent) -> records.ImpactEvent:
    return records.ImpactEvent(
        event_id=message.event_id,
        stamp_ns=time_ns(message.header.stamp),
        window_start_ns=time_ns(message.window_start),
        sample_rate=message.sample_rate,
        channels=tuple(_channel_record(channel) for channel in message.channels),
        values=_matrix(message),
        contacts=tuple(_contact_record(contact) for contact in message.contacts),
        contact_start=message.contact_start,
        contact_end=message.contact_end,
        event_end=message.event_end,
        zero_level=tuple(message.zero_level),
        noise_std=tuple(message.noise_std),
        rest_level=message.rest_level,
        quality=records.Quality(message.quality),
        oversampling=message.oversampling,
        test_point=_test_point_record(message.test_point),
    )


def _result(record: Any, message: Any) -> Any:
    """Fields of one name; the record's stamp is the header's."""
    for name in _names(record):
        value = getattr(record, name)
        if name == 'stamp_ns':
            message.header.stamp = time_message(value)
        elif isinstance(value, records.Estimate):
            setattr(message, name, _estimate(value))
        elif isinstance(value, records.TestPoint):
            message.test_point = _test_point(value)
        elif name == 'modes':
            message.modes = [_mode(mode) for mode in value]
        elif isinstance(value, tuple):
            setattr(message, name, list(value))
        else:
            kind = type(getattr(message, name))
            setattr(message, name, kind(value))
    return message


def _result_record(kind: type[Any], message: Any) -> Any:
    values: dict[str, Any] = {}
    for item in dataclasses.fields(kind):
        if item.name == 'stamp_ns':
            values['stamp_ns'] = time_ns(message.header.stamp)
            continue
        value = getattr(message, item.name)
        if isinstance(value, msg.Estimate):
            value = records.Estimate(value.value, value.std)
        elif isinstance(value, msg.TestPoint):
            value = _test_point_record(value)
        elif item.name == 'modes':
            value = tuple(_mode_record(mode) for mode in value)
        elif item.name in {'event_ids', 'reasons'}:
            value = tuple(value)
        values[item.name] = value
    if kind is records.ComplianceVerdict:
        values['verdict'] = records.Verdict(values['verdict'])
        values['scope'] = records.VerdictScope(values['scope'])
    return kind(**values)


_TO_MESSAGE: dict[type, Any] = {
    records.SampleBlock: _block,
    records.SyncedBlock: _synced,
    records.ImpactEvent: _event,
    records.TestPoint: _test_point,
    records.SensorParameters: lambda record: _result(record, msg.SensorParameters()),
    records.SensorSummary: lambda record: _result(record, msg.SensorSummary()),
    records.ImpactParameters: lambda record: _result(record, msg.ImpactParameters()),
    records.ComplianceVerdict: lambda record: _result(record, msg.ComplianceVerdict()),
}
_TO_RECORD: dict[type, Any] = {
    msg.SampleBlock: _block_record,
    msg.SyncedBlock: _synced_record,
    msg.ImpactEvent: _event_record,
    msg.TestPoint: _test_point_record,
    msg.SensorParameters: lambda m: _result_record(records.SensorParameters, m),
    msg.SensorSummary: lambda m: _result_record(records.SensorSummary, m),
    msg.ImpactParameters: lambda m: _result_record(records.ImpactParameters, m),
    msg.ComplianceVerdict: lambda m: _result_record(records.ComplianceVerdict, m),
}


def to_message(record: Any) -> Any:
    """The message of a record. Raises KeyError for a type that has none."""
    return _TO_MESSAGE[type(record)](record)


def to_record(message: Any) -> Any:
    """The record of a message. Raises KeyError for a type that has none."""
    return _TO_RECORD[type(message)](message)
