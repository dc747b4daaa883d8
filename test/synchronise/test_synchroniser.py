import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.errors import ConfigurationError
from impactscope.records import Quality, SampleBlock, SyncedBlock
from impactscope.synchronise import quality_notes
from impactscope.synchronise.synchroniser import Synchroniser, SynchroniserSettings

START = 1_700_000_000_000_000_000
TONE = 31.0  # Hz, of what every channel sees


def block(channel, rate, index, values, phase=0.0, **more) -> SampleBlock:
    given_fields = {
        'channel': channel,
        'unit': 'N',
        'sample_rate': rate,
        'stamp_ns': START + round((phase + index / rate) * 1e9),
        'first_index': index,
        'values': np.asarray(values, dtype=np.float32),
    }
    return SampleBlock(**{**given_fields, **more})


def tone(rate, size, phase=0.0) -> np.ndarray:
    return np.sin(2 * np.pi * TONE * (np.arange(size) / rate + phase)).astype(np.float32)


def stream(channel, rate, size, cut=50, phase=0.0, **more) -> list[SampleBlock]:
    """A tone in blocks of ``cut`` samples, or cut at the places listed."""
    values = tone(rate, size, phase)
    edges = list(range(0, size, cut)) if isinstance(cut, int) else sorted({0, *cut})
    edges = [*[e for e in edges if e < size], size]
    return [
        block(channel, rate, a, values[a:b], phase, **more) for a, b in itertools.pairwise(edges)
    ]


def end(channel, rate, size, **more) -> SampleBlock:
    return block(channel, rate, size, [], **more)


def merged(*streams) -> list[SampleBlock]:
    """In the order in which a driver would have them complete."""
    blocks = [item for items in streams for item in items]
    return sorted(blocks, key=lambda b: b.stamp_ns + b.values.size / b.sample_rate * 1e9)


def run(synchroniser, blocks, flush=True) -> list[SyncedBlock]:
    out = [item for one in blocks for item in synchroniser.push(one)]
    return out + synchroniser.flush() if flush else out


def joined(out) -> np.ndarray:
    return np.concatenate([b.values for b in out], axis=1)


def quality(out, row) -> Quality:
    flags = Quality.NONE
    for item in out:
        flags |= item.channels[row].quality
    return flags


def make(*channels, **more) -> Synchroniser:
    return Synchroniser(SynchroniserSettings(tuple(channels), **more))


# -- the grid ----------------------------------------------------------------------------------


def test_channels_on_the_same_instants_are_copied_bit_for_bit():
    a, b = stream('a', 1000.0, 500), stream('b', 1000.0, 500, cut=37)
    out = run(make('a', 'b'), merged(a, b))
    values = joined(out)
    assert values[0].tobytes() == values[1].tobytes() == tone(1000.0, 500).tobytes()
    assert out[-1].is_end
    assert [o.is_end for o in out].count(True) == 1
    assert quality(out, 0) == quality(out, 1) == Quality.NONE


def test_blocks_join_without_gap_in_index_and_time():
    out = run(make('a', 'b'), merged(stream('a', 1000.0, 700), stream('b', 4000.0, 2800)))
    index = 0
    for item in out:
        assert item.first_index == index
        assert item.sample_rate == 4000.0
        assert item.stamp_ns == START + round(index / 4000.0 * 1e9)
        index += item.values.shape[1]
    assert index == 699 * 4 + 1  # up to the reference's last sample


@pytest.mark.parametrize(
    ('rates', 'phases', 'ratio'),
    [
        ((1000.0, 25_600.0), (0.0, 3.3e-6), 26),
        ((25_600.0, 1000.0), (0.0, -4e-4), 1),
        ((5000.0, 5000.0), (0.0, 7.7e-5), 1),
        ((1000.0, 1000.0000001), (0.0, 0.0), 1),
        ((3000.0, 7000.0), (1e-4, 0.0), 3),
    ],
)
def test_every_channel_shows_the_same_tone_on_the_grid(rates, phases, ratio):
    seconds = 0.5
    streams = [
        stream(name, rate, int(rate * seconds), cut=max(5, int(rate * 0.02)), phase=phase)
        for name, rate, phase in zip('ab', rates, phases, strict=True)
    ]
    out = run(make('a', 'b'), merged(*streams))
    values, grid_rate = joined(out), out[0].sample_rate
    assert out[0].oversampling == ratio
    assert grid_rate == rates[0] * ratio
    truth = np.sin(2 * np.pi * TONE * (np.arange(values.shape[1]) / grid_rate + phases[0]))
    inside = slice(int(0.03 * grid_rate), int((seconds - 0.03) * grid_rate))
    assert np.abs(values - truth)[:, inside].max() < 5e-5
    own = values[0, ::ratio]
    assert own.tobytes() == streams_values(streams[0])[: own.size].tobytes()


