"""Pacing of lines that do not come from a camera: at a steady rate, or as fast as they are taken."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from prooflight.errors import RequestError


class Pacer:
    """Delays lines until a camera would have read them.

    A slow reader gets lines late, but with the time at which they were read, as from a camera with a large
    buffer; or the lines wait for it.
    """

    def __init__(
        self,
        line_rate_hz: float | None,
        *,
        waits: bool = False,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] | None = None,
    ) -> None:
        """Set the rate.

        line_rate_hz: None: as fast as lines are taken. waits: whether no line is read before it is asked for, so that
        the time that a slow reader takes is lost, and not made up for. sleep: by default until ``stop``.
        RequestError: a rate that is not above 0.
        """
        if line_rate_hz is not None and not line_rate_hz > 0:
            raise RequestError("source", f"a rate of {line_rate_hz} lines/s", remedy="give a rate above 0")
        self._stopped = threading.Event()
        self._rate_hz, self._clock, self._sleep = line_rate_hz, clock, sleep or self._stopped.wait
        self._waits = waits
        self._begun_s: float | None = None
        self._lines = 0

    def read(self, lines: int) -> float:
        """Wait until so many more lines are read; return the time at which the last of them was. [s]"""
        if self._begun_s is None:
            self._begun_s = self._clock()
        self._lines += lines
        if self._rate_hz is None:
            return self._clock()
        due_s = self._begun_s + self._lines / self._rate_hz
        left_s = due_s - self._clock()
        if left_s > 0:
            self._sleep(left_s)
        elif self._waits:
            self._begun_s -= left_s
            due_s -= left_s
        return due_s

    def stop(self) -> None:
        """End all waiting, now and later."""
        self._stopped.set()
