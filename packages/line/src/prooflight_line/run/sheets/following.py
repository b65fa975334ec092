"""Identification of the page that a sheet shows, and of the sequence of pages."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from prooflight_line.run.sheets.fitting import evidence, inside, is_blank, lay, taped_rows
from prooflight_line.run.sheets.readings import UNWATCHED, Reading, Readings
from prooflight_line.run.sheets.records import Fault, MissingPage
from prooflight_line.run.sheets.thumbnails import signature

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    from prooflight.scans.geometry import ScanGeometry
    from prooflight_line.run.sheets.fitting import Fit
    from prooflight_line.run.sheets.thumbnails import Thumbnail

ALIKE: Final = 0.45
"""Least likeness at which a scan may show a page: 88 good prints of 44 designs in the press world reached
0.62 and more, and 0.40 at most on another design's page (their seed, 501, is in no study)."""
MARGIN: Final = 30.0
"""Log likelihood ratio for another page that outweighs the expectation of this one: about eight thumbnail
pixels, two digits. [nat]"""
AHEAD: Final = 8
"""Number of pages on either side of the expected one that are always considered."""
WIDE: Final = 512
"""Number of pages on either side that are considered if the sheet resembles none of those."""
TRIED: Final = 8
"""Number of pages of the wide search that are compared: those of the most similar signatures."""
LIKENED: Final = 4
"""Number of pages that a sheet is compared with if the thumbnail of the page due is unknown."""
BLANK: Final = "a blank sheet"
UNKNOWN_SHEET: Final = "a sheet that is no page of the job"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Match:
    """Identification of a sheet."""

    job_page: int | None
    taken_for: int | None = None
    """The page in whose place it came, if that page's thumbnail is unknown."""
    blank: bool = False
    fit: Fit | None = None
    """The scan registered to the page that it shows."""
    likeness: float = 0.0
    """Greatest likeness to any compared page, whether the sheet shows it or not. [-]"""
    readings: tuple[Reading, ...] = ()
    """Hypotheses about its place in the job, the most likely first."""


class Expected(Protocol):
    """The pages of a run in the order in which they should come; a Sequence of thumbnails is one."""

    def __len__(self) -> int: ...

    def __getitem__(self, job_page: int, /) -> Thumbnail | None:
        """Return the thumbnail of one page, the same object for the same design; None: it is not known yet."""
        ...


