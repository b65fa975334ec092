"""A console for a study: its session, port, and the CPU time and memory of its process."""

from __future__ import annotations

import os
import socket
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from prooflight_console.accounts.account_store import Accounts
from prooflight_console.accounts.roles import Role
from prooflight_console.running import LOOPBACK

if TYPE_CHECKING:
    from prooflight_console.settings import ConsoleSettings

STARTS_S: Final = 300.0
"""Time that a console has to start: most of it on a machine that does much else. [s]"""


def session(settings: ConsoleSettings, *, role: Role = Role.VIEWER) -> str:
    """Sign in a user of this role and return the session."""
    accounts = Accounts(settings.data)
    try:
        accounts.add(role.value, role, by="study")
        return accounts.begin(role.value)
    finally:
        accounts.close()


def nothing(_address: str, _link: str | None) -> None:
    """Ignore the console's address, which the study knows."""


def free_port() -> int:
    """Return a port of the loopback interface that is free at this moment."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def wait_until_it_answers(port: int) -> None:
    """Wait until a server accepts connections at the port; OSError: none does in time."""
    until = time.monotonic() + STARTS_S
    while True:
        try:
            socket.create_connection((LOOPBACK, port), timeout=1).close()
        except OSError:
            if time.monotonic() > until:
                raise
            time.sleep(0.05)
        else:
            return


def cpu_s(pid: int) -> float | None:
    """Return the CPU time of a process so far, including its threads; Linux only, proc(5)."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    except OSError:
        return None
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def megabytes(pid: int) -> float | None:
    """Return the resident memory of a process; Linux only, proc(5)."""
    try:
        fields = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()
    except OSError:
        return None
    return int(fields[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
