"""Recordings made on the spot: blocks with known values, and files of every layout."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from impactscope.recordings import RecordingWriter
from impactscope.records import Quality, SampleBlock

START_NS = 1_700_000_000_000_000_000


def make_block(
    channel: str = 'force', index: int = 0, count: int = 64, rate: float = 6400.0
) -> SampleBlock:
    """Block number ``index`` of a channel; sample k of the stream has the value k."""
    first = index * count
    stamp_ns = START_NS + round(first * 1e9 / rate)
    return SampleBlock(
        channel=channel,
        unit='N' if channel.startswith('force') else 'm/s^2',
        sample_rate=rate,
        stamp_ns=stamp_ns,
        first_index=first,
        values=np.arange(first, first + count, dtype=np.float32),
        epoch=1,
        device_time_ns=stamp_ns - START_NS,
        received_ns=stamp_ns + round(count * 1e9 / rate),
        quality=Quality.NONE,
        range_min=-1e9,
        range_max=1e9,
        frame_id='plate',
    )


def same_block(a: SampleBlock, b: SampleBlock) -> bool:
    """Equal in every field, NaN equal to NaN."""
    for name in SampleBlock.__dataclass_fields__:
        x, y = getattr(a, name), getattr(b, name)
        if not np.array_equal(
            np.asarray(x),
            np.asarray(y),
            equal_nan=name in {'values', 'range_min', 'range_max', 'sample_rate'},
        ):
            return False
    return True


def stamped_cdr(stamp_ns: int, doubles: list[float], frame: str = 'plate') -> bytes:
    """A header and doubles, little endian."""
    second, nanosecond = divmod(stamp_ns, 1_000_000_000)
    name = frame.encode() + b'\0'
    body = struct.pack('<iII', second, nanosecond, len(name)) + name
    body += b'\0' * (-len(body) % 8)
    return b'\0\1\0\0' + body + struct.pack(f'<{len(doubles)}d', *doubles)


class Bench:
    """The helpers of this file, as one fixture."""

    start_ns = START_NS
    block = staticmethod(make_block)
    same = staticmethod(same_block)
    stamped = staticmethod(stamped_cdr)

    @staticmethod
    def blocks(count: int, channels: tuple[str, ...] = ('force', 'acceleration.plate')):
        return [make_block(c, i) for i in range(count) for c in channels]

    @staticmethod
    def write(path: Path, blocks: list[SampleBlock], **options) -> Path:
        options.setdefault('flush_interval', 0)
        with RecordingWriter(path, **options) as writer:
            for block in blocks:
                writer.write_block(block)
        return path


@pytest.fixture(scope='session')
def bench() -> type[Bench]:
    return Bench
