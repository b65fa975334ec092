"""Incidents: sheets that alarm for the same cause are one incident, be they one sheet or four hundred.

An alarm is a sheet that is no good one without more: a misprint, one that was not inspected, a page that did not come,
one of which the camera lost lines, one whose verdict was late. Every alarm belongs to exactly one incident, that of its
cause: its kind and its place. What counts as the place is by kind: of a streak the column, of what changes the print as
a whole the sheet, of all else the box in millimetres. Other places of the same sheet keep their incidents open.

An incident ends when ``ENDS_AFTER`` sheets that were looked at have passed without it. It is the same one again where
it comes back within ``RETURNS_WITHIN`` sheets, and is then given twice as long as it paused: one page of a job of a
hundred that is wrong each time is one incident, and so is a fault of every fortieth sheet.

Nothing but records is asked, as they come from the run or from its journal; those of good sheets may be left out.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from prooflight.detectors.disposition import gravest
from prooflight.inspection.common_cause import COLUMN_KINDS, NEAR_MM, SHEET_KINDS
from prooflight.line.monitor.forecast import LEAST_PAGES, SLOPE_SDS
from prooflight.line.places import around, gap_mm, in_words
from prooflight.scans.lines import CAMERA_AWAY

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight.detectors.disposition import Disposition
    from prooflight.detectors.verdict import Region
    from prooflight.journal.records import PageRecord
    from prooflight.line.places import Box

Scope = Literal["place", "column", "sheet", "run"]
"""What of a cause says where it is: a box, a column of the web, the sheet as a whole, or nothing on the sheet."""
Direction = Literal["grows", "steady", "shrinks", "unknown"]
What = Literal["opened", "grew", "ended", "returned"]

ENDS_AFTER: Final = 20
"""Sheets without it. assumed: four seconds at 5 sheets a second, longer than a person takes to look at the tray."""
RETURNS_WITHIN: Final = 1000
"""Sheets after its end. assumed: longer than most jobs of several pages, so that each copy meets the last one's."""
FIRST_SHEETS, LAST_SHEETS = 16, 48
"""Of an incident's sheets whose numbers are kept."""
MOST_PAGES: Final = 64
"""Pages of the job that are named."""
LEAST_GROWTH: Final = 0.05
"""Of the mean, over all sheets so far: less is not worth a word. assumed."""
MISSING, LOST_LINES, CAMERA_GONE, NOT_INSPECTED, LATE = (
    *("missing-page", "lost-lines", "camera-gone", "not-inspected", "late"),
)
NO_MISPRINT: Final = frozenset({MISSING, LOST_LINES, CAMERA_GONE, NOT_INSPECTED, LATE})
"""Kinds of incidents in which nothing wrong was seen on a sheet: no label says what these sheets were."""
UNKNOWN: Final = "unknown"
_NUMBERS = re.compile(r"[-+]?\d+(?:[.,:]\d+)*")


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """How a number of an incident goes, by a straight line through its sheets."""

    now: float
    """At the last sheet, on that line."""
    a_sheet: float
    direction: Direction


@dataclass(frozen=True, slots=True, kw_only=True)
class Incident:
    """Alarms of one cause, as far as they have come."""

    number: int
    """In the run, from 1."""
    kind: str
    """Of the misprint, or missing-page, lost-lines, camera-gone, not-inspected, late."""
    scope: Scope
    where: str
    """In words; empty: nowhere on the sheet."""
    box_mm: Box | None
    """Around all its places: x, y, width and height; None: it has none."""
    first_sheet: int
    last_sheet: int
    reopened_sheet: int
    """The sheet with which it last opened or came back."""
    count: int
    """Sheets."""
    sheets: tuple[int, ...]
    """Numbers of the first ``FIRST_SHEETS`` and the last ``LAST_SHEETS``."""
    pages: tuple[str, ...]
    """Of the job, in the order they were met, ``MOST_PAGES`` at most."""
    since_s: float
    """When its first sheet came, by the source's clock. [s]"""
    last_s: float
    score: Trend | None
    """Of the place, in standard deviations; None: it has no score."""
    size_mm2: Trend | None
    """Of the box; None: it has none."""
    disposition: Disposition
    """The gravest of its sheets."""
    reason: str
    """Of its last sheet, in one line."""
    returned: int
    """How often it came again after it had ended."""
    ended_with: int | None
    """The sheet with which it ended; None: it is open."""

    @property
    def open(self) -> bool:
        """Whether it goes on."""
        return self.ended_with is None

    @property
    def by_costs(self) -> bool:
        """Whether its misprints are accepted, by the costs of the press file."""
        return self.disposition == "accept" and self.kind not in NO_MISPRINT


