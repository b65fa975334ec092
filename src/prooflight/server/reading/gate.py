"""What a run's gate was told and did, from its log and the journal, as ``prooflight run reconcile`` has it."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import asdict, dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import RequestError
from prooflight.journal.following import Asked
from prooflight.journal.words import run_key
from prooflight.pages.memory import file_stamp
from prooflight.plant.gate.log import KeptDecisions, log_path, rows_of
from prooflight.plant.gate.reconciling import Account, Accounted, Reconciliation, read_trays, reconciled
from prooflight.server.problems import not_found

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from prooflight.journal.records import PageRecord, RunRow
    from prooflight.server.reading.runs import Reading

AT_ONCE: Final = 1000
KEPT: Final = 2
"""Runs whose sheets stay accounted for: those of a long one take seconds, and are asked for page by page."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gated:
    """A run with a gate."""

    kept: KeptDecisions
    found: Reconciliation

    def sheets(self, *, after: int, limit: int, account: Account | None) -> list[Accounted]:
        """By number; after: behind this one. account: of these alone."""
        told = (
            one
            for one in self.found.sheets
            if one.sheet is not None and one.sheet > after and account in (None, one.account)
        )
        return list(islice(told, limit))


class Gates:
    """Of any run; accounted for anew when the run, or its gate's log, has come further."""

    def __init__(self, reading: Reading, *, trays: Path | None = None) -> None:
        """trays: the controller's log of its trays, which may grow."""
        self._reading, self._trays = reading, trays
        self._guard = threading.Lock()
        self._kept: OrderedDict[tuple[Any, ...], Gated] = OrderedDict()

    def of(self, run: RunRow) -> Gated:
        """``Problem`` 404: it had no gate. PlantError: its log is damaged. RequestError: the controller's is."""
        path, trays = log_of(self._reading, run), self._trays
        key = run_key(run), run.pages, run.state, *file_stamp(path), *([] if trays is None else _stamp(trays))
        with self._guard:
            if (gated := self._kept.get(key)) is None:
                kept = KeptDecisions.read(path)
                rows = None if trays is None else read_trays(trays)
                gated = Gated(kept=kept, found=reconciled(all_pages(self._reading, run), kept, rows))
                self._kept[key] = gated
                while len(self._kept) > KEPT:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(key)
            return gated

    def lines(self, run: RunRow, *, after: int, limit: int) -> list[dict[str, Any]]:
        """Of its log, each with its number from 1; after: behind this one. As ``of``."""
        rows = enumerate(rows_of(log_of(self._reading, run)), start=1)
        return [{"line": number, **row} for number, row in islice(rows, after, after + limit)]


def _stamp(trays: Path) -> list[int]:
    """RequestError: the controller's log is gone."""
    try:
        return file_stamp(trays)
    except OSError as error:
        remedy = "put it back, or start the console without --trays"
        raise RequestError(trays, f"cannot be read ({error.strerror})", remedy=remedy) from error


def gate_facts(run: RunRow, gated: Gated) -> dict[str, Any]:
    """A run's sheets in counts, and how its gate was set."""
    found, kept = gated.found, gated.kept
    return {
        "run": run.id,
        "sessions": kept.sessions,
        "settings": kept.began.get("settings", {}),
        "trays_from": found.source,
        "disagreements": [asdict(one) for one in found.disagreements],
        "counts": dict(found.counts),
        "lost_by": dict(found.lost_by),
        "not_in_the_journal": sum(not one.in_journal for one in found.sheets if one.sheet is not None),
    }


def sheet_facts(gated: Gated, one: Accounted) -> dict[str, Any]:
    """What became of a sheet, and what was decided and written of it."""
    tag = None if one.sheet is None else one.sheet + 1
    decided = {} if tag is None else gated.kept.decisions.get(tag, {})
    told = asdict(one)
    told["set"] = told.pop("set_number") if decided else None
    return told | {
        "tag": tag if decided else None,
        "position": decided.get("position"),
        "written": tag in gated.kept.written,
    }


def log_of(reading: Reading, run: RunRow) -> Path:
    """Where the log of a run's gate lies; ``Problem`` 404: there is none."""
    path = log_path(reading.path, run.id)
    if not path.is_file():
        raise not_found(f"run {run.id} had no gate")
    return path


def all_pages(reading: Reading, run: RunRow) -> Iterator[PageRecord]:
    """Of a run, by number; those that cannot be read are left out."""
    after, asked = -1, Asked(run_id=run.id)
    while rows := reading.sheets(asked, after=after, limit=AT_ONCE, damaged=lambda _: None):
        yield from (row.page for row in rows)
        after = rows[-1].page.sheet
