"""What happens in the long run of the gate: every sheet's truth and verdict, and when the plant fails."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Final, Literal, Self

from prooflight.rng import stream
from prooflight.scans.geometry import ScanGeometry

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

SHEET_MM: Final = 297.0
PITCH_MM: Final = 360.0
"""assumed: A4 along the travel, and a gap of a fifth of it."""
LINE_MM: Final = 0.36
DISTANCE_MM: Final = 3000.0
FIRST_MM: Final = 9000.0
"""Until the first sheet: five seconds of empty belt, in which the gate becomes ready."""
JOB_PAGES: Final = 8
GEOMETRY: Final = ScanGeometry(
    pixels=2, pixel_pitch_mm=LINE_MM, line_pitch_mm=LINE_MM, lead_in_mm=7.2, lead_out_mm=7.2
)
Kind = Literal[
    "good",
    "false-alarm",
    "misprint",
    "unknown",
    "repeated",
    "slip",
    "small-slip",
    "double",
    "lost-lines",
    "late",
]
SHARES: Final[dict[Kind, float]] = {
    "misprint": 0.03,
    "false-alarm": 0.01,
    "unknown": 0.002,
    "repeated": 0.003,
    "slip": 0.003,
    "small-slip": 0.01,
    "double": 0.003,
    "lost-lines": 0.003,
    "late": 0.003,
}
"""assumed: a press in a bad hour. late: nobody could inspect it in time."""
Failure = Literal[
    "camera-away", "plc-off", "link-cut", "link-delayed", "plc-hung", "watch-killed", "clock-jump"
]
LASTS_S: Final[dict[Failure, float]] = {
    "camera-away": 6.0,
    "plc-off": 5.0,
    "link-cut": 3.0,
    "link-delayed": 10.0,
    "plc-hung": 3.0,
    "watch-killed": 4.0,
    "clock-jump": 0.0,
}
DELAY_S: Final = 2.0
"""Delay of the link, each way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedSheet:
    """A sheet as it is, and as the stand-in inspector will judge it."""

    serial: int
    """Number of the sheet, from 1."""
    kind: Kind
    front_mm: float
    """How far the transport has moved when its leading edge passes the camera."""
    slip_mm: float
    latency_s: float
    """Time from its last line to its verdict."""

    @property
    def truth(self) -> str:
        """What a person sees who looks into the tray."""
        if self.kind in ("misprint", "unknown", "repeated"):
            return self.kind
        return "good"


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A run of the plant; the same for the process that plays the plant and for those that play the inspection."""

    sheets: tuple[PlannedSheet, ...]
    failures: tuple[tuple[float, Failure], ...]
    """When each begins, from the start. [s]"""
    speed_mm_s: float
    faster: float
    """How many times faster than it is said here time goes."""

    @classmethod
    def draw(
        cls, sheets: int, *, rate: float, faster: float, seed: int, latencies_s: np.ndarray, rounds: int
    ) -> Self:
        """Draw a plan.

        latencies_s: measured latencies, from which new ones are drawn. rounds: number of each failure.
        """
        rng = stream(seed, "gate-plan")
        speed = rate * PITCH_MM
        kinds = [*SHARES, "good"]
        shares = [*SHARES.values(), 1 - sum(SHARES.values())]
        drawn = rng.choice(len(kinds), size=sheets, p=shares)
        jitter_mm = rng.uniform(-10, 10, sheets)
        sizes_mm = rng.uniform(60, 140, sheets) * rng.choice([1, 1, -1], sheets)
        latencies = rng.choice(latencies_s, sheets)
        planned = []
        for at in range(sheets):
            kind: Kind = kinds[drawn[at]]
            slip_mm = {"slip": abs(float(sizes_mm[at])), "small-slip": float(sizes_mm[at]) / 7}.get(kind, 0.0)
            planned.append(
                PlannedSheet(
                    serial=2 * at + 1,  # the even ones stick below
                    kind=kind,
                    front_mm=FIRST_MM + at * PITCH_MM + float(jitter_mm[at]),
                    slip_mm=slip_mm,
                    latency_s=float(latencies[at]),
                )
            )
        names: list[Failure] = [name for _ in range(rounds) for name in LASTS_S]
        span_s = sheets / rate
        starts = [FIRST_MM / speed + span_s * (at + 0.5) / len(names) for at in range(len(names))]
        return cls(
            sheets=tuple(planned),
            failures=tuple(zip(starts, names, strict=True)),
            speed_mm_s=speed,
            faster=faster,
        )

    @property
    def ends_s(self) -> float:
        """When the last sheet has reached the gate."""
        last = self.sheets[-1]
        return (last.front_mm + DISTANCE_MM + 3 * PITCH_MM) / self.speed_mm_s

    def save(self, path: Path) -> None:
        """Write the plan for the other process."""
        path.write_text(json.dumps(asdict(self)), encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a plan that was saved."""
        stored = json.loads(path.read_text(encoding="utf-8"))
        return cls(
            sheets=tuple(PlannedSheet(**one) for one in stored["sheets"]),
            failures=tuple((begins_s, name) for begins_s, name in stored["failures"]),
            speed_mm_s=stored["speed_mm_s"],
            faster=stored["faster"],
        )