@dataclass(frozen=True, slots=True, kw_only=True)
class IncidentChange:
    """What happened to an incident, and what it is now."""

    what: What
    incident: Incident


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """Why a sheet alarms."""

    kind: str
    scope: Scope
    key: str = ""
    """What else must be alike: of a sheet that was not inspected its reason, numbers left out."""
    box_mm: Box | None = None
    score: float | None = None

    @property
    def group(self) -> tuple[str, Scope, str]:
        """Causes of different groups are never the same."""
        return self.kind, self.scope, self.key


def causes_of(record: PageRecord) -> tuple[Cause, ...]:
    """Why a sheet alarms, the most telling cause first; none: it does not."""
    verdict = record.verdict
    if verdict.verdict == "misprint":
        kind = verdict.kind or UNKNOWN
        found = [
            _of_region(region, kind if at == 0 else region.kind) for at, region in enumerate(verdict.regions)
        ]
        scope: Scope = "column" if kind in COLUMN_KINDS else "sheet"
        return tuple(found) or (Cause(kind=kind, scope=scope, score=verdict.score),)
    if record.faults == ("missing",) and verdict.verdict == "not-inspected":
        return (Cause(kind=MISSING, scope="run"),)
    if "lost-lines" in record.faults:
        gone = any(CAMERA_AWAY in note for note in record.notes)
        return (Cause(kind=CAMERA_GONE if gone else LOST_LINES, scope="run"),)
    if verdict.verdict == "not-inspected":
        return (Cause(kind=NOT_INSPECTED, scope="run", key=_NUMBERS.sub("#", verdict.reason)[:200]),)
    return (Cause(kind=LATE, scope="run"),) if record.late else ()


def _of_region(region: Region, kind: str) -> Cause:
    box_mm = (region.x_mm, region.y_mm, region.width_mm, region.height_mm)
    scope: Scope = "column" if kind in COLUMN_KINDS else "sheet" if kind in SHEET_KINDS else "place"
    if not all(map(math.isfinite, box_mm)):
        return Cause(kind=kind, scope="sheet", score=region.score)
    return Cause(kind=kind, scope=scope, box_mm=box_mm, score=region.score)


