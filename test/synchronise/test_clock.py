import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.errors import ConfigurationError
from impactscope.records import SampleBlock
from impactscope.synchronise.clock import StampClock, TimeLine

START = 1_700_000_000_000_000_000


def at(index, stamp_ns, rate=1000.0) -> SampleBlock:
    return SampleBlock('a', 'N', rate, stamp_ns, index, np.zeros(10, dtype=np.float32))


def observe(clock, index, stamp_ns):
    reading = clock.observe(at(index, stamp_ns))
    whole, fraction = reading.line.at(index)
    return (whole - START) + fraction, reading.jumped


@given(st.integers(0, 10**10), st.sampled_from([51_200.0, 25_600.0, 3000.0, 44_100.0, 100.0]))
@settings(deadline=None)
def test_a_line_keeps_sub_nanosecond_time_for_days(index, rate):
    line = TimeLine(0, START, 0.25, 1e9 / rate)
    whole, fraction = line.at(index)
    assert 0 <= fraction < 1
    exact = index * 10**9 / rate + 0.25
    assert (whole - START) + fraction == pytest.approx(exact, rel=1e-15, abs=1e-6)
    continued = line.continued(index, line.period_ns)
    assert continued.at(index + 7)[0] - line.at(index + 7)[0] in (-1, 0, 1)


@given(st.lists(st.tuples(st.integers(1, 500), st.integers(-900_000, 900_000)), max_size=40))
@settings(deadline=None)
def test_stamps_within_the_tolerance_change_nothing(steps):
    clock = StampClock(1000.0, tolerance=1e-3)
    line = clock.observe(at(0, START)).line
    index = 0
    for size, jitter in steps:
        index += size
        assert clock.observe(at(index, START + index * 1_000_000 + jitter)).line is line


def test_drift_is_followed_by_slewing_without_a_step():
    clock = StampClock(1000.0, tolerance=1e-4)
    before, worst = None, 0.0
    for index in range(0, 100_000, 20):
        stamp = START + round(index * 1e6 * (1 + 50e-6))
        line = clock.observe(at(index, stamp)).line
        whole, fraction = line.at(index)
        worst = max(worst, abs((whole - stamp) + fraction))
        if before is not None:
            last = before.at(index)
            assert abs((whole - last[0]) + (fraction - last[1])) < 1e-3
        assert abs(line.period_ns / 1e6 - 1) <= 500e-6
        before = line
    assert worst < 110_000


def test_the_slew_is_bounded():
    clock = StampClock(1000.0, tolerance=1e-4)
    observe(clock, 0, START)
    observe(clock, 20, START + 20_000_000 + 19_000_000)
    time, jumped = observe(clock, 1020, START + 1_020_000_000 + 19_000_000)
    assert time == pytest.approx(1_020_000_000 + 1000 * 500)
    assert not jumped


def test_beyond_the_jump_the_timeline_is_anchored_anew():
    clock = StampClock(1000.0)
    observe(clock, 0, START)
    assert observe(clock, 100, START + 130_000_000) == (130_000_000, True)
    assert observe(clock, 200, START + 230_000_000) == (230_000_000, False)
    assert observe(clock, 300, START - 10**9) == (-(10**9), True)


def test_stamps_running_backwards_within_the_jump_are_told_but_do_not_anchor():
    clock = StampClock(1000.0, tolerance=1e-2)
    observe(clock, 0, START)
    observe(clock, 5, START + 9_000_000)
    assert observe(clock, 8, START + 8_000_000) == (8_000_000, True)


def test_zero_stamps_are_ignored():
    clock = StampClock(1000.0)
    assert clock.observe(at(0, 0)) is None
    assert observe(clock, 10, START) == (0, False)
    assert observe(clock, 20, 0) == (10_000_000, False)
    assert observe(clock, 30, START + 20_000_000) == (20_000_000, False)


@pytest.mark.parametrize('rate', [0.0, -1.0, math.nan, math.inf])
def test_bad_rates(rate):
    with pytest.raises(ConfigurationError, match='sample rate'):
        StampClock(rate)


@pytest.mark.parametrize('name', ['tolerance', 'jump', 'slew'])
def test_bad_bounds(name):
    with pytest.raises(ConfigurationError, match=name):
        StampClock(1000.0, **{name: -1.0})
