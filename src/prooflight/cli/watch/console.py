"""``watch --serve``: the console in a process of its own, next to the run that it shows."""

from __future__ import annotations

from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Final

from prooflight.cli import faults
from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    Announce = Callable[[str, str | None], None]

MISSING: Final = 'install it with pip install "prooflight[server]"'
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
        raise RequestError("--serve", "shows what the journal holds", remedy="leave out --journal none")
    needed()
    from prooflight.journal.opening import default_journal, journal_path
    from prooflight.plant.gate.reconciling import read_trays
    from prooflight.server.running import Listening, spawned
    from prooflight.server.settings import ConsoleSettings

    if trays is not None:
        read_trays(trays)
    settings = ConsoleSettings.of(
        journal_path(journal or str(default_journal())).absolute(),
        trays=None if trays is None else trays.absolute(),
        presses=(press.absolute(),),
        jobs=(job.absolute(),),
    )
    process = spawned(settings, Listening(port=port), announce or print_address)
    try:
        yield
    finally:
        process.terminate()
        process.join(END_S)
        if process.is_alive():
            process.kill()
            process.join()


def print_address(address: str, link: str | None) -> None:
    """Print on standard error, because the run's output goes to standard output."""
    faults.report(f"the console is at {address}")
    if link is not None:
        faults.report(f"nobody can sign in yet; open this link once to choose the admin's password: {link}")


def needed() -> None:
    """Raise RequestError if the extra is not installed."""
    for name in ("argon2", "fastapi", "python_multipart", "uvicorn"):
        if find_spec(name) is None:
            raise RequestError("serve", f"{name} is not installed", remedy=MISSING)
