"""The contract of a stage: samples in, results out, streaming, without ROS."""

from __future__ import annotations

from typing import Protocol, TypeVar

In = TypeVar('In', contravariant=True)
Out = TypeVar('Out')


class Stage(Protocol[In, Out]):
    """A streaming step of the analysis.

    What comes out depends on the records pushed and their order alone: not on wall-clock time
    and not on how a stream was cut into blocks. So a replayed bag and a live graph agree.
    """

    def push(self, record: In) -> list[Out]:
        """Take one record; return the results that are complete with it, in order."""

    def flush(self) -> list[Out]:
        """The stream has ended: return what is still open, marked as such, and start afresh."""
