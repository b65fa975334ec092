"""Which page of the job a sheet shows, and what that says of the pages before it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from prooflight.kernels.thumbnails import STEPS
from prooflight.line.sheets.fitting import evidence, inside, is_blank, lay, taped_rows
from prooflight.line.sheets.readings import Reading, Readings
from prooflight.line.sheets.records import Fault, MissingPage
from prooflight.line.sheets.thumbnails import signature

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    from prooflight.line.sheets.fitting import Fit
    from prooflight.line.sheets.thumbnails import Thumbnail
    from prooflight.scans.geometry import ScanGeometry

ALIKE: Final = 0.45
"""Likeness from which a scan may show a page: 88 good prints of 44 designs in the press world reached 0.62 and more,
and 0.40 at most on another design's page (their seed, 501, is in no study)."""
MARGIN: Final = 30.0
"""Evidence for another page that outweighs that this one is expected: about eight thumbnail pixels, two
digits. [nat]"""
AHEAD: Final = 8
"""Pages behind and before the expected one that are always thought of."""
WIDE: Final = 512
"""The same where the sheet is like none of those."""
TRIED: Final = 8
"""Pages of the wide search whose likeness is looked at: those of the most similar signatures."""
LIKENED: Final = 4
"""Pages that a sheet is likened to where the look of the page due is not known."""
BLANK: Final = "a blank sheet"
STRANGER: Final = "a sheet that is no page of the job"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Match:
    """What a sheet shows."""

    job_page: int | None
    taken_for: int | None = None
    """The page in whose place it came, where nothing is known of that page's look."""
    blank: bool = False
    fit: Fit | None = None
    """The scan laid on the page that it shows."""
    likeness: float = 0.0
    """The greatest found, of the page it shows or not. [-]"""
    readings: tuple[Reading, ...] = ()
    """What it may be in the job, the most likely first."""


class Expected(Protocol):
    """The pages of a run in the order in which they should come; a Sequence of thumbnails is one."""

    def __len__(self) -> int: ...

    def __getitem__(self, job_page: int, /) -> Thumbnail | None:
        """Of one page; the same object for the same design; None: it is not known yet."""
        ...


