"""Incidents: sheets that alarm for the same cause form one incident, be they one sheet or four hundred.

An alarm is a sheet that is not simply good: a misprint, a sheet that was not inspected, a missing page, a sheet
of which the camera lost lines, or one whose verdict was late. Every alarm belongs to exactly one incident, that
of its cause: its kind and its place. The place depends on the kind: the column for a streak, the sheet for what
changes the print as a whole, and the box in millimetres for all else. Other places of the same sheet keep their
incidents open.

An incident ends when ``ENDS_AFTER`` analysed sheets have passed without it. If it recurs within
``RETURNS_WITHIN`` sheets, the same incident is reopened and then waits twice as long as it paused: one page of a
job of a hundred that is wrong each time is one incident, and so is a fault of every fortieth sheet.

The input is records alone, from the run or from its journal; those of good sheets may be left out.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from prooflight.detectors.disposition import gravest
from prooflight.inspection.common_cause import COLUMN_KINDS, NEAR_MM, SHEET_KINDS
from prooflight.scans.lines import CAMERA_AWAY, CAMERA_AWAY_BEFORE
from prooflight_line.run.monitor.run import LEAST_PAGES, SLOPE_SDS
from prooflight_line.run.places import around, gap_mm, place_text

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight.detectors.disposition import Disposition
    from prooflight.detectors.verdict import Region, Verdict
    from prooflight_line.journal.records import PageRecord
    from prooflight_line.run.places import Box

Scope = Literal["place", "column", "sheet", "run"]
"""Part of a cause that locates it: a box, a column of the web, the sheet as a whole, or nothing on the
sheet."""
Direction = Literal["grows", "steady", "shrinks", "unknown"]
What = Literal["opened", "grew", "ended", "returned"]

ENDS_AFTER: Final = 20
"""Sheets without its cause after which an incident ends. assumed: four seconds at 5 sheets a second, longer
than a person takes to look at the tray."""
RETURNS_WITHIN: Final = 1000
"""Sheets after its end within which an incident may recur. assumed: longer than most jobs of several pages,
so that each copy joins the incident of the copy before."""
FIRST_SHEETS, LAST_SHEETS = 16, 48
"""Number of sheets, from an incident's start and from its end, whose numbers are kept."""
MOST_PAGES: Final = 64
"""Greatest number of the job's pages that an incident names."""
LEAST_GROWTH: Final = 0.05
"""Least change over an incident's sheets that is reported as a trend, as a share of the mean. assumed."""
MISSING, LOST_LINES, CAMERA_GONE, NOT_INSPECTED, LATE = (
    *("missing-page", "lost-lines", "camera-gone", "not-inspected", "late"),
)
NO_MISPRINT: Final = frozenset({MISSING, LOST_LINES, CAMERA_GONE, NOT_INSPECTED, LATE})
"""Kinds of incidents in which nothing wrong was seen on a sheet: no label says what these sheets were."""
UNKNOWN: Final = "unknown"
_NUMBERS = re.compile(r"[-+]?\d+(?:[.,:]\d+)*")


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """Linear trend of a quantity over the sheets of an incident."""

    now: float
    """Value of the line at the last sheet."""
    a_sheet: float
    direction: Direction


