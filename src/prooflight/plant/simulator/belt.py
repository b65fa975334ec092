"""The paper path behind the camera: a transport with its encoder, and sheets that lie on it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from prooflight.plant.gate.registers import WRAP

if TYPE_CHECKING:
    from collections.abc import Iterator


@dataclass(frozen=True, slots=True, kw_only=True)
class BeltSheet:
    """A sheet of paper, and what a person would see who looked at it."""

    serial: int
    """From 1, as the press fed it."""
    front_mm: float
    """How far the transport had moved when its leading edge passed the camera."""
    truth: str = "good"
    """good, misprint, or anything else that must not be sold."""
    slip_mm: float = 0.0
    """How far it slips back between camera and gate."""
    under: int = 0
    """Sheets that stick to it from below: the eye sees them as one."""


@dataclass(slots=True, kw_only=True)
class Belt:
    """Moves at one speed since it was started."""

    distance_mm: float
    """From camera to gate."""
    counts_per_mm: float
    speed_mm_s: float = 0.0
    started_s: float = 0.0
    first_count: int = 0
    """Of the encoder, at the start."""
    sheets: deque[BeltSheet] = field(default_factory=deque)

    def start(self, speed_mm_s: float, now_s: float) -> None:
        """Move from now on, as if nothing had passed; the encoder goes on."""
        self.first_count = self.count(now_s)
        self.speed_mm_s, self.started_s = speed_mm_s, now_s
        self.sheets.clear()

    def travelled_mm(self, now_s: float) -> float:
        """Since the start."""
        return (now_s - self.started_s) * self.speed_mm_s

    def count(self, now_s: float) -> int:
        """The encoder's."""
        return self.count_at(self.travelled_mm(now_s))

    def count_at(self, travelled_mm: float) -> int:
        """The encoder's when the transport has moved so far."""
        return int(self.first_count + travelled_mm * self.counts_per_mm) % WRAP

    def lay(self, sheet: BeltSheet) -> None:
        """A sheet passes the camera; sheets come in their order."""
        self.sheets.append(sheet)

    def at_gate(self, now_s: float) -> Iterator[tuple[BeltSheet, int]]:
        """Sheets whose leading edge has reached the gate's eye since the last time, with the encoder's count then."""
        travelled_mm = self.travelled_mm(now_s)
        while self.sheets:
            one = self.sheets[0]
            there_mm = one.front_mm + self.distance_mm + one.slip_mm
            if there_mm > travelled_mm:
                return
            yield self.sheets.popleft(), self.count_at(there_mm)
