"""Hypotheses about the sheets that came: what each was, and the run's position in its job after it.

A page that comes where another was expected may be a wrong print in its place, a sheet too many, or a jump of the
run to that page. One sheet does not decide. All hypotheses are kept in parallel, each with its cost (the negative
log likelihood), until later sheets decide (Viterbi's algorithm): a wrong print costs once, a wrong position costs
with every sheet.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator

    from prooflight_line.run.sheets.records import FaultKind

# Approximate negative log likelihoods. [nat] All are assumed: one sheet in a thousand goes wrong (7); the other cases
# are so much rarer or more frequent that one sheet in its place decides between any two of them.
WRONG: Final = 7.0
"""Cost of another page, or none of the job, printed in place of the page due."""
SWAPPED: Final = 3.0
"""Cost of a page that comes after one or two that were to follow it and have come too early."""
LATE, LATE_PAGE = 5.0, 0.5
"""Cost of a page that comes late after it was missing, or of the last page once more; for a missing one, the
first plus the second for each page of distance."""
AGAIN: Final = 9.0
"""Cost of a page that comes again, or of a sheet too many that is no page of the job."""
TOO_EARLY: Final = 12.0
"""Cost of an additional page that will come again in its turn."""
AHEAD_FROM, AHEAD_PAGE, AHEAD_MOST = 7.8, 0.5, 12.8
"""Cost of a jump ahead over pages that do not come: the first plus the second for each of them, at most the
third."""
BACK_FROM, BACK_PAGE, BACK_MOST = 13.0, 0.3, 19.0
"""Cost of a jump back to pages that came: as above."""
BLIND_FROM, BLIND_PAGE, BLIND_MOST = 1.0, 0.1, 6.0
"""Cost of a jump ahead over pages that passed while no lines came: as above."""
NO_ROOM: Final = 3.0
"""Cost of the page due if there was room for sheets before it."""
UNKNOWN_THUMBNAIL: Final = 3.0
"""Cost of a sheet whose page's design was not ready in time."""
ENDS_EARLY: Final = 5.0
"""Cost of lines that end before the job does."""
WORSE: Final = 25.0
"""Cost above the best hypothesis beyond which hypotheses are dropped."""
MOST_READINGS: Final = 8
"""Greatest number of hypotheses that is kept."""
STRAYS: Final = 8
"""Number of successive strays that count as sheets in place of pages; after so many the run is taken to stand
still."""
PATIENCE: Final = 2
"""Number of pages that may come before one that was expected earlier, until that one is reported missing."""
UNSEEN: Final = "the camera delivered no lines while the sheet passed"
UNWATCHED: Final = "the run was interrupted: the sheet was not inspected, or its verdict was lost"
"""Reason of a page that passed between the end of the process that watched it and the resumption of its run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One hypothesis about the sheets that came."""

    due: int = 0
    """The page that should come next."""
    cost: float = 0.0
    """Cost above that of the best hypothesis. [nat]"""
    strays: tuple[str, ...] = ()
    """Descriptions of the sheets that came in place of the last pages before the one due."""
    waiting: tuple[tuple[int, int], ...] = ()
    """Pages that were skipped, with the number of pages that have come since."""
    unreported: tuple[tuple[int, str], ...] = ()
    """Pages that are missing, and why, and have not been reported yet."""
    page: int | None = None
    """The page that the last sheet shows; None: none is known."""
    taken_for: int | None = None
    """The page in whose place it came, if that page's thumbnail is unknown."""
    fault: tuple[FaultKind, str] | None = None
    """Fault of the order of pages at the last sheet."""

    @property
    def settled(self) -> int:
        """The page after the last that came in its place."""
        return self.due - len(self.strays)

    def is_waiting(self, page: int) -> bool:
        """Return whether a page has been skipped and may still come."""
        return any(page == passed for passed, _ in self.waiting)

    def strayed(self) -> tuple[tuple[int, str], ...]:
        """Return the pages in whose place strays came, and what these were."""
        return tuple(
            (self.settled + at, f"{what} came instead of the page") for at, what in enumerate(self.strays)
        )

    def passed(self, until: int, cost: float, *, why: str | None = None) -> Reading:
        """Return the hypothesis that the run jumps ahead to page ``until``.

        why: reason for which the skipped pages are missing; None: they may still come.
        """
        absent = range(self.due, until)
        missing = () if why is None else tuple((page, why) for page in absent)
        waiting = tuple((page, -1) for page in absent) if why is None else ()
        return replace(
            self,
            cost=self.cost + cost,
            due=until,
            strays=(),
            waiting=self.waiting + waiting,
            unreported=self.unreported + self.strayed() + missing,
        )

    def back_to(self, page: int, cost: float) -> Reading:
        """Return the hypothesis that the run goes back to a page; all pages from it on may come."""
        waiting = tuple(entry for entry in self.waiting if entry[0] < page)
        unreported = tuple(entry for entry in self.unreported if entry[0] < page)
        strays = self.strays[: max(page - self.settled, 0)]
        return replace(
            self, cost=self.cost + cost, due=page, strays=strays, waiting=waiting, unreported=unreported
        )

    def in_place(self) -> Reading:
        """Return the hypothesis that the page due came."""
        on = self.passed(self.due, 0.0)
        return replace(on, due=self.due + 1, page=self.due)

    def taken(self, cost: float = 0.0) -> Reading:
        """Return the hypothesis that a sheet is taken for the page due."""
        return replace(self.in_place(), cost=self.cost + cost, page=None, taken_for=self.due)

    def instead(self, what: str, cost: float, page: int | None = None) -> Reading:
        """Return the hypothesis that a sheet came in place of the page due.

        what: description of the sheet. page: the page that it shows.
        """
        return replace(self, cost=self.cost + cost, due=self.due + 1, strays=(*self.strays, what), page=page)

    def besides(self, cost: float, page: int | None = None) -> Reading:
        """Return the hypothesis that a sheet came in addition to all pages; page: that it shows."""
        return replace(self, cost=self.cost + cost, page=page)

    def one_more(self) -> Reading:
        """Return the hypothesis after a sheet that shows a page: skipped pages have waited for one more."""
        rest = [(page, since + 1) for page, since in self.waiting if page != self.page]
        late = tuple((page, f"page {page + 1} was not detected") for page, since in rest if since >= PATIENCE)
        unreported = tuple(entry for entry in self.unreported if entry[0] != self.page)
        waiting = tuple(entry for entry in rest if entry[1] < PATIENCE)
        return replace(self, waiting=waiting, unreported=unreported + late)


