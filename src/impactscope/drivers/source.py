"""The contract of a device driver."""

from __future__ import annotations

from typing import Protocol

from impactscope.errors import ImpactscopeError
from impactscope.records import SampleBlock

__all__ = ['Source', 'SourceError']


class SourceError(ImpactscopeError):
    """The device is gone or says nonsense; closing and opening it again may help."""


class Source(Protocol):
    """A device that delivers blocks of samples of one or more channels.

    Called from one acquisition thread: ``open``, then ``read`` again and again, then ``close``.
    """

    def open(self, epoch: int) -> None:
        """Start acquiring; blocks carry this epoch. Raises SourceError."""

    def read(self, timeout: float) -> list[SampleBlock]:
        """Wait at most ``timeout`` s for the next blocks; empty: nothing came in that time.

        Raises SourceError when the device has died. A block without values ends its channel.
        """

    def close(self) -> None:
        """Stop acquiring; may be called in any state, also twice."""
