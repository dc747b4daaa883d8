import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.errors import ConfigurationError, InputError
from impactscope.signals.decimate import PeakDecimator


def decimate(values, bucket, cuts=(), first=0):
    decimator = PeakDecimator(bucket)
    edges = [0, *sorted(cuts), len(values)]
    parts = [
        decimator.push(first + a, np.array(values[a:b], dtype=np.float32))
        for a, b in itertools.pairwise(edges)
    ]
    parts.append(decimator.flush())
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


numbers = st.lists(st.floats(-100, 100, width=32) | st.just(float('nan')), max_size=60)


@settings(deadline=None)
@given(numbers, st.integers(1, 9), st.lists(st.integers(0, 60), max_size=4), st.integers(0, 20))
def test_cutting_does_not_matter(values, bucket, cuts, first):
    cuts = [min(c, len(values)) for c in cuts]
    whole, parts = decimate(values, bucket, first=first), decimate(values, bucket, cuts, first)
    assert np.array_equal(whole[0], parts[0])
    assert np.array_equal(whole[1], parts[1], equal_nan=True)


@settings(deadline=None)
@given(numbers, st.integers(1, 9))
def test_every_bucket_keeps_its_extremes_in_order_of_time(values, bucket):
    array = np.array(values, dtype=np.float32)
    indices, kept = decimate(values, bucket)
    assert (np.diff(indices) > 0).all()
    assert np.array_equal(array[indices], kept, equal_nan=True)
    for begin in range(0, array.size, bucket):
        part = array[begin : begin + bucket]
        mine = kept[(indices >= begin) & (indices < begin + bucket)]
        assert 1 <= mine.size <= 2
        if np.isnan(part).all():
            assert np.isnan(mine).all()
        else:
            assert mine.min() == np.nanmin(part)
            assert mine.max() == np.nanmax(part)


def test_a_jump_of_the_index_closes_the_open_bucket():
    decimator = PeakDecimator(4)
    assert decimator.push(0, np.array([1, 5], dtype=np.float32))[0].size == 0
    indices, kept = decimator.push(100, np.array([2, 3, 1, 0], dtype=np.float32))
    assert indices.tolist() == [0, 1, 101, 103]
    assert kept.tolist() == [1.0, 5.0, 3.0, 0.0]


def test_bad_input():
    with pytest.raises(ConfigurationError, match='0'):
        PeakDecimator(0)
    with pytest.raises(InputError, match=r'\(1, 2\)'):
        PeakDecimator(2).push(0, np.ones((1, 2), dtype=np.float32))
