"""A controller that knows nothing of Prooflight but docs/reference/registers.md: a program of its own.

``python -m prooflight_studies.gate.independent_plc BELT.json TRAYS.jsonl`` listens at a free port of this machine,
which its first line of output names, and sorts the sheets of BELT.json into two trays by the ladder of that page. It
imports no module of Prooflight, so that a mistake in what these share cannot be made on both sides of the wire.

BELT.json says what happens to it, in times of this machine's monotonic clock: ``began_s``, ``speed_mm_s``,
``distance_mm`` from the camera to the eye, ``watchdog_s``, ``first_count`` of the encoder, ``sheets`` in the order of
their arrival (``serial``, ``front_mm`` travelled when its edge passes the camera, ``slip_mm``, ``under``: number of
sheets that stick below it), and ``faults`` (``kind``, ``at_s``, ``lasts_s``): it hangs, answers slowly, has no power.
"""

from __future__ import annotations

import asyncio
import json
import logging
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TextIO

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

COUNTS_PER_MM: Final = 10.0
SCAN_S: Final = 0.004
SLOW_S: Final = 0.12
"""Time to an answer while it answers slowly; less than Prooflight's patience."""
STORE: Final = 32
WRITTEN, SHOWN_AT, SHOWN, REGISTERS = 15, 32, 18, 64
RANGE: Final = 1 << 32
"""The encoder wraps here."""


