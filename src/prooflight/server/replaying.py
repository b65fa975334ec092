"""What a sheet's verdict is made again from: its evidence, and the press of its run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from prooflight.server.problems import Problem, not_found

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from prooflight.journal.records import PageRecord, RunRow
    from prooflight.press.artefact import Press
    from prooflight.server.console import Console


def replayable(held: Console, run: str, sheet: int) -> tuple[RunRow, PageRecord, Press]:
    """Its run, the sheet with its evidence, and the press; Problem: one of them is not there."""
    found = held.reading.run_named(run)
    page = held.reading.sheet(found.id, sheet)
    kept_of(page, run=found.id)
    press = held.stations.press(found)
    if press is None:
        named = f"press {found.facts.press}, digest {found.facts.press_digest[:16]}"
        raise Problem(409, "no-press", f"start the console with --press and the artefact of {named}")
    return found, page, press


def kept_of(page: PageRecord, *, run: int | str) -> Mapping[str, NDArray[Any]]:
    """What was kept of a sheet; Problem: nothing was."""
    if page.evidence is None:
        raise not_found(f"no evidence of sheet {page.sheet} of run {run} is kept")
    return page.evidence
