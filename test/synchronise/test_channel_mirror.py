import numpy as np
import pytest

from impactscope.errors import ConfigurationError
from impactscope.records import SampleBlock
from impactscope.synchronise.mirror import ChannelMirror

START = 1_700_000_000_000_000_000


def blocks(rate, size, cut):
    samples = np.random.default_rng(4).normal(size=size).astype(np.float32)
    return samples, [
        SampleBlock('a', 'N', rate, START + round(k / rate * 1e9), k, samples[k : k + cut])
        for k in range(0, size, cut)
    ]


def mirrored(rate, size, cut, mirror_rate=500.0):
    samples, parts = blocks(rate, size, cut)
    mirror = ChannelMirror(mirror_rate)
    out = [mirror.push(b) for b in parts]
    return samples, np.concatenate([o[0] for o in out]), np.concatenate([o[1] for o in out])


@pytest.mark.parametrize('cut', [100, 333, 1024])
def test_every_peak_is_shown_at_its_own_time(cut):
    samples, times, shown = mirrored(51_200.0, 51_200, cut)
    assert shown.size <= 500
    indices = np.rint((times - START) * 51_200.0 / 1e9).astype(int)
    assert np.array_equal(samples[indices], shown)
    done = 51_200 // 205 * 205
    assert shown.max() == samples[:done].max()
    assert shown.min() == samples[:done].min()
    assert (np.diff(times) > 0).all()


def test_slow_channels_pass_as_they_are():
    samples, times, shown = mirrored(100.0, 50, 7)
    assert np.array_equal(samples, shown)
    assert np.array_equal(times, START + np.arange(50) * 10_000_000)


def test_bad_rate():
    with pytest.raises(ConfigurationError, match='0'):
        ChannelMirror(0.0)
    block = SampleBlock('a', 'N', float('nan'), START, 0, np.ones(3, dtype=np.float32))
    assert ChannelMirror().push(block)[0].size == 0
