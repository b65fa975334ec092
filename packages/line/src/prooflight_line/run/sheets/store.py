"""Buffer of the last pages' lines, in one continuous count, whatever the camera's own count does."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from itertools import permutations
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.kernels.thumbnails import SHRINK, count_near
from prooflight.scans.lines import Unseen, check_block, runs
from prooflight_line.run.sheets.records import Fault
from prooflight_line.run.sheets.thumbnails import Shrinker

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight.scans.lines import LineBlock
    from prooflight_line.run.sheets.records import FaultKind

NEAR_BACKING: Final = 0.006, 0.1
"""Tolerance around the backing's light: in white, and as a share of the backing's own. Lamps and tables of
the press world err by 2 %, and darker solids than a backing of 5 % are 0.035 away; tints within the tolerance
occur on one page in dozens."""
GAP_SHARE: Final = 0.97
"""Least share of the columns at the backing's light in a row of gap: dust may lie on the backing."""
WIDE_SHARE: Final = 0.25
"""Least share of the columns that a sheet covers; anything narrower is dirt on the backing."""
GAP_MM: Final = 3.0
"""Length of backing inserted where the camera's count restarts, so that sheets before and after do not
merge."""


class LineStore:
    """Lines by position: 0 for the first that came, one more for every line; lost lines repeat the one before them.

    A sheet thus keeps its length if the camera reports which lines were lost. Repeated lines are left out. A jump
    of the camera's count ahead by more than ``longest``, or back by as much, counts as a restart.
    """

    def __init__(self, press: Press, *, longest: int) -> None:
        self._sensors, self._pixels = len(press.sensors), press.geometry.pixels
        self._longest = longest
        self._shrinker = Shrinker(press)
        backing = [
            np.rint(sensor.column_offset_dn + sensor.column_gain * sensor.backing_dn)
            for sensor in press.sensors
        ]
        self.backing_dn = np.clip(np.stack(backing), 0, 65535).astype(np.uint16)
        self._offset_dn = np.stack([sensor.column_offset_dn for sensor in press.sensors])
        self._white_dn = np.stack([sensor.column_gain * sensor.white_dn for sensor in press.sensors])
        self._gap_lines = round(GAP_MM / press.geometry.line_pitch_mm)
        self.backing_light = float(
            np.mean([sensor.backing_dn / sensor.white_dn for sensor in press.sensors], dtype=np.float64)
        )
        """Mean light of the backing. [white]"""
        self.near = max(NEAR_BACKING[0], NEAR_BACKING[1] * self.backing_light)
        """Tolerance within which light counts as backing. [white]"""
        self._parts: deque[tuple[int, NDArray[np.uint16], float]] = deque()
        self._counts: list[tuple[int, int]] = []  # (position, excess of the camera's count from there on)
        self._unseen = deque[Unseen]()  # by position
        self._breaks = deque[tuple[int, int]]()  # the same, where the number of lost lines is unknown
        self.broken_until: int | None = None
        """Position of the first line after the last unknown number of lost lines; None: there was no such
        loss."""
        self._named_until = 0  # count after the last line whose fault the source itself has reported
        self._backing = deque[int]()  # columns at the backing's light in every row from ``first_row`` on
        self.first_row = 0
        self.end = 0
        """Position after the last line."""

    def add(self, block: LineBlock) -> list[tuple[int, Fault]]:
        """Store a block's lines; return the faults of its count, with their positions.

        ScanError: the block is not of this camera.
        """
        check_block(block, sensors=self._sensors, pixels=self._pixels)
        lines, faults = self._with_lost_replaced(block), list[tuple[int, Fault]]()
        if not self._counts:
            self._counts.append((0, block.first_line))
        due = self.count_at(self.end)
        ahead = block.first_line - due
        away = any(fault.kind == "camera-away" and fault.sensor is None for fault in block.faults)
        for fault in block.faults:
            first = max(self.end + fault.first_line - due, 0)
            kind: FaultKind = "lost-lines" if fault.unseen else "extra-lines"
            faults.append((first, Fault(kind=kind, first_line=fault.first_line, detail=fault.detail)))
            if fault.unseen and not away:
                self._unseen.append(Unseen(first, first + fault.lines, fault.sensor))
            self._named_until = max(self._named_until, fault.next_line)
        if away or abs(ahead) > self._longest:
            if not away:
                what = f"the camera counts {block.first_line} after {due}: lines were lost, how many is not known"
                faults.append((self.end, Fault(kind="lost-lines", first_line=block.first_line, detail=what)))
            gap = self.end, self.end + self._gap_lines
            self._unseen.append(Unseen(*gap))
            self._breaks.append(gap)
            self._append(np.repeat(self.backing_dn[:, None], self._gap_lines, axis=1), block.time_s)
            self._counts.append((self.end, block.first_line - self.end))
            self._named_until, self.broken_until = block.first_line, self.end
        elif ahead > 0:
            if due >= self._named_until:
                what = f"lines {due} to {block.first_line - 1} were not delivered"
                faults.append((self.end, Fault(kind="lost-lines", first_line=due, detail=what)))
            self._unseen.append(Unseen(self.end, self.end + ahead))
            last = self._parts[-1][1][:, -1:] if self._parts else self.backing_dn[:, None]
            self._append(np.repeat(last, ahead, axis=1), block.time_s)
        elif ahead < 0:
            again = min(-ahead, lines.shape[1])
            what = f"lines {block.first_line} to {block.first_line + again - 1} were delivered twice"
            faults.append((self.end, Fault(kind="extra-lines", first_line=block.first_line, detail=what)))
            lines = lines[:, again:]
        self._append(lines, block.time_s)
        return faults

    def lines_of(self, light: NDArray[np.float32]) -> NDArray[np.uint16]:
        """Return lines (sensors, n, pixels) [DN] of a light (n, columns) [white]; backing from its columns on."""
        lines = np.repeat(self.backing_dn[:, None], len(light), axis=1)
        used = slice(0, light.shape[1])
        levels = self._offset_dn[:, None, used] + self._white_dn[:, None, used] * light
        lines[:, :, used] = np.rint(np.clip(levels, 0, 65535))
        return lines

    def _with_lost_replaced(self, block: LineBlock) -> NDArray[np.uint16]:
        """Return a block's lines, with those that one sensor lost replaced from another, at the first one's levels.

        Sheets are thereby still detected and identified while one of several cameras is disconnected.
        """
        lost = np.zeros(block.lines.shape[:2], bool)
        for fault in block.faults:
            if fault.sensor is not None and fault.unseen:
                first = fault.first_line - block.first_line
                lost[fault.sensor, max(first, 0) : max(first + fault.lines, 0)] = True
        if not lost.any():
            return block.lines
        lines = block.lines.copy()
        for borrower, lender in permutations(range(self._sensors), 2):
            at = lost[borrower] & ~lost[lender]
            if at.any():
                light = (lines[lender, at] - self._offset_dn[lender]) / self._white_dn[lender]
                own = self._offset_dn[borrower] + self._white_dn[borrower] * light
                lines[borrower, at] = np.rint(np.clip(own, 0, 65535)).astype(np.uint16)
                lost[borrower, at] = False
        return lines

    def _append(self, lines: NDArray[np.uint16], time_s: float) -> None:
        if not lines.shape[1]:
            return
        self._parts.append((self.end, lines, time_s))
        self.end += lines.shape[1]
        rows = self._shrinker.rows(lines)
        if len(rows):
            counts = np.empty(len(rows), np.int64)
            count_near(rows, np.float32(self.backing_light), np.float32(self.near), counts)
            self._backing.extend(counts.tolist())

    @property
    def end_row(self) -> int:
        """Number of the row after the last complete one, of 8 lines each."""
        return self.first_row + len(self._backing)

    def is_gap(self, row: int) -> bool:
        """Return whether lines 8 row to 8 row + 7 show nothing but backing."""
        return self._backing[row - self.first_row] >= GAP_SHARE * self._shrinker.columns

    def is_lost(self, row: int) -> bool:
        """Return whether any of a row's lines was lost, of losses whose number is known."""
        first, end = SHRINK * row, SHRINK * (row + 1)
        return any(
            begin < end and first < behind and (begin, behind) not in self._breaks
            for begin, behind, _ in self._unseen
        )

    def is_wide(self, row: int) -> bool:
        """Return whether a row shows something as wide as a sheet."""
        return self._backing[row - self.first_row] <= (1 - WIDE_SHARE) * self._shrinker.columns

    def count_at(self, position: int) -> int:
        """Return the camera's count at a position."""
        if not self._counts:
            return position
        place = bisect_right(self._counts, position, key=lambda entry: entry[0])
        return position + self._counts[max(place - 1, 0)][1]

    def time_at(self, position: int) -> float:
        """Return the time at which the line at a position was read, exact to a block. [s]"""
        for first, lines, time_s in self._parts:
            if position < first + lines.shape[1]:
                return time_s
        return self._parts[-1][2] if self._parts else 0.0

    def cut(self, first: int, count: int, *, since: int = 0, until: int | None = None) -> NDArray[np.uint16]:
        """Return a copy of lines (sensors, count, pixels) from position ``first`` on; backing if there are none.

        since, until: positions before and from which on the copy is backing, too.
        """
        copy = np.empty((self._sensors, count, self._pixels), np.uint16)
        begun = max(first, since, self._parts[0][0] if self._parts else self.end)
        stop = min(first + count, self.end if until is None else min(until, self.end))
        for begin, lines, _ in self._parts:
            start, end = max(begin, begun), min(begin + lines.shape[1], stop)
            if start < end:
                copy[:, start - first : end - first] = lines[:, start - begin : end - begin]
        copy[:, : max(begun - first, 0)] = self.backing_dn[:, None]
        copy[:, max(stop - first, 0) :] = self.backing_dn[:, None]
        return copy

    def unseen(self, first: int, count: int) -> tuple[Unseen, ...]:
        """Return the lost ones among ``count`` lines from a position on, in order; 0 is the line at ``first``."""
        lost = np.zeros((self._sensors, count), bool)
        for begin, end, sensor in self._unseen:
            of = slice(None) if sensor is None else sensor
            lost[of, max(begin - first, 0) : max(end - first, 0)] = True
        by_all = np.asarray(lost.all(axis=0))
        lost_runs = [Unseen(*run) for run in runs(by_all)]
        for sensor, own in enumerate(lost if self._sensors > 1 else ()):
            lost_runs += [Unseen(*run, sensor) for run in runs(own & ~by_all)]
        return tuple(sorted(lost_runs, key=lambda run: run.first))

    def broken(self, first: int, end: int) -> bool:
        """Return whether an unknown number of lines was lost between two positions, or next to them."""
        return any(begin <= end and first <= behind for begin, behind in self._breaks)

    def profile(self, first: int, count: int) -> NDArray[np.float64]:
        """Return the share of pixels in each line (count,) that are not backing, of the first sensor. [-]"""
        lines = self.cut(first, count)[0].astype(np.float32)
        level = self.backing_dn[0].astype(np.float32)
        # A single pixel has its sensor's noise, in which the share of a line averages out.
        limit = np.maximum(1.5 * self.near / max(self.backing_light, 1e-3) * level, 12.0)
        return (np.abs(lines - level) > limit).mean(axis=1, dtype=np.float64)

    def forget(self, before: int) -> None:
        """Drop lines that are not needed any more."""
        while self._parts and self._parts[0][0] + self._parts[0][1].shape[1] <= before:
            self._parts.popleft()
        while self._unseen and self._unseen[0].end < before:
            self._unseen.popleft()
        while self._breaks and self._breaks[0][1] < before:
            self._breaks.popleft()
        row = min(before // SHRINK, self.end_row)
        while self.first_row < row:
            self._backing.popleft()
            self.first_row += 1
        while len(self._counts) > 1 and self._counts[1][0] <= before:
            self._counts.pop(0)
