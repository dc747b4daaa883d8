"""When a sample of the past is due again."""

from __future__ import annotations

import threading
import time

from impactscope.records import NANOSECONDS

__all__ = ['Pace']


class Pace:
    """Maps data time to wall-clock time, or holds back by what consumers have taken.

    With ``rate`` above zero, data time runs ``rate`` times as fast as the wall clock, from
    ``data_start_ns`` at wall time ``wall_start_ns`` (Unix time; so several drivers, also in
    several processes, keep step). With ``rate`` zero there is no clock: from the wall start on,
    data goes out as long as it is at most ``lead`` s ahead of the progress that a consumer
    reported. That must be less than what the consumer waits for a channel that lags. If nobody
    reports for ``patience`` s, it goes on: a replay that nobody listens to still ends.
    """

    def __init__(
        self,
        data_start_ns: int,
        *,
        rate: float = 1.0,
        wall_start_ns: int = 0,
        lead: float = 1.5,
        patience: float = 10.0,
    ) -> None:
        self._data_start_ns = data_start_ns
        self._rate = rate
        self._wall_start_ns = wall_start_ns or time.time_ns()
        self._lead_ns = round(lead * NANOSECONDS)
        self._patience = patience
        self._progress_ns = data_start_ns
        self._changed = threading.Condition()
        self.unheard = False  # whether data went on without a consumer's progress

    def progress(self, data_ns: int) -> None:
        """A consumer has taken everything up to this data time."""
        with self._changed:
            self._progress_ns = max(self._progress_ns, data_ns)
            self.unheard = False
            self._changed.notify_all()

    def wait(self, data_ns: int, timeout: float) -> bool:
        """Wait until this data time is due, at most ``timeout`` s; whether it is due."""
        if self._rate > 0:
            due_ns = self._wall_start_ns + (data_ns - self._data_start_ns) / self._rate
            remaining = (due_ns - time.time_ns()) / NANOSECONDS
            if remaining > timeout:
                time.sleep(timeout)
                return False
            if remaining > 0:
                time.sleep(remaining)
            return True
        if not self._started:
            early = (self._wall_start_ns - time.time_ns()) / NANOSECONDS
            if early > timeout:
                time.sleep(timeout)
                return False
            time.sleep(max(early, 0.0))
            self._started = True
        with self._changed:
            if self.unheard or data_ns <= self._progress_ns + self._lead_ns:
                return True
            before = self._progress_ns
            if self._changed.wait_for(
                lambda: data_ns <= self._progress_ns + self._lead_ns, timeout
            ):
                return True
            self._waited = timeout if self._progress_ns != before else self._waited + timeout
            self.unheard = self._waited >= self._patience
            return self.unheard

    _waited = 0.0
    _started = False
