"""A recording as a device."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from impactscope.inputs import Item, inputs_of
from impactscope.inputs import recorded_items as items_of
from impactscope.recordings import open_recording

__all__ = ['recorded_items']


def recorded_items(path: str, written: Sequence[str] = ()) -> Iterator[Item]:
    """Blocks and test points of a recording, in order; raises as the reader does."""
    with open_recording(path) as recording:
        yield from items_of(recording, inputs_of(recording, written))
