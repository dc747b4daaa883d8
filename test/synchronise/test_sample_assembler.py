import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.errors import ConfigurationError, InputError
from impactscope.records import Quality
from impactscope.synchronise.sample_assembler import SampleAssembler
from impactscope.synchronise.synchroniser import Synchroniser, SynchroniserSettings

START = 1_700_000_000_000_000_000


def stamps(size, rate=1000.0, jitter=0.0, seed=0) -> np.ndarray:
    wobble = np.random.default_rng(seed).normal(0, jitter, size) if jitter else 0.0
    return START + np.rint((np.arange(size) / rate + wobble) * 1e9).astype(np.int64)


def values(size) -> np.ndarray:
    return np.random.default_rng(9).normal(size=size).astype(np.float32)


def assemble(assembler, times, samples):
    return [*assembler.extend(times, samples), *assembler.end()]


def same(one, other) -> bool:
    return all(
        (a.first_index, a.stamp_ns, a.quality, a.sample_rate, a.values.tobytes())
        == (b.first_index, b.stamp_ns, b.quality, b.sample_rate, b.values.tobytes())
        for a, b in zip(one, other, strict=True)
    )


@pytest.mark.parametrize('rate', [100.0, 1000.0, 4096.0, 10_000.0])
@pytest.mark.parametrize('jitter', [0.0, 0.05, 0.1])
def test_nothing_is_lost_or_invented_under_jitter(rate, jitter):
    size = int(5 * rate)
    assembler = SampleAssembler('force', 'N')
    blocks = assemble(assembler, stamps(size, rate, jitter / rate), values(size))
    assert np.concatenate([b.values for b in blocks]).tobytes() == values(size).tobytes()
    assert [b.first_index for b in blocks] == list(
        np.cumsum([0, *(b.values.size for b in blocks[:-1])])
    )
    assert blocks[0].sample_rate == rate
    assert blocks[-1].is_end
    assert assembler.statistics.lost_samples == 0
    assert not any(b.quality for b in blocks)


def test_even_stamps_come_through_to_the_nanosecond():
    blocks = assemble(SampleAssembler('force', 'N', 1000.0), stamps(1000), values(1000))
    assert [b.stamp_ns for b in blocks] == [START + b.first_index * 1_000_000 for b in blocks]
    assert {b.values.size for b in blocks[:-1]} == {20}


def test_block_stamps_are_smoother_than_the_samples():
    noisy = stamps(20_000, 1000.0, 1e-4)
    blocks = assemble(SampleAssembler('force', 'N', 1000.0), noisy, values(20_000))
    errors = np.array([b.stamp_ns - START - b.first_index * 1e6 for b in blocks[10:]])
    assert errors.std() < 0.4e5  # of 1e5 ns


def test_a_rate_that_is_no_whole_number_is_estimated():
    assembler = SampleAssembler('force', 'N')
    assemble(assembler, stamps(400, 99.3, 1e-5), values(400))
    blocks = assemble(assembler, stamps(400, 99.3, 1e-5), values(400))
    assert blocks[0].sample_rate == pytest.approx(99.3, rel=1e-4)
    assert blocks[0].epoch == 1


@pytest.mark.parametrize('lost', [1, 2, 7, 500])
def test_a_gap_of_the_stamps_is_a_jump_of_the_index(lost):
    keep = np.r_[0:430, 430 + lost : 1500]
    assembler = SampleAssembler('force', 'N')
    blocks = assemble(assembler, stamps(1500, 1000.0, 5e-5)[keep], values(1500)[keep])
    for block in blocks:
        part = slice(block.first_index, block.first_index + block.values.size)
        assert block.values.tobytes() == values(1500)[part].tobytes()
    assert [b.first_index for b in blocks if b.quality == Quality.GAP_BEFORE] == [430 + lost]
    assert assembler.statistics.lost_samples == lost


def test_duplicates_backward_and_zero_stamps_are_dropped_and_counted():
    times, samples = stamps(300).tolist(), values(300).tolist()
    times[100:100] = [times[99], 0, times[95]]
    samples[100:100] = [9.0, 9.0, 9.0]
    assembler = SampleAssembler('force', 'N')
    blocks = assemble(assembler, times, samples)
    assert np.concatenate([b.values for b in blocks]).tobytes() == values(300).tobytes()
    s = assembler.statistics
    assert (s.duplicates, s.unstamped, s.backwards, s.lost_samples) == (1, 1, 1, 0)