@dataclass(slots=True, eq=False)
class Readings:
    """All hypotheses about the sheets of a run, the best first."""

    pages: int
    hypotheses: tuple[Reading, ...] = (Reading(),)
    last: int | None = None
    """The page that came last."""
    missing: set[int] = field(default_factory=set)
    """Pages reported missing; they may still come."""
    reported: set[int] = field(default_factory=set)
    """Pages that were ever reported missing."""
    blind: bool = False
    """Whether an unknown number of lines was lost since the last page of the job."""
    unseen: str = UNSEEN
    """Reason of the pages that passed meanwhile."""

    @property
    def best(self) -> Reading:
        """The most likely hypothesis."""
        return self.hypotheses[0]

    def likely_due(self) -> tuple[int, ...]:
        """Return the pages due by hypotheses that one sheet may still confirm, the best one's first."""
        return tuple(one.due for one in self.hypotheses if one.cost <= WRONG and one.due < self.pages)

    def cost(self, page: int, *, skipped: int = 0) -> float:
        """Return the least cost of a page coming next, relative to the best hypothesis. [nat]

        skipped: number of sheets that the gap had room for.
        """
        return min(one.cost for one in self._of_page((page,), skipped)) - self.best.cost

    def of_page(
        self,
        pages: Collection[int],
        *,
        skipped: int = 0,
        has_thumbnail: Callable[[int], bool] = lambda _page: True,
    ) -> tuple[Reading, ...]:
        """Return the hypotheses about a sheet that shows the one design of these pages.

        prepared_page: returns whether a page's thumbnail is known.
        """
        candidates = list(self._of_page(pages, skipped))
        candidates += [
            one.taken(UNKNOWN_THUMBNAIL)
            for one in self.hypotheses
            if one.due < self.pages and not has_thumbnail(one.due)
        ]
        return _best(one.one_more() if one.taken_for is None else one for one in candidates)

    def of_stray(self, what: str, *, has_thumbnail: Callable[[int], bool]) -> tuple[Reading, ...]:
        """Return the hypotheses about a sheet that shows no known page.

        what: description of the sheet. known: returns whether a page's thumbnail is known; always true for a
        blank sheet.
        """
        candidates = list[Reading]()
        for one in self.hypotheses:
            if one.due >= self.pages or len(one.strays) >= STRAYS:
                candidates.append(one.besides(WRONG))
            elif not has_thumbnail(one.due):
                candidates.append(one.taken(UNKNOWN_THUMBNAIL))
            else:
                candidates += [one.instead(what, WRONG), one.besides(AGAIN)]
        return _best(candidates)

    def of_hidden(self) -> tuple[Reading, ...]:
        """Return the hypotheses about a sheet whose content cannot be seen: it is taken for the page due."""
        return _best(one.taken() if one.due < self.pages else one.besides(0.0) for one in self.hypotheses)

    def go_on(self, readings: tuple[Reading, ...]) -> list[tuple[int, str]]:
        """Replace the hypotheses; return the pages that the best one newly reports missing, and why."""
        best = readings[0]
        if best.page is not None:
            self.last, self.blind, self.unseen = best.page, False, UNSEEN
            self.missing.discard(best.page)
        self.missing = {page for page in self.missing if page < best.due}
        fresh = [(page, why) for page, why in best.unreported if page not in self.reported]
        missing = {page for page, _ in best.unreported}
        self.missing |= {page for page, why in best.unreported if why != UNWATCHED}
        self.reported |= missing
        self.hypotheses = tuple(
            replace(
                one,
                cost=one.cost - best.cost,
                unreported=tuple(entry for entry in one.unreported if entry[0] not in missing),
                page=None,
                taken_for=None,
                fault=None,
            )
            for one in readings
        )
        return fresh

    def ended(self) -> list[tuple[int, str]]:
        """Choose the best hypothesis at the end of the sheets; return the pages that it reports missing."""
        final = min(self.hypotheses, key=lambda one: one.cost + ENDS_EARLY * (one.due < self.pages))
        late = tuple((page, f"page {page + 1} was not detected") for page, _ in final.waiting)
        advanced = final.passed(final.due, 0.0)
        return self.go_on((replace(advanced, waiting=(), unreported=advanced.unreported + late),))

    # --- continuations of hypotheses ---

    def _of_page(self, pages: Collection[int], skipped: int) -> Iterator[Reading]:
        for one in self.hypotheses:
            for read in self._continuations(one, pages):
                yield replace(read, cost=read.cost + NO_ROOM) if skipped else read
            if skipped:
                due = one.due + skipped
                if due in pages:
                    room = one.passed(due, 0.0, why=self.unseen if self.blind else None).in_place()
                    yield replace(room, fault=self._fault(one, due))

    def _continuations(self, one: Reading, pages: Collection[int]) -> Iterator[Reading]:
        """Yield the continuations of one hypothesis by a sheet that shows the design of these pages."""
        due = one.due
        if due in pages:
            yield one.in_place()
        ahead = min((page for page in pages if page > due), default=None)
        previous = max((page for page in pages if page < due), default=None)
        if ahead is not None:
            cost, why = _on_cost(ahead - due, blind=self.blind), self.unseen if self.blind else None
            on = one.passed(ahead, cost, why=why).in_place()
            yield on if self.blind else replace(on, fault=self._fault(one, ahead))
        if previous is not None:
            back = one.back_to(previous, min(BACK_FROM + BACK_PAGE * (due - previous), BACK_MOST)).in_place()
            yield replace(back, fault=self._fault(one, previous))
        if due in pages:
            return
        near = [page for page in (ahead, previous) if page is not None]
        for page in near:
            fault = self._fault(one, page)
            yield replace(one.besides(self._besides(one, page, pages), page), fault=fault)
        page = min(near, key=lambda page: (abs(page - due), page < due))
        if due < self.pages:
            shown = one.instead(f"a sheet that shows page {page + 1}", WRONG, page)
            yield replace(shown, fault=self._fault(one, page))

    def _besides(self, one: Reading, page: int, pages: Collection[int]) -> float:
        """Return the cost of a page that comes out of turn while the run's position stays."""
        if page > one.due:
            return TOO_EARLY
        if one.is_waiting(page):
            return SWAPPED
        if page >= one.settled or self.last in pages:
            return LATE
        # If designs repeat, a page that was missing long ago is the less likely, the further back it is.
        return min(LATE + LATE_PAGE * (one.due - page), AGAIN) if page in self.missing else AGAIN

    def _fault(self, one: Reading, page: int) -> tuple[FaultKind, str] | None:
        """Return the fault of the order if a page comes that is not the one due."""
        if page >= one.due:
            return "missing", f"page {page + 1} came where page {one.due + 1} was expected"
        if one.is_waiting(page) or page in self.missing or page >= one.settled:
            return "out-of-order", f"page {page + 1} came after page {(self.last or 0) + 1}"
        again = "again" if page == self.last else f"again, after page {(self.last or 0) + 1}"
        return "repeated", f"page {page + 1} came {again}"


def _on_cost(distance: int, *, blind: bool) -> float:
    if blind:
        return min(BLIND_FROM + BLIND_PAGE * distance, BLIND_MOST)
    return min(AHEAD_FROM + AHEAD_PAGE * distance, AHEAD_MOST)


def _best(readings: Iterable[Reading]) -> tuple[Reading, ...]:
    """Return the best hypothesis of every position, the best of all first."""
    of_place = dict[int, Reading]()
    for one in sorted(readings, key=lambda reading: reading.cost):
        of_place.setdefault(one.due, one)
    least = next(iter(of_place.values())).cost
    return tuple(one for one in of_place.values() if one.cost <= least + WORSE)[:MOST_READINGS]
