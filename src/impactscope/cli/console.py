"""Where the command line writes: results to stdout, progress and errors to stderr."""

import os
import sys
import time
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

__all__ = ['Bar', 'err', 'out', 'print_nowhere']


class _Output(Console):
    """A console whose reader may go: the rest is done all the same, and the exit code is true."""

    def on_broken_pipe(self) -> None:
        """Write nowhere from now on."""
        self.quiet = True
        print_nowhere()


def print_nowhere() -> None:
    """Results go nowhere from now on: who read them has gone."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


out = _Output(highlight=False)
err = Console(stderr=True, highlight=False)


class Bar:
    """Progress on stderr, shown only where something takes longer than a moment."""

    def __init__(self, title: str) -> None:
        self._progress = Progress(
            TextColumn('{task.description}'),
            BarColumn(),
            TextColumn('{task.percentage:>3.0f}%'),
            TimeRemainingColumn(),
            console=err,
            transient=True,
            redirect_stdout=err.is_terminal,
        )
        self._task = self._progress.add_task(escape(title), total=1.0)
        self._started = time.monotonic()
        self._running = False

    def __call__(self, share: float) -> None:
        """Show the share that is done, 0 to 1."""
        if not self._running and time.monotonic() - self._started > 0.5:
            self._progress.start()
            self._running = True
        self._progress.update(self._task, completed=share)

    def describe(self, share: float, text: str) -> None:
        """Progress with a word on what is being done."""
        self._progress.update(self._task, description=escape(text))
        self(share)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._running:
            self._progress.stop()
