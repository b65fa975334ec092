"""The ways in which the sheets that came may be read: what each was, and where the run then stands in its job.

A page that comes where another was expected may be a wrong print in that one's place, a sheet too many, or the run gone
on to there. One sheet does not tell. All ways are kept side by side, each with what it is surprising by, until the
sheets behind bear one out (Viterbi's algorithm): a wrong print costs once, a wrong place costs with every sheet.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator

    from prooflight.line.sheets.records import FaultKind

# -log of how likely each is, about. [nat] All are assumed: something goes wrong with one sheet in a thousand (7); what
# a sheet may be besides is so much rarer or less rare that one sheet in its place decides between any two of them.
WRONG: Final = 7.0
"""Another page, or none of the job, is printed in place of the page due."""
SWAPPED: Final = 3.0
"""A page comes behind one or two that were to come behind it, when these have come too early."""
LATE, LATE_PAGE = 5.0, 0.5
"""A page comes that was missing, or the last page again; for a missing one that, with so much for each page."""
AGAIN: Final = 9.0
"""A page comes again, or a sheet too many that is no page of the job."""
TOO_EARLY: Final = 12.0
"""A page comes besides, and will come again in its turn."""
AHEAD_FROM, AHEAD_PAGE, AHEAD_MOST = 7.8, 0.5, 12.8
"""The run goes on behind pages that do not come: that, with so much for each of them, and no more than so much."""
BACK_FROM, BACK_PAGE, BACK_MOST = 13.0, 0.3, 19.0
"""The run goes back to pages that came."""
BLIND_FROM, BLIND_PAGE, BLIND_MOST = 1.0, 0.1, 6.0
"""The run goes on behind pages that passed while no lines came."""
NO_ROOM: Final = 3.0
"""The page due comes although there was room for sheets before it."""
UNKNOWN_LOOK: Final = 3.0
"""The design of the page due was not ready in time."""
ENDS_EARLY: Final = 5.0
"""The lines end before the job does."""
WORSE: Final = 25.0
"""Readings so much more surprising than the best are dropped ..."""
MOST_READINGS: Final = 8
"""... and those beyond so many."""
STRAYS: Final = 8
"""On end, strays are taken to have come in place of pages; behind so many the run is taken to stand still."""
PATIENCE: Final = 2
"""Pages that may come before one of which they were expected behind, until it is said to be missing."""
UNSEEN: Final = "the camera gave no lines when it passed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One way to read the sheets that came."""

    due: int = 0
    """The page that should come next."""
    cost: float = 0.0
    """How much more surprising it is than the best. [nat]"""
    strays: tuple[str, ...] = ()
    """What came in place of the pages before the one due, of each that did."""
    waiting: tuple[tuple[int, int], ...] = ()
    """Pages passed over, with how many have come since."""
    gone: tuple[tuple[int, str], ...] = ()
    """Pages found missing, and why, that have not been said."""
    page: int | None = None
    """The page that the last sheet shows; None: none is known."""
    taken_for: int | None = None
    """The page in whose place it came, where that page's look is not known."""
    fault: tuple[FaultKind, str] | None = None
    """What is wrong with the order of pages at it."""

    @property
    def settled(self) -> int:
        """Behind the last page that came in its place."""
        return self.due - len(self.strays)

    def is_waiting(self, page: int) -> bool:
        """Whether a page has been passed over and may come yet."""
        return any(page == passed for passed, _ in self.waiting)

    def strayed(self) -> tuple[tuple[int, str], ...]:
        """Pages in whose place strays came, and what these were."""
        return tuple((self.settled + at, f"{what} came in its place") for at, what in enumerate(self.strays))

    def passed(self, until: int, cost: float, *, why: str | None = None) -> Reading:
        """The run goes on to page ``until``, and those before it are passed over. why: these are missing."""
        absent = range(self.due, until)
        missing = () if why is None else tuple((page, why) for page in absent)
        waiting = tuple((page, -1) for page in absent) if why is None else ()
        return replace(
            self,
            cost=self.cost + cost,
            due=until,
            strays=(),
            waiting=self.waiting + waiting,
            gone=self.gone + self.strayed() + missing,
        )

    def back_to(self, page: int, cost: float) -> Reading:
        """The run goes back to a page, and all from it on may come."""
        waiting = tuple(entry for entry in self.waiting if entry[0] < page)
        gone = tuple(entry for entry in self.gone if entry[0] < page)
        strays = self.strays[: max(page - self.settled, 0)]
        return replace(self, cost=self.cost + cost, due=page, strays=strays, waiting=waiting, gone=gone)

    def in_place(self) -> Reading:
        """The page due came."""
        on = self.passed(self.due, 0.0)
        return replace(on, due=self.due + 1, page=self.due)

    def taken(self, cost: float = 0.0) -> Reading:
        """A sheet came that is taken for the page due."""
        return replace(self.in_place(), cost=self.cost + cost, page=None, taken_for=self.due)

    def instead(self, what: str, cost: float, page: int | None = None) -> Reading:
        """A sheet came in place of the page due; what: that it is. page: that it shows."""
        return replace(self, cost=self.cost + cost, due=self.due + 1, strays=(*self.strays, what), page=page)

    def besides(self, cost: float, page: int | None = None) -> Reading:
        """A sheet came that is in no page's place; page: that it shows."""
        return replace(self, cost=self.cost + cost, page=page)

    def one_more(self) -> Reading:
        """Behind a sheet that shows a page: those passed over have waited for one more."""
        rest = [(page, since + 1) for page, since in self.waiting if page != self.page]
        late = tuple((page, f"page {page + 1} has not come") for page, since in rest if since >= PATIENCE)
        gone = tuple(entry for entry in self.gone if entry[0] != self.page)
        waiting = tuple(entry for entry in rest if entry[1] < PATIENCE)
        return replace(self, waiting=waiting, gone=gone + late)


