import dataclasses

import numpy as np

from impactscope.drivers.monitor import BlockMonitor
from impactscope.records import Quality, SampleBlock


def block(index=0, values=None, *, received_ms=20, device_ms=0.0, **changes):
    data = np.zeros(20, np.float32) if values is None else np.asarray(values, np.float32)
    made = SampleBlock(
        'force',
        'N',
        1000.0,
        stamp_ns=10**9 + index * 10**6,
        first_index=index,
        values=data,
        device_time_ns=round(device_ms * 1e6),
        received_ns=10**9 + round(received_ms * 1e6),
        range_min=-500.0,
        range_max=500.0,
    )
    return dataclasses.replace(made, **changes)


def test_a_sound_block_passes_unchanged():
    monitor = BlockMonitor()
    first = block()
    assert monitor.check(first) is first
    second = block(20, received_ms=40, device_ms=20)
    assert monitor.check(second) is second
    assert monitor.statistics.samples == 40


def test_lost_samples_are_counted_and_flagged():
    monitor = BlockMonitor()
    monitor.check(block())
    assert monitor.check(block(50, received_ms=70, device_ms=50)).quality == Quality.GAP_BEFORE
    assert monitor.statistics.lost_samples == 30


def test_clipping_needs_a_range():
    values = np.zeros(20)
    values[3] = 500.0
    assert BlockMonitor().check(block(values=values)).quality == Quality.CLIPPED
    free = block(values=values, range_min=np.nan, range_max=np.nan)
    assert BlockMonitor().check(free).quality == Quality.NONE
    values[3] = -500.0
    assert BlockMonitor().check(block(values=values)).quality == Quality.CLIPPED


def test_values_that_are_not_finite():
    values = np.zeros(20)
    values[0] = np.inf
    assert Quality.NOT_FINITE in BlockMonitor().check(block(values=values)).quality


def test_device_clock_that_leaps():
    monitor = BlockMonitor()
    monitor.check(block())
    checked = monitor.check(block(20, received_ms=40, device_ms=25))
    assert checked.quality == Quality.CLOCK_JUMP


def test_late_delivery_is_a_stall():
    monitor = BlockMonitor(stall_time=0.25)
    monitor.check(block())
    assert monitor.check(block(20, received_ms=400, device_ms=20)).quality == Quality.STALLED
    assert monitor.statistics.stalls == 1


def test_a_new_epoch_begins_afresh():
    monitor = BlockMonitor()
    monitor.check(block(500))
    assert monitor.check(block(0, received_ms=5000, epoch=1)).quality == Quality.NONE


def test_a_clipped_sample_beside_one_that_is_no_number_is_seen():
    values = np.zeros(20)
    values[0], values[3] = np.nan, 500.0
    assert BlockMonitor().check(block(values=values)).quality == (
        Quality.NOT_FINITE | Quality.CLIPPED
    )


def test_nothing_but_nan():
    assert BlockMonitor().check(block(values=np.full(20, np.nan))).quality == Quality.NOT_FINITE
