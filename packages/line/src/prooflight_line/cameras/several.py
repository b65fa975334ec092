"""Several line cameras as one source: the sensors of one press, aligned by the count of their encoder.

Each camera is read by a thread of its own (``source``), which also reopens it after a failure; ``in_step``
aligns their blocks. Where blocks have the count of line triggers, that is the common count, whatever was lost
and whenever each camera was started. Where they do not, all cameras have to be started while the press
stands, and count their lines from there.
"""

from __future__ import annotations

import math
import queue
import threading
from functools import partial
from typing import TYPE_CHECKING, Final, Literal

from prooflight.errors import RequestError, ScanError
from prooflight_line.cameras.in_step import InStep

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping, Sequence

    from prooflight.scans.alignment import SensorOffset
    from prooflight.scans.lines import LineBlock
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
