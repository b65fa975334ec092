"""Segmentation of a continuous stream of lines into the pages of a job, robust to losses and wrong sheets.

    pager = Pager(press, expected=thumbnails)
    for block in source.blocks():
        for page in pager.push(block):
            ...  # SeenPage or MissingPage
    pager.flush()

Every sheet is detected by its edges in the image, cut out as a scan, and compared with the thumbnails of the
pages that may come: the likelihood decides which one it shows. The page before does not constrain it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.kernels.thumbnails import SHRINK, STEPS
from prooflight.scans.lines import LineBlock
from prooflight_line.run.sheets.edges import EDGE_LINES, STRETCH, Sheet, SheetFinder
from prooflight_line.run.sheets.fitting import lay
from prooflight_line.run.sheets.following import Expected, Following
from prooflight_line.run.sheets.records import Fault, MissingPage, SeenPage
from prooflight_line.run.sheets.sheet_faults import Rhythm, length_fault, splice_fault
from prooflight_line.run.sheets.store import LineStore
from prooflight_line.run.sheets.thumbnails import Shrinker, Thumbnail

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight_line.run.sheets.fitting import Fit
    from prooflight_line.run.sheets.following import Match
    from prooflight_line.run.sheets.readings import Readings

SLIP_MM: Final = 1.2
"""Displacement from which a sheet counts as slipped: good ones of the press world lie within 0.76 mm."""
PAGES_LIKE_GAP: Final = 3
"""Number of pages that may explain an apparent gap by their own tint: the one expected, and its
neighbours."""
ABOUT, ABOUT_SHARE = 5, 0.8
"""Limits within which a page's own tint still resembles the backing: multiple of the backing's tolerance, and
share of the columns."""
TORN_LINES: Final = 40
"""Distance to a sheet's measured edge within which lost lines may be its own: the edge is measured over as
many."""
UNSEEN_EDGE_LINES: Final = 4
"""Distance from the first or last line within which a sheet may continue where no lines were read; an edge is
measured to two lines. On a press that leaves less than twice as much before its sheets, half of that
applies."""
PIECES_WITHIN: Final = 2
"""Range after an unknown number of lost lines, in lengths of the longest sheet, within which pieces of sheets
may be seen: the torn one, and the next, which may be any page."""
TRIGGER_REACH_MM: Final = 12.0
"""Distance to its trigger beyond which a sheet is cut at its edge: registration searches no further."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetEdge:
    """Scans that start the lead-in above the sheet's edge, as detected in the image."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TriggerCount:
    """Scans that start every ``lines`` lines of the camera's count; the image shows whether a sheet is there."""

    lines: int
    """Number of lines from scan to scan."""
    first_line: int = 0
    """The camera's count at the first scan's first line."""

    def nearest(self, line: int) -> int:
        """Return the trigger nearest to a line of the camera's count."""
        return self.first_line + round((line - self.first_line) / self.lines) * self.lines


PageStart = SheetEdge | TriggerCount


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _CutSheet:
    """A sheet that was cut out and compared with the pages."""

    sheet: Sheet
    first: int
    """Position of the scan's first line."""
    scan: NDArray[np.uint16]
    match: Match
    hidden: bool
    """Whether its edge resembled the backing and was located from its print instead: its length is not
    measured."""