def streams_values(blocks) -> np.ndarray:
    return np.concatenate([b.values for b in blocks])


def test_grid_rate_can_be_asked_for():
    out = run(make('a', grid_rate=3500.0), stream('a', 1000.0, 100))
    assert out[0].oversampling == 4
    assert joined(out)[0, ::4].tobytes() == tone(1000.0, 100).tobytes()


def test_reference_is_row_zero_whatever_its_place_in_the_list():
    out = run(make('b', 'a', reference='a'), merged(stream('a', 1000.0, 90), stream('b', 1e3, 90)))
    assert [c.name for c in out[0].channels] == ['a', 'b']


def test_messages_stay_small():
    out = run(
        make('a', 'b'), [*stream('a', 1e5, 100_000, cut=100_000), *stream('b', 1e5, 100_000)]
    )
    assert max(b.values.nbytes for b in out) <= 260_000
    assert joined(out).shape == (2, 100_000)


def test_what_is_covered_comes_out_at_once():
    synchroniser = make('a', 'b')
    a, b = stream('a', 1000.0, 200, cut=20), stream('b', 1000.0, 200, cut=20, phase=2.5e-4)
    emitted = 0
    for one, other in zip(a, b, strict=True):
        synchroniser.push(one)
        emitted += sum(o.values.shape[1] for o in synchroniser.push(other))
        covered = one.first_index + 20 - 16
        assert emitted >= covered - 5  # less than a quarter of a block is kept back


# -- order and cutting do not matter -----------------------------------------------------------

PLAN = {'a': (1000.0, 0.0), 'b': (2560.0, 1.3e-4), 'c': (1000.0, -2.2e-4), 'd': (1000.0, 0.0)}
LENGTH = 0.4


def synced(cuts, order_seed, dropped=()):
    """Outcome for streams cut and interleaved at random; ``dropped`` samples are lost."""
    queues = []
    for (name, (rate, phase)), cut in zip(PLAN.items(), cuts, strict=True):
        size = int(rate * LENGTH)
        edges = {int(c * size) for c in cut}
        lost = [(int(x * size), int(y * size)) for n, x, y in dropped if n == name]
        edges |= {e for pair in lost for e in pair}
        blocks = stream(name, rate, size, cut=edges, phase=phase, range_max=0.97)
        blocks = [b for b in blocks if not any(x <= b.first_index < y for x, y in lost)]
        queues.append([*blocks, end(name, rate, size)])
    rng = np.random.default_rng(order_seed)
    synchroniser = make(*PLAN)
    out = []
    while any(queues):
        ready = [q for q in queues if q]
        out += synchroniser.push(ready[rng.integers(len(ready))].pop(0))
    return out


cut_lists = st.tuples(*(st.lists(st.floats(0, 0.999), max_size=12) for _ in PLAN))
gaps = st.lists(
    st.tuples(st.sampled_from(list(PLAN)), st.floats(0.2, 0.5), st.floats(0.5, 0.8)), max_size=2
)


@settings(max_examples=60, deadline=None)
@given(cut_lists, st.integers(0, 2**32 - 1), gaps)
def test_neither_cutting_nor_interleaving_changes_a_bit(cuts, seed, dropped):
    tidy = synced([[0.5]] * len(PLAN), 0, dropped)
    wild = synced(cuts, seed, dropped)
    assert joined(wild).tobytes() == joined(tidy).tobytes()
    assert wild[-1].is_end
    assert wild[-1].first_index == tidy[-1].first_index
    for row in range(len(PLAN)):
        assert quality(wild, row) == quality(tidy, row)
    starts = np.cumsum([0, *(b.values.shape[1] for b in wild)])
    assert [b.first_index for b in wild] == starts[:-1].tolist()


