"""Fewer, longer blocks of the grid for whoever has fallen behind."""

from __future__ import annotations

import dataclasses

import numpy as np

from impactscope.records import NANOSECONDS, SyncedBlock
from impactscope.synchronise.synchroniser import LARGEST_BLOCK

__all__ = ['BlockJoiner']

ROUNDING_NS = 1  # stamps are whole nanoseconds


class BlockJoiner:
    """Holds blocks back and joins those that continue each other, up to ``longest`` s of data.

    Blocks are joined only where whoever takes them cannot tell: the same channels with the same
    flags, no sample missing between them, and a stamp that continues the stamps before. An end
    marker is never held back, nor is what came before it.
    """

    def __init__(self, longest: float = 0.1) -> None:
        self._longest = longest
        self._held: list[SyncedBlock] = []
        self._samples = 0  # of the grid, held

    def push(self, block: SyncedBlock) -> list[SyncedBlock]:
        """Take a block; return what can no longer grow, in order."""
        complete: list[SyncedBlock] = []
        if self._held and not self._continues(block):
            complete = self.flush()
        if block.is_end:
            return [*complete, block]
        self._held.append(block)
        self._samples += block.values.shape[1]
        if self._samples >= self._longest * block.sample_rate:
            complete += self.flush()
        return complete

    def flush(self) -> list[SyncedBlock]:
        """What is held, as one block; nothing where nothing is."""
        held, self._held, self._samples = self._held, [], 0
        if len(held) < 2:
            return held
        values = np.concatenate([block.values for block in held], axis=1)
        return [dataclasses.replace(held[0], values=values)]

    def _continues(self, block: SyncedBlock) -> bool:
        first = self._held[0]
        passed_ns = self._samples * NANOSECONDS / first.sample_rate
        return (
            not block.is_end
            and block.first_index == first.first_index + self._samples
            and block.epoch == first.epoch
            and block.sample_rate == first.sample_rate
            and block.oversampling == first.oversampling
            and block.channels == first.channels
            and abs(block.stamp_ns - first.stamp_ns - passed_ns) <= ROUNDING_NS
            and 4 * (self._samples * len(block.channels) + block.values.size) <= LARGEST_BLOCK
        )
