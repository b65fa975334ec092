"""The paper path after the camera: a transport with its encoder, and the sheets on it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from prooflight_line.plant.gate.registers import WRAP

if TYPE_CHECKING:
    from collections.abc import Iterator


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
