import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impactscope.errors import InputError
from impactscope.signals.resample import HALF_TAPS, SINC_TABLE, interpolate, resample_line


def sine(frequency: float, positions: np.ndarray, phase: float = 0.3) -> np.ndarray:
    return np.sin(2 * np.pi * frequency * positions + phase)


@pytest.mark.parametrize('frequency', [0.0, 0.01, 0.1, 0.2, 0.3, 0.38])
def test_error_of_a_sine_stays_below_the_stated_bound(frequency):
    samples = sine(frequency, np.arange(4000)).astype(np.float32)
    positions = np.random.default_rng(3).uniform(HALF_TAPS, 4000 - HALF_TAPS - 1, 20_000)
    error = interpolate(samples, positions) - sine(frequency, positions)
    assert np.abs(error).max() < 5e-5


def test_a_frequency_near_nyquist_is_not_claimed_to_be_exact():
    samples = sine(0.49, np.arange(4000)).astype(np.float32)
    positions = np.arange(100.5, 3900)
    assert np.abs(interpolate(samples, positions) - sine(0.49, positions)).max() > 0.01


@settings(deadline=None)
@given(st.lists(st.floats(-1e6, 1e6, width=32), min_size=1, max_size=80))
def test_whole_positions_give_the_samples_bit_for_bit(values):
    samples = np.array(values, dtype=np.float32)
    result = interpolate(samples, np.arange(samples.size, dtype=float))
    assert result.tobytes() == samples.tobytes()


def test_a_constant_stays_constant_also_at_the_edges():
    samples = np.full(50, 7.25, dtype=np.float32)
    result = interpolate(samples, np.linspace(0, 49, 997))
    assert np.allclose(result, 7.25, rtol=1e-6, atol=0)


def test_nan_in_the_taps_is_nan_and_reaches_no_further():
    samples = np.ones(200, dtype=np.float32)
    samples[100] = np.nan
    positions = np.arange(199) + 0.5
    missing = np.isnan(interpolate(samples, positions))
    expected = np.abs(positions - 100) < HALF_TAPS
    assert np.array_equal(missing, expected)
    assert np.isnan(interpolate(samples, np.arange(200.0))).sum() == 1


def test_outside_is_nan_and_order_does_not_matter():
    samples = np.arange(40, dtype=np.float32)
    positions = np.array([39.0, -0.01, 20.0, 39.01, 0.0, 1e300, -1e300])
    result = interpolate(samples, positions)
    assert result[[0, 2, 4]].tolist() == [39.0, 20.0, 0.0]
    assert np.isnan(result[[1, 3, 5, 6]]).all()


@pytest.mark.parametrize('size', [1, 2, 5, 31, 32, 33])
def test_short_sequences_use_the_taps_there_are(size):
    samples = np.linspace(0, 1, size, dtype=np.float32)
    result = interpolate(samples, np.linspace(0, size - 1, 50))
    assert np.isfinite(result).all()
    assert result.min() >= -0.2
    assert result.max() <= 1.2


def test_bad_input_is_refused_with_the_offending_value():
    with pytest.raises(InputError, match=r'\(2, 2\)'):
        interpolate(np.ones((2, 2), dtype=np.float32), np.zeros(1))
    with pytest.raises(InputError, match='nan'):
        interpolate(np.ones(4, dtype=np.float32), np.array([1.0, np.nan]))


@settings(max_examples=60, deadline=None)
@given(
    origin=st.floats(-5, 60),
    step=st.sampled_from([1.0, 0.5, 1 / 3, 0.99995, 1.00005, 0.039]),
    cut=st.integers(1, 199),
)
def test_a_line_cut_anywhere_gives_the_same_bits(origin, step, cut):
    samples = np.random.default_rng(5).normal(size=300).astype(np.float32)
    whole = np.empty(200, dtype=np.float32)
    pieces = np.empty(200, dtype=np.float32)
    resample_line(samples, 3, 290, 7, origin, step, 11, 1e-6, SINC_TABLE, whole)
    for begin, end in ((0, cut), (cut, 200)):
        part = pieces[begin:end]
        resample_line(samples, 3, 290, 7, origin, step, 11 + begin, 1e-6, SINC_TABLE, part)
    assert whole.tobytes() == pieces.tobytes()


@pytest.mark.parametrize('step', [1.0, 0.5, 0.999])
def test_a_line_agrees_with_interpolation_at_its_positions(step):
    samples = np.random.default_rng(6).normal(size=400).astype(np.float32)
    out = np.empty(300, dtype=np.float32)
    resample_line(samples, 0, 400, 0, 20.37, step, 0, 1e-9, SINC_TABLE, out)
    expected = interpolate(samples, 20.37 + np.arange(300) * step)
    assert np.allclose(out, expected, atol=1e-6)


def test_positions_within_the_snap_are_copied():
    samples = np.random.default_rng(7).normal(size=100).astype(np.float32)
    out = np.empty(40, dtype=np.float32)
    resample_line(samples, 0, 100, 0, 30.0 + 4e-6, 1.0, 0, 1e-5, SINC_TABLE, out)
    assert out.tobytes() == samples[30:70].tobytes()
    resample_line(samples, 0, 100, 0, 30.0 + 4e-6, 1.0, 0, 1e-6, SINC_TABLE, out)
    assert out.tobytes() != samples[30:70].tobytes()
