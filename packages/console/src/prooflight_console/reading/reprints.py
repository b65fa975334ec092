"""Sheets to print again of any run, as ``plant.reprinting`` determines them, for all their readers."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from dataclasses import asdict, dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import ProoflightError
from prooflight.pages.memory import file_stamp
from prooflight_console.reading.imposition import MOST_LISTED, positions_passed
from prooflight_console.reading.runs import pages_to_review
from prooflight_line.journal.following import PageQuery
from prooflight_line.journal.labels import Labels, run_key
from prooflight_line.journal.reading import refuse
from prooflight_line.plant.gate.log import log_path
from prooflight_line.plant.reprinting import reprint_list

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_console.reading.gate import Gated, Gates
    from prooflight_console.reading.incidents import RunIncidents
    from prooflight_console.reading.runs import Reading
    from prooflight_line.journal.labels import LabelStore
    from prooflight_line.journal.records import PageRecord, RunRow
    from prooflight_line.plant.gate.reconciling import Disagreement
    from prooflight_line.plant.reprinting import ReprintList

MOST_STORED: Final = 16
"""Number of runs whose lists are cached."""
QUICK_S: Final = 0.05
SHARE: Final = 20
"""Inverse share of time spent on lists for Now.

A list that takes more processor time than ``QUICK_S`` is made again in one part of so many of the time.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Counted:
    """Sheets to print again as Now shows them."""

    count: int | None
    """Number of sheets; None if they cannot be counted."""
    unprinted: int = 0
    """Number of them that were not printed when the run ended."""
    trouble: str = ""
    """Reason why they cannot be counted."""
    disagreements: int = 0
    """Number of sheets for which the controller's log and the wire name different trays."""
    gated: Gated | None = None
    """State of the gate's sheets; None if the run had no gate."""


@dataclass(slots=True)
class _Lately:
    forced: tuple[Any, ...] | None = None
    """Run, its state and its last label: a change of these needs a new count at once."""
    at_s: float = 0.0
    took_s: float = 0.0
    counted: Counted | None = None


class Reprints:
    """Cache of lists, made again when the run, its labels or its gate's log have got further."""

    def __init__(
        self,
        reading: Reading,
        incidents: RunIncidents,
        label_store: LabelStore,
        gates: Gates,
        *,
        trays: Path | None,
    ) -> None:
        """Create the cache. trays: the controller's log of its trays."""
        self._reading, self._incidents, self._label_store, self._gates = (
            reading,
            incidents,
            label_store,
            gates,
        )
        self._trays = trays
        self._guard = threading.Lock()
        self._stored: OrderedDict[tuple[Any, ...], ReprintList] = OrderedDict()
        self._lately = _Lately()

    def of(self, run: RunRow) -> ReprintList:
        """Return the sheets to print again.

        Raises ProoflightError if the gate's log, the controller's log or a sheet of the journal cannot be
        read.
        """
        key = self._key(run)
        with self._guard:
            if (stored := self._stored.get(key)) is None:
                stored = self._stored[key] = self._listed(run)
                while len(self._stored) > MOST_STORED:
                    self._stored.popitem(last=False)
            self._stored.move_to_end(key)
            return stored

    def counted(self, run: RunRow) -> Counted:
        """Return the count for Now, which may lag some sheets behind in a long run."""
        forced = run_key(run), run.state, self._label_store.last()
        lately, now_s, began_s = self._lately, time.monotonic(), time.thread_time()
        waits = lately.took_s > QUICK_S and now_s - lately.at_s < SHARE * lately.took_s
        if lately.counted is None or lately.forced != forced or not waits:
            counted = self.count(run)
            lately = _Lately(forced=forced, at_s=now_s, took_s=time.thread_time() - began_s, counted=counted)
            self._lately = lately
        assert lately.counted is not None
        return lately.counted

    def gated(self, run: RunRow) -> Gated | None:
        """Return the accounts of a run with a gate; None if it had none. Raises ProoflightError as ``of``."""
        return self._gates.of(run) if log_path(self._reading.path, run.id).is_file() else None

    def count(self, run: RunRow) -> Counted:
        """Return the current count, or why there is none."""
        try:
            listed, gated = self.of(run), self.gated(run)
        except (ProoflightError, OSError) as error:
            return Counted(count=None, trouble=str(error))
        return Counted(
            count=len(listed),
            unprinted=len(listed.unprinted),
            disagreements=0 if gated is None else len(disagreements(run, gated)),
            gated=gated,
        )

    def _key(self, run: RunRow) -> tuple[Any, ...]:
        counts = run.pages, run.misprints, run.not_inspected, run.state
        files = (log_path(self._reading.path, run.id), self._trays)
        return run_key(run), *counts, self._label_store.last(), *map(_stamp, files)

    def _listed(self, run: RunRow) -> ReprintList:
        labels = Labels(self._label_store.of_run(run_key(run)))
        rows = list(pages_to_review(self._reading, run, damaged=refuse))
        gated = self.gated(run)
        return reprint_list(
            run,
            self._with_others(run, rows, labels),
            passed=positions_passed(self._reading, run, rows),
            labels=labels,
            incident_of=self._incidents.incident_by_sheet(run).get,
            gate=None if gated is None else (gated.log, gated.accounts),
        )

    def _with_others(self, run: RunRow, rows: list[PageRecord], labels: Labels) -> list[PageRecord]:
        """Return rows to review, rows with a label, and all prints of sheets that came again."""
        row_of_sheet = {row.sheet: row for row in rows}
        again = {row.job_page for row in rows if "repeated" in row.faults and row.job_page is not None}
        query = PageQuery(run_id=run.id, sheets=tuple(labels.sheets), job_pages=tuple(again))
        after = -1
        while (labels.sheets or again) and (
            more := self._reading.sheets(query, after=after, limit=1000, damaged=refuse)
        ):
            row_of_sheet |= {row.page.sheet: row.page for row in more}
            after = more[-1].page.sheet
        return [row_of_sheet[sheet] for sheet in sorted(row_of_sheet)]


def disagreements(run: RunRow, gated: Gated) -> list[Disagreement]:
    """Return the disagreements between the controller's log and the wire.

    While the run goes on, rows of the log may still be to come, so a missing row is none.
    """
    return [one for one in gated.accounts.disagreements if one.file or run.state != "running"]


def reprint_facts(
    run: RunRow, listed: ReprintList, incidents: RunIncidents, gated: Gated | None
) -> dict[str, Any]:
    """Return the list for programs; see ``ReprintAnswer``."""
    sheets = []
    for one in islice(listed.all(), MOST_LISTED):
        facts = asdict(one)
        facts["set"] = facts.pop("set_number")
        facts["incident"] = None if one.sheet is None else incidents.of_sheet(run, one.sheet)
        sheets.append(facts | {"pages": list(one.pages)})
    return {
        "count": len(listed),
        "unprinted": len(listed.unprinted),
        "sheets": sheets,
        "pages": dict(listed.pages()),
        "truncated": len(listed) > len(sheets),
        "by": listed.by,
        "trays_from": listed.trays_from,
        "released_manually": list(listed.vouched),
        "disagreements": [] if gated is None else [asdict(one) for one in disagreements(run, gated)],
    }


def _stamp(path: Path | None) -> tuple[int, ...]:
    """Return the stamp of a file; empty if there is none."""
    try:
        return () if path is None else tuple(file_stamp(path))
    except OSError:
        return ()
