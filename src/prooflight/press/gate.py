"""``[gate]`` of a press file: where bad sheets leave the paper path, and the controller that moves the gate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Policy = Literal["reject", "accept", "stop"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlcSettings:
    """``[gate.plc]``: the plant's controller, which is a Modbus TCP server."""

    host: str
    port: int = 502
    unit: int = 1
    style: Literal["registers", "coil"] = "registers"
    """registers: a result a sheet, which the controller matches by its encoder. coil: one output, timed by us."""
    first_register: int = 0
    """Of the register map, as the protocol counts: 0 is what many controllers call 40001."""
    coil: int = 0
    counts_per_mm: float = 10.0
    """Of the encoder whose count the controller shows."""
    cycle_ms: int = 20
    """From one exchange of registers to the next."""
    timeout_ms: int = 250
    """Without an answer, after which the connection is given up and opened again."""
    heartbeat_ms: int = 500
    """Without a change of the other's heartbeat, after which either side takes the other to be gone."""

    @property
    def where(self) -> str:
        """For people."""
        return f"{self.host}:{self.port}"


@dataclass(frozen=True, slots=True, kw_only=True)
class GateSettings:
    """``[gate]``."""

    distance_mm: float
    """From the line that the camera sees to the gate's eye, along the paper path."""
    tolerance_mm: float = 40.0
    """How far from its place a sheet may reach the gate and still be the sheet that was judged."""
    policy: Policy = "reject"
    """What becomes of a sheet in every doubt."""
    divert: Literal["sheet", "until-clean-break"] = "sheet"
    """What leaves with a bad sheet: it (and the rest of its set), or all until the next whole copy begins."""
    pages_a_set: int = 1
    """A bad page spoils its set."""
    stop_in_a_row: int | None = None
    """Misprints one behind the other, at which the press is stopped."""
    stop_of: tuple[int, int] | None = None
    """Misprints, of so many sheets, at which the press is stopped."""
    plc: PlcSettings
