"""The console next to a run, for ``prooflight watch --serve``: the entry point of the group ``prooflight.consoles``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.cli import event_log, faults

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.process import BaseProcess
    from pathlib import Path


def start(
    *,
    journal: Path,
    press: Path,
    job: Path,
    port: int,
    trays: Path | None,
    announce: Callable[[str, str | None], None] | None,
) -> BaseProcess:
    """Start the console of a journal in a process of its own, and return that process.

    Parameters
    ----------
    journal, press, job : absolute paths of the run's journal, its press artefact and its job
    port : where it listens, on loopback; 0: any free port
    trays : the controller's log of its trays; None: there is none
    announce : receives the address, and the link for a first admin, in that process; None: they are printed
    """
    from prooflight_console.running import Listening, spawned
    from prooflight_console.settings import ConsoleSettings

    settings = ConsoleSettings.of(journal, trays=trays, presses=(press,), jobs=(job,))
    return spawned(settings, Listening(port=port), announce or print_address)


def print_address(address: str, link: str | None) -> None:
    """Print the address, and the link for a first admin, on standard error.

    Standard output is the run's.
    """
    if event_log.write("listening", address=address):
        return  # the link belongs in no log; `prooflight serve user link` prints one
    faults.report(f"the console is at {address}")
    if link is not None:
        faults.report(f"no user can sign in yet; open this link once to choose the admin's password: {link}")