class Following:
    """Tracker of a run's position in its job."""

    def __init__(
        self, *, expected: Expected, geometry: ScanGeometry, readings: Readings | None = None
    ) -> None:
        self.expected, self._geometry = expected, geometry
        self.readings = readings or Readings(pages=len(expected))

    @property
    def due(self) -> int:
        """The page that should come next."""
        return self.readings.best.due

    def thumbnails_near(self) -> list[Thumbnail]:
        """Return the thumbnails of pages near the one due, that one first, each once."""
        near = sorted(self._near(), key=lambda page: (page != self.due, abs(page - self.due)))
        thumbnails = (self.expected[page] for page in near)
        return list({id(page): page for page in thumbnails if page is not None}.values())

    def identify(self, light: NDArray[np.float32], *, longer: float, skipped: int = 0) -> Match:
        """Identify what a sheet shows.

        Parameters
        ----------
        light
            (rows, columns) light of its scan.
        longer
            Excess of its length over the page's. [rows]
        skipped
            Number of sheets that the gap before it had room for.
        """
        near = self._designs(self._near(), lambda page: self.readings.cost(page, skipped=skipped))
        by_cost = sorted(near, key=lambda entry: entry[2])
        if self.due < len(self.expected) and not self._has_thumbnail(self.due):
            # An unknown page cannot be distinguished from one that resembles it: only the sequence decides.
            best = self._liken(light, by_cost[:LIKENED], longer)
            return self._read(best, skipped) if best.likeness >= ALIKE else self._stray(best)
        if not near:
            return self._stray(Match(job_page=None))
        first = by_cost[0][1]
        if is_blank(light, inside(first, self._geometry)) and not self._is_blank(first):
            return self._stray(Match(job_page=None, blank=True))
        best = self._liken(light, by_cost[:1], longer)
        # After an unknown number of pages, none is expected so strongly that likeness alone suffices.
        if best.likeness < ALIKE or self.readings.blind:
            best = max(best, self._liken(light, by_cost[1:], longer), key=lambda match: match.likeness)
        if best.likeness < ALIKE or self.readings.blind:
            wide = self._designs(self._wide(light), lambda page: float(abs(page - self.due)))
            best = max(best, self._liken(light, wide, longer), key=lambda match: match.likeness)
        if best.likeness < ALIKE or best.fit is None:
            return self._stray(best)
        return self._read(self._best_supported(light, best, best.fit, near, longer), skipped)

    def _read(self, match: Match, skipped: int) -> Match:
        """Return the match with its hypotheses, interpreted by the most likely one."""
        shown = match.job_page
        pages = {page for page in self._near() if self._same(page, match)} | ({shown} - {None})
        readings = self.readings.of_page(
            {page for page in pages if page is not None}, skipped=skipped, has_thumbnail=self._has_thumbnail
        )
        return replace(match, job_page=readings[0].page, taken_for=readings[0].taken_for, readings=readings)

    def _stray(self, match: Match) -> Match:
        """Return the match of a sheet that shows no known page, with its hypotheses."""
        has_thumbnail = (lambda _page: True) if match.blank else self._has_thumbnail
        readings = self.readings.of_stray(
            BLANK if match.blank else UNKNOWN_SHEET, has_thumbnail=has_thumbnail
        )
        return replace(match, job_page=None, fit=None, taken_for=readings[0].taken_for, readings=readings)

    def _same(self, page: int, match: Match) -> bool:
        return match.fit is not None and self.expected[page] is match.fit.page

    def _has_thumbnail(self, page: int) -> bool:
        return self.expected[page] is not None

    def _best_supported(
        self,
        light: NDArray[np.float32],
        best: Match,
        fit: Fit,
        near: list[tuple[int, Thumbnail, float]],
        longer: float,
    ) -> Match:
        """Return the match of the nearby page with the greatest evidence; ``best``, with its fit, is the start."""
        chosen: tuple[int, Thumbnail, float] | None = None
        most = 0.0
        taped = taped_rows(fit)
        own = min((cost for job_page, _, cost in near if job_page == best.job_page), default=0.0)
        for job_page, page, cost in near:
            if page is fit.page:
                continue
            log_ratio = evidence(fit, page, taped)
            if log_ratio > MARGIN and log_ratio - cost + own > most:
                chosen, most = (job_page, page, cost), log_ratio - cost + own
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
        return is_blank(page.white, inside(page, self._geometry))

    def _near(self) -> list[int]:
        """Return the pages that a sheet is compared with first."""
        hypotheses, last = self.readings.hypotheses, self.readings.last
        pages = set(range(self.due - AHEAD, self.due + AHEAD + 1)) | {one.due for one in hypotheses}
        pages |= {page for one in hypotheses for page, _ in one.waiting}
        if last is not None:
            pages |= {last, last + 1}
        return sorted(page for page in pages if 0 <= page < len(self.expected))

    def _wide(self, light: NDArray[np.float32]) -> list[int]:
        """Return the pages further away whose signature is most similar to the scan's."""
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
        """Return every known design among the pages once, as its page of least cost: page, thumbnail, cost."""
        cheapest: dict[int, tuple[int, Thumbnail, float]] = {}
        for job_page in pages:
            page = self.expected[job_page]
            if page is None:
                continue
            costs = cost(job_page)
            if id(page) not in cheapest or costs < cheapest[id(page)][2]:
                cheapest[id(page)] = (job_page, page, costs)
        return list(cheapest.values())

    def arrived(self, match: Match, first_line: int) -> tuple[list[Fault], list[MissingPage]]:
        """Advance past a sheet; return the faults of order that it shows, and the pages now reported missing."""
        fault = match.readings[0].fault
        faults = [] if fault is None else [Fault(kind=fault[0], first_line=first_line, detail=fault[1])]
        return faults, _missing(self.readings.go_on(match.readings), first_line)

    def hidden(self, first_line: int) -> tuple[int | None, list[MissingPage]]:
        """Advance past a sheet whose page cannot be seen.

        Return the page that it is taken for, None if that is unknown, and the pages now reported missing.
        """
        if self.readings.blind or self.due >= len(self.expected):
            return None, []
        readings = self.readings.of_hidden()
        return readings[0].taken_for, _missing(self.readings.go_on(readings), first_line)

    def ended(self, first_line: int) -> list[MissingPage]:
        """Return the pages that were skipped and have not come, at the end of the lines."""
        return _missing(self.readings.ended(), first_line)


def _missing(absent: Iterable[tuple[int, str]], first_line: int) -> list[MissingPage]:
    return [
        MissingPage(
            job_page=page,
            faults=(
                Fault(kind="unwatched" if why == UNWATCHED else "missing", first_line=first_line, detail=why),
            ),
        )
        for page, why in absent
    ]