def signed(difference: int) -> int:
    """Return a difference of two counts on the shorter way round."""
    return (difference + RANGE // 2) % RANGE - RANGE // 2


@dataclass(slots=True)
class Memory:
    """Variables of the ladder, by the names that they have there."""

    alive: bool = False
    heard_s: float = 0.0
    heartbeat_seen: int = 0
    session_taken: int = 0
    session_dropped: int = 0
    result_taken: int = 0
    stored_policy: int = 0
    press_stop: bool = False
    last_tag: int = 0
    last_tray: int = 0
    sheets_at_gate: int = 0
    store: list[dict[str, int]] = field(default_factory=list)


class Controller:
    """Ladder, encoder and trays."""

    def __init__(self, belt: dict[str, Any], log: TextIO) -> None:
        self._belt, self._log = belt, log
        self._sheets = list(belt["sheets"])
        self._zero_mm, self._first = 0.0, int(belt["first_count"])
        self._powered = True
        self._plc_heartbeat = 0
        self.written = [0] * WRITTEN
        self.memory = Memory()
        self.trays = {1: 0, 2: 0}

    def fault(self, kind: str) -> bool:
        """Return whether a fault of this kind goes on."""
        now_s = time.monotonic()
        faults = self._belt["faults"]
        return any(one["kind"] == kind and 0 <= now_s - one["at_s"] < one["lasts_s"] for one in faults)

    @property
    def _travelled_mm(self) -> float:
        return max(time.monotonic() - self._belt["began_s"], 0.0) * float(self._belt["speed_mm_s"])

    def _count(self, travelled_mm: float) -> int:
        return (self._first + round((travelled_mm - self._zero_mm) * COUNTS_PER_MM)) % RANGE

    def scan(self) -> None:
        """Go through the ladder once."""
        powered = not self.fault("power")
        if powered != self._powered:
            # What lies in memory is lost; the encoder begins anew.
            self._powered, self.memory, self.written = powered, Memory(), [0] * WRITTEN
            self._zero_mm, self._first = self._travelled_mm, 0
        self._plc_heartbeat = (self._plc_heartbeat + 1) % 65_536
        if powered:
            self._listen()
        while self._sheets and self._reaches_mm(self._sheets[0]) <= self._travelled_mm:
            self._sort(self._sheets.pop(0))

    def shown(self) -> list[int]:
        """Return registers 32 to 49."""
        memory = self.memory
        count = self._count(self._travelled_mm)
        longs = (memory.sheets_at_gate, memory.last_tag)
        return [
            *(0x5046, 1, self._plc_heartbeat, 1 | 4 * memory.press_stop),
            *(memory.session_taken, memory.result_taken, memory.heartbeat_seen),
            *(count >> 16, count & 0xFFFF),
            *(half for number in longs for half in (number >> 16, number & 0xFFFF)),
            memory.last_tray,
            *(half for tray in (1, 2) for half in (self.trays[tray] >> 16, self.trays[tray] & 0xFFFF)),
        ]

    def _listen(self) -> None:
        memory, cells = self.memory, self.written
        status, heartbeat, session, policy = cells[:4]
        now_s = time.monotonic()
        if heartbeat != memory.heartbeat_seen:
            memory.heartbeat_seen, memory.heard_s, memory.alive = heartbeat, now_s, True
        if memory.alive and now_s - memory.heard_s > self._belt["watchdog_s"]:
            memory.alive = False
            memory.store.clear()
            memory.session_dropped, memory.session_taken = memory.session_taken, 0
        if memory.alive and session not in (memory.session_taken, memory.session_dropped):
            memory.store.clear()
            memory.session_taken, memory.result_taken, memory.press_stop = session, 0, False
        if memory.alive and session == memory.session_taken != 0:
            memory.stored_policy = policy
            memory.press_stop |= bool(status & 1 << 5)
            if status & 1 << 2 and cells[7] != memory.result_taken:
                memory.result_taken = cells[7]
                memory.store.append(
                    {
                        "tag": cells[8] << 16 | cells[9],
                        "result": cells[10],
                        "position": cells[12] << 16 | cells[13],
                        "tolerance": cells[14],
                    }
                )
                del memory.store[:-STORE]

    def _reaches_mm(self, sheet: dict[str, Any]) -> float:
        return float(sheet["front_mm"] + sheet["slip_mm"] + self._belt["distance_mm"])

    def _sort(self, sheet: dict[str, Any]) -> None:
        memory = self.memory
        count = self._count(self._reaches_mm(sheet))
        near = [one for one in memory.store if abs(signed(one["position"] - count)) <= one["tolerance"]]
        memory.store = [one for one in memory.store if signed(one["position"] - count) > one["tolerance"]]
        opened, memory.last_tag = memory.stored_policy == 1, 0
        if len(near) == 1:
            opened, memory.last_tag = near[0]["result"] == 1, near[0]["tag"]
        elif memory.stored_policy == 2:
            memory.press_stop = True
        memory.last_tray = 1 if opened else 2
        memory.sheets_at_gate += 1
        for below in range(sheet["under"] + 1):
            self.trays[memory.last_tray] += 1
            row = {
                "session": memory.session_taken,
                "tag": memory.last_tag,
                "tray": "good" if opened else "reject",
                "count": count,
                "serial": sheet["serial"] + below,
                "at_s": time.monotonic(),
            }
            self._log.write(json.dumps(row) + "\n")


async def serve(controller: Controller) -> None:
    """Answer requests and go through the ladder until the program is ended."""

    async def answer(
        function: int, _start: int, address: int, _count: int, registers: list[int], values: Any
    ) -> ExcCodes | None:
        while controller.fault("hung") or controller.fault("power"):
            await asyncio.sleep(SCAN_S)
        if controller.fault("slow"):
            await asyncio.sleep(SLOW_S)
        if function == 16 and values is not None:
            if address + len(values) > WRITTEN:
                return ExcCodes.ILLEGAL_ADDRESS
            controller.written[address : address + len(values)] = values
        registers[:WRITTEN] = controller.written
        registers[SHOWN_AT : SHOWN_AT + SHOWN] = controller.shown()
        return None

    cells = [SimData(0, values=[0] * REGISTERS, datatype=DataType.REGISTERS)]
    bits = [SimData(0, values=[False] * 16, datatype=DataType.BITS)]
    device = SimDevice(id=1, simdata=(bits, bits, cells, cells), action=answer)
    server = ModbusTcpServer(device, address=("127.0.0.1", 0))
    await server.serve_forever(background=True)
    listening: Any = server.transport
    sys.stdout.write(f"{listening.sockets[0].getsockname()[1]}\n")
    sys.stdout.flush()
    while True:
        controller.scan()
        await asyncio.sleep(SCAN_S)


def main(belt: str, trays: str) -> None:
    """Run the controller."""
    logging.getLogger("pymodbus").setLevel(
        logging.CRITICAL
    )  # it says how each inspection that is killed goes
    with Path(trays).open("a", encoding="utf-8", buffering=1) as log:
        asyncio.run(serve(Controller(json.loads(Path(belt).read_text(encoding="utf-8")), log)))


if __name__ == "__main__":
    main(*sys.argv[1:])
