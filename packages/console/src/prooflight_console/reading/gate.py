"""The gate of a run, from its log and the journal, as ``prooflight run reconcile`` reports it."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import asdict, dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import RequestError
from prooflight.pages.memory import file_stamp
from prooflight_console.problems import not_found
from prooflight_line.journal.following import PageQuery
from prooflight_line.journal.labels import run_key
from prooflight_line.plant.gate.log import LoggedDecisions, log_path, rows_of
from prooflight_line.plant.gate.reconciling import Account, Accounted, Reconciliation, read_trays, reconciled

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from prooflight_console.reading.runs import Reading
    from prooflight_line.journal.records import PageRecord, RunRow

AT_ONCE: Final = 1000
MOST_CACHED: Final = 2
"""Number of runs whose accounts are cached: a long one takes seconds, and is requested page by page."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gated:
    """Log of a run's gate, and the account of the run's sheets."""

    log: LoggedDecisions
    accounts: Reconciliation

    def sheets(self, *, after: int, limit: int, account: Account | None) -> list[Accounted]:
        """Return accounts by number; after: beyond this sheet; account: only those of this kind."""
        selected = (
            one
            for one in self.accounts.sheets
            if one.sheet is not None and one.sheet > after and account in (None, one.account)
        )
        return list(islice(selected, limit))


class Gates:
    """Cache of accounts, computed again when the run or its gate's log has got further."""

    def __init__(self, reading: Reading, *, trays: Path | None = None) -> None:
        """Create the cache. trays: the controller's log of its trays, which may grow."""
        self._reading, self._trays = reading, trays
        self._guard = threading.Lock()
        self._cached: OrderedDict[tuple[Any, ...], Gated] = OrderedDict()

    def of(self, run: RunRow) -> Gated:
        """Return the gate of a run.

        Raises ``Problem`` 404 if it had no gate, PlantError if the gate's log is damaged, and RequestError if
        the controller's log is.
        """
        path, trays = log_of(self._reading, run), self._trays
        key = run_key(run), run.pages, run.state, *file_stamp(path), *([] if trays is None else _stamp(trays))
        with self._guard:
            if (gated := self._cached.get(key)) is None:
                log = LoggedDecisions.read(path)
                rows = None if trays is None else read_trays(trays)
                gated = Gated(log=log, accounts=reconciled(all_pages(self._reading, run), log, rows))
                self._cached[key] = gated
                while len(self._cached) > MOST_CACHED:
                    self._cached.popitem(last=False)
            self._cached.move_to_end(key)
            return gated

    def lines(self, run: RunRow, *, after: int, limit: int) -> list[dict[str, Any]]:
        """Return lines of the gate's log after line ``after``, with numbers from 1; raises as ``of``."""
        rows = enumerate(rows_of(log_of(self._reading, run)), start=1)
        return [{"line": number, **row} for number, row in islice(rows, after, after + limit)]


def _stamp(trays: Path) -> list[int]:
    """Return the stamp of the controller's log; raises RequestError if it is missing."""
    try:
        return file_stamp(trays)
    except OSError as error:
        remedy = "put it back, or start the console without --trays"
        raise RequestError(trays, f"cannot be read ({error.strerror})", remedy=remedy) from error


def gate_facts(run: RunRow, gated: Gated) -> dict[str, Any]:
    """Return the counts of a run's sheets, and the settings of its gate."""
    accounts, log = gated.accounts, gated.log
    return {
        "run": run.id,
        "sessions": log.sessions,
        "settings": log.began.get("settings", {}),
        "trays_from": accounts.source,
        "disagreements": [asdict(one) for one in accounts.disagreements],
        "counts": dict(accounts.counts),
        "lost_by": dict(accounts.lost_by),
        "not_in_the_journal": sum(not one.in_journal for one in accounts.sheets if one.sheet is not None),
    }


def sheet_facts(gated: Gated, one: Accounted) -> dict[str, Any]:
    """Return the account of a sheet, with the decision and its acknowledgement."""
    tag = None if one.sheet is None else one.sheet + 1
    decided = {} if tag is None else gated.log.decisions.get(tag, {})
    fields = asdict(one)
    fields["set"] = fields.pop("set_number") if decided else None
    return fields | {
        "tag": tag if decided else None,
        "position": decided.get("position"),
        "written": tag in gated.log.written,
    }


def log_of(reading: Reading, run: RunRow) -> Path:
    """Return the path of the log of a run's gate; raises ``Problem`` 404 if there is none."""
    path = log_path(reading.path, run.id)
    if not path.is_file():
        raise not_found(f"run {run.id} had no gate")
    return path


def all_pages(reading: Reading, run: RunRow) -> Iterator[PageRecord]:
    """Iterate over the pages of a run by number; those that cannot be read are omitted."""
    after, query = -1, PageQuery(run_id=run.id)
    while rows := reading.sheets(query, after=after, limit=AT_ONCE, damaged=lambda _: None):
        yield from (row.page for row in rows)
        after = rows[-1].page.sheet
