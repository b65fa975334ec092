"""Blocks as they came over the wire -> lines in one unbroken count, and what befell those that are not there.

Pure functions of what came, without a camera: GigE Vision numbers blocks by 16 bits from 1 to 65535 and over again,
packets get lost, whole blocks do, cameras pass over triggers, and what was asked for again may come too late.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.errors import ScanError
from prooflight.scans.cameras.pixel_formats import pixel_format, unpacked
from prooflight.scans.lines import LineBlock, LineFault, runs

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from prooflight.scans.cameras.camera import Grab
    from prooflight.scans.lines import LineFaultKind

PERIOD: Final = 65535
"""Of 16-bit block numbers: GigE Vision 1.2 leaves out 0, which is for test packets."""
LATEST: Final = 1024
"""Blocks by which one may come too late; further back, the number has begun again."""


def blocks_ahead(block_id: int, last_id: int, *, wraps: bool, period: int = PERIOD) -> int:
    """How many blocks a number is ahead of the last: 1 is the next, 0 or less came late.

    wraps: whether numbers have 16 bits; period: after how many blocks they come again.
    """
    ahead = block_id - last_id
    if not wraps:
        return ahead
    ahead %= period
    return ahead - period if ahead > period - LATEST else ahead


def lost_lines(
    missing: Sequence[tuple[int, int]], *, lines: int, line_bits: int, padding: int = 0
) -> NDArray[np.bool_]:
    """Which of a block's lines lack bytes, (lines,); missing: first and behind the last byte of each hole.

    line_bits: that a line's pixels take; packed ones may share a byte with the next line's. padding: bytes behind each.
    """
    lost = np.zeros(lines, bool)
    stride = line_bits + 8 * padding
    for first, end in missing:
        lost[max((8 * first - line_bits) // stride + 1, 0) : -(-8 * end // stride)] = True
    return lost


@dataclass(slots=True, eq=False)
class LineCounter:
    """Counts the lines of one camera, from block to block, through losses and restarts."""

    name: str
    """Of the camera, in errors."""
    pixels: int | None = None
    """Of a line; None: as the first block has it."""
    sensors: int | None = None
    next_line: int = 0
    """The count behind the last line that came or is known to be lost."""
    lines: int = 0
    """That came."""
    lost: int = 0
    blocks: int = 0
    broken: int = 0
    """Blocks that came with a part missing."""
    _last_id: int | None = None
    _triggers: int | None = None
    _period: int = PERIOD
    _to_say: list[LineFault] = field(default_factory=list)

    def restarted(self, *, lines: int, why: str) -> None:
        """The camera has been away while about so many lines passed: its numbers begin anew, the count goes on."""
        self._say("camera-away", lines, f"about {lines} lines from {self.next_line} on were lost: {why}")
        self._last_id = self._triggers = None

    def take(self, grab: Grab) -> Iterator[LineBlock]:
        """Its lines, cut where some are lost. ScanError: they are not of a camera with so many pixels and sensors."""
        form = pixel_format(grab.pixel_format, where=self.name)
        self._check(grab.pixels, form.sensors)
        ahead = self._ahead(grab)
        if ahead <= 0:
            first = max(self.next_line + (ahead - 1) * grab.lines, 0)
            what = f"block {grab.block_id} came behind block {self._last_id}, and its lines were left out"
            self._to_say.append(LineFault(kind="late-lines", first_line=first, lines=grab.lines, detail=what))
            return
        ignored = self._ignored(grab, ahead)
        if ahead > 1:
            count = (ahead - 1) * grab.lines
            blocks = f"{ahead - 1} blocks before block {grab.block_id}"
            self._say("lost-blocks", count, f"{self._lines(count)} lost: {blocks} did not come")
        self._last_id, self._triggers = grab.block_id, grab.triggers
        self.blocks += 1
        gone = lost_lines(
            grab.missing,
            lines=grab.lines,
            line_bits=form.block_bits(lines=1, pixels=grab.pixels),
            padding=grab.padding,
        )
        self.broken += bool(gone.any())
        yield from self._pieces(grab, gone, ignored)

    def _pieces(self, grab: Grab, gone: NDArray[np.bool_], ignored: int) -> Iterator[LineBlock]:
        """The lines that came, each run of them a block of its own; what is said of lost ones goes with the next."""
        first, form = self.next_line, pixel_format(grab.pixel_format, where=self.name)
        if ignored:
            what = f"{ignored} line triggers were passed over somewhere in lines {first} to {first + grab.lines - 1}"
            self._to_say.append(
                LineFault(kind="lost-triggers", first_line=first, lines=grab.lines + ignored, detail=what)
            )
            self.lost += ignored
        lines = None
        if not gone.all():
            lines = unpacked(
                grab.data, form, lines=grab.lines, pixels=grab.pixels, padding=grab.padding, where=self.name
            )
        at = 0
        for begin, end in [*runs(~gone), (grab.lines, grab.lines)]:
            if begin > at:
                lost = f"parts of block {grab.block_id} did not arrive"
                self._say("lost-packets", begin - at, f"{self._lines(begin - at)} lost: {lost}")
            if end > begin and lines is not None:
                faults, self._to_say = tuple(self._to_say), []
                piece = lines if end - begin == grab.lines else np.ascontiguousarray(lines[:, begin:end])
                block = LineBlock(first_line=self.next_line, lines=piece, time_s=grab.time_s, faults=faults)
                self.next_line += end - begin
                self.lines += end - begin
                yield block
            at = end
        self.next_line += ignored

    def _say(self, kind: LineFaultKind, lines: int, detail: str) -> None:
        """So many lines are lost."""
        self._to_say.append(LineFault(kind=kind, first_line=self.next_line, lines=lines, detail=detail))
        self.next_line += lines
        self.lost += lines

    def _lines(self, count: int) -> str:
        first = self.next_line
        return f"line {first} was" if count == 1 else f"lines {first} to {first + count - 1} were"

    def _ahead(self, grab: Grab) -> int:
        if self._last_id is None:
            return 1
        if grab.id_wraps and grab.block_id == 0:
            self._period = PERIOD + 1  # this camera counts 0 as well
        return blocks_ahead(grab.block_id, self._last_id, wraps=grab.id_wraps, period=self._period)

    def _ignored(self, grab: Grab, ahead: int) -> int:
        """Triggers that the camera saw since the last block and took no line for."""
        if grab.triggers is None or self._triggers is None:
            return 0
        return max(grab.triggers - self._triggers - ahead * grab.lines, 0)

    def _check(self, pixels: int, sensors: int) -> None:
        known = self.pixels or pixels, self.sensors or sensors
        if (pixels, sensors) != known:
            what = f"sends {sensors} sensors x {pixels} pixels"
            remedy = f"set it to {known[1]} sensors x {known[0]} pixels, as the press has"
            raise ScanError(self.name, what, remedy=remedy)
        self.pixels, self.sensors = pixels, sensors
