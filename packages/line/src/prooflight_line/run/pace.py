"""Detection of overload: inspection that does not keep pace is an alarm of the run, not of single sheets."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from prooflight_line.run.notices import Notice

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight_line.journal.records import PageRecord

NO_ROOM: Final = "too many sheets were waiting for inspection"
TOO_LATE: Final = "the verdict would have been late"
NOT_READY: Final = "the page was not prepared in time"
EARLIER: Final = (
    "too many sheets waited",
    "its verdict would have come too late",
    "its design was not ready in time",
)
"""The same reasons in journals of earlier versions."""
OUT_OF_TIME: Final = frozenset({NO_ROOM, TOO_LATE, NOT_READY, *EARLIER})
"""Reasons of sheets that were not inspected because inspection did not keep pace."""
RECENT: Final = 100
"""Number of recent sheets that decide about overload."""
ALARM_FROM: Final = 5
"""Number of the recent sheets out of time that raises the alarm. assumed: one burst of another process costs
three or four."""
REMEDY: Final = (
    "run the press slower; where designs were not ready, prepare the job with `prooflight job prepare`"
)


def out_of_time(record: PageRecord) -> bool:
    """Return whether a sheet was not inspected because inspection did not keep pace."""
    return record.verdict.verdict == "not-inspected" and record.verdict.reason in OUT_OF_TIME


def overload(records: Iterable[PageRecord]) -> tuple[int, int] | None:
    """Return how many of the recent sheets were out of time, and of how many; None: inspection keeps pace."""
    late = [out_of_time(record) for record in records][-RECENT:]
    return (sum(late), len(late)) if sum(late) >= ALARM_FROM else None


def overload_text(late: int, recent: int) -> str:
    """Return the alarm in words.

    >>> overload_text(89, 100)
    'inspection cannot keep up: 89 of the last 100 sheets not inspected'
    """
    return f"inspection cannot keep up: {late} of the last {recent} sheets not inspected"


@dataclass(slots=True)
class Pace:
    """Overload detector of a run, updated sheet by sheet."""

    overloaded: bool = False
    _recent: deque[bool] = field(default_factory=lambda: deque(maxlen=RECENT))

    def add(self, record: PageRecord) -> Notice | None:
        """Add the next sheet; return a notice if the alarm begins or ends with it."""
        self._recent.append(out_of_time(record))
        late, was = sum(self._recent), self.overloaded
        # Hysteresis: the alarm ends when none is left, so that it does not flicker around the threshold.
        self.overloaded = late >= ALARM_FROM or (was and late > 0)
        if self.overloaded and not was:
            text = f"{overload_text(late, len(self._recent))}; {REMEDY}"
            return Notice(kind="overloaded", text=text)
        if was and not self.overloaded:
            text = f"inspection keeps up again: all of the last {len(self._recent)} sheets were inspected in time"
            return Notice(kind="in-time", text=text)
        return None
