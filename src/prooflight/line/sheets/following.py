"""Which page of the job a sheet shows, and what that says of the pages before it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from prooflight.kernels.thumbnails import STEPS
from prooflight.line.sheets.fitting import evidence, inside, is_blank, lay, taped_rows
from prooflight.line.sheets.records import Fault, MissingPage
from prooflight.line.sheets.thumbnails import signature

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from prooflight.line.sheets.fitting import Fit
    from prooflight.line.sheets.records import FaultKind
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
UNSEEN: Final = "the camera gave no lines when it passed"
PATIENCE: Final = 2
"""Pages that may come before one of which they were expected behind, until it is said to be missing."""


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


class Expected(Protocol):
    """The pages of a run in the order in which they should come; a Sequence of thumbnails is one."""

    def __len__(self) -> int: ...

    def __getitem__(self, job_page: int, /) -> Thumbnail | None:
        """Of one page; the same object for the same design; None: it is not known yet."""
        ...


@dataclass(slots=True, eq=False)
class Following:
    """Where the run stands in its job."""

    expected: Expected
    geometry: ScanGeometry
    frontier: int = 0
    """The page expected next: behind the furthest that came."""
    last: int | None = None
    """The page that came last."""
    waiting: dict[int, int] = field(default_factory=dict)
    """Pages passed over, with how many have come since."""
    missing: set[int] = field(default_factory=set)
    """Pages said to be missing; they may come yet."""
    blind: bool = False
    """Whether lines were lost since the last page of the job, and nobody knows how many."""
    strays: list[str] = field(default_factory=list)
    """What came since the last page of the job: sheets that show none of its pages."""

    @property
    def due(self) -> int:
        """The page that should come next if every stray sheet came in the place of one; no further than ``AHEAD``."""
        return self.frontier + min(len(self.strays), AHEAD)

    def next_page(self) -> Thumbnail | None:
        """Of the page expected next; None: not known, or the job is over."""
        return self.expected[self.frontier] if self.frontier < len(self.expected) else None

    def known_near(self) -> list[Thumbnail]:
        """Thumbnails of pages near the expected one, that first, each once."""
        near = sorted(self._near(), key=lambda page: (page != self.frontier, abs(page - self.frontier)))
        known = (self.expected[page] for page in near)
        return list({id(page): page for page in known if page is not None}.values())

    def identify(self, light: NDArray[np.float32], *, longer: float, skipped: int = 0) -> Match:
        """What a sheet shows; light (rows, columns) of its scan. longer: than its page. [rows]

        skipped: sheets for which there was room in the gap before it.
        """
        if self.frontier < len(self.expected) and self.next_page() is None:
            # What is not known cannot be told from what is like it.
            return Match(job_page=None, taken_for=self.frontier)
        near = self._designs(sorted(self._near()), skipped)
        if not near:
            return Match(job_page=None)
        by_cost = sorted(near, key=lambda entry: entry[2])
        first = by_cost[0][1]
        if is_blank(light, inside(first, self.geometry)) and not self._is_blank(first):
            return Match(job_page=None, blank=True)
        best = self._liken(light, by_cost[:1], longer)
        if best.likeness < ALIKE:
            best = max(best, self._liken(light, by_cost[1:], longer), key=lambda match: match.likeness)
        if best.likeness < ALIKE:
            wide = self._designs(self._wide(light), skipped)
            best = max(best, self._liken(light, wide, longer), key=lambda match: match.likeness)
        if best.likeness < ALIKE or best.fit is None:
            unknown = self.due < len(self.expected) and self.expected[self.due] is None
            return Match(job_page=None, taken_for=self.due if unknown else None, likeness=best.likeness)
        return self._weighed(light, best, best.fit, near, longer)

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
            fit = lay(light, page, self.geometry, longer=longer)
            if fit.likeness > best.likeness:
                best = Match(job_page=job_page, fit=fit, likeness=fit.likeness)
        return best

    def _is_blank(self, page: Thumbnail) -> bool:
        return is_blank(page.light.astype(np.float32) / np.float32(STEPS), inside(page, self.geometry))

    def _near(self) -> set[int]:
        pages = set(range(self.frontier - AHEAD, self.frontier + AHEAD + 1)) | set(self.waiting)
        if self.last is not None:
            pages |= {self.last, self.last + 1}
        return {page for page in pages if 0 <= page < len(self.expected)}

    def _wide(self, light: NDArray[np.float32]) -> list[int]:
        """Pages further away whose signature is most like the scan's."""
        of_scan = signature(light)
        around = range(max(self.frontier - WIDE, 0), min(self.frontier + WIDE + 1, len(self.expected)))
        designs = self._designs(around, 0)
        similar = [
            (float(page.signature @ of_scan), job_page)
            for job_page, page, _ in designs
            if page.signature.size == of_scan.size
        ]
        return [job_page for _, job_page in sorted(similar, reverse=True)[:TRIED]]

    def _designs(self, pages: Iterable[int], skipped: int) -> list[tuple[int, Thumbnail, float]]:
        """Every design among pages once, as the page that is the least surprising: page, thumbnail, cost [nat]."""
        found: dict[int, tuple[int, Thumbnail, float]] = {}
        for job_page in pages:
            page = self.expected[job_page]
            if page is None:
                continue
            cost = self._cost(job_page, skipped)
            if id(page) not in found or cost < found[id(page)][2]:
                found[id(page)] = (job_page, page, cost)
        return list(found.values())

    def _cost(self, job_page: int, skipped: int) -> float:
        """-log of how likely a page is to come next, about: assumed, one page in a thousand is not the one expected."""
        if job_page == self.frontier + skipped:
            return 0.0
        if job_page == self.frontier:
            return 3.0
        if job_page == self.last or job_page in self.waiting:
            return 5.0 + 3.0 * (skipped > 0)
        if self.last is not None and job_page == self.last + 1:
            return 6.0
        far = 0.3 * min(abs(job_page - self.frontier), 50)
        return (6.0 if job_page > self.frontier else 8.0) + far

    def arrived(self, job_page: int, first_line: int) -> tuple[list[Fault], list[MissingPage]]:
        """Go on to behind a page that came: its faults of order, and pages now said to be missing."""
        faults, gone = list[Fault](), list[MissingPage]()

        def say(kind: FaultKind, detail: str) -> None:
            faults.append(Fault(kind=kind, first_line=first_line, detail=detail))

        if job_page >= self.frontier:
            passed = list(range(self.frontier, job_page))
            if self.blind:
                gone += [self._gone(absent, first_line, UNSEEN) for absent in passed]
                passed = []
            gone += self._strayed(passed, first_line)
            for absent in passed[len(self.strays) :]:
                self.waiting[absent] = -1
            if len(passed) > len(self.strays):
                say("missing", f"page {job_page + 1} came where page {self.frontier + 1} was expected")
            self.frontier = job_page + 1
        elif job_page in self.waiting or job_page in self.missing:
            self.waiting.pop(job_page, None)
            self.missing.discard(job_page)
            say("out-of-order", f"page {job_page + 1} came behind page {(self.last or 0) + 1}")
        else:
            again = "again" if job_page == self.last else f"again, behind page {(self.last or 0) + 1}"
            say("repeated", f"page {job_page + 1} came {again}")
        self.last, self.strays, self.blind = job_page, [], False
        for absent in list(self.waiting):
            self.waiting[absent] += 1
            if self.waiting[absent] >= PATIENCE:
                gone.append(self._gone(absent, first_line, f"page {absent + 1} has not come"))
        return faults, gone

    def taken(self, job_page: int, first_line: int) -> list[MissingPage]:
        """A sheet passed in the place of a page whose look is not known: it is taken to be it.

        Returns the pages before it in whose places strays came.
        """
        gone = self._strayed(range(self.frontier, job_page), first_line)
        self.frontier, self.strays = job_page + 1, []
        return gone

    def stray(self, what: str) -> None:
        """A sheet passed that shows no page of the job."""
        self.strays.append(what)

    def _strayed(self, passed: Iterable[int], first_line: int) -> list[MissingPage]:
        """Of pages passed over, those in whose places strays came."""
        return [
            self._gone(absent, first_line, stray) for absent, stray in zip(passed, self.strays, strict=False)
        ]

    def ended(self, line: int) -> list[MissingPage]:
        """Pages that were passed over and have not come until the end."""
        return [self._gone(absent, line, f"page {absent + 1} has not come") for absent in list(self.waiting)]

    def _gone(self, absent: int, line: int, detail: str) -> MissingPage:
        self.waiting.pop(absent, None)
        self.missing.add(absent)
        return MissingPage(job_page=absent, faults=(Fault(kind="missing", first_line=line, detail=detail),))
