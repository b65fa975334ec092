"""The plant of the long run: belt, controller and link of a real Modbus server and a real relay, and all that fails."""

from __future__ import annotations

import subprocess
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from prooflight_line.plant.simulator.plc import Belt, BeltSheet, SimulatedPlc
from prooflight_line.plant.simulator.server import SCAN_S, PlcServer
from prooflight_line.testing.relay import Relay
from prooflight_studies.gate.plan import DELAY_S, DISTANCE_MM, LASTS_S
from prooflight_studies.gate.stand_in import ScaledClock, settings_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from prooflight_line.plant.simulator.plc import TrayRow
    from prooflight_studies.gate.plan import Failure, Plan

READY_S: Final = 6.0
"""Time for the first process to be loaded, before the belt starts."""
POLL_S: Final = 0.05
AHEAD_S: Final = 2.0
"""Before they pass the camera, sheets are laid on the belt."""


@dataclass(slots=True, kw_only=True)
class Happened:
    """What a run of the plant left."""

    rows: list[TrayRow]
    """Rows of both trays, in the order in which the sheets reached the gate."""
    failures: list[tuple[float, Failure]] = field(default_factory=list)
    """When each began. [s]"""
    starts: int = 0
    seconds: float = 0.0
    """Duration of the run."""


class Watches:
    """The inspection's process, and one that stands by for it."""

    def __init__(self, stack: ExitStack, arguments: list[str]) -> None:
        self._stack, self._arguments = stack, arguments
        self._standing_by = self._spawned()
        self._running: subprocess.Popen[str] | None = None
        self.starts = 0

    def start(self, *, another: bool) -> None:
        """Let the one that stands by begin; another: have the next one stand by."""
        self._running = self._standing_by
        if self._running.stdin is not None:
            self._running.stdin.write("begin\n")
            self._running.stdin.flush()
        self.starts += 1
        if another:
            self._standing_by = self._spawned()

    def kill(self) -> None:
        """Kill the inspection as `kill -9` does."""
        if self._running is not None:
            self._running.kill()
            self._running.wait()

    def ended(self) -> None:
        """Wait until it has ended by itself. RuntimeError: it failed."""
        if self._running is not None and (code := self._running.wait()):
            raise RuntimeError(f"the stand-in inspection ended with {code}")

    def _spawned(self) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "prooflight_studies.gate.stand_in", *self._arguments]
        process = subprocess.Popen(command, stdin=subprocess.PIPE, text=True)
        self._stack.callback(self._end, process)
        return process

    @staticmethod
    def _end(process: subprocess.Popen[str]) -> None:
        process.kill()
        process.wait()
        if process.stdin is not None:
            process.stdin.close()


def run_plant(plan: Plan, folder: Path, *, log: Path, progress: Callable[[str], None]) -> Happened:
    """Play the plan through; journal, gate's logs and the controller's log lie in the folder then."""
    plan.save(folder / "plan.json")
    started_s = time.monotonic() + READY_S
    clock = ScaledClock(started_s=started_s, faster=plan.faster)
    belt = Belt(distance_mm=DISTANCE_MM, counts_per_mm=10.0, first_count=1 << 30)
    settings = settings_of("127.0.0.1", 0)
    with ExitStack() as stack:
        file = stack.enter_context(log.open("w", encoding="utf-8"))
        plc = SimulatedPlc(belt=belt, heartbeat_s=settings.plc.heartbeat_ms / 1e3, clock=clock, log=file)
        belt.start(plan.speed_mm_s, 0.0)
        server = stack.enter_context(PlcServer(plc, scan_s=SCAN_S / plan.faster))
        relay = stack.enter_context(Relay("127.0.0.1", server.port))
        arguments = [str(folder / "plan.json"), str(folder / "runs.sqlite"), "127.0.0.1"]
        watches = Watches(stack, [*arguments, str(relay.port), repr(started_s)])
        time.sleep(max(started_s - time.monotonic(), 0))
        kills = sum(name == "watch-killed" for _, name in plan.failures)
        watches.start(another=kills > 0)
        happened = Happened(rows=plc.rows)
        begun_s = time.perf_counter()
        todo = sorted(_steps(plan, server, relay, watches, kills, happened), key=lambda step: step[0])
        sheets = iter(plan.sheets)
        coming = next(sheets, None)
        reported = 0
        while clock() < plan.ends_s:
            now_s = clock()
            while todo and todo[0][0] <= now_s:
                todo.pop(0)[1]()
            while coming is not None and coming.front_mm < (now_s + AHEAD_S) * plan.speed_mm_s:
                placed = BeltSheet(
                    serial=coming.serial,
                    front_mm=coming.front_mm,
                    truth=coming.truth,
                    slip_mm=coming.slip_mm,
                    under=coming.kind == "double",
                )
                server.call(lambda placed=placed: belt.lay(placed))  # type: ignore[misc]
                coming = next(sheets, None)
            if len(plc.rows) >= reported + 1000:
                reported = len(plc.rows)
                progress(f"{reported:,} sheets at the gate")
            time.sleep(POLL_S / plan.faster)
        watches.ended()
        happened.starts, happened.seconds = watches.starts, time.perf_counter() - begun_s
    return happened


def _steps(
    plan: Plan, server: PlcServer, relay: Relay, watches: Watches, kills: int, happened: Happened
) -> Iterator[tuple[float, Callable[[], None]]]:
    """Yield times, and what is done then."""

    def hang(on: bool) -> None:
        server.hung = on

    def delay(seconds: float) -> None:
        relay.delay_s = seconds / plan.faster

    def power(on: bool) -> None:
        server.call(lambda: server.plc.power(on=on))
        (relay.repair if on else relay.cut)()

    left = kills
    for begins_s, name in plan.failures:
        ends_s = begins_s + LASTS_S[name]
        yield begins_s, lambda at=begins_s, what=name: happened.failures.append((at, what))  # type: ignore[misc]
        match name:
            case "plc-off":
                yield begins_s, lambda: power(False)
                yield ends_s, lambda: power(True)
            case "link-cut":
                yield begins_s, relay.cut
                yield ends_s, relay.repair
            case "link-delayed":
                yield begins_s, lambda: delay(DELAY_S)
                yield ends_s, lambda: delay(0.0)
            case "plc-hung":
                yield begins_s, lambda: hang(True)
                yield ends_s, lambda: hang(False)
            case "watch-killed":
                left -= 1
                yield begins_s, watches.kill
                yield ends_s, lambda more=left > 0: watches.start(another=more)  # type: ignore[misc]
            case _:
                continue  # the stand-in plays it
