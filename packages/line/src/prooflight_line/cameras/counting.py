"""Conversion of blocks as they came over the wire to lines in one unbroken count, with all losses reported.

Pure functions of the blocks, without a camera: GigE Vision numbers blocks by 16 bits from 1 to 65535 and over
again; packets and whole blocks get lost, cameras skip triggers, and packets requested again may come too
late.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.errors import ScanError
from prooflight.scans.lines import LineBlock, LineFault, runs
from prooflight_line.cameras.pixel_formats import pixel_format, unpacked

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from prooflight.scans.lines import LineFaultKind
    from prooflight_line.cameras.camera import Grab

PERIOD: Final = 65535
"""Period of 16-bit block numbers: GigE Vision 1.2 leaves out 0, which is for test packets."""
SHORT, LONG = 1 << 16, 1 << 32
"""Periods of cameras' counters of triggers and encoder steps."""
MOST_IGNORED: Final = 1 << 14
"""Greatest number of skipped triggers between blocks; a counter with a larger jump was reset."""
LATEST: Final = 1024
"""Greatest number of blocks by which one may come late; further back, the number has wrapped around."""


def blocks_ahead(block_id: int, last_id: int, *, wraps: bool, period: int = PERIOD) -> int:
    """Return how many blocks a number is ahead of the last: 1 is the next, 0 or less came late.

    wraps: whether numbers have 16 bits; period: number of blocks after which they repeat.
    """
    ahead = block_id - last_id
    if not wraps:
        return ahead
    ahead %= period
    return ahead - period if ahead > period - LATEST else ahead


def counted_on(value: int, last: int) -> int:
    """Return the increase of a camera's counter, which wraps after 16 bits or, once it has been beyond, after 32."""
    on = value - last
    return on if on >= 0 else on % (SHORT if last < SHORT else LONG)


