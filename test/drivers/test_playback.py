import itertools
import threading
import time

import numpy as np
import pytest

from impactscope.drivers.faults import FaultySource, parse_faults
from impactscope.drivers.pace import Pace
from impactscope.drivers.playback import Playback
from impactscope.drivers.source import SourceError
from impactscope.errors import ConfigurationError
from impactscope.records import SampleBlock, TestPoint

START = 10**18


def blocks(count=10, channels=('force', 'acceleration.plate')):
    return [
        SampleBlock(
            name,
            'N',
            1000.0,
            START + index * 20_000_000,
            index * 20,
            np.full(20, index, np.float32),
            device_time_ns=index * 20_000_000,
        )
        for index, name in itertools.product(range(count), channels)
    ]


def as_fast(data_ns):
    return Pace(data_ns, rate=0.0, lead=1e6)


def play(source, epoch=0):
    source.open(epoch)
    played = []
    while not source.ended:
        played += source.read(0.05)
    return played


def test_plays_its_own_channels_and_marks_the_end():
    played = play(Playback(blocks, lambda name: name == 'force', as_fast))
    assert [b.channel for b in played] == ['force'] * 11
    assert played[-1].is_end
    assert played[-1].first_index == 200
    assert played[-1].stamp_ns == START + 200_000_000


def test_a_recorded_end_is_not_doubled():
    def items():
        made = blocks(channels=('force',))
        last = made[-1]
        return [*made, SampleBlock('force', 'N', 1000.0, last.stamp_ns, 200, last.values[:0])]

    assert sum(b.is_end for b in play(Playback(items, lambda _: True, as_fast))) == 1


def test_restamping_keeps_the_differences():
    source = Playback(
        lambda: blocks(3, ('force',)), lambda _: True, as_fast, restamp_to_ns=5 * 10**18
    )
    assert [b.stamp_ns - 5 * 10**18 for b in play(source)[:3]] == [0, 20_000_000, 40_000_000]


def test_opened_again_it_goes_on_in_a_new_epoch():
    source = Playback(lambda: blocks(10, ('force',)), lambda _: True, as_fast)
    source.open(0)
    first = [source.read(0.1)[0] for _ in range(4)]
    rest = [b for b in play(source, epoch=1) if not b.is_end]
    assert [b.values[0] for b in first + rest] == list(range(10))
    assert rest[0].first_index == 0
    assert {b.epoch for b in rest} == {1}


def test_test_points_come_out_in_their_time():
    items = [TestPoint(id='a', start_ns=START), *blocks(2, ('force',))]
    source = Playback(lambda: items, lambda _: True, as_fast)
    play(source)
    assert [point.id for point in source.test_points] == ['a']


def test_real_time_pace():
    started = time.time_ns()
    pace = Pace(START, rate=2.0, wall_start_ns=started)
    assert pace.wait(START + 200_000_000, 1.0)
    assert 0.1 <= (time.time_ns() - started) / 1e9 < 1.0
    assert not pace.wait(START + 10 * 10**9, 0.01)


def test_without_a_clock_the_consumer_sets_the_pace():
    pace = Pace(0, rate=0.0, lead=1.0, patience=100.0)
    assert pace.wait(10**9, 0.01)
    assert not pace.wait(2 * 10**9, 0.02)
    threading.Timer(0.05, pace.progress, [10**9]).start()
    assert pace.wait(2 * 10**9, 2.0)


def test_without_any_consumer_it_still_ends():
    pace = Pace(0, rate=0.0, lead=1.0, patience=0.05)
    assert not pace.wait(5 * 10**9, 0.03)
    assert pace.wait(5 * 10**9, 0.03)
    assert pace.unheard


@pytest.mark.parametrize('text', ['', 'explode@2', 'stall', 'stall@x', 'stall@1:2:3'])
def test_faults_that_cannot_be_read(text):
    with pytest.raises(ConfigurationError, match='fault'):
        parse_faults([text])


def test_faults_happen():
    source = FaultySource(
        Playback(lambda: blocks(20, ('force',)), lambda _: True, as_fast),
        parse_faults(['drop@0.1:0.05', 'nan@0.2:0.02', 'jump@0.3:0.5', 'die@0.35']),
    )
    source.open(0)
    played = []
    with pytest.raises(SourceError, match='died'):
        while True:
            played += source.read(0.05)
    assert [b.first_index for b in played][4:6] == [80, 160]
    assert any(np.isnan(b.values).all() for b in played)
    leaps = np.diff([b.device_time_ns for b in played])
    assert leaps.max() >= 500_000_000