def faulty_streams(seed):
    """Streams with jittered stamps, lost, repeated and late blocks, cut once and for all."""
    rng = np.random.default_rng(seed)
    queues = []
    for name, (rate, phase) in PLAN.items():
        size = int(rate * LENGTH)
        blocks = stream(name, rate, size, cut=[int(c) for c in rng.integers(1, size, 25)])
        jitter = rng.normal(0, 4e5, len(blocks)).astype(int)
        phase_ns = round(phase * 1e9)
        blocks = [
            dataclasses.replace(b, stamp_ns=int(b.stamp_ns + phase_ns + j))
            for b, j in zip(blocks, jitter, strict=True)
        ]
        del blocks[int(rng.integers(1, 10))]
        at = int(rng.integers(10, len(blocks) - 1))
        blocks.insert(at, blocks[at - 2])
        blocks[1], blocks[2] = blocks[2], blocks[1]
        queues.append([*blocks, end(name, rate, size)])
    return queues


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_interleaving_does_not_change_a_bit_of_faulty_streams_either(seed, order_seed):
    def outcome(rng):
        queues = faulty_streams(seed)
        synchroniser = make(*PLAN, clock_tolerance=1e-4)
        out = []
        while any(queues):
            ready = [q for q in queues if q]
            out += synchroniser.push(ready[rng.integers(len(ready)) if rng else 0].pop(0))
        return out, synchroniser.statistics

    (tidy, counted), (wild, counted_again) = (
        outcome(None),
        outcome(np.random.default_rng(order_seed)),
    )
    assert joined(wild).tobytes() == joined(tidy).tobytes()
    assert wild[-1].is_end
    assert {n: dataclasses.replace(c, lag_s=0) for n, c in counted.items()} == {
        n: dataclasses.replace(c, lag_s=0) for n, c in counted_again.items()
    }
    assert all(c.duplicates >= 1 and c.lost_samples >= 1 for c in counted.values())


# -- what may go wrong -------------------------------------------------------------------------


def test_lost_samples_are_nan_flagged_and_counted_and_never_bridged():
    a, b = stream('a', 1000.0, 2000), stream('b', 1000.0, 2000, phase=3e-4)
    del a[10], b[20]
    synchroniser = make('a', 'b')
    out = run(synchroniser, merged(a, b))
    missing = np.isnan(joined(out))
    assert np.flatnonzero(missing[0]).tolist() == list(range(500, 550))
    # b lies 0.3 samples later: NaN where one of 32 taps is lost.
    assert np.flatnonzero(missing[1])[1:].tolist() == list(range(1000 - 15, 1050 + 16))
    assert quality(out, 0) == Quality.GAP_BEFORE
    assert Quality.GAP_BEFORE in quality(out, 1)
    flagged = [o.first_index for o in out if Quality.GAP_BEFORE in o.channels[0].quality]
    assert all(400 < index < 600 for index in flagged)
    assert [synchroniser.statistics[n].lost_samples for n in 'ab'] == [50, 50]


def test_duplicates_are_dropped_and_counted():
    blocks = stream('a', 1000.0, 500)
    synchroniser = make('a')
    out = run(synchroniser, [*blocks[:5], blocks[3], blocks[4], *blocks[5:]])
    assert joined(out)[0].tobytes() == tone(1000.0, 500).tobytes()
    assert synchroniser.statistics['a'].duplicates == 2
    assert synchroniser.statistics['a'].samples == 500


def test_a_block_that_overlaps_gives_only_what_is_new():
    values = tone(1000.0, 200)
    synchroniser = make('a')
    blocks = [block('a', 1e3, 0, values[:120]), block('a', 1e3, 80, values[80:])]
    assert joined(run(synchroniser, blocks))[0].tobytes() == values.tobytes()
    assert synchroniser.statistics['a'].duplicates == 1


@pytest.mark.parametrize('name', ['a', 'b'])
def test_a_late_block_is_put_in_its_place(name):
    streams = {'a': stream('a', 1e3, 2000), 'b': stream('b', 1e3, 2000, phase=1e-4)}
    tidy = run(make('a', 'b'), merged(*streams.values()))
    blocks = streams[name]
    blocks[7], blocks[8], blocks[9] = blocks[9], blocks[7], blocks[8]
    synchroniser = make('a', 'b')
    mixed = run(synchroniser, [x for pair in zip(*streams.values(), strict=True) for x in pair])
    assert joined(mixed).tobytes() == joined(tidy).tobytes()
    assert synchroniser.statistics[name].out_of_order == 2
    assert synchroniser.statistics[name].lost_samples == 0
    assert quality(mixed, 0) == Quality.NONE


def test_a_block_later_than_the_wait_is_dropped_and_counted():
    blocks = stream('a', 1000.0, 2000)
    late = blocks.pop(4)
    synchroniser = make('a')
    out = run(synchroniser, [*blocks[:20], late, *blocks[20:]])
    assert np.isnan(joined(out)[0]).sum() == 50
    assert synchroniser.statistics['a'].late == 1
    assert synchroniser.statistics['a'].duplicates == 0
    assert synchroniser.statistics['a'].lost_samples == 50


