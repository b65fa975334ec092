"""A running console: the address at which it listens, the settings it refuses, and how it ends."""

from __future__ import annotations

import gc
import ipaddress
import multiprocessing
import os
import signal
import socket
import ssl
import threading
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import uvicorn
from uvicorn.config import LOGGING_CONFIG

from prooflight.cli import event_log, faults
from prooflight.errors import RequestError
from prooflight_console.app import console_app
from prooflight_console.settings import ConsoleSettings

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import FrameType

    from prooflight_console.console import Console

PORT: Final = 8080
LOOPBACK: Final = "127.0.0.1"
GRACE_S: Final = 3
"""Time that open responses have to finish when the console ends. [s]"""
NICE: Final = 5
"""Niceness of the console's process, which gives way to inspection."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Listening:
    """Address and certificate with which a console listens."""

    host: str = LOOPBACK
    port: int = PORT
    certificate: Path | None = None
    """Chain of certificates as PEM; with ``key``, the console is reached by TLS."""
    key: Path | None = None

    @property
    def address(self) -> str:
        """Address for a browser on this machine."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.certificate else 'http'}://{host}:{self.port}"

    def reached_at(self, port: int, origins: Sequence[str] = ()) -> str:
        """Return the address at which a browser reaches the console.

        An unspecified address ("listen on all") cannot be opened; the first origin or the host's name
        replaces it.

        Parameters
        ----------
        port
            Port on which the console listens.
        origins
            Further addresses at which the console is known to be reached.
        """
        if not _is_any(self.host):
            return self.address.rpartition(":")[0] + f":{port}"
        return next(iter(origins), replace(self, host=socket.gethostname(), port=port).address)

    def check(self) -> None:
        """Raise RequestError if others could read along, or if the certificate cannot be used."""
        if (self.certificate is None) != (self.key is None):
            raise RequestError("serve", "--tls-cert and --tls-key go together", remedy="give both or neither")
        if self.certificate is None:
            if not _is_loopback(self.host):
                what = f"without TLS passwords and sessions could be read on the way to {self.host}"
                remedy = "give --tls-cert and --tls-key, or stay on 127.0.0.1 behind a proxy that has TLS"
                raise RequestError("serve", what, remedy=remedy)
            return
        assert self.key is not None
        for path in (self.certificate, self.key):
            if not path.is_file():
                raise RequestError(path, "is not a file", remedy="give a certificate and its key as PEM")
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(self.certificate, self.key, password="")
        except (ssl.SSLError, OSError, ValueError) as error:
            what = f"cannot be used with {self.key.name} ({getattr(error, 'reason', None) or error})"
            raise RequestError(
                self.certificate, what, remedy="give PEM files that belong together"
            ) from error

    def bound(self) -> socket.socket:
        """Return a listening socket; raises RequestError if the address is taken."""
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        listener = socket.socket(family, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((self.host, self.port))
        except (OSError, OverflowError) as error:
            listener.close()
            what = (
                f"cannot listen at {self.host} port {self.port} ({getattr(error, 'strerror', None) or error})"
            )
            raise RequestError("serve", what, remedy="give another --port or --host") from error
        listener.listen(512)
        return listener


class ConsoleServer(uvicorn.Server):
    """Server that ends live events when it stops, so that browsers reconnect and do not keep it running."""

    def __init__(self, config: uvicorn.Config, live: Any) -> None:
        super().__init__(config)
        self._live = live
        self.interrupted = False

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Record an interrupt, close the live events and stop the server."""
        self.interrupted |= sig == signal.SIGINT
        self._live.close()
        super().handle_exit(sig, frame)


def serve(
    settings: ConsoleSettings, listening: Listening, *, ready: Callable[[str, str | None], None]
) -> None:
    """Serve until a signal ends the console.

    Parameters
    ----------
    ready
        Called with the address, and with the link for a first admin if nobody can sign in yet.

    Raises
    ------
    RequestError
        If the console cannot listen as requested.
    """
    listening.check()
    with listening.bound() as bound:
        app = console_app(settings)
        console = app.state.console
        secret = console.accounts.first_link()
        port = bound.getsockname()[1]
        address = listening.reached_at(port, settings.origins)
        config = uvicorn.Config(
            app,
            log_level="warning",
            access_log=False,
            log_config=None if event_log.is_on() else LOGGING_CONFIG,
            server_header=False,
            timeout_graceful_shutdown=GRACE_S,
            ssl_certfile=listening.certificate,
            ssl_keyfile=listening.key,
            proxy_headers=False,
        )
        ready(address, None if secret is None else f"{address}/welcome#{secret}")
        threading.Thread(target=warm, args=(console,), name="warm", daemon=True).start()
        server = ConsoleServer(config, console.live)
        server.run(sockets=[bound])
        if server.interrupted:
            # uvicorn raises the signal again, but on a busy machine that signal is sometimes lost.
            raise KeyboardInterrupt


def warm(console: Console) -> None:
    """Load in advance, so that the first request need not wait.

    Loading a press takes a quarter of a second. A full garbage collection, which Python runs now and then,
    takes a sixth of a second over all loaded objects, so these are frozen.
    """
    console.pictures.warm()
    console.stations.warm()
    gc.collect()
    gc.freeze()  # loaded objects stay, and need not be collected again


def spawned(settings: ConsoleSettings, listening: Listening, ready: Callable[[str, str | None], None]) -> Any:
    """Start a console in a process of its own, which ends with this one, and return the process.

    Raises RequestError before the process starts.
    """
    listening.check()
    listening.bound().close()
    process = multiprocessing.get_context("spawn").Process(
        target=_serve_aside,
        args=(settings, listening, ready, "json" if event_log.is_on() else "text"),
        name="console",
    )
    process.start()
    return process


def _serve_aside(
    settings: ConsoleSettings,
    listening: Listening,
    ready: Callable[[str, str | None], None],
    log: Literal["text", "json"],
) -> None:
    if hasattr(os, "nice"):
        os.nice(NICE)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles the terminal's Ctrl-C
    _end_with_parent()
    # A terminal's Ctrl-C comes to this process too, by the server's own handler; the parent reports the end.
    with faults.logged(["serve"]), suppress(KeyboardInterrupt):
        event_log.begin(log)
        serve(settings, listening, ready=ready)


def _end_with_parent() -> None:
    """End this process when its parent ends, even if the parent is killed."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def wait() -> None:
        parent.join()
        os.kill(os.getpid(), 15)

    threading.Thread(target=wait, name="parent", daemon=True).start()


def _is_any(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return not host


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
