"""The register map between Prooflight and the plant's controller.

A controller's programmer reads it in docs/reference/registers.md, which is written from this table.

Prooflight is the client. It writes the first block in one request (function 16), so a result is never seen in
halves, and reads the second in one (function 3). A number of 32 bits is two registers, the high word first.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Self

MAP_ID: Final = 0x5046
"""Value of the register ``map_id``: the letters PF."""
MAP_VERSION: Final = 2
"""Version of the map with the ring of trays. A controller of version 1 shows the last tray alone."""
WRAP: Final = 1 << 32
"""Value at which counts of 32 bits begin again."""


class OurStatus(IntFlag):
    """Bits of ``status``."""

    READY = 1
    """Results can be relied on: the controller has taken this session, and the encoder is aligned with the
    lines."""
    BUSY = 2
    """The results of some sheets that have passed the camera have not been written."""
    RESULT_VALID = 4
    """The registers of the result hold one; it is new if ``result_number`` has changed."""
    PASS = 8
    """The result is accept."""
    FAULT = 16
    """There is a fault, which ``fault`` names."""
    STOP = 32
    """The press is to be stopped; stays set until the session ends."""


class PlcStatus(IntFlag):
    """Bits of ``plc_status``."""

    READY = 1
    """The gate may be used."""
    FAULT = 2
    """The controller itself has a fault."""
    STOPPED = 4
    """The controller has stopped the press because it was asked to."""


class Result(IntEnum):
    """Result for a sheet."""

    NONE = 0
    ACCEPT = 1
    DIVERT = 2
    STOP = 3
    """Divert, and stop the press."""


class Code(IntEnum):
    """Reason for a result."""

    NONE = 0
    GOOD = 1
    MISPRINT = 2
    NOT_INSPECTED = 3
    """The sheet was not inspected."""
    LOST_LINES = 4
    """The camera lost lines of it, or it has too few or too many."""
    UNKNOWN_SHEET = 5
    """It is no page of the job, or blank."""
    OUT_OF_PLACE = 6
    """It came twice, or after its turn."""
    SET_SPOILED = 7
    """Another page of its set is bad or missing."""
    UNTIL_CLEAN_BREAK = 8
    """It follows a bad sheet, and no whole copy has begun since."""
    TOO_LATE = 9
    """It reached the gate before its result could be written."""
    PLACE_UNKNOWN = 10
    """Its time at the gate is not known: the encoder and the lines do not agree."""


class Fault(IntEnum):
    """Reason why Prooflight is not ready."""

    NONE = 0
    ENCODER = 1
    """The controller's count and the camera's lines do not agree."""
    NOT_TAKEN = 2
    """The controller has not taken the session."""
    PLC_HEARTBEAT = 3
    """The controller's heartbeat stands still."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Register:
    """One number of the map."""

    name: str
    at: int
    """Number of its first register, relative to the first register of the map."""
    words: Literal[1, 2] = 1
    what: str


def _numbered(rows: Sequence[tuple[str, Literal[1, 2], str]], *, first: int) -> tuple[Register, ...]:
    registers, at = [], first
    for name, words, what in rows:
        registers.append(Register(name=name, at=at, words=words, what=what))
        at += words
    return tuple(registers)


