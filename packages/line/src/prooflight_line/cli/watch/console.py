"""``watch --serve``: the console of another package in a process of its own, next to the run that it shows."""

from __future__ import annotations

from contextlib import contextmanager
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    Announce = Callable[[str, str | None], None]

GROUP: Final = "prooflight.consoles"
"""Entry points of consoles: functions with the parameters of ``console_alongside`` but the first, which start one, and
return the process that serves it."""
END_S: Final = 10.0
"""Time for a console to end; then it is killed."""


@contextmanager
def console_alongside(
    wanted: bool,
    *,
    journal: str | None,
    press: Path,
    job: Path,
    port: int,
    trays: Path | None = None,
    announce: Announce | None = None,
) -> Iterator[None]:
    """Run the console from before the run until after it; it only reads the journal. RequestError: it cannot run.

    ``trays`` is the controller's log of its trays. ``announce`` receives the address, and the link for a first
    admin, in the console's process; None: they are printed.
    """
    if not wanted:
        yield
        return
    if journal == "none":
        raise RequestError("--serve", "shows the contents of a journal", remedy="leave out --journal none")
    from prooflight_line.journal.opening import default_journal, journal_path
    from prooflight_line.plant.gate.reconciling import read_trays

    consoles = list(entry_points(group=GROUP))
    if not consoles:
        remedy = "pip install prooflight-console, or leave --serve out"
        raise RequestError("--serve", "prooflight-console is not installed", remedy=remedy)
    if trays is not None:
        read_trays(trays)
    process = consoles[0].load()(
        journal=journal_path(journal or str(default_journal())).absolute(),
        press=press.absolute(),
        job=job.absolute(),
        port=port,
        trays=None if trays is None else trays.absolute(),
        announce=announce,
    )
    try:
        yield
    finally:
        process.terminate()
        process.join(END_S)
        if process.is_alive():
            process.kill()
            process.join()
