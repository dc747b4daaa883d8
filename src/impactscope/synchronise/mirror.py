"""What of a channel is shown in plotting tools: few values, every peak among them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impactscope.errors import ConfigurationError
from impactscope.records import NANOSECONDS, SampleBlock
from impactscope.signals.decimate import PeakDecimator

__all__ = ['ChannelMirror']


class ChannelMirror:
    """Smallest and largest sample of each stretch of one channel, with their times.

    Args:
        rate: Hz, the most values that come out; channels slower than that pass as they are.

    Raises:
        ConfigurationError: the rate is not above zero.
    """

    def __init__(self, rate: float = 500.0) -> None:
        if not (math.isfinite(rate) and rate > 0):
            raise ConfigurationError(f'mirror rate is {rate} Hz; it must be above zero')
        self._rate = rate
        self._stream: tuple[int, float] | None = None
        self._decimator = PeakDecimator(1)

    def push(self, block: SampleBlock) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Take a block; return times in ns and values, each of shape (n_values,), in order.

        Times are those of the samples themselves, by the block's stamp and rate; a value from
        the block before lies at its distance before the stamp.
        """
        rate = block.sample_rate
        if not (math.isfinite(rate) and rate > 0):
            return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.float32)
        if self._stream != (block.epoch, rate):
            self._stream = (block.epoch, rate)
            bucket = 1 if rate <= self._rate else math.ceil(2 * rate / self._rate)
            self._decimator = PeakDecimator(bucket)
        indices, values = self._decimator.push(block.first_index, block.values)
        ahead = (indices - block.first_index) * (NANOSECONDS / rate)
        return block.stamp_ns + np.rint(ahead).astype(np.int64), values
