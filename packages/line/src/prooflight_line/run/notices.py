"""Notices of a run that belong to no sheet.

They concern a page of the job that cannot be used, a source that has gone silent, or the run as a whole, such as
a false-alarm rate that does not hold.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from prooflight.inspection.reasons import reason_of
from prooflight.pages.check import warning_text

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable, Iterator

    from prooflight.pages.warnings import PageWarning
    from prooflight.scans.lines import LineBlock

NoticeKind = Literal[
    "page-unusable",
    "page-usable",
    "page-warning",
    "silent",
    "lines-again",
    "camera-away",
    "camera-back",
    "promise-suspended",
    "overloaded",
    "in-time",
    "gate-away",
    "gate-ready",
    "outlet-away",
    "outlet-ready",
    "resumed",
    "stopped",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Notice:
    """A message for whoever watches the run, to be shown at once."""

    kind: NoticeKind
    text: str
    """Message in one line."""


class Silence:
    """Monitor of a source's silence: one notice when it is too long, and one when it is over.

    One thread reads the source through ``heard``; another calls ``check`` now and then.
    """

    def __init__(
        self, limit_s: float, say: Callable[[Notice], None], *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._limit_s, self._say, self._clock = limit_s, say, clock
        self._guard = threading.Lock()
        self._since_s: float | None = None
        self._reported = False

    def heard(self, blocks: Iterator[LineBlock]) -> Iterator[LineBlock]:
        """Yield the same blocks; time that their consumer takes between two of them is not silence."""
        while True:
            with self._guard:
                self._since_s = self._clock()
            block = None
            try:
                block = next(blocks, None)
            finally:
                self._over(came=block is not None)
            if block is None:
                return
            yield block

    def check(self) -> None:
        """Give a notice if the silence has lasted too long."""
        with self._guard:
            since_s = self._since_s
            if self._reported or since_s is None or self._clock() - since_s < self._limit_s:
                return
            self._reported = True
            self._say(Notice(kind="silent", text=f"no line has arrived for {self._limit_s:g} s"))

    def _over(self, *, came: bool) -> None:
        with self._guard:
            since_s, self._since_s = self._since_s, None
            if self._reported and came and since_s is not None:
                lasted_s = self._clock() - since_s
                self._say(Notice(kind="lines-again", text=f"lines arrive again, after {lasted_s:.0f} s"))
            self._reported = False


class PageWarnings:
    """Warnings of pages as these are prepared, each reported once; safe for several threads."""

    def __init__(self, say: Callable[[Notice], None], reported: Iterable[PageWarning] = ()) -> None:
        """``reported``: warnings that were reported before the run."""
        self._say, self._known, self._guard = say, set(reported), threading.Lock()

    def add(self, warnings: Iterable[PageWarning]) -> None:
        """Report the warnings of a page that have not been reported yet."""
        with self._guard:
            new = [warning for warning in warnings if warning not in self._known]
            self._known.update(new)
        for warning in new:
            self._say(Notice(kind="page-warning", text=warning_text(warning)))


class Unusable:
    """Designs that could not be prepared, and why; every reason is reported once. Safe for several threads."""

    def __init__(self, say: Callable[[Notice], None]) -> None:
        self._say = say
        self._guard = threading.Lock()
        self._why: dict[Hashable, tuple[str, str]] = {}

    def __getitem__(self, design: Hashable) -> str:
        """Return why a design cannot be used; empty: no failure is recorded."""
        with self._guard:
            return self._why.get(design, ("", ""))[1]

    def add(self, design: Hashable, name: str, error: Exception) -> None:
        """Record that a design could not be prepared; name: of its page."""
        why = reason_of(error, of=f"page {name} could not be prepared")
        with self._guard:
            if self._why.get(design, ("", ""))[1] == why:
                return
            self._why[design] = name, why
        text = f"page {name} of the job cannot be used, its sheets will not be inspected: {why}"
        self._say(Notice(kind="page-unusable", text=text))

    def remove(self, design: Hashable) -> None:
        """Record that a design has been prepared after all."""
        with self._guard:
            was = self._why.pop(design, None)
        if was is not None:
            self._say(Notice(kind="page-usable", text=f"page {was[0]} of the job can be used after all"))
