"""Several line cameras as one source: the sensors of one press, aligned by the count of their encoder.

Each camera is read by a thread of its own (``source``), which also reopens it after a failure; ``InStep``
aligns their blocks. Where blocks have the count of line triggers, that is the common count, whatever was lost
and whenever each camera was started. Where they do not, all cameras have to be started while the press
stands, and count their lines from there.
"""

from __future__ import annotations

import math
import queue
import threading
from collections import deque
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from prooflight.errors import RequestError, ScanError
from prooflight.scans.alignment import moved_columns
from prooflight.scans.lines import LineBlock, LineFault, runs

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.scans.alignment import SensorOffset
    from prooflight.scans.lines import LineFaultKind
    from prooflight_line.cameras.camera import Health
    from prooflight_line.cameras.pixel_formats import PixelFormat
    from prooflight_line.cameras.source import CameraLines, Notify, Place

WAITING: Final = 32
"""Number of blocks of each camera that may wait for alignment; then the camera's own buffers fill."""
POLL_S: Final = 0.1
"""Interval at which a waiting thread checks whether to end."""


class SeveralCameras:
    """The lines of several cameras, or of one with several offset sensors; see ``LineSource``."""

    def __init__(
        self,
        cameras: Sequence[CameraLines],
        offsets: Sequence[Sequence[SensorOffset]],
        *,
        tell: Notify = lambda _kind, _text: None,
    ) -> None:
        """Combine cameras; offsets: of each camera's sensors.

        RequestError, after which all are closed: the cameras do not match.
        """
        self._cameras, self._offsets, self.tell = cameras, offsets, tell
        self._closed = threading.Event()
        self._queue: queue.Queue[tuple[int, LineBlock | str | Exception, Place | None]] = queue.Queue(
            WAITING * len(cameras)
        )
        self.sensors = sum(camera.sensors for camera in cameras)
        self.pixels = cameras[0].pixels
        self.form: PixelFormat = cameras[0].form
        self._reading = False
        try:
            self._refuse_unfit()
        except RequestError:
            self.close()
            raise

    @property
    def name(self) -> str:
        """Names of all cameras."""
        return " + ".join(camera.name for camera in self._cameras)

    def blocks(self) -> Generator[LineBlock, None, None]:
        """See ``LineSource``; ends only by ``close``. ScanError: a camera cannot start, or they are not aligned."""
        if self._closed.is_set():
            return
        step = InStep(self._offsets, names=[camera.name for camera in self._cameras])
        threads = [
            threading.Thread(target=self._read, args=(number,), name=f"camera-{number}", daemon=True)
            for number in range(len(self._cameras))
        ]
        self._reading = True
        for thread in threads:
            thread.start()
        try:
            yield from self._aligned(step)
        finally:
            self.close()
            for thread in threads:
                while thread.is_alive():
                    self._empty()
                    thread.join(POLL_S)

    def close(self) -> None:
        """See ``LineSource``."""
        self._closed.set()
        for camera in self._cameras:
            camera.close()

    def healths(self) -> Mapping[str, Health]:
        """Return the health of each camera, by its name."""
        return {camera.name: camera.health() for camera in self._cameras}

    # --- threads ---

    def _read(self, number: int) -> None:
        camera = self._cameras[number]
        camera.tell = partial(self._notified, number)
        try:
            for block in camera.blocks():
                self._put(number, block, camera.place)
        except Exception as error:  # any error is raised where lines are taken
            self._put(number, error, None)

    def _notified(self, number: int, kind: Literal["camera-away", "camera-back"], text: str) -> None:
        self.tell(kind, text)
        if kind == "camera-away":
            self._put(number, text, None)

    def _put(self, number: int, what: LineBlock | str | Exception, place: Place | None) -> None:
        while not self._closed.is_set():
            try:
                self._queue.put((number, what, place), timeout=POLL_S)
            except queue.Full:
                continue
            return

    def _empty(self) -> None:
        while True:
            try:
                self._queue.get_nowait()
            except queue.Empty:
                return

    # --- the thread that takes lines ---

    def _aligned(self, step: InStep) -> Generator[LineBlock, None, None]:
        start, silent = _Start(self._cameras), frozenset[int]()
        while not self._closed.is_set():
            try:
                number, what, place = self._queue.get(timeout=POLL_S)
            except queue.Empty:
                continue
            if isinstance(what, Exception):
                raise what
            if isinstance(what, str):
                yield from step.away(number, "the camera sends no lines")
            elif place is not None:
                yield from step.add(number, what, ahead=start.ahead(number, what, place), counted=place.exact)
            now = frozenset(step.silent)
            for other in now - silent:
                self._cameras[other].suspect("has sent no line while the other cameras did")
            silent = now

    def _refuse_unfit(self) -> None:
        for camera, own in zip(self._cameras, self._offsets, strict=True):
            if camera.pixels != self.pixels or camera.form.top_code_dn != self.form.top_code_dn:
                what = f"sends {camera.pixels} pixels {camera.form.name}"
                remedy = (
                    f"{self._cameras[0].name} sends {self.pixels} pixels {self.form.name}: set both alike"
                )
                raise RequestError(camera.name, what, remedy=remedy)
            if camera.sensors != len(own):
                what = f"sends {camera.sensors} sensors, and offsets of {len(own)} are stated"
                raise RequestError(camera.name, what, remedy="give one offset for each sensor")
            if len(self._cameras) > 1 and camera.settings.trigger == "free":
                what = "runs free, and so cannot be synchronised with another camera"
                raise RequestError(
                    camera.name, what, remedy='trigger all cameras by one encoder: trigger = "encoder"'
                )


