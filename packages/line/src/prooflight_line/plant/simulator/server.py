"""The simulated controller as a Modbus TCP server in a thread of its own, which also scans its ladder program."""

from __future__ import annotations

import asyncio
import threading
from typing import TYPE_CHECKING, Final, Self

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from prooflight_line.plant.gate.log import PlantError
from prooflight_line.plant.gate.registers import READ_FROM, RING, RING_FROM, WRITTEN_WORDS
from prooflight_line.plant.simulator.feed import FEED_AT, FEED_WORDS, fed, feed_shown

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight_line.plant.simulator.plc import SimulatedPlc

SCAN_S: Final = 0.005
"""Time from scan to scan. assumed: the cycle of a small controller."""
WRITES: Final = frozenset({5, 6, 15, 16})
"""Functions of the protocol that write."""
REGISTERS: Final = 192


class PlcServer:
    """Server of a controller; use it as a context."""

    def __init__(
        self,
        plc: SimulatedPlc,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        first_register: int = 0,
        unit: int = 1,
        scan_s: float = SCAN_S,
    ) -> None:
        """Prepare the server.

        ``port`` 0 takes a free port, which the attribute ``port`` names after the start. PlantError, at the
        start: the port is taken.
        """
        self.plc = plc
        self._host, self.port, self._first, self._unit = host, port, first_register, unit
        self._scan_s = scan_s
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="simulated plc", daemon=True)
        self._started, self._ended = threading.Event(), asyncio.Event()
        self._failed: Exception | None = None
        self.hung = False
        """Whether the server takes requests and answers none."""

    def __enter__(self) -> Self:
        self._thread.start()
        self._started.wait()
        if self._failed is not None:
            what = f"cannot be listened on ({self._failed})"
            raise PlantError(f"{self._host}:{self.port}", what, remedy="give another --listen")
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()

    def call(self, what: Callable[[], object]) -> None:
        """Call a function between two scans, and wait for it."""
        done = threading.Event()

        def then() -> None:
            what()
            done.set()

        self._loop.call_soon_threadsafe(then)
        done.wait()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        bits = [SimData(0, values=[False] * 16, datatype=DataType.BITS)]
        registers = [SimData(self._first, values=[0] * REGISTERS, datatype=DataType.REGISTERS)]
        device = SimDevice(id=self._unit, simdata=(bits, bits, registers, registers), action=self._handle)
        server = ModbusTcpServer(device, address=(self._host, self.port))
        try:
            await server.serve_forever(background=True)
            self.port = self._port_of(server)
        except (OSError, RuntimeError) as error:
            self._failed = error
            self._started.set()
            return
        self._started.set()
        while not self._ended.is_set():
            self.plc.scan()
            await asyncio.sleep(self._scan_s)
        await server.shutdown()  # type: ignore[no-untyped-call]

    def _port_of(self, server: ModbusTcpServer) -> int:
        listening = server.transport
        sockets = listening.sockets if isinstance(listening, asyncio.Server) else ()
        return int(sockets[0].getsockname()[1])

    async def _handle(
        self,
        function: int,
        _start: int,
        address: int,
        count: int,
        registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Handle a request: fill registers for it, or take them from it."""
        while self.hung and not self._ended.is_set():
            await asyncio.sleep(self._scan_s)
        if function in WRITES:
            # A single coil is read once more after it was written.
            return None if values is None else self._written(function, address - self._first, list(values))
        shown = dict(enumerate(self.plc.registers))
        shown |= dict(enumerate(self.plc.shown(), start=READ_FROM))
        shown |= dict(enumerate(feed_shown(), start=FEED_AT))
        for at, value in shown.items():
            if function == 3:
                registers[at] = value
        if function == 1:
            registers[0] = registers[0] & ~1 | int(self.plc.coil)
        return None if address + count <= self._first + REGISTERS else ExcCodes.ILLEGAL_ADDRESS

    def _written(self, function: int, at: int, values: list[int] | list[bool]) -> ExcCodes | None:
        if function in (5, 15):
            self.plc.set_coil(bool(values[0]))
        elif at >= 0 and at + len(values) <= WRITTEN_WORDS:
            self.plc.write(at, [int(value) for value in values])
        elif at == FEED_AT and len(values) == FEED_WORDS:
            fed(self.plc, [int(value) for value in values])
        elif not READ_FROM <= at < RING_FROM + RING:
            return ExcCodes.ILLEGAL_ADDRESS
        else:
            return ExcCodes.ILLEGAL_VALUE
        return None
