"""Lines of several cameras, or of several sensors of one, laid side by side: by their count, never by their arrival.

    A  |--64--|--64--|--64--|          lines of each sensor, in the count of all
    B     |--64--|      |--64--|       a block was lost; the rest keeps its place
    out   |=================|          what all have told; B's lost lines by name

A line is given on once every camera has told what became of it, or is known to be away. So the result does not depend
on which camera's blocks come first, nor on any clock. What is held is bounded: a camera that falls too far behind is
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

MOST_BEHIND: Final = 4096
"""Lines that a camera may lie behind the others before they go on without it: 1.5 s of the prototype's, 16 MB a sensor
of 2048 pixels."""
SILENT: Final = "it has fallen silent while others go on"
UNCOUNTED: Final = "it is back, but tells no count of triggers, so nobody knows its lines' places"


@dataclass(slots=True, eq=False)
class _Lane:
    """One sensor's lines in the common count, as far as they have come and have not been given on."""

    camera: int
    whole: tuple[int, int]
    """Lines and pixels of its offset that are counted off."""
    until: int | None = None
    """Behind the last line of which is known what became of it; None: nothing has come."""
    first: int = 0
    pieces: deque[tuple[int, NDArray[np.uint16]]] = field(default_factory=deque)
    faults: deque[LineFault] = field(default_factory=deque)
    last: NDArray[np.uint16] | None = None
    """The line given on last, (1, pixels), which stands where one is missing."""


class InStep:
    """Takes the blocks of each camera, gives on those of all sensors."""

    def __init__(
        self,
        offsets: Sequence[Sequence[SensorOffset]],
        *,
        names: Sequence[str],
        most_behind: int = MOST_BEHIND,
    ) -> None:
        """offsets: of each camera's sensors, in the press's order; names: of the cameras, for a person."""
        self._names, self._most_behind = names, most_behind
        self._lanes = [_Lane(camera, offset.whole) for camera, own in enumerate(offsets) for offset in own]
        self._of = [
            [place for place, lane in enumerate(self._lanes) if lane.camera == camera]
            for camera in range(len(offsets))
        ]
        self._why = [""] * len(offsets)  # it is not waited for; empty: it is
        self._begun: int | None = None  # the common count of the first line given on, which is called 0
        self._next = 0  # the common count behind the last line given on
        self._time_s = 0.0

    @property
    def silent(self) -> tuple[int, ...]:
        """Cameras that have said nothing while others went on, and are not waited for any more."""
        return tuple(camera for camera, why in enumerate(self._why) if why == SILENT)

    @property
    def held(self) -> int:
        """Lines that wait for other cameras', all sensors together."""
        return sum(piece.shape[0] for lane in self._lanes for _, piece in lane.pieces)

    def away(self, camera: int, why: str) -> list[LineBlock]:
        """A camera gives no lines: the others go on without it. why: for a person."""
        self._why[camera] = why
        return self._ready()

    def add(self, camera: int, block: LineBlock, *, ahead: int = 0, counted: bool = True) -> list[LineBlock]:
        """A camera's next block; ahead: how much the common count is more than its own. Returns what is complete.

        counted: whether it is known which lines these are; if not, nobody sees what they show.
        """
        self._time_s = block.time_s
        if not counted:
            return self.away(camera, UNCOUNTED)
        for place in self._of[camera]:
            self._take(place, block, ahead)
        furthest = max(lane.until or 0 for lane in self._lanes)
        own = [self._lanes[place] for place in self._of[camera]]
        if all(furthest - (lane.until or 0) <= self._room(lane) // 2 for lane in own):
            self._why[camera] = ""  # it has caught up: lines that come from now on are waited for
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
        known = [lane for lane in self._lanes if lane.until is not None]
        furthest = max((lane.until or 0 for lane in known), default=0)
        for lane in self._lanes:
            behind = furthest - (self._start(known) if lane.until is None else lane.until)
            if not self._why[lane.camera] and behind > self._room(lane):
                self._why[lane.camera] = SILENT
        waited = [lane for lane in self._lanes if not self._why[lane.camera]]
        if not waited or any(lane.until is None for lane in waited):
            return []
        if self._begun is None:
            self._begun = self._next = max(lane.first for lane in waited)
        end = min(lane.until or 0 for lane in waited)
        return list(self._given(end)) if end > self._next else []

    def _start(self, known: Sequence[_Lane]) -> int:
        """Where a camera stands that has sent nothing yet: where the first of the others began."""
        return min(lane.first for lane in known) if known else 0

    def _room(self, lane: _Lane) -> int:
        """Lines that a sensor may lie behind; others are ahead of one that sees each place of the page later."""
        return self._most_behind + lane.whole[0] - min(other.whole[0] for other in self._lanes)

    def _given(self, end: int) -> Iterator[LineBlock]:
        """Lines up to ``end`` of all sensors; where no sensor has one, the count jumps."""
        count = end - self._next
        width = next(piece.shape[1] for lane in self._lanes for _, piece in lane.pieces)
        lines = np.empty((len(self._lanes), count, width), np.uint16)
        there = np.zeros(lines.shape[:2], bool)
        faults = list[LineFault]()
        for place, lane in enumerate(self._lanes):
            self._fill(lane, lines[place], there[place])
            faults += self._said(place, lane, there[place], end)
        begun = self._begun or 0
        faults = [replace(fault, first_line=max(fault.first_line - begun, 0)) for fault in faults]
        for first, behind in runs(np.asarray(there.any(axis=0))):
            part = lines if behind - first == count else np.ascontiguousarray(lines[:, first:behind])
            yield LineBlock(
                first_line=self._next + first - begun, lines=part, time_s=self._time_s, faults=tuple(faults)
            )
            faults = []
        self._next = end

    def _fill(self, lane: _Lane, lines: NDArray[np.uint16], there: NDArray[np.bool_]) -> None:
        """A lane's lines (n, pixels) from where others stand, and which of them have come."""
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
        for first, behind in runs(~there):
            before = lines[first - 1 : first] if first else lane.last
            lines[first:behind] = 0 if before is None else before
        lane.last = lines[-1:].copy()

    def _said(self, place: int, lane: _Lane, there: NDArray[np.bool_], end: int) -> Iterator[LineFault]:
        """What befell a lane's lines up to ``end``: as its camera told, and of others that they are missing."""
        named, later = there.copy(), deque[LineFault]()
        for fault in lane.faults:
            if fault.first_line >= end:
                later.append(fault)
                continue
            if fault.unseen:
                if fault.next_line > end:  # what is left is said with its lines
                    later.append(replace(fault, first_line=end, lines=fault.next_line - end))
                # Lines that were given on without this camera have been said; only triggers are told afterwards.
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
        detail = f"{self._names[lane.camera]}, sensor {place + 1}: {why or 'its lines were not delivered'}"
        for first, behind in runs(~named):
            yield LineFault(
                kind=kind,
                first_line=self._next + first,
                lines=behind - first,
                detail=detail,
                sensor=place,
            )