class Following:
    """Where the run stands in its job."""

    def __init__(self, *, expected: Expected, geometry: ScanGeometry) -> None:
        self.expected, self._geometry = expected, geometry
        self.readings = Readings(pages=len(expected))

    @property
    def due(self) -> int:
        """The page that should come next."""
        return self.readings.best.due

    def known_near(self) -> list[Thumbnail]:
        """Thumbnails of pages near the one due, that first, each once."""
        near = sorted(self._near(), key=lambda page: (page != self.due, abs(page - self.due)))
        known = (self.expected[page] for page in near)
        return list({id(page): page for page in known if page is not None}.values())

    def identify(self, light: NDArray[np.float32], *, longer: float, skipped: int = 0) -> Match:
        """What a sheet shows; light (rows, columns) of its scan. longer: than its page. [rows]

        skipped: sheets for which there was room in the gap before it.
        """
        near = self._designs(self._near(), lambda page: self.readings.cost(page, skipped=skipped))
        by_cost = sorted(near, key=lambda entry: entry[2])
        if self.due < len(self.expected) and not self._is_known(self.due):
            # What is not known cannot be told from what is like it, unless the sheets before bear that out.
            best = self._liken(light, by_cost[:LIKENED], longer)
            return self._read(best, skipped) if best.likeness >= ALIKE else self._stray(best)
        if not near:
            return self._stray(Match(job_page=None))
        first = by_cost[0][1]
        if is_blank(light, inside(first, self._geometry)) and not self._is_blank(first):
            return self._stray(Match(job_page=None, blank=True))
        best = self._liken(light, by_cost[:1], longer)
        # Where nobody knows how many pages passed, none is expected so much that it need only be alike.
        if best.likeness < ALIKE or self.readings.blind:
            best = max(best, self._liken(light, by_cost[1:], longer), key=lambda match: match.likeness)
        if best.likeness < ALIKE or self.readings.blind:
            wide = self._designs(self._wide(light), lambda page: float(abs(page - self.due)))
            best = max(best, self._liken(light, wide, longer), key=lambda match: match.likeness)
        if best.likeness < ALIKE or best.fit is None:
            return self._stray(best)
        return self._read(self._weighed(light, best, best.fit, near, longer), skipped)

    def _read(self, match: Match, skipped: int) -> Match:
        """The same, read as what is the most likely in the job."""
        shown = match.job_page
        pages = {page for page in self._near() if self._same(page, match)} | ({shown} - {None})
        readings = self.readings.of_page(
            {page for page in pages if page is not None}, skipped=skipped, known=self._is_known
        )
        return replace(match, job_page=readings[0].page, taken_for=readings[0].taken_for, readings=readings)

    def _stray(self, match: Match) -> Match:
        """The same of a sheet that shows no page that is known."""
        known = (lambda _page: True) if match.blank else self._is_known
        readings = self.readings.of_stray(BLANK if match.blank else STRANGER, known=known)
        return replace(match, job_page=None, fit=None, taken_for=readings[0].taken_for, readings=readings)

    def _same(self, page: int, match: Match) -> bool:
        return match.fit is not None and self.expected[page] is match.fit.page

    def _is_known(self, page: int) -> bool:
        return self.expected[page] is not None

    def _weighed(
        self,
        light: NDArray[np.float32],
        best: Match,
        fit: Fit,
        near: list[tuple[int, Thumbnail, float]],
        longer: float,
    ) -> Match:
        """The page that the evidence is for, of those near; ``best``, with its fit, is one that it is like."""
        chosen: tuple[int, Thumbnail, float] | None = None
        most = 0.0
        taped = taped_rows(fit)
        own = min((cost for job_page, _, cost in near if job_page == best.job_page), default=0.0)
        for job_page, page, cost in near:
            if page is fit.page:
                continue
            said = evidence(fit, page, taped)
            if said > MARGIN and said - cost + own > most:
                chosen, most = (job_page, page, cost), said - cost + own
        if chosen is None:
            return best
        other = self._liken(light, [chosen], longer)
        return best if other.likeness < ALIKE else other

    def _liken(
        self, light: NDArray[np.float32], pages: Iterable[tuple[int, Thumbnail, float]], longer: float
    ) -> Match:
        best = Match(job_page=None)
        for job_page, page, _ in pages:
            fit = lay(light, page, self._geometry, longer=longer)
            if fit.likeness > best.likeness:
                best = Match(job_page=job_page, fit=fit, likeness=fit.likeness)
        return best

    def _is_blank(self, page: Thumbnail) -> bool:
        return is_blank(page.light.astype(np.float32) / np.float32(STEPS), inside(page, self._geometry))

    def _near(self) -> list[int]:
        """Pages that a sheet is laid on first."""
        kept, last = self.readings.kept, self.readings.last
        pages = set(range(self.due - AHEAD, self.due + AHEAD + 1)) | {one.due for one in kept}
        pages |= {page for one in kept for page, _ in one.waiting}
        if last is not None:
            pages |= {last, last + 1}
        return sorted(page for page in pages if 0 <= page < len(self.expected))

    def _wide(self, light: NDArray[np.float32]) -> list[int]:
        """Pages further away whose signature is most like the scan's."""
        of_scan = signature(light)
        around = range(max(self.due - WIDE, 0), min(self.due + WIDE + 1, len(self.expected)))
        similar = [
            (float(page.signature @ of_scan), job_page)
            for job_page, page, _ in self._designs(around, lambda page: float(abs(page - self.due)))
            if page.signature.size == of_scan.size
        ]
        return [job_page for _, job_page in sorted(similar, reverse=True)[:TRIED]]

    def _designs(
        self, pages: Iterable[int], cost: Callable[[int], float]
    ) -> list[tuple[int, Thumbnail, float]]:
        """Every known design among pages once, as the page that costs least: page, thumbnail, cost."""
        found: dict[int, tuple[int, Thumbnail, float]] = {}
        for job_page in pages:
            page = self.expected[job_page]
            if page is None:
                continue
            costs = cost(job_page)
            if id(page) not in found or costs < found[id(page)][2]:
                found[id(page)] = (job_page, page, costs)
        return list(found.values())

    def arrived(self, match: Match, first_line: int) -> tuple[list[Fault], list[MissingPage]]:
        """Go on behind a sheet: faults of order that it shows, and pages now said to be missing."""
        fault = match.readings[0].fault
        faults = [] if fault is None else [Fault(kind=fault[0], first_line=first_line, detail=fault[1])]
        return faults, _missing(self.readings.go_on(match.readings), first_line)

    def hidden(self, first_line: int) -> tuple[int | None, list[MissingPage]]:
        """Go on behind a sheet of which nobody can see what it shows; the page it is taken for, None: nobody can tell,
        and pages now said to be missing.
        """
        if self.readings.blind or self.due >= len(self.expected):
            return None, []
        readings = self.readings.of_hidden()
        return readings[0].taken_for, _missing(self.readings.go_on(readings), first_line)

    def ended(self, first_line: int) -> list[MissingPage]:
        """No more lines come: pages that were passed over and have not come."""
        return _missing(self.readings.ended(), first_line)


def _missing(gone: Iterable[tuple[int, str]], first_line: int) -> list[MissingPage]:
    return [
        MissingPage(job_page=page, faults=(Fault(kind="missing", first_line=first_line, detail=why),))
        for page, why in gone
    ]
