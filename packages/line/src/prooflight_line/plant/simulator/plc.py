"""The simulated controller: its ladder program, which handles watchdog, results and gate in every scan, and its belt.

docs/reference/registers.md has it as structured text; both do the same.
"""

from __future__ import annotations

import json
import time
from collections import Counter, deque
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Final, TextIO

from prooflight_line.plant.gate.registers import (
    MAP_ID,
    MAP_VERSION,
    RING,
    WRAP,
    WRITTEN_WORDS,
    Code,
    OurStatus,
    PlcStatus,
    Result,
    count_distance,
    packed_of_plc,
    ring_register,
    unpacked,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

RESULTS: Final = 32
"""Number of results that the controller stores: more than there are sheets between camera and gate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stored:
    """A result as the controller stores it."""

    tag: int
    result: int
    code: int
    position: int
    tolerance: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TrayRow:
    """One sheet at the gate: the controller's log entry, and the truth that a person would see in the tray."""

    serial: int
    truth: str
    session: int
    """Session; 0: none was taken."""
    tag: int
    """Tag of the sheet; 0: no result was found for it."""
    code: int
    tray: str
    """Tray: good or reject."""
    why: str
    count: int
    """Count of the encoder at its leading edge."""


@dataclass(slots=True)
class SimulatedPlc:
    """Controller that sorts the sheets of a belt into two trays. One thread calls it."""

    belt: Belt
    heartbeat_s: float = 0.5
    log: TextIO | None = None
    """Log that receives one JSON object a sheet."""
    clock: Callable[[], float] = time.monotonic
    coil: bool = False
    """State of the single output, which the gate follows instead of registers."""
    style: str = "registers"
    registers: list[int] = field(default_factory=lambda: [0] * WRITTEN_WORDS)
    stored: deque[Stored] = field(default_factory=lambda: deque(maxlen=RESULTS))
    rows: list[TrayRow] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    last: TrayRow | None = None
    alive: bool = False
    """Whether Prooflight's heartbeat moves."""
    off: bool = False
    """Whether the controller has no power."""
    stopped: bool = False
    """Whether the press was asked to stop; sheets still on their way are sorted as ever."""
    _beat: int = 0
    _beat_s: float = 0.0
    _session: int = 0
    _dropped: int = 0
    _taken: int = 0
    _own_beat: int = 0
    _at_gate: int = 0
    _policy: int = 0
    _ring: list[int] = field(default_factory=lambda: [0] * RING)

    @property
    def session(self) -> int:
        """Session that is taken; 0: none."""
        return self._session

    @property
    def taken(self) -> int:
        """Number of the last result that is stored."""
        return self._taken

    # --- what the wire does ---

    def write(self, at: int, words: Sequence[int]) -> None:
        """Take registers that were written."""
        self.registers[at : at + len(words)] = words
        self.scan()

    def set_coil(self, on: bool) -> None:
        """Take the output that was written."""
        self.coil = on
        self._heard()
        self.scan()

    def shown(self) -> list[int]:
        """Return the registers that can be read from ``READ_FROM`` on, the ring of trays among them."""
        self._own_beat = (self._own_beat + 1) & 0xFFFF
        status = PlcStatus.READY | (PlcStatus.STOPPED if self.stopped else PlcStatus(0))
        last = self.last
        base = packed_of_plc(
            {
                "map_id": MAP_ID,
                "map_version": MAP_VERSION,
                "plc_heartbeat": self._own_beat,
                "plc_status": int(status),
                "session_taken": self._session,
                "result_taken": self._taken,
                "heartbeat_seen": self._beat & 0xFFFF,
                "encoder": self.belt.count(self.clock()),
                "sheets_at_gate": self._at_gate,
                "last_tag": 0 if last is None else last.tag,
                "last_tray": 0 if last is None else 1 + (last.tray == "reject"),
                "in_good": self.counts["good"],
                "in_reject": self.counts["reject"],
            }
        )
        return base + self._ring

    def power(self, *, on: bool) -> None:
        """Switch the power.

        Off: the controller forgets all but the content of the trays, and the gate falls to reject. On: its
        encoder counts from 0.
        """
        self.off = not on
        self.registers = [0] * WRITTEN_WORDS
        self.stored.clear()
        self.alive = self.coil = self.stopped = False
        self._beat, self._session, self._dropped, self._taken, self._policy = 0, 0, 0, 0, 0
        if on:
            self.belt.first_count = -int(self.belt.travelled_mm(self.clock()) * self.belt.counts_per_mm)

    # --- the ladder ---

    def scan(self) -> None:
        """Do one scan, which is due every few milliseconds."""
        if self.style == "registers" and not self.off:
            self._listen()
        self._watch()
        for sheet, count in self.belt.at_gate(self.clock()):
            self._sort(sheet, count)

    def _listen(self) -> None:
        values = unpacked(self.registers)
        if values["heartbeat"] != self._beat:
            self._beat = values["heartbeat"]
            self._heard()
        if not self.alive:
            return
        session = values["session"]
        if session not in (self._session, self._dropped):
            self.stored.clear()
            self._session, self._taken, self.stopped = session, 0, False
        if session != self._session or session == 0:
            return
        self._policy = values["policy"]
        self.stopped |= bool(values["status"] & OurStatus.STOP)
        number = values["result_number"]
        if values["status"] & OurStatus.RESULT_VALID and number != self._taken:
            self._taken = number
            names = ("tag", "result", "code", "position", "tolerance")
            self.stored.append(Stored(**{name: values[name] for name in names}))

    def _heard(self) -> None:
        self._beat_s, self.alive = self.clock(), True

    def _watch(self) -> None:
        """Forget a client that is silent for too long, with all its results."""
        if self.alive and self.clock() - self._beat_s > self.heartbeat_s:
            self.alive, self.coil = False, False
            self.stored.clear()
            self._dropped, self._session = self._session, 0

    def _sort(self, sheet: BeltSheet, count: int) -> None:
        tag, code, accepted, why = self._match(count)
        tray = "good" if accepted else "reject"
        facts: dict[str, Any] = {"session": self._session, "tag": tag, "code": code, "tray": tray, "why": why}
        for below in range(sheet.under + 1):  # what sticks to a sheet goes where it goes
            truth = sheet.truth if below == 0 else "under another sheet"
            row = TrayRow(serial=sheet.serial + below, truth=truth, count=count, **facts)
            self.rows.append(row)
            self.counts[tray] += 1
            if self.log is not None:
                self.log.write(json.dumps(asdict(row)) + "\n")
        self.last = row
        self._ring[self._at_gate % RING] = ring_register(tag, 1 if accepted else 2)
        self._at_gate += 1

    def _match(self, count: int) -> tuple[int, int, bool, str]:
        """Return tag, code, whether the sheet is accepted, and why."""
        if self.style == "coil":
            return 0, 0, self.coil, "the output is on" if self.coil else "the output is off"
        near = [one for one in self.stored if abs(count_distance(one.position, count)) <= one.tolerance]
        for one in list(self.stored):
            if count_distance(one.position, count) <= one.tolerance:  # it has passed
                self.stored.remove(one)
        if len(near) == 1:
            one = near[0]
            why = Code(one.code).name.lower().replace("_", " ") if one.code in list(Code) else "?"
            return one.tag, one.code, one.result == Result.ACCEPT, why
        why = "two results for this position" if near else "no result for this position"
        why = "the controller is off" if self.off else why if self.alive else "no signal from Prooflight"
        self.stopped |= self._policy == 2
        return 0, 0, self._policy == 1, why


# --- the paper path after the camera: a transport with its encoder, and the sheets on it ---


@dataclass(frozen=True, slots=True, kw_only=True)
class BeltSheet:
    """A sheet of paper, with the truth about its print."""

    serial: int
    """Number of the sheet, from 1, as the press fed it."""
    front_mm: float
    """Distance that the transport had moved when the sheet's leading edge passed the camera."""
    truth: str = "good"
    """True state of the sheet: good, misprint, or anything else that must not be sold."""
    slip_mm: float = 0.0
    """Distance by which it slips back between camera and gate."""
    under: int = 0
    """Number of sheets that stick to it from below; the eye sees them as one."""


@dataclass(slots=True, kw_only=True)
class Belt:
    """Transport that has moved at one speed since it was started."""

    distance_mm: float
    """Distance from camera to gate."""
    counts_per_mm: float
    speed_mm_s: float = 0.0
    started_s: float = 0.0
    first_count: int = 0
    """Count of the encoder at the start."""
    sheets: deque[BeltSheet] = field(default_factory=deque)

    def start(self, speed_mm_s: float, now_s: float) -> None:
        """Move from now on, without sheets; the encoder's count continues."""
        self.first_count = self.count(now_s)
        self.speed_mm_s, self.started_s = speed_mm_s, now_s
        self.sheets.clear()

    def travelled_mm(self, now_s: float) -> float:
        """Return the distance moved since the start."""
        return (now_s - self.started_s) * self.speed_mm_s

    def count(self, now_s: float) -> int:
        """Return the encoder's count."""
        return self.count_at(self.travelled_mm(now_s))

    def count_at(self, travelled_mm: float) -> int:
        """Return the encoder's count when the transport has moved by a distance."""
        return int(self.first_count + travelled_mm * self.counts_per_mm) % WRAP

    def lay(self, sheet: BeltSheet) -> None:
        """Add a sheet that passes the camera; sheets are added in their order."""
        self.sheets.append(sheet)

    def at_gate(self, now_s: float) -> Iterator[tuple[BeltSheet, int]]:
        """Yield sheets that have reached the gate's eye since the last call, with the encoder's counts then."""
        travelled_mm = self.travelled_mm(now_s)
        while self.sheets:
            one = self.sheets[0]
            there_mm = one.front_mm + self.distance_mm + one.slip_mm
            if there_mm > travelled_mm:
                return
            yield self.sheets.popleft(), self.count_at(there_mm)