class Pager:
    """Converter of blocks of lines into pages.

    The result does not depend on how the lines are divided into blocks.
    """

    def __init__(
        self,
        press: Press,
        *,
        expected: Expected,
        start: PageStart | None = None,
        readings: Readings | None = None,
    ) -> None:
        """expected: thumbnails in job order, read when they are near; the same object for the same design.

        A thumbnail that is not known yet is None. readings: hypotheses about the position of a run that is
        resumed.
        """
        geometry = press.geometry
        self._press = press
        self._geometry, self._start = geometry, start or SheetEdge()
        self._lead_in, self._lead_out = (
            round(mm / geometry.line_pitch_mm) for mm in (geometry.lead_in_mm, geometry.lead_out_mm)
        )
        self._unseen_edge = min(UNSEEN_EDGE_LINES, self._lead_in // 2)
        self._following = Following(expected=expected, geometry=geometry, readings=readings)
        self._longest = max(self._lengths(), default=2 * geometry.pixels)
        self._store = LineStore(press, longest=self._longest)
        self._finder = SheetFinder(self._store, lengths=self._lengths, like_gap=self._like_gap)
        self._shrinker = Shrinker(press)
        self._sheets: deque[Sheet] = deque()
        self._faults: deque[tuple[int, Fault]] = deque()
        self._rhythm = Rhythm(tolerance=SLIP_MM / geometry.line_pitch_mm)
        self._before: Sheet | None = None
        # An unknown number of lines was lost, and with it the triggers' positions.
        self._untriggered = readings is not None

    @property
    def next_page(self) -> int:
        """Index in ``expected`` of the page that should come next."""
        return self._following.due

    @property
    def may_come(self) -> tuple[int, ...]:
        """Indices in ``expected`` of the pages that the next sheet may well show, the most likely first."""
        return self._following.readings.likely_due()

    @property
    def to_come(self) -> int:
        """Number of pages of ``expected`` from the run's position on."""
        return max(len(self._following.expected) - self._following.due, 0)

    @property
    def missing(self) -> int:
        """Number of pages that were reported missing and have not come since."""
        return len(self._following.readings.missing)

    def warm_up(self) -> None:
        """Take one sheet, made of a page's thumbnail, through a pager of its own.

        The first sheet of the run then need not wait for compilers and caches.
        """
        near = self._following.thumbnails_near()[:2]
        if not near:
            return
        sheet = self._store.lines_of(near[0].white.repeat(SHRINK, axis=0).repeat(SHRINK, axis=1))
        gap = np.repeat(self._store.backing_dn[:, None], self._lead_in + self._lead_out, axis=1)
        rehearsal = Pager(self._press, expected=near)
        rehearsal.push(LineBlock(first_line=0, lines=np.concatenate([gap, sheet, gap], axis=1), time_s=0.0))
        rehearsal.flush()

    def push(self, block: LineBlock) -> list[SeenPage | MissingPage]:
        """Return the pages that are complete with this block. ScanError: the block is not of this press's camera."""
        self._faults.extend(self._store.add(block))
        self._sheets.extend(self._finder.sheets())
        pages: list[SeenPage | MissingPage] = []
        while self._sheets and self._store.end >= self._sheets[0].end + self._lead_out:
            pages += self._page(self._sheets.popleft())
        needed = min(self._finder.needed_from, self._sheets[0].start if self._sheets else self._store.end)
        # An edge that resembles the backing is detected late: the whole gap before a sheet is kept.
        gap = 0 if self._before is None else self._before.end
        self._store.forget(max(min(needed, gap), needed - self._longest) - self._lead_in)
        return pages

    def flush(self) -> list[SeenPage | MissingPage]:
        """Return the remaining pages at the end of the lines; pages still to come are not reported missing."""
        self._sheets.extend(self._finder.sheets())
        last = self._finder.last()
        pages: list[SeenPage | MissingPage] = []
        for sheet in self._sheets:
            pages += self._page(sheet)
        self._sheets.clear()
        if last is not None:
            page = self._page_of_length(last)
            pages += self._cut_short(last, page) if self._is_short(last, page) else self._page(last)
        return pages + self._following.ended(self._store.count_at(self._store.end))

    def _page(self, sheet: Sheet) -> list[SeenPage | MissingPage]:
        """Return a sheet's page, after the pages that it shows to be missing."""
        page = self._page_of_length(sheet)
        broken_before = self._broken_before(sheet)
        if broken_before:
            self._following.readings.blind = self._untriggered = True
        if self._is_torn(sheet, page):
            return self._torn(sheet, page)
        skipped = self._room_before(sheet)
        cut = self._identified(sheet, page, skipped)
        shown = cut.match.fit
        if shown is not None and page is not None and shown.page.height_mm != page.height_mm:
            cut = self._identified(sheet, shown.page, skipped)
        sheet, match = cut.sheet, cut.match
        if self._is_piece(sheet, match, page):
            return self._torn(sheet, page)
        if self._untriggered and match.job_page is not None:
            self._restart_triggers(sheet)
        count = self._store.count_at(sheet.start)
        faults = self._faults_until(sheet.end + self._lead_out)
        off_lines = self._late(sheet)
        if off_lines:
            what = f"the sheet came {abs(off_lines) * self._geometry.line_pitch_mm:.1f} mm"
            detail = f"{what} {'late' if off_lines > 0 else 'early'}"
            faults.append(Fault(kind="slip", first_line=count, detail=detail))
        of_order, missing = self._following.arrived(match, count)
        if match.job_page is not None and match.fit is not None:
            faults += [*self._of_sheet(cut, match.fit, count), *of_order]
        elif match.blank:
            faults.append(Fault(kind="blank", first_line=count, detail="nothing is printed on the sheet"))
        elif match.taken_for is None:
            what = f"no page of the job is like the sheet, {match.likeness:.0%} at most"
            faults.append(Fault(kind="unknown", first_line=count, detail=what))
        self._before = sheet
        seen = SeenPage(
            scan=cut.scan,
            first_line=count - (sheet.start - cut.first),  # lines were lost between them
            first_line_time_s=self._store.time_at(max(cut.first, 0)),
            last_line_time_s=self._store.time_at(min(cut.first + cut.scan.shape[1], self._store.end) - 1),
            job_page=match.job_page,
            faults=tuple(faults),
            taken_for=match.taken_for,
            unseen=self._store.unseen(cut.first, cut.scan.shape[1]),
        )
        return [*missing, seen]

    def _torn(self, sheet: Sheet, page: Thumbnail | None) -> list[SeenPage | MissingPage]:
        """Return a sheet that lost an unknown number of lines; its page is taken from its turn."""
        first, scan, _ = self._cut(sheet, page)
        lines = scan.shape[1]
        expected, missing = self._following.hidden(self._store.count_at(first))
        begun_within = self._begins_unseen(sheet)
        self._before = sheet
        seen = SeenPage(
            scan=scan,
            first_line=self._store.count_at(first),
            last_line_time_s=self._store.time_at(min(first + lines, self._store.end) - 1),
            job_page=None,
            faults=tuple(self._faults_until(sheet.end + self._lead_out)),
            taken_for=expected,
            unseen=self._store.unseen(first, lines),
            torn=True,
            begun_within=begun_within,
        )
        return [*missing, seen]

    def _restart_triggers(self, sheet: Sheet) -> None:
        """Count triggers from the edge of a sheet that shows a page, after their count was lost.

        The edge of a piece, or of an unknown sheet, is no trigger's position: all later sheets would be cut
        displaced.
        """
        self._untriggered = False
        if isinstance(self._start, TriggerCount):
            first = self._store.count_at(sheet.start) - self._lead_in  # lines were lost between them
            self._start = replace(self._start, first_line=first)

    def _broken_before(self, sheet: Sheet) -> bool:
        """Return whether an unknown number of lines was lost between the previous sheet and this one."""
        since = 0 if self._before is None else self._before.end - TORN_LINES
        return self._store.broken(since, sheet.start + TORN_LINES)

    def _is_torn(self, sheet: Sheet, page: Thumbnail | None) -> bool:
        """Return whether a sheet is torn by an unknown number of lost lines.

        It is torn if they were lost within it, if they were lost near it and it is not as long as its page, or if
        it began before the lines did.
        """
        near = self._unseen_edge
        if self._begins_unseen(sheet) or self._store.broken(sheet.start - near, sheet.end + near):
            return True
        if not self._store.broken(sheet.start - TORN_LINES, sheet.end + TORN_LINES):
            return False
        return not self._is_whole(sheet, page)

    def _is_piece(self, sheet: Sheet, match: Match, page: Thumbnail | None) -> bool:
        """Return whether a sheet may be part of one near an unknown number of lost lines.

        Its other parts need not be next to it: a band across a page that resembles the backing divides a sheet if
        neither the expected page nor the lines' position on it is known. A whole sheet is what it shows.
        """
        lost = self._store.broken_until
        if lost is None or not self._following.readings.blind or match.taken_for is not None:
            return False
        if sheet.start >= lost + PIECES_WITHIN * self._longest:
            return False
        if match.fit is not None:  # another piece may lie where, by its print, it begins
            begun = max(lost, self._before.end if self._before else 0)
            return sheet.start < begun or not self._is_whole(sheet, match.fit.page)
        return not (sheet.free and self._is_whole(sheet, page))

    def _is_whole(self, sheet: Sheet, page: Thumbnail | None) -> bool:
        """Return whether a sheet is as long as a page."""
        lines = 0.0 if page is None else page.height_mm / self._geometry.line_pitch_mm
        return abs(sheet.end - sheet.start - lines) <= STRETCH * lines + EDGE_LINES

    @property
    def _by_edge(self) -> bool:
        """Whether sheets are cut at their edges in the image: there are no triggers, or their count was lost."""
        return self._untriggered or isinstance(self._start, SheetEdge)

    def _begins_unseen(self, sheet: Sheet) -> bool:
        """Return whether a run's first sheet begins with its lines; counted triggers say where it begins."""
        return self._before is None and sheet.start <= self._unseen_edge and self._by_edge

    def _cut_short(self, sheet: Sheet, page: Thumbnail | None) -> list[SeenPage | MissingPage]:
        """Return a sheet of which only the beginning was read, too little to identify its page."""
        first, scan, _ = self._cut(sheet, page)
        expected, missing = self._following.hidden(self._store.count_at(first))
        seen = SeenPage(
            scan=scan,
            first_line=self._store.count_at(first),
            last_line_time_s=self._store.time_at(self._store.end - 1),
            job_page=None,
            faults=tuple(self._faults_until(self._store.end)),
            taken_for=expected,
            cut_short=True,
        )
        return [*missing, seen]

    def _is_short(self, sheet: Sheet, page: Thumbnail | None) -> bool:
        """Return whether a sheet without a gap after it ends before its page does; it does if no page is known."""
        if sheet.free or page is None:
            return not sheet.free
        page_lines = page.height_mm / self._geometry.line_pitch_mm
        return sheet.end - sheet.start < (1 - STRETCH) * page_lines - EDGE_LINES

    def _identified(self, sheet: Sheet, page: Thumbnail | None, skipped: int) -> _CutSheet:
        """Cut a sheet out as ``page`` would be, and identify what it shows."""
        first, scan, light = self._cut(sheet, page)
        longer = self._longer(sheet, page) / SHRINK
        match = self._following.identify(light, longer=longer, skipped=skipped)
        fit, hidden = match.fit, False
        if fit is not None and fit.drop.size and np.ptp(fit.drop) < 1 and self._by_edge:
            late = -round(float(fit.drop.mean()) * SHRINK)
            # A print displaced on its sheet is a misprint; a sheet whose dark end resembles the backing is not.
            hidden = abs(late) > SHRINK and (not sheet.free or abs(late + longer * SHRINK) <= SHRINK)
            if hidden:
                sheet = replace(sheet, start=sheet.start - late)
                first, scan, light = self._cut(sheet, fit.page)
                fit = lay(light, fit.page, self._geometry)
                match = replace(match, fit=fit, likeness=fit.likeness)
        return _CutSheet(sheet=sheet, first=first, scan=scan, match=match, hidden=hidden)

    def _cut(
        self, sheet: Sheet, page: Thumbnail | None
    ) -> tuple[int, NDArray[np.uint16], NDArray[np.float32]]:
        """Return a sheet's scan, the position of its first line, and its light."""
        height_mm = (
            (sheet.end - sheet.start) * self._geometry.line_pitch_mm if page is None else page.height_mm
        )
        first = sheet.start - self._lead_in
        if isinstance(self._start, TriggerCount) and not self._untriggered:
            count = self._store.count_at(sheet.start) - self._lead_in
            off = self._start.nearest(count) - count
            if abs(off) * self._geometry.line_pitch_mm <= TRIGGER_REACH_MM:
                first += off
        since = 0 if self._before is None else self._before.end
        until = sheet.end + (self._lead_out if sheet.free else 0)
        scan = self._store.cut(first, self._geometry.lines(height_mm), since=since, until=until)
        return first, scan, self._shrinker.picture(scan)

    def _of_sheet(self, cut: _CutSheet, fit: Fit, count: int) -> list[Fault]:
        """Return the faults of the sheet itself, from its fit to its page."""
        pitch_mm = self._geometry.line_pitch_mm
        longer = 0.0 if cut.hidden else self._longer(cut.sheet, fit.page)
        page_lines = round(fit.page.height_mm / pitch_mm)
        faults = (
            length_fault(fit, longer_lines=longer, page_lines=page_lines, start_line=count),
            splice_fault(fit, start_line=count, line_pitch_mm=pitch_mm),
        )
        return [fault for fault in faults if fault is not None]

    def _longer(self, sheet: Sheet, page: Thumbnail | None) -> float:
        """Return how much longer a sheet is than a page, 0 if its end is not known. [lines]"""
        if page is None or not sheet.free:
            return 0.0
        return sheet.end - sheet.start - page.height_mm / self._geometry.line_pitch_mm

    def _room_before(self, sheet: Sheet) -> int:
        """Return the number of sheets that the gap before this one had room for."""
        gap = self._gap_before(sheet)
        return 0 if gap is None or isinstance(self._start, TriggerCount) else self._rhythm.room(*gap)

    def _late(self, sheet: Sheet) -> float:
        """Return by how many lines a sheet came late; 0: in time, or unknown."""
        if isinstance(self._start, TriggerCount) and not self._untriggered:
            count = self._store.count_at(sheet.start) - self._lead_in
            off = float(count - self._start.nearest(count))
            return off if abs(off) * self._geometry.line_pitch_mm > SLIP_MM else 0.0
        gap = self._gap_before(sheet)
        return 0.0 if gap is None else self._rhythm.beat(*gap)

    def _gap_before(self, sheet: Sheet) -> tuple[float, float] | None:
        """Return the lengths of the gap before a sheet and of the sheet, in lines; None: no gap was seen."""
        if self._before is None or not self._before.free or self._broken_before(sheet):
            return None
        page = self._page_of_length(sheet)
        lines = sheet.end - sheet.start if page is None else page.height_mm / self._geometry.line_pitch_mm
        return sheet.start - self._before.end, lines

    def _faults_until(self, position: int) -> list[Fault]:
        faults: dict[tuple[str, str], Fault] = {}
        while self._faults and self._faults[0][0] < position:
            fault = self._faults.popleft()[1]
            faults.setdefault((fault.kind, fault.detail), fault)  # every block reports a disconnected camera
        return list(faults.values())

    def _page_of_length(self, sheet: Sheet) -> Thumbnail | None:
        """Return the expected page, or the first near it that is as long as the sheet."""
        near = self._following.thumbnails_near()
        pitch, length = self._geometry.line_pitch_mm, sheet.end - sheet.start
        for page in near if sheet.free else []:
            if abs(page.height_mm / pitch - length) <= STRETCH * length + EDGE_LINES:
                return page
        return near[0] if near else None

    def _lengths(self) -> list[int]:
        """Return the lengths in lines of the sheets that may come, the next one's first."""
        pitch = self._geometry.line_pitch_mm
        return list(
            dict.fromkeys(round(page.height_mm / pitch) for page in self._following.thumbnails_near())
        )

    def _like_gap(self, below: int) -> bool:
        """Return whether a page that may come next resembles the backing so many lines below its edge."""
        row = (below + self._lead_in) // SHRINK
        for page in self._following.thumbnails_near()[:PAGES_LIKE_GAP]:
            end = len(page.light) - self._lead_out // SHRINK - 2
            rows = page.light[max(row - 2, 0) : min(row + 3, end)].astype(np.float32) / STEPS
            off = np.abs(rows - self._store.backing_light)
            if rows.size and ((off < ABOUT * self._store.near).mean(axis=1) >= ABOUT_SHARE).any():
                return True
        return False