def test_a_block_from_before_the_first_is_late():
    blocks = stream('a', 1000.0, 300)
    synchroniser = make('a')
    out = run(synchroniser, [blocks[1], blocks[0], *blocks[2:]])
    assert out[0].first_index == 50
    assert joined(out)[0].tobytes() == tone(1000.0, 300)[50:].tobytes()
    assert synchroniser.statistics['a'].late == 1


def test_a_channel_that_lags_is_missing_and_does_not_stop_the_others():
    a, b = stream('a', 1000.0, 6000), stream('b', 1000.0, 1000)
    synchroniser = make('a', 'b', longest_wait=0.5)
    out = run(synchroniser, merged(a, b), flush=False)
    values = joined(out)
    assert values.shape[1] == pytest.approx(5500, abs=50)
    assert not np.isnan(values[0]).any()
    assert np.array_equal(np.isnan(values[1]), np.arange(values.shape[1]) >= 1000)
    assert Quality.MISSING in quality(out, 1)
    assert synchroniser.statistics['b'].missing == values.shape[1] - 1000
    assert synchroniser.statistics['b'].not_waited_for == values.shape[1] - 1000
    assert any('longest_wait' in note for note in quality_notes(synchroniser.statistics))
    assert synchroniser.statistics['b'].lag_s == pytest.approx(5.0)


def test_a_channel_that_comes_back_after_its_absence_is_taken_again():
    a = stream('a', 1000.0, 6000)
    b = [x for x in stream('b', 1000.0, 6000) if not 1000 <= x.first_index < 3000]
    out = run(make('a', 'b', longest_wait=0.5), merged(a, b))
    values = joined(out)
    assert np.array_equal(
        np.isnan(values[1]), (np.arange(6000) >= 1000) & (np.arange(6000) < 3000)
    )
    assert values[1, 3000:].tobytes() == tone(1000.0, 6000)[3000:].tobytes()


def test_a_channel_never_seen_is_waited_for_and_then_missing():
    synchroniser = make('a', 'b', longest_wait=0.5)
    blocks = stream('a', 1000.0, 1000)
    assert run(synchroniser, blocks[:10], flush=False) == []
    out = run(synchroniser, blocks[10:])
    values = joined(out)
    assert values[0].tobytes() == tone(1000.0, 1000).tobytes()
    assert np.isnan(values[1]).all()
    assert out[0].channels[1].quality == Quality.MISSING


def test_a_channel_that_comes_too_late_and_too_fast_is_refused_with_the_reason():
    synchroniser = make('a', 'b', longest_wait=0.2)
    run(synchroniser, stream('a', 1000.0, 1000), flush=False)
    assert synchroniser.push(block('b', 5000.0, 0, np.ones(10), phase=1.0)) == []
    assert synchroniser.statistics['b'].refused == 1
    assert '5000 Hz' in synchroniser.statistics['b'].refusal


def test_a_new_epoch_begins_a_new_grid_and_nothing_is_lost():
    first, second = stream('a', 1000.0, 300), stream('a', 2000.0, 400, phase=1.0, epoch=1)
    b = stream('b', 1000.0, 1300)
    synchroniser = make('a', 'b')
    out = run(synchroniser, merged(first, second, b))
    parts = [[o for o in out if o.epoch == e] for e in (0, 1)]
    assert joined(parts[0])[0].tobytes() == tone(1000.0, 300).tobytes()
    assert joined(parts[1])[0].tobytes() == tone(2000.0, 400, 1.0).tobytes()
    assert parts[1][0].first_index == 0
    assert parts[1][0].stamp_ns == START + 1_000_000_000
    assert parts[1][0].sample_rate == 2000.0
    truth = np.sin(2 * np.pi * TONE * (1.0 + np.arange(400) / 2000))
    assert np.abs(joined(parts[1])[1] - truth)[:-40].max() < 5e-5
    assert synchroniser.statistics['a'].restarts == 1


def test_another_channels_new_epoch_is_placed_by_its_stamps():
    b = [*stream('b', 1000.0, 300), *stream('b', 1000.0, 400, phase=0.5, epoch=1)]
    out = run(make('a', 'b'), merged(stream('a', 1000.0, 1000), b))
    missing = np.isnan(joined(out)[1])
    index = np.arange(1000)
    assert np.array_equal(missing, ((index >= 300) & (index < 500)) | (index >= 900))
    assert {o.epoch for o in out} == {0}


