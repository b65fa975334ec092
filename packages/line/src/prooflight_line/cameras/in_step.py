"""Alignment of the lines of several cameras, or of several sensors of one, by their count, never by their arrival.

    A  |--64--|--64--|--64--|          lines of each sensor, in the common count
    B     |--64--|      |--64--|       a block was lost; the rest keeps its place
    out   |=================|          lines reported by all; B's lost lines as faults

A line is released once every camera has reported it, or is known to be disconnected, so the result depends
neither on whose blocks come first nor on any clock. Memory is bounded: a camera that lags too far behind is
left out until it has caught up.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.scans.alignment import moved_columns
from prooflight.scans.lines import LineBlock, LineFault, runs

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from prooflight.scans.alignment import SensorOffset
    from prooflight.scans.lines import LineFaultKind

MOST_LAG: Final = 4096
"""Greatest lag of a camera before the others go on without it: 1.5 s of the prototype's, 16 MB a sensor of
2048 pixels. [lines]"""
SILENT: Final = "the camera sends no lines while the other cameras do"
UNCOUNTED: Final = (
    "it is connected again, but reports no count of triggers, so the places of its lines are unknown"
)


@dataclass(slots=True, eq=False)
class _Lane:
    """Lines of one sensor in the common count that have come and have not been released."""

    camera: int
    whole: tuple[int, int]
    """Whole lines and pixels of its offset, which are removed."""
    until: int | None = None
    """Number after the last line that is reported; None if nothing has come."""
    first: int = 0
    pieces: deque[tuple[int, NDArray[np.uint16]]] = field(default_factory=deque)
    faults: deque[LineFault] = field(default_factory=deque)
    last: NDArray[np.uint16] | None = None
    """Last line released, (1, pixels), which is repeated where one is missing."""


class InStep:
    """Combines the blocks of each camera into blocks of all sensors."""

    def __init__(
        self,
        offsets: Sequence[Sequence[SensorOffset]],
        *,
        names: Sequence[str],
        most_lag: int = MOST_LAG,
    ) -> None:
        """Align cameras by count.

        offsets: of each camera's sensors, in the press's order; names: of the cameras, for messages.
        """
        self._names, self._most_lag = names, most_lag
        self._lanes = [_Lane(camera, offset.whole) for camera, own in enumerate(offsets) for offset in own]
        self._of = [
            [place for place, lane in enumerate(self._lanes) if lane.camera == camera]
            for camera in range(len(offsets))
        ]
        self._why = [""] * len(offsets)  # why a camera is not waited for; empty if it is
        self._begun: int | None = None  # common count of the first line released, which is numbered 0
        self._next = 0  # common count after the last line released
        self._time_s = 0.0

    @property
    def silent(self) -> tuple[int, ...]:
        """Cameras that sent nothing while others went on, and are no longer waited for."""
        return tuple(camera for camera, why in enumerate(self._why) if why == SILENT)

    @property
    def waiting_lines(self) -> int:
        """Number of lines that wait for other cameras', all sensors together."""
        return sum(piece.shape[0] for lane in self._lanes for _, piece in lane.pieces)

    def away(self, camera: int, why: str) -> list[LineBlock]:
        """Mark a camera as giving no lines, so that the others go on without it; return what is complete.

        why: for messages.
        """
        self._why[camera] = why
        return self._ready()

    def add(self, camera: int, block: LineBlock, *, ahead: int = 0, counted: bool = True) -> list[LineBlock]:
        """Add a camera's next block, and return what is complete.

        ahead: the common count minus the camera's own. counted: whether the lines' numbers are known; if not,
        the camera is left out.
        """
        self._time_s = block.time_s
        if not counted:
            return self.away(camera, UNCOUNTED)
        for place in self._of[camera]:
            self._take(place, block, ahead)
        furthest = max(lane.until or 0 for lane in self._lanes)
        own = [self._lanes[place] for place in self._of[camera]]
        if all(furthest - (lane.until or 0) <= self._room(lane) // 2 for lane in own):
            self._why[camera] = ""  # it has caught up, and is waited for from now on
        return self._ready()

    def _take(self, place: int, block: LineBlock, ahead: int) -> None:
        lane = self._lanes[place]
        lines, pixels = lane.whole
        shift = ahead - lines
        first, own = block.first_line + shift, self._of[lane.camera].index(place)
        if lane.until is None:
            lane.first = lane.until = first
        for fault in block.faults:
            lane.faults.append(
                replace(
                    fault,
                    first_line=fault.first_line + shift,
                    sensor=place,
                    detail=f"{self._names[lane.camera]}, sensor {place + 1}: {fault.detail}",
                )
            )
            lane.until = max(lane.until, fault.next_line + shift if fault.unseen else 0)
        lane.pieces.append((first, moved_columns(block.lines[own], pixels)))
        lane.until = max(lane.until, block.next_line + shift)

    def _ready(self) -> list[LineBlock]:
        started = [lane for lane in self._lanes if lane.until is not None]
        furthest = max((lane.until or 0 for lane in started), default=0)
        for lane in self._lanes:
            lag = furthest - (self._start(started) if lane.until is None else lane.until)
            if not self._why[lane.camera] and lag > self._room(lane):
                self._why[lane.camera] = SILENT
        waited = [lane for lane in self._lanes if not self._why[lane.camera]]
        if not waited or any(lane.until is None for lane in waited):
            return []
        if self._begun is None:
            self._begun = self._next = max(lane.first for lane in waited)
        end = min(lane.until or 0 for lane in waited)
        return list(self._given(end)) if end > self._next else []

    def _start(self, started: Sequence[_Lane]) -> int:
        """Return the count of a camera that has sent nothing yet: where the first of the others began."""
        return min(lane.first for lane in started) if started else 0

    def _room(self, lane: _Lane) -> int:
        """Return the greatest lag of a sensor; others are ahead of one that sees each place of the page later."""
        return self._most_lag + lane.whole[0] - min(other.whole[0] for other in self._lanes)

    def _given(self, end: int) -> Iterator[LineBlock]:
        """Yield lines up to ``end`` of all sensors; where no sensor has one, the count jumps."""
        count = end - self._next
        width = next(piece.shape[1] for lane in self._lanes for _, piece in lane.pieces)
        lines = np.empty((len(self._lanes), count, width), np.uint16)
        there = np.zeros(lines.shape[:2], bool)
        faults = list[LineFault]()
        for place, lane in enumerate(self._lanes):
            self._fill(lane, lines[place], there[place])
            faults += self._faults(place, lane, there[place], end)
        begun = self._begun or 0
        faults = [replace(fault, first_line=max(fault.first_line - begun, 0)) for fault in faults]
        for first, after in runs(np.asarray(there.any(axis=0))):
            part = lines if after - first == count else np.ascontiguousarray(lines[:, first:after])
            yield LineBlock(
                first_line=self._next + first - begun, lines=part, time_s=self._time_s, faults=tuple(faults)
            )
            faults = []
        self._next = end

    def _fill(self, lane: _Lane, lines: NDArray[np.uint16], there: NDArray[np.bool_]) -> None:
        """Copy a lane's lines (n, pixels) from the next count on, and mark which of them have come."""
        end = self._next + len(lines)
        while lane.pieces and lane.pieces[0][0] < end:
            first, piece = lane.pieces.popleft()
            begin, stop = max(first, self._next), min(first + len(piece), end)
            if begin < stop:
                lines[begin - self._next : stop - self._next] = piece[begin - first : stop - first]
                there[begin - self._next : stop - self._next] = True
            if first + len(piece) > end:
                lane.pieces.appendleft((end, piece[max(end - first, 0) :]))
                break
        for first, after in runs(~there):
            before = lines[first - 1 : first] if first else lane.last
            lines[first:after] = 0 if before is None else before
        lane.last = lines[-1:].copy()

    def _faults(self, place: int, lane: _Lane, there: NDArray[np.bool_], end: int) -> Iterator[LineFault]:
        """Yield the faults of a lane's lines up to ``end``: those that its camera reported, and missing lines else."""
        named, later = there.copy(), deque[LineFault]()
        for fault in lane.faults:
            if fault.first_line >= end:
                later.append(fault)
                continue
            if fault.unseen:
                if fault.next_line > end:  # the rest is reported with its lines
                    later.append(replace(fault, first_line=end, lines=fault.next_line - end))
                # Lines released without this camera have been reported; only triggers are reported afterwards.
                begin = (
                    fault.first_line if fault.kind == "lost-triggers" else max(fault.first_line, self._next)
                )
                fault = replace(fault, first_line=begin, lines=min(fault.next_line, end) - begin)
                if fault.lines <= 0:
                    continue
                named[max(begin - self._next, 0) : max(fault.next_line - self._next, 0)] = True
            yield fault
        lane.faults = later
        why = self._why[lane.camera]
        kind: LineFaultKind = "camera-away" if why else "lost-blocks"
        detail = f"{self._names[lane.camera]}, sensor {place + 1}: {why or 'the lines were not delivered'}"
        for first, after in runs(~named):
            yield LineFault(
                kind=kind,
                first_line=self._next + first,
                lines=after - first,
                detail=detail,
                sensor=place,
            )