WRITTEN: Final = _numbered(
    (
        ("status", 1, "bits: 0 ready, 1 busy, 2 result valid, 3 pass, 4 fault, 5 stop"),
        ("heartbeat", 1, "changes with every exchange"),
        ("session", 1, "1 to 65535, another with each start of Prooflight; 0: none"),
        ("policy", 1, "what becomes of a sheet in doubt: 0 reject, 1 accept, 2 stop"),
        ("fault", 1, "why not ready: 0 none, 1 encoder, 2 session not taken, 3 PLC heartbeat"),
        ("sheet_at_camera", 2, "tag of the last sheet that has passed the camera"),
        ("result_number", 1, "1 to 65535, the next with each result; 0: none yet"),
        ("tag", 2, "of the sheet that the result is of, from 1"),
        ("result", 1, "1 accept, 2 divert, 3 divert and stop the press"),
        ("code", 1, "why: see the codes"),
        ("position", 2, "encoder count at which the sheet's leading edge reaches the gate's eye"),
        ("tolerance", 1, "counts before and after `position` within which it is this sheet"),
    ),
    first=0,
)
"""Registers that Prooflight writes."""
READ_FROM: Final = 32
READ: Final = _numbered(
    (
        ("map_id", 1, "0x5046"),
        ("map_version", 1, "2; 1 if there is no ring of trays"),
        ("plc_heartbeat", 1, "changes at least every 100 ms"),
        ("plc_status", 1, "bits: 0 ready, 1 fault, 2 press stopped"),
        ("session_taken", 1, "`session` when the controller has forgotten all results of others"),
        ("result_taken", 1, "`result_number` of the last result that it has stored: the acknowledgement"),
        ("heartbeat_seen", 1, "`heartbeat` as last seen"),
        ("encoder", 2, "encoder count now, which only rises and wraps at 2^32"),
        ("sheets_at_gate", 2, "sheets that have reached the gate's eye"),
        ("last_tag", 2, "tag of the last of them; 0: no result was found for it"),
        ("last_tray", 1, "its tray: 1 good, 2 reject"),
        ("in_good", 2, "sheets in the good tray"),
        ("in_reject", 2, "sheets in the reject tray"),
    ),
    first=READ_FROM,
)
"""Registers that the controller shows and Prooflight reads."""
WRITTEN_WORDS: Final = WRITTEN[-1].at + WRITTEN[-1].words
READ_WORDS: Final = READ[-1].at + READ[-1].words - READ_FROM
RING: Final = 64
"""Number of sheets whose trays the controller shows, in as many registers after ``READ``.

Sheet number n at the gate, from 1, is in register (n - 1) mod 64 of them: twelve seconds of sheets at 5 a second."""
RING_FROM: Final = READ_FROM + READ_WORDS
TAGS: Final = (1 << 14) - 1
"""Number of tags that a register of the ring can tell apart; those of the last sheets are fewer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """Registers of a controller, read in one request."""

    values: Mapping[str, int]
    trays: tuple[int, ...] = ()
    """Registers of the ring; none of a controller of map version 1."""

    @classmethod
    def of(cls, words: Sequence[int]) -> Self:
        """Unpack registers from ``READ_FROM`` on; ValueError if there are too few."""
        return cls(values=unpacked_of_plc(words), trays=tuple(words[READ_WORDS : READ_WORDS + RING]))

    def passed(self, count: int, *, last_tag: int) -> list[tuple[int, int]]:
        """Return tag and tray of each of the last ``count`` sheets, oldest first, as far as they are shown.

        last_tag: tag of the last sheet that passed the camera. A sheet whose result was not found has no tag and is
        left out.
        """
        at_gate = self.values["sheets_at_gate"]
        if not self.trays:
            tag = self.values["last_tag"]
            return [(tag, self.values["last_tray"])] if count == 1 and tag else []
        places = range(at_gate - min(count, len(self.trays)), at_gate)
        words = [self.trays[place % len(self.trays)] for place in places]
        sheets = ((last_tag - (last_tag - (word >> 2)) % TAGS, word & 3) for word in words if word >> 2)
        return [(tag, tray) for tag, tray in sheets if tag > 0]


def ring_register(tag: int, tray: int) -> int:
    """Return a sheet's register in the ring: its tag as 1 to 16383, which repeats, in bits 2 to 15; its tray below.

    tag: 0 if no result was found for the sheet; tray: 1 good, 2 reject.
    """
    return ((tag - 1) % TAGS + 1 if tag else 0) << 2 | tray


def packed(values: Mapping[str, int]) -> list[int]:
    """Return the registers that Prooflight writes, from its first on; those not named are 0."""
    words = [0] * WRITTEN_WORDS
    for register in WRITTEN:
        _put(words, register, values.get(register.name, 0), first=0)
    return words


def packed_of_plc(values: Mapping[str, int]) -> list[int]:
    """Return the registers that the controller shows, from ``READ_FROM`` on."""
    words = [0] * READ_WORDS
    for register in READ:
        _put(words, register, values.get(register.name, 0), first=READ_FROM)
    return words


def unpacked(words: Sequence[int]) -> dict[str, int]:
    """Return by name what Prooflight has written; ValueError if there are too few registers."""
    return _named(words, WRITTEN, first=0)


def unpacked_of_plc(words: Sequence[int]) -> dict[str, int]:
    """Return by name what the controller shows; ValueError if there are too few registers."""
    return _named(words, READ, first=READ_FROM)


def after(number: int) -> int:
    """Return the next of the numbers 1 to 65535, which wrap around."""
    return number % 0xFFFF + 1


def count_distance(one: int, other: int) -> int:
    """Return the signed difference of two counts of 32 bits, the shorter way round; negative: ``one`` is
    before ``other``.
    """
    return (one - other + WRAP // 2) % WRAP - WRAP // 2


def _put(words: list[int], register: Register, value: int, *, first: int) -> None:
    at = register.at - first
    if register.words == 2:
        words[at : at + 2] = divmod(value % WRAP, 1 << 16)
    else:
        words[at] = value & 0xFFFF


def _named(words: Sequence[int], registers: tuple[Register, ...], *, first: int) -> dict[str, int]:
    needed = registers[-1].at + registers[-1].words - first
    if len(words) < needed:
        raise ValueError(f"{len(words)} registers are too few: {needed} are needed")
    values = {}
    for register in registers:
        at = register.at - first
        values[register.name] = words[at] if register.words == 1 else (words[at] << 16) | words[at + 1]
    return values