@dataclass(frozen=True, slots=True, kw_only=True)
class Incident:
    """Alarms of one cause, as of the latest record."""

    number: int
    """Number within the run, from 1."""
    kind: str
    """Kind of misprint, or missing-page, lost-lines, camera-gone, not-inspected, late."""
    scope: Scope
    where: str
    """Description of the place; empty: the incident has no place on the sheet."""
    box_mm: Box | None
    """Bounding box of all its places: x, y, width and height; None: it has no place."""
    first_sheet: int
    last_sheet: int
    reopened_sheet: int
    """Sheet at which it last opened or recurred."""
    count: int
    sheets: tuple[int, ...]
    """Numbers of its first ``FIRST_SHEETS`` and last ``LAST_SHEETS`` sheets."""
    pages: tuple[str, ...]
    """Names of its pages of the job, in order of appearance, ``MOST_PAGES`` at most."""
    since_s: float
    """Time of its first sheet, by the source's clock. [s]"""
    last_s: float
    score: Trend | None
    """Trend of the place's score, in standard deviations; None: it has no score."""
    size_mm2: Trend | None
    """Trend of the box's area; None: it has no box."""
    disposition: Disposition
    """Most severe disposition among its sheets."""
    reason: str
    """Reason of its last sheet, in one line."""
    last_verdict: Verdict
    """Verdict of its last sheet, whose first region is the incident's."""
    returned: int
    """Number of times it recurred after it had ended."""
    ended_with: int | None
    """Sheet at which it ended; None: it is open."""

    @property
    def open(self) -> bool:
        """Whether it has not ended."""
        return self.ended_with is None

    @property
    def by_costs(self) -> bool:
        """Whether its misprints are accepted by the costs of the press file."""
        return self.disposition == "accept" and self.kind not in NO_MISPRINT


@dataclass(frozen=True, slots=True, kw_only=True)
class IncidentChange:
    """A change of an incident, and the incident after it."""

    what: What
    incident: Incident


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """The cause of a sheet's alarm."""

    kind: str
    scope: Scope
    key: str = ""
    """Further distinction within the kind: the reason of a sheet that was not inspected, with numbers
    masked."""
    box_mm: Box | None = None
    score: float | None = None

    @property
    def group(self) -> tuple[str, Scope, str]:
        """Key that causes must share to be the same."""
        return self.kind, self.scope, self.key