@dataclass(slots=True, eq=False)
class Readings:
    """All readings of the sheets of a run, the best first."""

    pages: int
    """Of the job."""
    kept: tuple[Reading, ...] = (Reading(),)
    last: int | None = None
    """The page that came last."""
    missing: set[int] = field(default_factory=set)
    """Pages said to be missing; they may come yet."""
    said: set[int] = field(default_factory=set)
    """Pages that ever were."""
    blind: bool = False
    """Whether lines were lost since the last page of the job, and nobody knows how many."""

    @property
    def best(self) -> Reading:
        """What is believed."""
        return self.kept[0]

    def likely_due(self) -> tuple[int, ...]:
        """Pages due by readings that one sheet may yet bear out, the best reading's first."""
        return tuple(one.due for one in self.kept if one.cost <= WRONG and one.due < self.pages)

    def cost(self, page: int, *, skipped: int = 0) -> float:
        """How surprising it would be if a page came next, of all that may. skipped: sheets for which there was
        room. [nat]
        """
        return min(one.cost for one in self._of_page((page,), skipped)) - self.best.cost

    def of_page(
        self, pages: Collection[int], *, skipped: int = 0, known: Callable[[int], bool] = lambda _page: True
    ) -> tuple[Reading, ...]:
        """Readings of a sheet that shows the one design of these pages. known: of which pages it is known how they
        look.
        """
        found = list(self._of_page(pages, skipped))
        found += [one.taken(UNKNOWN_LOOK) for one in self.kept if one.due < self.pages and not known(one.due)]
        return _best(one.one_more() if one.taken_for is None else one for one in found)

    def of_stray(self, what: str, *, known: Callable[[int], bool]) -> tuple[Reading, ...]:
        """Readings of a sheet that shows no known page; what: that it is. known: as above; of a blank sheet: all."""
        found = list[Reading]()
        for one in self.kept:
            if one.due >= self.pages or len(one.strays) >= STRAYS:
                found.append(one.besides(WRONG))
            elif not known(one.due):
                found.append(one.taken(UNKNOWN_LOOK))
            else:
                found += [one.instead(what, WRONG), one.besides(AGAIN)]
        return _best(found)

    def of_hidden(self) -> tuple[Reading, ...]:
        """Readings of a sheet of which it cannot be seen what it shows: it is taken for the page due."""
        return _best(one.taken() if one.due < self.pages else one.besides(0.0) for one in self.kept)

    def go_on(self, readings: tuple[Reading, ...]) -> list[tuple[int, str]]:
        """Take readings for those that now are; pages that the best says to be missing, which were not said before."""
        best = readings[0]
        if best.page is not None:
            self.last, self.blind = best.page, False
            self.missing.discard(best.page)
        self.missing = {page for page in self.missing if page < best.due}
        fresh = [(page, why) for page, why in best.gone if page not in self.said]
        gone = {page for page, _ in best.gone}
        self.missing |= gone
        self.said |= gone
        self.kept = tuple(
            replace(
                one,
                cost=one.cost - best.cost,
                gone=tuple(entry for entry in one.gone if entry[0] not in gone),
                page=None,
                taken_for=None,
                fault=None,
            )
            for one in readings
        )
        return fresh

    def ended(self) -> list[tuple[int, str]]:
        """No more sheets come: the reading that then is the best, and what it says to be missing."""
        final = min(self.kept, key=lambda one: one.cost + ENDS_EARLY * (one.due < self.pages))
        late = tuple((page, f"page {page + 1} has not come") for page, _ in final.waiting)
        behind = final.passed(final.due, 0.0)
        return self.go_on((replace(behind, waiting=(), gone=behind.gone + late),))

    # --- what a sheet may be ---

    def _of_page(self, pages: Collection[int], skipped: int) -> Iterator[Reading]:
        for one in self.kept:
            for read in self._by(one, pages):
                yield replace(read, cost=read.cost + NO_ROOM) if skipped else read
            if skipped:
                due = one.due + skipped
                if due in pages:
                    room = one.passed(due, 0.0, why=UNSEEN if self.blind else None).in_place()
                    yield replace(room, fault=self._fault(one, due))

    def _by(self, one: Reading, pages: Collection[int]) -> Iterator[Reading]:
        """What a sheet that shows the design of these pages may be to one reading."""
        due = one.due
        if due in pages:
            yield one.in_place()
        ahead = min((page for page in pages if page > due), default=None)
        behind = max((page for page in pages if page < due), default=None)
        if ahead is not None:
            cost, why = _on_cost(ahead - due, blind=self.blind), UNSEEN if self.blind else None
            on = one.passed(ahead, cost, why=why).in_place()
            yield on if self.blind else replace(on, fault=self._fault(one, ahead))
        if behind is not None:
            back = one.back_to(behind, min(BACK_FROM + BACK_PAGE * (due - behind), BACK_MOST)).in_place()
            yield replace(back, fault=self._fault(one, behind))
        if due in pages:
            return
        near = [page for page in (ahead, behind) if page is not None]
        for page in near:
            fault = self._fault(one, page)
            yield replace(one.besides(self._besides(one, page, pages), page), fault=fault)
        page = min(near, key=lambda page: (abs(page - due), page < due))
        if due < self.pages:
            shown = one.instead(f"a sheet that shows page {page + 1}", WRONG, page)
            yield replace(shown, fault=self._fault(one, page))

    def _besides(self, one: Reading, page: int, pages: Collection[int]) -> float:
        """What it costs that a page comes out of its turn, and the run stays where it is."""
        if page > one.due:
            return TOO_EARLY
        if one.is_waiting(page):
            return SWAPPED
        if page >= one.settled or self.last in pages:
            return LATE
        # Where designs repeat, what was missing long ago is the less likely the further back it lies.
        return min(LATE + LATE_PAGE * (one.due - page), AGAIN) if page in self.missing else AGAIN

    def _fault(self, one: Reading, page: int) -> tuple[FaultKind, str] | None:
        """What is wrong with the order where a page comes that is not the one due."""
        if page >= one.due:
            return "missing", f"page {page + 1} came where page {one.due + 1} was expected"
        if one.is_waiting(page) or page in self.missing or page >= one.settled:
            return "out-of-order", f"page {page + 1} came behind page {(self.last or 0) + 1}"
        again = "again" if page == self.last else f"again, behind page {(self.last or 0) + 1}"
        return "repeated", f"page {page + 1} came {again}"


def _on_cost(distance: int, *, blind: bool) -> float:
    if blind:
        return min(BLIND_FROM + BLIND_PAGE * distance, BLIND_MOST)
    return min(AHEAD_FROM + AHEAD_PAGE * distance, AHEAD_MOST)


def _best(readings: Iterable[Reading]) -> tuple[Reading, ...]:
    """The best reading of every place, the best of all first."""
    of_place = dict[int, Reading]()
    for one in sorted(readings, key=lambda reading: reading.cost):
        of_place.setdefault(one.due, one)
    least = next(iter(of_place.values())).cost
    return tuple(one for one in of_place.values() if one.cost <= least + WORSE)[:MOST_READINGS]
