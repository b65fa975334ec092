"""The inputs from which a sheet's verdict is repeated: its evidence, and the press of its run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from prooflight_console.problems import Problem, not_found

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight_console.console import Console
    from prooflight_line.journal.records import PageRecord, RunRow


def replayable(console: Console, run: str, sheet: int) -> tuple[RunRow, PageRecord, Press]:
    """Return the run, the sheet with its evidence, and the press; raises ``Problem`` if one is missing."""
    run_row = console.reading.run_named(run)
    page = console.reading.sheet(run_row.id, sheet)
    evidence_of(page, run=run_row.id)
    press = console.stations.press(run_row)
    if press is None:
        named = f"press {run_row.facts.press}, digest {run_row.facts.press_digest[:16]}"
        raise Problem(409, "no-press", f"start the console with --press and the artefact of {named}")
    return run_row, page, press


def evidence_of(page: PageRecord, *, run: int | str) -> Mapping[str, NDArray[Any]]:
    """Return the stored evidence of a sheet; raises ``Problem`` if there is none."""
    if page.evidence is None:
        raise not_found(f"no evidence of sheet {page.sheet} of run {run} is stored")
    return page.evidence
