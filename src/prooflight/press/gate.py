"""``[gate]`` of a press file: the gate at which bad sheets leave the paper path, and the controller that moves it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from prooflight.files.fields import NO_OTHER_FIELDS, Count, Positive, ShortText

Policy = Literal["reject", "accept", "stop"]
Register = Annotated[int, Field(strict=True, ge=0, le=65_535)]
Milliseconds = Annotated[int, Field(strict=True, ge=1, le=60_000)]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlcSettings:
    """``[gate.plc]``: the plant's controller, which is a Modbus TCP server."""

    __pydantic_config__: ClassVar = NO_OTHER_FIELDS

    host: ShortText
    port: Annotated[int, Field(strict=True, ge=1, le=65_535)] = 502
    unit: Annotated[int, Field(strict=True, ge=0, le=255)] = 1
    style: Literal["registers", "coil"] = "registers"
    """Protocol of the controller.

    registers: one result for each sheet, which the controller matches by its encoder. coil: one output, timed
    by this program.
    """
    first_register: Register = 0
    """First register of the register map, as the protocol counts: 0 is called 40001 by many controllers."""
    coil: Register = 0
    counts_per_mm: Positive = 10.0
    """Counts per millimetre of the encoder whose count the controller shows.

    assumed: an encoder of 5,000 counts on a wheel of 500 mm.
    """
    cycle_ms: Milliseconds = 20
    """Period of the exchange of registers. assumed: two scan cycles of a usual controller."""
    timeout_ms: Milliseconds = 250
    """Time without an answer after which the connection is closed and opened again."""
    heartbeat_ms: Milliseconds = 500
    """Time without a change of the other side's heartbeat after which that side is taken to be disconnected.

    assumed: half the time from camera to gate at 2 m/s and 2 m.
    """

    @property
    def where(self) -> str:
        """Return the controller's address, for messages."""
        return f"{self.host}:{self.port}"


@dataclass(frozen=True, slots=True, kw_only=True)
class GateSettings:
    """``[gate]``; ValueError: ``stop_of`` is more misprints than sheets."""

    __pydantic_config__: ClassVar = NO_OTHER_FIELDS

    distance_mm: Positive
    """Distance along the paper path from the line that the camera sees to the gate's photo-eye."""
    tolerance_mm: Positive = 40.0
    """Greatest distance of a sheet from its expected position at the gate at which it is still taken for that sheet."""
    policy: Policy = "reject"
    """Action on a sheet in every case of doubt."""
    divert: Literal["sheet", "until-clean-break"] = "sheet"
    """Sheets that leave with a bad sheet: it (and the rest of its set), or all until the next whole copy begins."""
    pages_a_set: Count = 1
    """Number of pages in a set; one bad page spoils its set."""
    stop_in_a_row: Count | None = None
    """Number of consecutive misprints at which the press is stopped."""
    stop_of: tuple[Count, Count] | None = None
    """Number of misprints, and the number of sheets among which they occur, at which the press is stopped."""
    plc: PlcSettings

    def __post_init__(self) -> None:
        """Check what several fields say together."""
        if self.stop_of is not None and self.stop_of[0] > self.stop_of[1]:
            raise ValueError("stop_of must be [misprints, of so many sheets]")