def test_a_clock_set_back_is_flagged_and_samples_go_on():
    times = stamps(600)
    times[300:] -= 5_000_000_000
    assembler = SampleAssembler('force', 'N')
    blocks = assemble(assembler, times, values(600))
    assert np.concatenate([b.values for b in blocks]).tobytes() == values(600).tobytes()
    assert [b.first_index for b in blocks if b.quality == Quality.CLOCK_JUMP] == [300]
    assert assembler.statistics.clock_jumps == 1


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.integers(0, 700), max_size=8),
    st.sampled_from([0.0, 1000.0]),
    st.integers(0, 5),
)
def test_handing_over_in_other_pieces_changes_nothing(cuts, rate, seed):
    rng = np.random.default_rng(seed)
    keep = np.sort(rng.choice(800, 700, replace=False))
    times, samples = stamps(800, 1000.0, 5e-5, seed)[keep], values(800)[keep]
    times[rng.integers(700, size=5)] = 0
    whole = assemble(SampleAssembler('f', 'N', rate), times, samples)
    assembler = SampleAssembler('f', 'N', rate)
    pieces = []
    edges = sorted({0, *cuts, 700})
    for number, (a, b) in enumerate(itertools.pairwise(edges)):
        if number % 2:
            pieces += assembler.extend(times[a:b], samples[a:b])
        else:
            for stamp, value in zip(times[a:b].tolist(), samples[a:b].tolist(), strict=True):
                pieces += assembler.push(stamp, value)
    assert same(whole, pieces + assembler.end())


def test_single_samples_come_out_with_the_sample_that_completes_the_block():
    assembler = SampleAssembler('f', 'N', 1000.0)
    sizes = [len(assembler.push(s, 1.0)) for s in stamps(100).tolist()]
    assert sizes == ([0] * 19 + [1]) * 5


def test_odd_values_are_flagged():
    samples = values(100)
    samples[[5, 25]] = [np.nan, 50.0]
    blocks = assemble(SampleAssembler('f', 'N', 1e3, range_max=50.0), stamps(100), samples)
    assert [b.quality for b in blocks[:3]] == [Quality.NOT_FINITE, Quality.CLIPPED, Quality.NONE]
    only = assemble(SampleAssembler('f', 'N', 1e3), stamps(3), [np.nan, np.nan, 1e300])
    assert only[0].quality == Quality.NOT_FINITE


def test_streams_too_short_to_tell_their_rate():
    assembler = SampleAssembler('f', 'N')
    assert assemble(assembler, stamps(1), [1.0]) == []
    assert assembler.statistics.unplaced == 1
    blocks = assemble(SampleAssembler('f', 'N'), stamps(2), [1.0, 2.0])
    assert blocks[0].sample_rate == 1000.0
    assert assemble(SampleAssembler('f', 'N'), [], []) == []


def test_stamps_that_never_tell_the_rate_cost_no_memory():
    assembler = SampleAssembler('f', 'N')
    for _ in range(200):
        assert assembler.extend(np.full(1000, START), np.ones(1000)) == []
    assert assembler._held[0].size < 20_000


def test_blocks_go_through_the_synchroniser_untouched():
    assembler = SampleAssembler('f', 'N')
    synchroniser = Synchroniser(SynchroniserSettings(('f',)))
    blocks = assemble(assembler, stamps(2000, 1000.0, 5e-5), values(2000))
    out = [o for b in blocks for o in synchroniser.push(b)]
    assert np.concatenate([o.values for o in out], axis=1)[0].tobytes() == values(2000).tobytes()
    assert out[-1].is_end


def test_bad_arguments():
    with pytest.raises(ConfigurationError, match='rate is -1'):
        SampleAssembler('f', 'N', -1.0)
    with pytest.raises(ConfigurationError, match='block_duration is 0'):
        SampleAssembler('f', 'N', 1.0, 0.0)
    with pytest.raises(InputError, match=r'\(2,\) and values \(3,\)'):
        SampleAssembler('f', 'N').extend([1, 2], [1.0, 2.0, 3.0])