def lost_lines(
    missing: Sequence[tuple[int, int]], *, lines: int, line_bits: int, padding: int = 0
) -> NDArray[np.bool_]:
    """Return which of a block's lines lack bytes, (lines,).

    Parameters
    ----------
    missing : first byte, and the one after the last, of each hole
    line_bits : size of a line's pixels; packed ones may share a byte with the next line's
    padding : bytes after each line
    """
    lost = np.zeros(lines, bool)
    stride = line_bits + 8 * padding
    for first, end in missing:
        lost[max((8 * first - line_bits) // stride + 1, 0) : -(-8 * end // stride)] = True
    return lost


@dataclass(slots=True, eq=False)
class LineCounter:
    """Counter of one camera's lines, from block to block, through losses and restarts."""

    name: str
    """Name of the camera, in errors."""
    pixels: int | None = None
    """Pixels of a line; None until the first block."""
    sensors: int | None = None
    encoder_steps: int | None = None
    """Encoder steps from line to line, for blocks with the encoder's count instead of that of triggers."""
    next_line: int = 0
    """Number after the last line that came or is known to be lost."""
    lines: int = 0
    lost: int = 0
    blocks: int = 0
    broken: int = 0
    """Blocks received with a part missing."""
    _last_id: int | None = None
    _triggers: int | None = None
    _uncounted: int = 0
    """Lines since the block that had the last count."""
    _encoder: int | None = None
    _steps: int = 0
    """Steps of the encoder, unwrapped."""
    base: int | None = None
    """The camera's own count of triggers minus this count; None if it has none."""
    exact: bool = True
    """Whether all lines since the first are counted exactly; not after an absence that the camera did not
    count."""
    _period: int = PERIOD
    _pending_faults: list[LineFault] = field(default_factory=list)

    def restarted(self, *, lines: int, why: str, grab: Grab | None = None) -> int:
        """Continue the count after the camera has been disconnected, while about so many lines passed.

        Its numbers start again. Where the camera has gone on counting triggers, the first block since,
        ``grab``, gives the number of lines that passed. Returns how many are lost.
        """
        counted = None if grab is None or self._triggers is None else self._passed(grab, lines)
        if counted is None:
            self.base, self.exact = None, False
        about = "about " if counted is None else ""
        lost = lines if counted is None else counted
        self._report_lost(
            "camera-away", lost, f"{about}{lost} lines from {self.next_line} on were lost: {why}"
        )
        self._last_id = self._triggers = None
        self._uncounted = 0
        return lost

    def _passed(self, grab: Grab, about: int) -> int | None:
        """Return the lines that passed before a block since the last, by the camera's count; None if that was reset."""
        triggers, before = self._count(grab), self._triggers
        if triggers is None or before is None:
            return None
        passed = counted_on(triggers, before) - grab.lines
        if triggers > before:  # a press may have stopped, or run faster, but not many times as fast
            return passed if 0 <= passed <= 2 * about + MOST_IGNORED else None
        # Either the counter has wrapped around, or the camera lost its power and counts from 0.
        return passed if abs(passed - about) <= about // 4 else None

    @property
    def period(self) -> int:
        """Lines after which the camera's own count of triggers wraps around."""
        turn = SHORT if max(self._triggers or 0, self._encoder or 0) < SHORT else LONG
        return turn if self._encoder is None else max(turn // (self.encoder_steps or 1), 1)

    def take(self, grab: Grab) -> Iterator[LineBlock]:
        """Yield the lines of a block, split where some are lost.

        ScanError: they are not of a camera with so many pixels and sensors.
        """
        form = pixel_format(grab.pixel_format, where=self.name)
        self._check(grab.pixels, form.sensors)
        if grab.missing and not self.blocks and not self.next_line:
            return  # the count begins with a complete block, which alone gives the camera's own count
        ahead = self._ahead(grab)
        if ahead <= 0:
            first = max(self.next_line + (ahead - 1) * grab.lines, 0)
            what = f"block {grab.block_id} came after block {self._last_id}, and its lines were discarded"
            self._pending_faults.append(
                LineFault(kind="late-lines", first_line=first, lines=grab.lines, detail=what)
            )
            return
        triggers = self._count(grab)
        ignored = self._ignored(triggers, ahead * grab.lines)
        uncounted = self._uncounted if ignored else 0  # lines of blocks without a count are in doubt as well
        if ahead > 1:
            count = (ahead - 1) * grab.lines
            blocks = f"{ahead - 1} blocks before block {grab.block_id}"
            self._report_lost("lost-blocks", count, f"{self._lines(count)} lost: {blocks} did not arrive")
        self._last_id = grab.block_id
        if triggers is None:
            self._uncounted += ahead * grab.lines
        else:
            self._triggers, self._uncounted = triggers, 0
        self.blocks += 1
        missing = lost_lines(
            grab.missing,
            lines=grab.lines,
            line_bits=form.block_bits(lines=1, pixels=grab.pixels),
            padding=grab.padding,
        )
        self.broken += bool(missing.any())
        yield from self._pieces(grab, missing, ignored, uncounted)

    def _pieces(
        self, grab: Grab, missing: NDArray[np.bool_], ignored: int, uncounted: int
    ) -> Iterator[LineBlock]:
        """Yield each run of lines that came as a block; faults of lost lines are attached to the next one."""
        first, form = self.next_line, pixel_format(grab.pixel_format, where=self.name)
        if ignored:
            begin, lines = first - uncounted, uncounted + grab.lines + ignored
            what = f"{ignored} line triggers were missed within lines {begin} to {first + grab.lines - 1}"
            self._pending_faults.append(
                LineFault(kind="lost-triggers", first_line=begin, lines=lines, detail=what)
            )
            self.lost += ignored
        came = None
        if not missing.all():
            came = unpacked(
                grab.data, form, lines=grab.lines, pixels=grab.pixels, padding=grab.padding, where=self.name
            )
        at = 0
        for begin, end in [*runs(~missing), (grab.lines, grab.lines)]:
            if begin > at:
                lost = f"parts of block {grab.block_id} did not arrive"
                self._report_lost("lost-packets", begin - at, f"{self._lines(begin - at)} lost: {lost}")
            if end > begin and came is not None:
                faults, self._pending_faults = tuple(self._pending_faults), []
                piece = came if end - begin == grab.lines else np.ascontiguousarray(came[:, begin:end])
                block = LineBlock(first_line=self.next_line, lines=piece, time_s=grab.time_s, faults=faults)
                self.next_line += end - begin
                self.lines += end - begin
                yield block
            at = end
        self.next_line += ignored

    def _report_lost(self, kind: LineFaultKind, lines: int, detail: str) -> None:
        """Report lines as lost."""
        self._pending_faults.append(
            LineFault(kind=kind, first_line=self.next_line, lines=lines, detail=detail)
        )
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

    def _count(self, grab: Grab) -> int | None:
        """Return the line triggers by the end of a block, as the camera counts them or from its encoder's steps."""
        if grab.triggers is not None or grab.encoder is None or self.encoder_steps is None:
            return grab.triggers
        self._steps += grab.encoder if self._encoder is None else counted_on(grab.encoder, self._encoder)
        self._encoder = grab.encoder
        return self._steps // self.encoder_steps

    def _ignored(self, triggers: int | None, lines: int) -> int:
        """Return the triggers since the last block for which the camera took no line; lines: that it took or lost."""
        if triggers is None:
            return 0
        if self._triggers is None:
            if self.base is None:
                self.base = triggers - lines - self.next_line
            return 0
        ignored = counted_on(triggers, self._triggers) - lines - self._uncounted
        if ignored > MOST_IGNORED:
            self.base, self.exact = None, False
            return 0
        return max(ignored, 0)

    def _check(self, pixels: int, sensors: int) -> None:
        expected = self.pixels or pixels, self.sensors or sensors
        if (pixels, sensors) != expected:
            what = f"sends {sensors} sensors x {pixels} pixels"
            remedy = f"set it to {expected[1]} sensors x {expected[0]} pixels, as in the press"
            raise ScanError(self.name, what, remedy=remedy)
        self.pixels, self.sensors = pixels, sensors