def test_a_recording_played_again_starts_over_although_no_epoch_says_so():
    blocks = stream('a', 1000.0, 5000, cut=20)
    out = run(make('a', longest_wait=0.5), [*blocks, *blocks])
    ends = [i for i, o in enumerate(out) if o.is_end]
    assert len(ends) == 2
    assert joined(out[: ends[0]]).shape[1] == 5000
    again = out[ends[0] + 1 : ends[1]]
    assert again[0].first_index == 20  # the first block could as well have been a late one
    assert joined(again).shape[1] == 4980


def test_a_lone_block_from_far_back_restarts_nothing():
    blocks = stream('a', 1000.0, 3000)
    synchroniser = make('a', longest_wait=0.5)
    out = run(synchroniser, [*blocks[:50], blocks[2], *blocks[50:]])
    assert joined(out).shape[1] == 3000
    assert synchroniser.statistics['a'].restarts == 0


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'unit': 'm/s^2'}, 'm/s'),
        ({'sample_rate': 2000.0}, '2000 Hz'),
        ({'sample_rate': math.nan}, 'nan'),
        ({'values': np.ones(50)}, 'float64'),
        ({'values': np.ones((2, 25), dtype=np.float32)}, r'(2, 25)'),
        ({'first_index': -1}, '-1'),
    ],
)
def test_a_block_that_contradicts_its_channel_is_refused_and_said_why(change, words):
    blocks = stream('a', 1000.0, 500)
    blocks[5] = dataclasses.replace(blocks[5], **change)
    synchroniser = make('a')
    values = joined(run(synchroniser, blocks))
    assert np.flatnonzero(np.isnan(values[0])).tolist() == list(range(250, 300))
    assert synchroniser.statistics['a'].refused == 1
    assert words in synchroniser.statistics['a'].refusal


def test_a_stream_without_any_stamp_is_refused():
    synchroniser = make('a')
    assert run(synchroniser, [block('a', 1e3, 0, np.ones(9), stamp_ns=0)]) == []
    assert 'stamp' in synchroniser.statistics['a'].refusal


def test_unknown_channels_are_counted_within_bounds():
    synchroniser = make('a')
    for k in range(200):
        assert synchroniser.push(block(f'x{k}', 1e3, 0, np.ones(3))) == []
    assert len(synchroniser.unknown_channels) == 64


def test_odd_values_are_flagged_and_stay_where_they_are():
    values = tone(1000.0, 400)
    values[[60, 61, 300]] = [np.inf, -np.inf, np.nan]
    values[200] = 5.0
    synchroniser = make('a')
    a = [block('a', 1e3, i, values[i : i + 50], range_max=5.0) for i in range(0, 400, 50)]
    out = run(synchroniser, a)
    assert np.flatnonzero(np.isnan(joined(out)[0])).tolist() == [60, 61, 300]
    flags = {o.first_index: o.channels[0].quality for o in out}
    assert Quality.NOT_FINITE in flags[50]
    assert Quality.CLIPPED in flags[50]  # inf is beyond any range
    assert flags[200] == Quality.CLIPPED
    assert flags[300] == Quality.NOT_FINITE
    assert flags[100] == flags[350] == Quality.NONE


def test_flags_of_drivers_reach_the_grid():
    blocks = stream('b', 1000.0, 300)
    blocks[3] = dataclasses.replace(blocks[3], quality=Quality.STALLED)
    out = run(make('a', 'b'), merged(stream('a', 1000.0, 300), blocks))
    assert [o.first_index for o in out if Quality.STALLED in o.channels[1].quality] == [150]


def test_end_markers_close_the_grid_and_lost_tails_are_counted():
    synchroniser = make('a', 'b')
    blocks = merged(stream('a', 1e3, 300), stream('b', 1e3, 300, phase=1e-4))
    out = run(synchroniser, [*blocks, end('b', 1e3, 310), end('a', 1e3, 300)], flush=False)
    assert out[-1].is_end
    assert out[-1].first_index == 300
    assert joined(out).shape == (2, 300)
    assert synchroniser.statistics['b'].lost_samples == 10
    assert synchroniser.flush() == []


def test_the_edges_of_a_stream_are_kept():
    out = run(make('a', 'b'), merged(stream('a', 1e3, 400), stream('b', 1e3, 400, phase=-2.5e-4)))
    values = joined(out)
    assert np.isnan(values[1]).sum() == 1  # after b's last sample
    truth = np.sin(2 * np.pi * TONE * np.arange(400) / 1e3)
    assert np.nanmax(np.abs(values[1] - truth)) < 0.1


