"""Endless lines from a camera: blocks with the camera's own count of lines and a time stamp.

A new source is one small class with ``blocks`` and ``close``: see ``replay.Replay`` and ``raw.RawLines``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from prooflight.errors import ScanError

BLOCK_LINES = 64
"""Lines in a block by default: 23 ms of the prototype's camera, a fiftieth of a page."""


LineFaultKind = Literal["lost-packets", "lost-blocks", "lost-triggers", "late-lines", "camera-away"]
CAMERA_AWAY: Final = "the camera was disconnected"
"""Beginning of every camera's message about lines missed while it was disconnected; the duration follows."""
CAMERA_AWAY_BEFORE: Final = "the camera was away"
"""The same in journals of earlier versions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineFault:
    """Lines that a camera did not deliver as they passed under it.

    lost-packets: parts of them did not arrive. lost-blocks: their whole block did not. lost-triggers: the
    camera skipped some of their triggers, and which is unknown. late-lines: they came after lines that follow
    them, and were left out. camera-away: the camera was disconnected; the number of lines is estimated from
    the time.
    """

    kind: LineFaultKind
    first_line: int
    """Number of the first line in the camera's count."""
    lines: int
    detail: str
    """Message for a person."""
    sensor: int | None = None
    """The one sensor concerned; None if all are."""

    @property
    def next_line(self) -> int:
        """The camera's count after its last line."""
        return self.first_line + self.lines

    @property
    def unseen(self) -> bool:
        """Whether its lines must not be inspected; late ones are reported as lost already."""
        return self.kind != "late-lines"


class Unseen(NamedTuple):
    """A run of lines that were not seen, and were filled in otherwise."""

    first: int
    end: int
    """Number after the last line."""
    sensor: int | None = None
    """The one sensor that did not see them; None if none did."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineBlock:
    """Some lines as the camera delivered them; the array belongs to the receiver and must not change any more."""

    first_line: int
    """The camera's own count at its first line, from 0; lost lines show as a jump between blocks."""
    lines: NDArray[np.uint16]
    """Raw digital numbers, (sensors, n, pixels). [DN]"""
    time_s: float
    """Time at which its last line was read, by the source's own clock."""
    faults: tuple[LineFault, ...] = ()
    """Faults of its lines, and of those missing before it, where the source knows more than the jump
    shows."""

    @property
    def next_line(self) -> int:
        """The camera's count after its last line."""
        return self.first_line + self.lines.shape[1]


class LineSource(Protocol):
    """Interface of sources of blocks."""

    @property
    def sensors(self) -> int:
        """Sensors in every block."""
        ...

    @property
    def pixels(self) -> int:
        """Pixels in every line."""
        ...

    def blocks(self) -> Iterator[LineBlock]:
        """Yield blocks until the source ends. ScanError: they are not lines of this camera."""
        ...

    def close(self) -> None:
        """Close the source; ``blocks`` then ends. May be called more than once, and from another thread."""
        ...


def check_block(block: LineBlock, *, sensors: int, pixels: int) -> None:
    """Raise ScanError unless a block is of a camera with so many sensors and pixels."""
    lines = block.lines
    if lines.dtype != np.uint16 or lines.ndim != 3 or lines.shape[::2] != (sensors, pixels):
        what = f"is {lines.dtype.name} {lines.shape}"
        remedy = f"give uint16 (sensors, n, pixels) of {sensors} sensors x {pixels} pixels"
        raise ScanError(f"block at line {block.first_line}", what, remedy=remedy)


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first index, and the one after the last, of each run of set flags (n,)."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
