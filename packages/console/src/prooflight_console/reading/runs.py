"""Runs and sheets of a journal that another process writes, which may not exist yet."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import TYPE_CHECKING, Final

from prooflight import __version__
from prooflight_console.problems import not_found
from prooflight_line.journal.following import Counted, Heads, JournalFollower, PageQuery, Written, follow
from prooflight_line.journal.reading import MOST_ID

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from prooflight_line.journal.records import PageRecord, RunRow
    from prooflight_line.journal.schema import JournalError

AT_ONCE: Final = 1000
MOST_CACHED: Final = 512
"""Number of ended runs that are cached: they do not change, and their pages need not be counted again."""


class Reading:
    """Reader of a journal.

    Its methods raise JournalError if the journal cannot be read, and ``Problem`` 404 for a missing item.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._follower: JournalFollower | None = None
        self._guard = threading.Lock()
        self._ended: OrderedDict[int, RunRow] = OrderedDict()
        self._going: Counted | None = None

    @property
    def follower(self) -> JournalFollower | None:
        """The open journal; None if there is none yet."""
        with self._guard:
            if self._follower is None:
                self._follower = follow(self.path, version=__version__)
            return self._follower

    def close(self) -> None:
        """Close the journal."""
        with self._guard:
            if self._follower is not None:
                self._follower.close()
                self._follower = None

    def heads(self) -> Heads:
        """Return the last row and the last run of the journal."""
        follower = self.follower
        return Heads(row=0, run=0, ended=False) if follower is None else follower.heads()

    def run_id(self, text: str) -> int:
        """Return the number of the run that a path names: digits, or `last`."""
        if text == "last":
            if last := self.heads().run:
                return last
            raise not_found("no run was recorded yet")
        if not (text.isascii() and text.isdecimal()) or len(text) > 18:
            raise not_found(f"there is no run {text[:20]!r}")
        return int(text)

    def run_named(self, text: str) -> RunRow:
        """Return the run that a path names."""
        return self.run(self.run_id(text))

    def run(self, run_id: int) -> RunRow:
        """Return one run."""
        with self._guard:
            if (kept := self._ended.get(run_id)) is not None:
                return kept
        follower = self.follower
        if (
            follower is None
            or not 0 < run_id <= MOST_ID
            or not follower.run_ids(before=run_id + 1, limit=1)[:1] == [run_id]
        ):
            raise not_found(f"there is no run {run_id}")
        row = self._counted(follower, run_id)
        if row.end is not None:
            with self._guard:
                self._ended[run_id] = row
                while len(self._ended) > MOST_CACHED:
                    self._ended.popitem(last=False)
        return row

    def _counted(self, follower: JournalFollower, run_id: int) -> RunRow:
        """Return a run; if it goes on, only new rows are counted, since all of it may be millions of rows."""
        with self._guard:
            before = self._going
        same = before is not None and before.run.id == run_id
        counted = follower.counted_on(before) if same and before is not None else None
        counted = counted or follower.counted(run_id)
        if counted.run.end is None:
            with self._guard:
                self._going = counted
        return counted.run

    def last_run(self) -> RunRow | None:
        """Return the latest run; None if there is none."""
        last = self.heads().run
        return self.run(last) if last else None

    def runs(
        self, *, before: int | None, limit: int, damaged: Callable[[JournalError], None]
    ) -> list[RunRow]:
        """Return runs, the latest first; before: only those of lower numbers."""
        from prooflight_line.journal.schema import JournalError

        follower, rows = self.follower, []
        for number in [] if follower is None else follower.run_ids(before=before, limit=limit):
            try:
                rows.append(self.run(number))
            except JournalError as error:
                damaged(error)
        return rows

    def sheet(self, run_id: int, sheet: int) -> PageRecord:
        """Return one sheet with its evidence."""
        self.written(run_id, sheet)
        follower = self.follower
        assert follower is not None
        return follower.page(run_id, sheet)

    def written(self, run_id: int, sheet: int) -> Written:
        """Return one sheet with its row, without its evidence."""
        follower = self.follower
        one = PageQuery(run_id=run_id, first_sheet=sheet, last_sheet=sheet)
        if follower is None or not 0 <= sheet <= MOST_ID or not 0 < run_id <= MOST_ID:
            raise not_found(f"run {run_id} has no sheet {sheet}")
        rows = follower.sheets(one, limit=1)
        if not rows:
            raise not_found(f"run {run_id} has no sheet {sheet}")
        return rows[0]

    def first_time_s(self, run: RunRow) -> float:
        """Return the time of a run's first sheet, by the source's clock; 0 if there is none. [s]"""
        follower = self.follower
        return 0.0 if follower is None else follower.first_time_s(run.id) or 0.0

    def clock_zero_s(self, run: RunRow) -> float:
        """Return the Unix time at which the source's clock of a run stood at 0. [s]"""
        return run.facts.started_s - self.first_time_s(run)

    def last_time_s(self, run: RunRow) -> float:
        """Return the time of a run's last sheet, by the source's clock; 0 if there is none. [s]"""
        follower = self.follower
        if follower is None:
            return 0.0
        last = PageQuery(run_id=run.id, first_sheet=follower.last_sheet(run.id))
        rows = self.sheets(last, after=-1, limit=1, damaged=lambda _: None)
        return rows[0].page.time_s if rows else 0.0

    def sheets(
        self, query: PageQuery, *, after: int, limit: int, damaged: Callable[[JournalError], None]
    ) -> list[Written]:
        """Return sheets of one run, by number."""
        follower = self.follower
        return [] if follower is None else follower.sheets(query, after=after, limit=limit, damaged=damaged)

    def search(
        self, query: PageQuery, *, before: int | None, limit: int, damaged: Callable[[JournalError], None]
    ) -> list[Written]:
        """Return sheets of any run, the latest first."""
        follower = self.follower
        return [] if follower is None else follower.search(query, before=before, limit=limit, damaged=damaged)

    def written_after(
        self, row: int, *, run_id: int | None = None, limit: int, damaged: Callable[[JournalError], None]
    ) -> list[Written]:
        """Return sheets after a row, in the order of writing."""
        follower = self.follower
        if follower is None:
            return []
        return follower.written_after(row, run_id=run_id, limit=limit, damaged=damaged)


def pages_to_review(
    reading: Reading, run: RunRow, *, damaged: Callable[[JournalError], None] = lambda _: None
) -> Iterator[PageRecord]:
    """Iterate over the sheets of a run that need review; damaged: called for each that cannot be read."""
    after, query = -1, PageQuery(run_id=run.id, to_review=True)
    while rows := reading.sheets(query, after=after, limit=AT_ONCE, damaged=damaged):
        yield from (row.page for row in rows)
        after = rows[-1].page.sheet
