import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from impactscope import msg, records
from impactscope.nodes.conversions import to_message, to_record
from impactscope.records import Channel, Contact, Estimate, Quality

pytestmark = pytest.mark.ros

text = st.text(st.characters(codec='utf-8', exclude_characters='\x00'), max_size=20)
finite = st.floats(-1e6, 1e6, width=32)
number = st.one_of(finite, st.just(math.nan))
stamp = st.integers(0, 2**31 * 10**9 - 1)
count = st.integers(0, 2**32 - 1)
estimate = st.builds(Estimate, number, number)
quality = st.builds(Quality, st.integers(0, 1023))
channel = st.builds(Channel, text, text, text, finite, number, number, quality)
point = st.builds(
    records.TestPoint,
    text,
    text,
    st.sampled_from(records.ContactKind),
    count,
    count,
    text,
    text,
    text,
    number,
    text,
    number,
    number,
    text,
    text,
    stamp,
    stamp,
)


@st.composite
def matrices(draw, rows):
    columns = draw(st.integers(0, 4))
    values = draw(st.lists(number, min_size=rows * columns, max_size=rows * columns))
    return np.array(values, np.float32).reshape(rows, columns)


@st.composite
def blocks(draw):
    return records.SampleBlock(
        draw(text),
        draw(text),
        draw(finite),
        draw(stamp),
        draw(st.integers(0, 2**64 - 1)),
        draw(matrices(1))[0],
        draw(count),
        draw(st.integers(-1, 2**62)),
        draw(stamp),
        Quality(draw(st.integers(0, 31))),
        draw(number),
        draw(number),
        draw(text),
    )


@st.composite
def synced(draw):
    channels = tuple(draw(st.lists(channel, min_size=1, max_size=3)))
    values = draw(matrices(len(channels)))
    return records.SyncedBlock(
        draw(stamp), draw(finite), draw(count), draw(count), channels, values, draw(count)
    )


@st.composite
def events(draw):
    channels = tuple(draw(st.lists(channel, min_size=1, max_size=3)))
    levels = st.tuples(*[number] * len(channels))
    contacts = st.lists(
        st.builds(Contact, number, number, number, number, number), max_size=3
    ).map(tuple)
    return records.ImpactEvent(
        draw(count),
        draw(stamp),
        draw(stamp),
        draw(finite),
        channels,
        draw(matrices(len(channels))),
        draw(contacts),
        draw(number),
        draw(number),
        draw(number),
        draw(levels),
        draw(levels),
        draw(number),
        draw(quality),
        draw(count),
        draw(point),
    )


def results(kind):
    """Any record whose fields are estimates, numbers and texts."""
    by_type = {
        'int': st.integers(0, 2**31 - 1),
        'bool': st.booleans(),
        'str': text,
        'float': number,
        'Estimate': estimate,
        'tuple[int, ...]': st.lists(count, max_size=3).map(tuple),
        'tuple[str, ...]': st.lists(text, max_size=3).map(tuple),
        'tuple[Mode, ...]': st.lists(
            st.builds(records.Mode, estimate, estimate, estimate), max_size=3
        ).map(tuple),
        'TestPoint': point,
        'Verdict': st.sampled_from(records.Verdict),
        'VerdictScope': st.sampled_from(records.VerdictScope),
    }
    return st.builds(kind, **{f.name: by_type[f.type] for f in dataclasses.fields(kind)})


def same(a, b):
    if isinstance(a, np.ndarray):
        return a.shape == b.shape and np.array_equal(a, b, equal_nan=True)
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(
            same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a)
        )
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b or (isinstance(a, float) and math.isnan(a) and math.isnan(b))


@settings(max_examples=60, deadline=None)
@given(
    st.one_of(
        blocks(),
        synced(),
        events(),
        point,
        results(records.SensorParameters),
        results(records.SensorSummary),
        results(records.ImpactParameters),
        results(records.ComplianceVerdict),
    )
)
def test_records_survive_the_wire(record):
    message = to_message(record)
    arrived = deserialize_message(serialize_message(message), type(message))
    assert same(to_record(arrived), record)


def test_every_field_of_a_message_has_its_record():
    header = {'header': {'stamp_ns', 'frame_id'}}
    for kind, record in (
        (msg.SensorParameters, records.SensorParameters),
        (msg.SensorSummary, records.SensorSummary),
        (msg.Mode, records.Mode),
        (msg.ImpactParameters, records.ImpactParameters),
        (msg.ComplianceVerdict, records.ComplianceVerdict),
        (msg.TestPoint, records.TestPoint),
        (msg.Contact, records.Contact),
        (msg.Channel, records.Channel),
    ):
        fields = set(kind.get_fields_and_field_types())
        names = {f.name.removesuffix('_ns') for f in dataclasses.fields(record)}
        assert fields - set(header) == names - {'stamp'}, kind


def test_flags_and_verdicts_are_those_of_the_messages():
    for flag in Quality:
        assert getattr(msg.Quality, flag.name) == flag.value
    for flag in ('CLIPPED', 'GAP_BEFORE', 'STALLED', 'CLOCK_JUMP', 'NOT_FINITE'):
        assert getattr(msg.SampleBlock, f'QUALITY_{flag}') == Quality[flag]
    for verdict in records.Verdict:
        assert getattr(msg.ComplianceVerdict, verdict.name) == verdict.value
    for kind in records.ContactKind:
        assert getattr(msg.TestPoint, f'CONTACT_{kind.name}') == kind.value


def test_an_unset_verdict_is_no_pass():
    assert msg.ComplianceVerdict().verdict == msg.ComplianceVerdict.INCOMPLETE


def test_a_kind_of_contact_from_the_future_is_unknown():
    assert to_record(msg.TestPoint(contact=77)).contact is records.ContactKind.UNKNOWN