# -- clocks ------------------------------------------------------------------------------------


def test_a_clock_set_forward_is_flagged_and_followed():
    blocks = stream('a', 1e3, 400)
    blocks[4:] = [dataclasses.replace(b, stamp_ns=b.stamp_ns + 10**9) for b in blocks[4:]]
    synchroniser = make('a')
    out = run(synchroniser, blocks)
    assert joined(out)[0].tobytes() == tone(1e3, 400).tobytes()
    assert [o.first_index for o in out if o.channels[0].quality == Quality.CLOCK_JUMP] == [200]
    assert {o.first_index: o.stamp_ns for o in out}[200] == START + 1_200_000_000
    assert synchroniser.statistics['a'].clock_jumps == 1


@pytest.mark.parametrize('jump', [-0.7, 0.7, -30.0, 3600.0])
def test_channels_whose_clock_is_set_together_stay_aligned(jump):
    def shifted(blocks):
        return [
            dataclasses.replace(b, stamp_ns=b.stamp_ns + (b.first_index >= 1000) * int(jump * 1e9))
            for b in blocks
        ]

    a, b = stream('a', 1e3, 4000), stream('b', 1e3, 4000, phase=3e-4)
    pairs = [x for p in zip(shifted(a), shifted(b), strict=True) for x in p]
    out = run(make('a', 'b'), pairs)
    values = joined(out)
    truth = np.sin(2 * np.pi * TONE * np.arange(4000) / 1e3)
    assert values[0].tobytes() == tone(1e3, 4000).tobytes()
    assert np.isnan(values[1]).sum() <= 2
    error = np.abs(values[1] - truth)
    error[[0, 1000, *range(3950, 4000)]] = 0
    error[:40] = 0
    assert np.nanmax(error) < 5e-5
    assert Quality.CLOCK_JUMP in quality(out, 0)
    assert Quality.CLOCK_JUMP in quality(out, 1)


def test_one_channels_clock_set_back_is_waited_for_and_aligned_again():
    b = [
        dataclasses.replace(x, stamp_ns=x.stamp_ns + (x.first_index < 1000) * 10**8)
        for x in stream('b', 1e3, 3000)
    ]
    out = run(make('a', 'b'), merged(stream('a', 1e3, 3000), b))
    values = joined(out)
    assert values[1, 1100:].tobytes() == values[0, 1100:].tobytes()
    assert Quality.CLOCK_JUMP in quality(out, 1)


# -- bounds ------------------------------------------------------------------------------------


def test_memory_stays_bounded_when_the_reference_is_silent():
    synchroniser = make('a', 'b', longest_wait=0.1)
    rng = np.random.default_rng(2)
    for index in range(0, 2_000_000, 1000):
        jitter = int(rng.normal(0, 1e6))
        one = block('b', 1e5, index, rng.normal(size=1000), quality=Quality(1 << rng.integers(4)))
        synchroniser.push(dataclasses.replace(one, stamp_ns=one.stamp_ns + jitter))
    held = synchroniser._streams['b']
    assert held.store.samples.size < 400_000
    assert len(held.segments) < 200


def test_an_absurd_jump_of_the_index_costs_no_memory():
    blocks = [
        block('a', 1e3, 0, np.ones(50)),
        block('a', 1e3, 10**15, np.ones(50), stamp_ns=START + 60_000_000),
        block('a', 1e3, 10**15 + 50, np.ones(50), stamp_ns=START + 110_000_000),
    ]
    synchroniser = make('a')
    out = run(synchroniser, blocks)
    assert joined(out).shape == (1, 150)
    assert out[1].first_index == 10**15
    assert Quality.GAP_BEFORE in out[1].channels[0].quality
    assert synchroniser.statistics['a'].lost_samples == 10**15 - 50


@pytest.mark.parametrize(
    'wrong',
    [
        {'channels': ()},
        {'channels': ('a', 'a')},
        {'channels': ('a',), 'reference': 'b'},
        {'channels': ('a',), 'grid_rate': -1.0},
        {'channels': ('a',), 'longest_wait': 0.0},
        {'channels': ('a',), 'clock_jump': math.nan},
    ],
)
def test_settings_out_of_range(wrong):
    with pytest.raises(ConfigurationError, match='synchroniser'):
        SynchroniserSettings(**wrong)