class Incidents:
    """Of one run; ``add`` every record that is known, in the order of the run. Its size does not grow.

    size_mm: of a sheet, width and height, for words; None: it is not known.
    """

    def __init__(self, size_mm: tuple[float, float] | None = None) -> None:
        self._size_mm = size_mm
        self._number = 0
        self._last = -1
        """Sheet that was added last."""
        self._blind = 0
        """Sheets so far at which nobody looked."""
        self._known: dict[tuple[str, Scope, str], list[_Tracked]] = {}

    @property
    def open(self) -> tuple[Incident, ...]:
        """Those that go on, by number."""
        return tuple(one.incident(self._size_mm) for one in self._all_open())

    @property
    def number(self) -> int:
        """How many there were, those that have ended among them."""
        return self._number

    def add(self, record: PageRecord) -> tuple[IncidentChange, ...]:
        """The next sheet; returns what became of incidents, of the one that the sheet belongs to last.

        ValueError: its number is not above the last one's.
        """
        sheet = record.sheet
        if sheet <= self._last:
            message = f"sheet {sheet} comes after sheet {self._last}"
            raise ValueError(message)
        changes = self._ended(sheet - 1)
        self._blind += record.verdict.verdict == "not-inspected"
        self._last = sheet
        causes = causes_of(record)
        for cause in causes[1:]:
            if (held := self._same(cause, sheet)) is not None and held.ended_with is None:
                held.seen(sheet, self._blind, cause)
        belongs = self._taken(causes[0], record) if causes else ()
        return (*changes, *self._ended(sheet), *belongs)

    def passed(self, last_sheet: int | None = None) -> tuple[IncidentChange, ...]:
        """Good sheets that were left out have passed, up to ``last_sheet``; what has ended meanwhile."""
        self._last = self._last if last_sheet is None else max(self._last, last_sheet)
        return self._ended(self._last)

    def finish(self, last_sheet: int | None = None) -> tuple[IncidentChange, ...]:
        """No more sheets come: what is open ends. last_sheet: of the run, where good ones were left out."""
        changes = self.passed(last_sheet)
        return (*changes, *(self._end(one, self._last) for one in self._all_open()))

    def _all_open(self) -> list[_Tracked]:
        found = [one for tracked in self._known.values() for one in tracked if one.ended_with is None]
        return sorted(found, key=lambda one: one.number)

    def _ended(self, upto: int) -> tuple[IncidentChange, ...]:
        """What ends with a sheet or before; of those that were not added, each was looked at."""
        changes = []
        for one in self._all_open():
            looked_at = upto - one.seen_sheet - (self._blind - one.seen_blind)
            if looked_at >= one.patience:
                changes.append(self._end(one, upto - (looked_at - one.patience)))
        return tuple(sorted(changes, key=lambda change: change.incident.ended_with or 0))

    def _end(self, one: _Tracked, sheet: int) -> IncidentChange:
        one.ended_with = sheet
        return IncidentChange(what="ended", incident=one.incident(self._size_mm))

    def _taken(self, cause: Cause, record: PageRecord) -> tuple[IncidentChange]:
        """The sheet's own incident: one that is known, or a new one."""
        one = self._same(cause, record.sheet)
        what: What = "grew"
        if one is None:
            what = "opened"
            self._number += 1
            self._forget(record.sheet)
            one = _Tracked(number=self._number, cause=cause, first=record)
            self._known.setdefault(cause.group, []).append(one)
        elif one.ended_with is not None:
            what, one.ended_with = "returned", None
            one.returned, one.reopened_sheet = one.returned + 1, record.sheet
        one.take(cause, record)
        one.seen(record.sheet, self._blind, cause)
        return (IncidentChange(what=what, incident=one.incident(self._size_mm)),)

    def _same(self, cause: Cause, sheet: int) -> _Tracked | None:
        """The incident of a cause: an open one before one that has ended, then the nearest; None: there is none."""
        near = [
            (one.ended_with is not None, gap, one.number, one)
            for one in self._known.get(cause.group, [])
            if one.may_go_on(sheet) and (gap := one.gap_mm(cause)) <= NEAR_MM
        ]
        return min(near, key=lambda one: one[:3])[3] if near else None

    def _forget(self, sheet: int) -> None:
        """Leave out incidents that ended too long ago to come back."""
        kept = {group: [one for one in known if one.may_go_on(sheet)] for group, known in self._known.items()}
        self._known = {group: known for group, known in kept.items() if known}


def incidents_of(
    records: Iterable[PageRecord],
    *,
    size_mm: tuple[float, float] | None = None,
    last_sheet: int | None = None,
    ended: bool = True,
) -> list[Incident]:
    """All incidents of records in the order of their run, by number.

    last_sheet: of the run, where good ones were left out. ended: whether the run has.
    """
    incidents, found = Incidents(size_mm), dict[int, Incident]()
    for record in records:
        found |= {change.incident.number: change.incident for change in incidents.add(record)}
    for change in incidents.finish(last_sheet) if ended else incidents.passed(last_sheet):
        found[change.incident.number] = change.incident
    return [found[number] for number in sorted(found)]


