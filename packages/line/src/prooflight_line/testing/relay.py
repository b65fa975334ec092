"""A link that can be cut and delayed: a TCP relay between a client and a server."""

from __future__ import annotations

import asyncio
import threading
from contextlib import suppress
from typing import Self


class Relay:
    """Relay that passes bytes on; use it as a context. ``cut`` and ``delay_s`` may be set from any thread."""

    def __init__(self, host: str, port: int) -> None:
        """Prepare a relay to this address."""
        self._to = host, port
        self.port = 0
        self.delay_s = 0.0
        """Time by which each piece is delayed, in either direction."""
        self._cut = False
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="relay", daemon=True)
        self._started, self._ended = threading.Event(), asyncio.Event()
        self._writers: set[asyncio.StreamWriter] = set()
        self._tasks: set[asyncio.Task[None]] = set()

    def __enter__(self) -> Self:
        self._thread.start()
        self._started.wait()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()

    def cut(self) -> None:
        """Break all connections, and refuse new ones."""
        self._loop.call_soon_threadsafe(self._break)

    def repair(self) -> None:
        """Accept connections again."""
        self._loop.call_soon_threadsafe(self._reconnect)

    def _break(self) -> None:
        self._cut = True
        for writer in self._writers:
            writer.transport.abort()

    def _reconnect(self) -> None:
        self._cut = False

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        server = await asyncio.start_server(self._joined, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        self._started.set()
        await self._ended.wait()
        server.close()
        self._break()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _joined(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        own = asyncio.current_task()
        if own is not None:
            self._tasks.add(own)
        self._writers.add(writer)
        there: asyncio.StreamWriter | None = None
        try:
            if self._cut:
                return
            back, there = await asyncio.open_connection(*self._to)
            self._writers.add(there)
            await asyncio.gather(self._pass(reader, there), self._pass(back, writer))
        except (OSError, asyncio.CancelledError):
            return
        finally:
            for one in filter(None, (writer, there)):
                self._writers.discard(one)
                one.transport.abort()
                with suppress(OSError, asyncio.CancelledError):
                    await one.wait_closed()
            if own is not None:
                self._tasks.discard(own)

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(4096):
            if self.delay_s:
                await asyncio.sleep(self.delay_s)
            writer.write(data)
            await writer.drain()
        raise ConnectionResetError
