"""Endless lines from a camera: blocks with the camera's own count of lines and a time stamp.

A new source is one small class with ``blocks`` and ``close``: see ``replay.Replay`` and ``raw.RawLines``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, Protocol

import numpy as np

from prooflight.errors import ScanError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

BLOCK_LINES = 64
"""Lines in a block, where nothing says otherwise: 23 ms of the prototype's camera, a fiftieth of a page."""


LineFaultKind = Literal["lost-packets", "lost-blocks", "lost-triggers", "late-lines", "camera-away"]
CAMERA_AWAY: Final = "the camera was away"
"""What every camera says of lines that it missed for that reason; for how long follows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineFault:
    """Lines that a camera did not deliver as they passed under it.

    lost-packets: parts of them did not arrive. lost-blocks: their whole block did not. lost-triggers: the camera passed
    over some of their triggers, and nobody knows which. late-lines: they came behind lines that follow them, and were
    left out. camera-away: the camera gave no lines; how many passed meanwhile is reckoned by the time.
    """

    kind: LineFaultKind
    first_line: int
    """In the camera's count."""
    lines: int
    detail: str
    """For a person."""
    sensor: int | None = None
    """The one sensor that it befell; None: all of them."""

    @property
    def next_line(self) -> int:
        """The camera's count behind its last line."""
        return self.first_line + self.lines

    @property
    def unseen(self) -> bool:
        """Whether what its lines show may not be judged; late ones are lost already."""
        return self.kind != "late-lines"


class Unseen(NamedTuple):
    """A run of lines that nobody saw; something else stands in their place."""

    first: int
    end: int
    """Behind the last."""
    sensor: int | None = None
    """The one sensor that did not see them; None: none did."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineBlock:
    """Some lines as the camera delivered them; the array is the receiver's to keep and must not change any more."""

    first_line: int
    """The camera's own count of lines at its first line, from 0; lost lines show as a jump between blocks."""
    lines: NDArray[np.uint16]
    """(sensors, n, pixels) raw digital numbers. [DN]"""
    time_s: float
    """When its last line was read, by the source's own clock."""
    faults: tuple[LineFault, ...] = ()
    """Of its lines, and of those that are missing before it, where the source knows more than the jump says."""

    @property
    def next_line(self) -> int:
        """The camera's count behind its last line."""
        return self.first_line + self.lines.shape[1]


class LineSource(Protocol):
    """Where blocks come from."""

    @property
    def sensors(self) -> int:
        """Sensors in every block."""
        ...

    @property
    def pixels(self) -> int:
        """Pixels in every line."""
        ...

    def blocks(self) -> Iterator[LineBlock]:
        """Blocks as they come; ends when the source ends. ScanError: what comes is not lines of this camera."""
        ...

    def close(self) -> None:
        """Let go of the source; ``blocks`` then ends. May be called more than once, and from another thread."""
        ...


def check_block(block: LineBlock, *, sensors: int, pixels: int) -> None:
    """ScanError if a block is not of a camera with so many sensors and pixels."""
    lines = block.lines
    if lines.dtype != np.uint16 or lines.ndim != 3 or lines.shape[::2] != (sensors, pixels):
        what = f"is {lines.dtype.name} {lines.shape}"
        remedy = f"give uint16 (sensors, n, pixels) of {sensors} sensors x {pixels} pixels"
        raise ScanError(f"block at line {block.first_line}", what, remedy=remedy)


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and behind the last of each run of set flags (n,)."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