@dataclass(slots=True)
class _Line:
    """A straight line through points that are forgotten, by Welford's running moments."""

    count: int = 0
    x: float = 0.0
    y: float = 0.0
    xx: float = 0.0
    xy: float = 0.0
    yy: float = 0.0
    last_x: float = 0.0

    def add(self, x: float, y: float) -> None:
        self.count += 1
        dx, dy = x - self.x, y - self.y
        self.x += dx / self.count
        self.y += dy / self.count
        self.xx += dx * (x - self.x)
        self.xy += dx * (y - self.y)
        self.yy += dy * (y - self.y)
        self.last_x = x

    def trend(self) -> Trend | None:
        """None: there is no point."""
        if not self.count:
            return None
        slope = self.xy / self.xx if self.xx > 0 else 0.0
        direction: Direction = "unknown"
        if self.count >= LEAST_PAGES:
            rest = max(self.yy - slope * self.xy, 0.0)
            sure = abs(slope) > SLOPE_SDS * math.sqrt(rest / (self.count - 2) / self.xx)
            span = 2 * (self.last_x - self.x)
            direction = "steady"
            if sure and abs(slope) * span > LEAST_GROWTH * abs(self.y):
                direction = "grows" if slope > 0 else "shrinks"
        return Trend(now=self.y + slope * (self.last_x - self.x), a_sheet=slope, direction=direction)


class _Tracked:
    """An incident as it goes on."""

    def __init__(self, *, number: int, cause: Cause, first: PageRecord) -> None:
        self.number, self.kind, self.scope = number, cause.kind, cause.scope
        self.first_sheet = self.reopened_sheet = first.sheet
        self.since_s = first.time_s
        self.seen_sheet, self.seen_blind, self.patience = first.sheet, 0, ENDS_AFTER
        self.ended_with: int | None = None
        self.returned = self.count = 0
        self._last: PageRecord = first
        self._place = self._around = cause.box_mm
        self._sheets, self._pages = list[int](), dict[str, None]()
        self._disposition: Disposition = "accept"
        self._score, self._size = _Line(), _Line()

    def may_go_on(self, sheet: int) -> bool:
        """Whether a sheet may be its next."""
        return self.ended_with is None or sheet - self.ended_with <= RETURNS_WITHIN

    def gap_mm(self, cause: Cause) -> float:
        """How far a cause of its group lies off its last place; below 0: it overlaps."""
        if self.scope in ("sheet", "run") or self._place is None or cause.box_mm is None:
            return 0.0
        return gap_mm(self._place, cause.box_mm, column=self.scope == "column")

    def seen(self, sheet: int, blind: int, cause: Cause) -> None:
        """It is there on a sheet, be it the sheet's own or another's beside it."""
        self.patience = min(max(self.patience, 2 * (sheet - self.seen_sheet)), 2 * RETURNS_WITHIN)
        self.seen_sheet, self.seen_blind = sheet, blind
        self._place = cause.box_mm

    def take(self, cause: Cause, record: PageRecord) -> None:
        """A sheet of its own."""
        self.count += 1
        self._last = record
        self._sheets.append(record.sheet)
        if len(self._sheets) > FIRST_SHEETS + LAST_SHEETS:
            del self._sheets[FIRST_SHEETS]
        if len(self._pages) < MOST_PAGES:
            self._pages.setdefault(record.verdict.page)
        self._disposition = gravest((self._disposition, record.disposition))
        if cause.box_mm is not None:
            self._around = cause.box_mm if self._around is None else around(self._around, cause.box_mm)
            self._size.add(record.sheet, cause.box_mm[2] * cause.box_mm[3])
        if cause.score is not None and math.isfinite(cause.score):
            self._score.add(record.sheet, cause.score)

    def incident(self, size_mm: tuple[float, float] | None) -> Incident:
        """As it is now."""
        where = ""
        if self.scope != "run":
            where = in_words(self._around, column=self.scope == "column", size_mm=size_mm)
        last = self._last
        return Incident(
            number=self.number,
            kind=self.kind,
            scope=self.scope,
            where=where,
            box_mm=self._around,
            first_sheet=self.first_sheet,
            last_sheet=last.sheet,
            reopened_sheet=self.reopened_sheet,
            count=self.count,
            sheets=tuple(self._sheets),
            pages=tuple(self._pages),
            since_s=self.since_s,
            last_s=last.time_s,
            score=self._score.trend(),
            size_mm2=self._size.trend(),
            disposition=self._disposition,
            reason=last.verdict.reason,
            returned=self.returned,
            ended_with=self.ended_with,
        )
