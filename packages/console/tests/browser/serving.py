"""A console that serves in a thread, which can end and come again at the same address; and people who may use it."""

from __future__ import annotations

import socket
import threading
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import uvicorn
from packages.console.tests.consoles import PASSWORD, QUICK, Clock
from packages.console.tests.engineering_steps import at_usual_priority

from prooflight_console.accounts.roles import Role
from prooflight_console.app import console_app
from prooflight_console.running import LOOPBACK, ConsoleServer
from prooflight_console.settings import ConsoleSettings

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from fastapi import FastAPI

    from prooflight_console.accounts.account_store import Accounts
    from prooflight_console.console import Console
    from prooflight_console.zones.prices import Prices

STARTS_S: Final = 60.0
"""Longer than any machine takes; nothing waits so long where all is well."""


@dataclass
class Serving:
    """Of one journal. ``clock``: of sessions and of the audit; sheets have their own times."""

    journal: Path
    settings: dict[str, Any] = field(default_factory=dict)
    clock: Clock = field(default_factory=lambda: Clock(now_s=1_780_050_000.0))
    port: int = 0
    prices: Prices | None = None
    ticking: Callable[[], float] = time.monotonic
    """By which a press is silent that brings no sheet."""
    _server: ConsoleServer | None = None
    _thread: threading.Thread | None = None

    @property
    def address(self) -> str:
        return f"http://{LOOPBACK}:{self.port}"

    @property
    def app(self) -> FastAPI:
        assert self._server is not None
        made: FastAPI = self._server.config.app
        return made

    @property
    def console(self) -> Console:
        held: Console = self.app.state.console
        return held

    @property
    def accounts(self) -> Accounts:
        return self.console.accounts

    def start(self) -> None:
        """Serve, at the same address as before where there was one."""
        made = ConsoleSettings.of(self.journal, **self.settings)
        app = console_app(
            made,
            clock=self.clock,
            ticking=self.ticking,
            passwords=QUICK,
            prices=self.prices,
            step=at_usual_priority,
        )
        bound = socket.socket()
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((LOOPBACK, self.port))
        bound.listen(64)
        self.port = bound.getsockname()[1]
        config = uvicorn.Config(app, log_level="error", access_log=False, timeout_graceful_shutdown=1)
        self._server = ConsoleServer(config, app.state.console.live)
        self._thread = threading.Thread(target=self._server.run, kwargs={"sockets": [bound]}, daemon=True)
        self._thread.start()
        pause = threading.Event()
        while not self._server.started and self._thread.is_alive():
            pause.wait(0.01)
        assert self._server.started, "the console did not start"

    def stop(self) -> None:
        """End it, as a signal would."""
        if self._server is None or self._thread is None:
            return
        self._server.config.app.state.console.live.close()
        self._server.should_exit = True
        self._thread.join(STARTS_S)
        assert not self._thread.is_alive()
        self._server = self._thread = None

    def person(self, role: Role, name: str | None = None) -> str:
        """Somebody of that role, who has chosen ``PASSWORD``; returns their name."""
        name = name or role.value
        if name not in {one.name for one in self.accounts.people()}:
            secret = self.accounts.add(name, role, by="test")
            assert self.accounts.choose(secret, PASSWORD) is not None
        return name
