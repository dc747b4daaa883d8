"""Faults to order, on top of any source: what a real device does on a bad day.

For rehearsing a bench and for tests. Written as ``kind@time[:duration]`` in seconds of data time
since the device was opened: ``stall@2:0.5`` (delivers late), ``drop@2:0.1`` (samples are lost),
``jump@2:0.3`` (the device clock leaps), ``die@2`` (the device is gone), ``nan@2:0.01`` (values
are not finite).
"""

from __future__ import annotations

import dataclasses
import re
import time
from collections.abc import Iterable

import numpy as np

from impactscope.drivers.source import Source, SourceError
from impactscope.errors import ConfigurationError
from impactscope.records import NANOSECONDS, SampleBlock

__all__ = ['Fault', 'FaultySource', 'parse_faults']

_KINDS = ('stall', 'drop', 'jump', 'die', 'nan')


@dataclasses.dataclass(frozen=True, slots=True)
class Fault:
    """One fault: what, when, how long (s)."""

    kind: str
    at: float
    duration: float = 0.0


def parse_faults(texts: Iterable[str]) -> tuple[Fault, ...]:
    """Faults from their written form; raises ConfigurationError for one that cannot be read."""
    faults = []
    for text in texts:
        match = re.fullmatch(r'(\w+)@([\d.]+)(?::([\d.]+))?', text.strip())
        if match is None or match[1] not in _KINDS:
            raise ConfigurationError(
                f'fault {text!r}; written as kind@seconds[:duration], '
                f'kinds are {", ".join(_KINDS)}'
            )
        faults.append(Fault(match[1], float(match[2]), float(match[3] or 0.0)))
    return tuple(faults)


class FaultySource:
    """A source that behaves badly at the times ordered; each fault happens once."""

    def __init__(self, source: Source, faults: Iterable[Fault]) -> None:
        self._source = source
        self._waiting = sorted(faults, key=lambda fault: fault.at)
        self._start_ns: int | None = None
        self._device_shift_ns = 0

    def __getattr__(self, name: str) -> object:
        return getattr(self._source, name)

    def open(self, epoch: int) -> None:
        """Open the device."""
        self._start_ns = None
        self._source.open(epoch)

    def close(self) -> None:
        """Close the device."""
        self._source.close()

    def read(self, timeout: float) -> list[SampleBlock]:
        """Blocks, with what is due to go wrong."""
        blocks = []
        for block in self._source.read(timeout):
            changed = self._apply(block)
            if changed is not None:
                blocks.append(changed)
        return blocks

    def _apply(self, block: SampleBlock) -> SampleBlock | None:
        if block.is_end:
            return block
        if self._start_ns is None:
            self._start_ns = block.stamp_ns
        now = (block.stamp_ns - self._start_ns) / NANOSECONDS
        for fault in list(self._waiting):
            if now < fault.at:
                continue
            if fault.kind in {'drop', 'nan'} and now < fault.at + fault.duration:
                if fault.kind == 'drop':
                    return None
                values = np.full_like(block.values, np.nan)
                return dataclasses.replace(block, values=values)
            self._waiting.remove(fault)
            if fault.kind == 'die':
                raise SourceError(f'the device died at {now:.3f} s, as ordered')
            if fault.kind == 'stall':
                time.sleep(fault.duration)
                block = dataclasses.replace(block, received_ns=time.time_ns())
            elif fault.kind == 'jump':
                self._device_shift_ns += round(fault.duration * NANOSECONDS)
        if self._device_shift_ns and block.device_time_ns >= 0:
            return dataclasses.replace(
                block, device_time_ns=block.device_time_ns + self._device_shift_ns
            )
        return block
