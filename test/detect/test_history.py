from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from impactscope.detect.history import History
from impactscope.records import Quality


@given(st.lists(st.tuples(st.integers(1, 3000), st.integers(0, 5000)), max_size=60))
def test_what_was_kept_can_be_read_back(steps):
    history = History(2, 1000.0, 7)
    stream = np.empty((2, 0), dtype=np.float32)
    for n, back in steps:
        part = np.arange(stream.shape[1], stream.shape[1] + n, dtype=np.float32)
        part = np.stack([part, -part])
        stream = np.concatenate([stream, part], axis=1)
        history.append(part, (Quality.NONE, Quality.NONE))
        assert history.stop == 7 + stream.shape[1]
        assert np.array_equal(
            history.view(history.kept, history.stop), stream[:, history.kept - 7 :]
        )
        history.drop_before(history.stop - back)
        assert history.kept >= history.stop - back


def test_flags_are_those_of_the_blocks_that_overlap():
    history = History(1, 1000.0, 0)
    for flags in (Quality.CLIPPED, Quality.NONE, Quality.STALLED):
        history.append(np.zeros((1, 10), np.float32), (flags,))
    assert history.flags(0, 5) == (Quality.CLIPPED,)
    assert history.flags(10, 20) == (Quality.NONE,)
    assert history.flags(9, 21) == (Quality.CLIPPED | Quality.STALLED,)


def test_time_follows_the_anchors():
    history = History(1, 1000.0, 0)
    history.anchor(0, 5_000_000)
    history.anchor(100, 205_000_000)
    assert history.stamp(50) == 55_000_000
    assert history.stamp(100) == 205_000_000
    assert history.stamp(101) == 206_000_000