def causes_of(record: PageRecord) -> tuple[Cause, ...]:
    """Return the causes of a sheet's alarm, the most significant first; empty if the sheet does not alarm."""
    verdict = record.verdict
    if verdict.verdict == "misprint":
        kind = verdict.kind or UNKNOWN
        regions = [
            _of_region(region, kind if at == 0 else region.kind) for at, region in enumerate(verdict.regions)
        ]
        scope: Scope = "column" if kind in COLUMN_KINDS else "sheet"
        return tuple(regions) or (Cause(kind=kind, scope=scope, score=verdict.score),)
    if record.faults == ("missing",) and verdict.verdict == "not-inspected":
        return (Cause(kind=MISSING, scope="run"),)
    if "lost-lines" in record.faults:
        camera_away = any(away in note for note in record.notes for away in (CAMERA_AWAY, CAMERA_AWAY_BEFORE))
        return (Cause(kind=CAMERA_GONE if camera_away else LOST_LINES, scope="run"),)
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
    """Tracker of the incidents of one run; call ``add`` with the records in the order of the run.

    Its memory does not grow with the run. size_mm: width and height of a sheet, for descriptions; None: unknown.
    """

    def __init__(self, size_mm: tuple[float, float] | None = None) -> None:
        self._size_mm = size_mm
        self._number = 0
        self._last = -1
        """Number of the last sheet that was added."""
        self._blind = 0
        """Number of sheets so far that were not inspected."""
        self._known: dict[tuple[str, Scope, str], list[_Tracked]] = {}

    @property
    def open(self) -> tuple[Incident, ...]:
        """Incidents that have not ended, by number."""
        return tuple(one.incident(self._size_mm) for one in self._all_open())

    @property
    def number(self) -> int:
        """Number of incidents so far, ended ones included."""
        return self._number

    def add(self, record: PageRecord) -> tuple[IncidentChange, ...]:
        """Add the next sheet; return the changes of incidents, that of the sheet's own incident last.

        ValueError: its number is not above that of the sheet before.
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
            if (secondary := self._same(cause, sheet)) is not None and secondary.ended_with is None:
                secondary.seen(sheet, self._blind, cause)
        belongs = self._taken(causes[0], record) if causes else ()
        return (*changes, *self._ended(sheet), *belongs)

    def passed(self, last_sheet: int | None = None) -> tuple[IncidentChange, ...]:
        """Advance over good sheets that were left out, up to ``last_sheet``; return what ended meanwhile."""
        self._last = self._last if last_sheet is None else max(self._last, last_sheet)
        return self._ended(self._last)

    def finish(self, last_sheet: int | None = None) -> tuple[IncidentChange, ...]:
        """End all open incidents. last_sheet: of the run, if good sheets were left out."""
        changes = self.passed(last_sheet)
        return (*changes, *(self._end(one, self._last) for one in self._all_open()))

    def _all_open(self) -> list[_Tracked]:
        incidents = [one for tracked in self._known.values() for one in tracked if one.ended_with is None]
        return sorted(incidents, key=lambda one: one.number)

    def _ended(self, upto: int) -> tuple[IncidentChange, ...]:
        """Return the incidents that end at ``upto`` or before; sheets that were not added count as analysed."""
        changes = []
        for one in self._all_open():
            analysed = upto - one.seen_sheet - (self._blind - one.seen_blind)
            if analysed >= one.patience:
                changes.append(self._end(one, upto - (analysed - one.patience)))
        return tuple(sorted(changes, key=lambda change: change.incident.ended_with or 0))

    def _end(self, one: _Tracked, sheet: int) -> IncidentChange:
        one.ended_with = sheet
        return IncidentChange(what="ended", incident=one.incident(self._size_mm))

    def _taken(self, cause: Cause, record: PageRecord) -> tuple[IncidentChange]:
        """Assign a sheet to its incident, which is opened if no known one matches."""
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
        """Return the incident of a cause, open ones first, then the nearest; None: there is none."""
        near = [
            (one.ended_with is not None, gap, one.number, one)
            for one in self._known.get(cause.group, [])
            if one.may_go_on(sheet) and (gap := one.gap_mm(cause)) <= NEAR_MM
        ]
        return min(near, key=lambda one: one[:3])[3] if near else None

    def _forget(self, sheet: int) -> None:
        """Drop incidents that ended too long ago to recur."""
        remaining = {
            group: [one for one in known if one.may_go_on(sheet)] for group, known in self._known.items()
        }
        self._known = {group: known for group, known in remaining.items() if known}


def incidents_of(
    records: Iterable[PageRecord],
    *,
    size_mm: tuple[float, float] | None = None,
    last_sheet: int | None = None,
    ended: bool = True,
) -> list[Incident]:
    """Return all incidents of records in the order of their run, by number.

    last_sheet: of the run, if good sheets were left out. ended: whether the run has ended.
    """
    incidents, found = Incidents(size_mm), dict[int, Incident]()
    for record in records:
        found |= {change.incident.number: change.incident for change in incidents.add(record)}
    for change in incidents.finish(last_sheet) if ended else incidents.passed(last_sheet):
        found[change.incident.number] = change.incident
    return [found[number] for number in sorted(found)]


@dataclass(slots=True)
class _Line:
    """Regression line over points that are not stored, from Welford's running moments."""

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
        """Return the trend of the points so far; None: there is no point."""
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
    """Mutable state of an incident."""

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
        """Return whether the incident is open, or may recur with this sheet."""
        return self.ended_with is None or sheet - self.ended_with <= RETURNS_WITHIN

    def gap_mm(self, cause: Cause) -> float:
        """Return the gap between a cause of its group and its last place; below 0: they overlap."""
        if self.scope in ("sheet", "run") or self._place is None or cause.box_mm is None:
            return 0.0
        return gap_mm(self._place, cause.box_mm, column=self.scope == "column")

    def seen(self, sheet: int, blind: int, cause: Cause) -> None:
        """Note that the cause appears on a sheet, as the sheet's own cause or as a secondary one."""
        self.patience = min(max(self.patience, 2 * (sheet - self.seen_sheet)), 2 * RETURNS_WITHIN)
        self.seen_sheet, self.seen_blind = sheet, blind
        self._place = cause.box_mm

    def take(self, cause: Cause, record: PageRecord) -> None:
        """Add a sheet whose own cause this is."""
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
        """Return the incident as of the latest sheet."""
        where = ""
        if self.scope != "run":
            where = place_text(self._around, column=self.scope == "column", size_mm=size_mm)
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
            last_verdict=last.verdict,
            returned=self.returned,
            ended_with=self.ended_with,
        )
