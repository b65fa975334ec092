"""Peers of outlets on loopback: a broker, a receiver of posts, and a proxy that cuts and delays links."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import socket
import subprocess
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any, Self

import pytest
from packages.line.tests.plant.runs import LONGEST_S, Heard

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

HERE = "127.0.0.1"


def free_port() -> int:
    with socket.socket() as found:
        found.bind((HERE, 0))
        return int(found.getsockname()[1])


class Broker:
    """Debian's mosquitto, which may be ended and started again on its port."""

    def __init__(self, folder: Path, port: int, lines: tuple[str, ...]) -> None:
        self.port, self._config = port, folder / "mosquitto.conf"
        self._config.write_text("\n".join((f"listener {port} {HERE}", *lines, "")), encoding="utf-8")
        self._process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        program = shutil.which("mosquitto") or "/usr/sbin/mosquitto"
        self._process = subprocess.Popen(
            [program, "-c", str(self._config)], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        )
        assert self._process.stderr is not None
        for line in self._process.stderr:
            if "running" in line:
                break
        else:
            pytest.fail("mosquitto did not start")
        self._drain = threading.Thread(target=self._process.stderr.read, daemon=True)
        self._drain.start()

    def end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._drain.join()
            if self._process.stderr is not None:
                self._process.stderr.close()
            self._process = None


@contextlib.contextmanager
def broker(folder: Path, *lines: str) -> Iterator[Broker]:
    if not (shutil.which("mosquitto") or shutil.which("/usr/sbin/mosquitto")):
        pytest.skip("mosquitto is not installed")
    found = Broker(folder, free_port(), lines or ("allow_anonymous true",))
    found.start()
    try:
        yield found
    finally:
        found.end()


class Proxy:
    """Forwards TCP to a port on loopback; it can hold what it forwards back, cut its links, and refuse new ones."""

    def __init__(self, target: int) -> None:
        self._target, self.port = target, 0
        self._loop = asyncio.new_event_loop()
        self._open: asyncio.Event
        self._links: set[asyncio.StreamWriter] = set()
        self._refusing = False
        self.links = Heard()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self.port = self._do(self._start())
        return self

    def __exit__(self, *_: object) -> None:
        self.cut()
        self._do(self._stop())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def cut(self, *, refusing: bool = False) -> None:
        """End all links; refusing: new ones as well, until ``repair``."""
        self._do(self._cut(refusing))

    def repair(self) -> None:
        self._do(self._cut(False, links=False))

    def hold(self) -> None:
        """Forward nothing until ``go``; nobody is told, as where a cable is pulled."""
        self._do(self._set(False))

    def go(self) -> None:
        self._do(self._set(True))

    def _do(self, work: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(LONGEST_S)

    async def _start(self) -> int:
        self._open = asyncio.Event()
        self._open.set()
        self._server = await asyncio.start_server(self._link, HERE, 0)
        return int(self._server.sockets[0].getsockname()[1])

    async def _stop(self) -> None:
        self._server.close()
        self._open.set()
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _set(self, is_open: bool) -> None:
        (self._open.set if is_open else self._open.clear)()

    async def _cut(self, refusing: bool, *, links: bool = True) -> None:
        self._refusing = refusing
        if links:
            for writer in list(self._links):
                writer.transport.abort()

    async def _link(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._refusing:
            writer.transport.abort()
            return
        try:
            there, back = await asyncio.open_connection(HERE, self._target)
        except OSError:
            writer.transport.abort()
            return
        self._links |= {writer, back}
        self.links(len(self.links.all) + 1)
        try:
            await asyncio.gather(self._pass(reader, back), self._pass(there, writer))
        finally:
            self._links -= {writer, back}
            writer.transport.abort()
            back.transport.abort()

    async def _pass(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while data := await source.read(65536):
                await self._open.wait()
                sink.write(data)
                await sink.drain()
        sink.transport.abort()


class Receiver:
    """A web server that keeps what it is posted; ``answers`` are given in turn, then 204."""

    def __init__(self) -> None:
        self.heard = Heard()
        self.answers: list[int] = []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                code = outer.answers.pop(0) if outer.answers else 204
                outer.heard((code, dict(self.headers), body))
                self.send_response(code)
                self.send_header("Content-Length", "0")
                self.end_headers()

            def do_HEAD(self) -> None:
                self.send_response(405)
                self.send_header("Content-Length", "0")
                self.end_headers()

            def log_message(self, *_: object) -> None:
                """Say nothing."""

        class Server(ThreadingHTTPServer):
            daemon_threads = True

            def handle_error(self, *_: object) -> None:
                """A link that is cut is what the test wants."""

        self._server = Server((HERE, 0), Handler)
        self._server.daemon_threads = True
        self.port = self._server.server_port
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)

    @property
    def taken(self) -> list[Any]:
        """What was answered well."""
        return [one for one in self.heard.all if one[0] < 300]

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
