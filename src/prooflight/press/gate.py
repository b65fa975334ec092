"""``[gate]`` of a press file: the gate at which bad sheets leave the paper path, and the controller that moves it."""

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
    """Protocol of the controller.

    registers: one result for each sheet, which the controller matches by its encoder. coil: one output, timed
    by this program.
    """
    first_register: int = 0
    """First register of the register map, as the protocol counts: 0 is called 40001 by many controllers."""
    coil: int = 0
    counts_per_mm: float = 10.0
    """Counts per millimetre of the encoder whose count the controller shows."""
    cycle_ms: int = 20
    """Period of the exchange of registers."""
    timeout_ms: int = 250
    """Time without an answer after which the connection is closed and opened again."""
    heartbeat_ms: int = 500
    """Time without a change of the other side's heartbeat after which that side is taken to be disconnected."""

    @property
    def where(self) -> str:
        """Return the controller's address, for messages."""
        return f"{self.host}:{self.port}"


@dataclass(frozen=True, slots=True, kw_only=True)
class GateSettings:
    """``[gate]``."""

    distance_mm: float
    """Distance along the paper path from the line that the camera sees to the gate's photo-eye."""
    tolerance_mm: float = 40.0
    """Greatest distance of a sheet from its expected position at the gate at which it is still taken for that sheet."""
    policy: Policy = "reject"
    """Action on a sheet in every case of doubt."""
    divert: Literal["sheet", "until-clean-break"] = "sheet"
    """Sheets that leave with a bad sheet: it (and the rest of its set), or all until the next whole copy begins."""
    pages_a_set: int = 1
    """Number of pages in a set; one bad page spoils its set."""
    stop_in_a_row: int | None = None
    """Number of consecutive misprints at which the press is stopped."""
    stop_of: tuple[int, int] | None = None
    """Number of misprints, and the number of sheets among which they occur, at which the press is stopped."""
    plc: PlcSettings
