"""A reading that cannot move faster than at some rate."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from impactscope.physics.slew_limit import behind

READINGS = arrays.arrays(np.float64, st.integers(2, 60), elements=st.floats(-1e3, 1e3))


def test_a_step_is_climbed_at_the_limit():
    read = np.r_[0.0, np.full(6, 10.0)]
    assert read + behind(read, 3.0) == pytest.approx([0.0, 3.0, 6.0, 9.0, 10.0, 10.0, 10.0])
    assert -read + behind(-read, 3.0) == pytest.approx(
        [0.0, -3.0, -6.0, -9.0, -10.0, -10.0, -10.0]
    )


@given(READINGS, st.floats(1e-3, 1e3))
def test_it_never_moves_faster_and_follows_what_is_slow(reading, most):
    followed = reading + behind(reading, most)
    assert followed[0] == reading[0]
    assert np.all(np.abs(np.diff(followed)) <= most * (1.0 + 1e-9) + 1e-9)
    slow = float(np.max(np.abs(np.diff(reading))))
    assert np.all(behind(reading, slow + 1e-9) == pytest.approx(0.0, abs=1e-9))
