"""Consoles for tests: a journal with a run of misprints, people of every role, and a clock that is set."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from argon2 import PasswordHasher
from packages.line.tests.journal.sample_rows import facts, good, misprint
from starlette.testclient import TestClient

from prooflight_console.accounts.passwords import Passwords
from prooflight_console.accounts.roles import Role
from prooflight_console.app import console_app
from prooflight_console.engineering.steps import step_aside
from prooflight_console.settings import ConsoleSettings
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from fastapi import FastAPI

    from prooflight_console.accounts.account_store import Accounts
    from prooflight_console.console import Console

QUICK = Passwords(PasswordHasher(time_cost=1, memory_cost=8, parallelism=1))
"""The same argon2, cheap: what it costs is no subject of these tests."""
PASSWORD = "correct horse battery"
ADDRESS = "http://testserver"


@dataclass
class Clock:
    """Seconds, set by tests."""

    now_s: float = 1_000_000.0

    def __call__(self) -> float:
        return self.now_s


def write_run(path: Path, *, sheets: int = 30, bad: tuple[int, ...] = (10, 11, 12), **changes: Any) -> int:
    """A run of a journal, with no end."""
    with Journal.open(str(path)) as journal:
        run = journal.begin_run(facts(**changes))
        for sheet in range(sheets):
            journal.record(run, misprint(sheet) if sheet in bad else good(sheet))
        journal.commit()
        return run


@dataclass
class Served:
    """A console and whoever asks it."""

    app: FastAPI
    clock: Clock
    journal: Path
    clients: list[TestClient] = field(default_factory=list)

    @property
    def console(self) -> Console:
        held: Console = self.app.state.console
        return held

    @property
    def accounts(self) -> Accounts:
        return self.console.accounts

    def client(self, role: Role | None = None) -> TestClient:
        """Somebody of that role who signed in, with the CSRF token in every request; None: nobody."""
        made = TestClient(self.app, base_url=ADDRESS, raise_server_exceptions=False)
        self.clients.append(made)
        if role is None:
            return made
        name = role.value
        if name not in {person.name for person in self.accounts.people()}:
            self.accounts.choose(self.accounts.add(name, role, by="test"), PASSWORD)
        answer = made.post("/api/v1/session", json={"name": name, "password": PASSWORD})
        assert answer.status_code == 200, answer.text
        made.headers["X-CSRF-Token"] = answer.json()["csrf"]
        return made

    def close(self) -> None:
        for client in self.clients:
            client.close()
        self.console.pictures.close()
        self.console.reading.close()
        self.accounts.close()


def served(
    folder: Path, *, run: bool = True, step: Callable[..., None] = step_aside, **settings: Any
) -> Served:
    """A console on a new journal."""
    journal, clock = folder / "journal.sqlite", Clock()
    if run:
        write_run(journal)
    made = ConsoleSettings.of(journal, **settings)
    return Served(
        app=console_app(made, clock=clock, ticking=clock, passwords=QUICK, step=step),
        clock=clock,
        journal=journal,
    )
