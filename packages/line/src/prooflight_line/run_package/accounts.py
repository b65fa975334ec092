"""The account of a run's sheets at the gate, and of those to print again, read from its journal; and its press."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from prooflight.errors import PressError, RequestError
from prooflight.press.artefact import Press
from prooflight_line.journal.labels import Labels, LabelStore, run_key
from prooflight_line.plant.gate.log import LoggedDecisions, log_path
from prooflight_line.plant.gate.reconciling import read_trays, reconciled
from prooflight_line.plant.reprinting import reprint_list
from prooflight_line.run.labelled_sheets import incidents_by_sheet

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_line.journal.reading import JournalReader
    from prooflight_line.journal.records import PageRecord, RunRow
    from prooflight_line.plant.gate.reconciling import Reconciliation
    from prooflight_line.plant.reprinting import ReprintList


def accounts_of(
    journal: JournalReader, run: RunRow, trays: Path | None = None
) -> tuple[ReprintList, Reconciliation | None]:
    """Return the sheets of a run to print again, and the account of its sheets; None if it had no gate.

    PlantError: the gate's log is damaged. RequestError: the controller's log is none, or is not of this run.
    """
    incident_of = incidents_by_sheet(journal.pages(run.id, passed=False))[1].get
    pages = [_brief(page) for page in journal.pages(run.id)]
    path, gate = log_path(journal.path, run.id), None
    if path.is_file():
        gate_log = LoggedDecisions.read(path)
        rows = None if trays is None else read_trays(trays)
        gate = gate_log, reconciled(pages, gate_log, rows)
        if trays is not None and gate_log.sessions and gate[1].source == "wire":
            remedy = "give the log that the controller wrote during the run, or leave out --trays"
            raise RequestError(trays, f"has no sheet of run {run.id}", remedy=remedy)
    listed = reprint_list(
        run,
        pages,
        passed=max((page.job_page + 1 for page in pages if page.job_page is not None), default=0),
        labels=Labels(LabelStore(journal.path).of_run(run_key(run))),
        incident_of=incident_of,
        gate=gate,
    )
    return listed, None if gate is None else gate[1]


def _brief(page: PageRecord) -> PageRecord:
    """Return a record without what no account needs, so that those of a long run fit into memory."""
    return replace(page, verdict=replace(page.verdict, regions=(), codes=(), inks={}), nuisance={}, notes=())


# --- the press artefact by which a run was judged ---


def press_of_run(path: Path, *, name: str, digest: str) -> Press:
    """Load a press artefact; PressError: it is none, or not the one by which the run was judged.

    name, digest: of the press, as the run's record has them.
    """
    press = Press.load(path)
    if digest != press.digest:
        what = f"has digest {press.digest[:16]}, the run was judged by {digest[:16]}"
        raise PressError(path, what, remedy=f"give the artefact of press {name} that the run used")
    return press
