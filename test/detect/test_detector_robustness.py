"""Whatever the stream, no exception, and events that make sense."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.detect import DetectorSettings, ImpactDetector
from impactscope.records import Channel, Quality, SyncedBlock

RATE = 2000.0
CHANNELS = (Channel('force', 'N'), Channel('acceleration.plate', 'm/s^2'))


@st.composite
def streams(draw):
    """Four seconds of noise with faults and blows of every kind."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    values = rng.normal(0, draw(st.sampled_from([0.0, 1e-6, 1.0, 1e4])), (2, 8000))
    for _ in range(draw(st.integers(0, 8))):
        row = draw(st.integers(0, 1))
        start = draw(st.integers(0, 7999))
        span = slice(start, start + draw(st.integers(1, 4000)))
        fault = draw(st.sampled_from(['nan', 'inf', 'step', 'ramp', 'hold', 'ring', 'spike']))
        size = draw(st.sampled_from([-1e6, -30.0, 5.0, 50.0, 1e6]))
        part = values[row, span]
        t = np.arange(part.size) / RATE
        if fault == 'nan':
            part[:] = math.nan
        elif fault == 'inf':
            part[:1] = math.inf * size
        elif fault == 'hold':
            part[:] = part[0]
        elif fault == 'spike':
            part[0] += size
        elif fault == 'step':
            part += size
        elif fault == 'ramp':
            part += size * t
        else:
            part += size * np.exp(-15 * t) * np.sin(200 * t)
    return values.astype(np.float32)


@given(
    streams(),
    st.lists(st.integers(20, 900), min_size=1, max_size=30),
    st.sampled_from([-1, 0, 1]),
    st.lists(st.integers(0, 300), max_size=3),
)
@settings(max_examples=60, deadline=None)
def test_any_stream_is_survived(values, sizes, polarity, jumps):
    detector = ImpactDetector(DetectorSettings(polarity=polarity))
    events, at, block = [], 0, 0
    skips = dict(enumerate(jumps, start=2))
    while at < values.shape[1]:
        n = sizes[block % len(sizes)]
        record = SyncedBlock(round(at * 1e9 / RATE), RATE, 0, at, CHANNELS, values[:, at : at + n])
        events += detector.push(record)
        at += n + skips.get(block, 0)
        block += 1
    events += detector.flush()
    assert [event.event_id for event in events] == list(range(1, len(events) + 1))
    for event in events:
        length = event.values.shape[1] / RATE
        assert event.values.shape[0] == len(event.channels) == len(event.zero_level)
        assert 0 <= event.contact_start <= event.contact_end <= length
        assert 0 <= event.event_end <= length
        assert event.contacts
        assert event.contacts[0].start == event.contact_start
        for contact in event.contacts:
            assert 0 <= contact.start < contact.end <= length + 1e-9
            assert math.isfinite(contact.peak_force)
        if np.isnan(event.values[0]).any():
            assert event.quality & (Quality.MISSING | Quality.GAP_BEFORE)
    assert detector.statistics.events == len(events)
    assert detector.flush() == []