class _Start:
    """Offsets between the counts of the cameras' lines, from their first blocks."""

    def __init__(self, cameras: Sequence[CameraLines]) -> None:
        self._cameras = cameras
        self._ahead: dict[int, int] = {}
        self._first: Place | None = None
        self._came_s: dict[int, float] = {}

    def ahead(self, number: int, block: LineBlock, place: Place) -> int:
        """Return the common count minus a camera's. ScanError: it cannot be determined."""
        if number not in self._ahead:
            if self._first is None:
                self._first = place
            self._ahead[number] = self._offset(number, place)
        if len(self._cameras) > 1 and place.base is None:
            self._refuse_moving(number, block)
        return self._ahead[number]

    def _offset(self, number: int, place: Place) -> int:
        first = self._first
        assert first is not None
        if (first.base is None) != (place.base is None):
            what = "does not report its count of line triggers, or another camera does not"
            raise ScanError(
                self._cameras[number].name, what, remedy="set chunks = true for all cameras, or for none"
            )
        if first.base is None or place.base is None:
            return 0
        # Counters of 16 bits may have wrapped around since they began together.
        period = min(first.period, place.period)
        return (place.base - first.base + period // 2) % period - period // 2

    def _refuse_moving(self, number: int, block: LineBlock) -> None:
        """Raise ScanError if lines came before all cameras waited for them, and no camera counts them."""
        started_s = max(camera.started_s for camera in self._cameras)
        before_s = self._came_s.setdefault(number, block.time_s)
        if before_s == math.inf:
            return
        first_s = before_s - (block.time_s - before_s)  # its second block took as long as its first, or less
        if first_s < started_s:
            what = (
                "sent lines before all cameras were started, and does not report its count of line triggers"
            )
            remedy = "start while the press is stopped, or let the cameras report it: chunks = true"
            raise ScanError(self._cameras[number].name, what, remedy=remedy)
        if block.time_s > before_s:
            self._came_s[number] = math.inf


# --- alignment of lines by their count, never by their arrival ---
#
#     A  |--64--|--64--|--64--|          lines of each sensor, in the common count
#     B     |--64--|      |--64--|       a block was lost; the rest keeps its place
#     out   |=================|          lines reported by all; B's lost lines as faults
#
# A line is released once every camera has reported it, or is known to be disconnected, so the result depends neither on
# whose blocks come first nor on any clock. Memory is bounded: a camera that lags too far behind is left out until it
# has caught up.

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
