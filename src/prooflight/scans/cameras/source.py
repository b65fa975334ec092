"""A camera as an endless source of lines: it may die and come back, and the count goes on.

One thread reads. Where no lines come though they should, or the camera says that it is gone, another thread closes it
and opens it again until it answers: both take seconds, and the run can be ended meanwhile. The lines that passed are
reckoned by the time and the line rate, so that nothing is counted twice; nobody claims to know them to the line.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Final, Literal

from prooflight.errors import ScanError
from prooflight.scans.cameras.camera import Health
from prooflight.scans.cameras.counting import LineCounter
from prooflight.scans.cameras.pixel_formats import pixel_format
from prooflight.scans.cameras.setting_up import value_of

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator

    from prooflight.scans.cameras.camera import Camera, Grab
    from prooflight.scans.lines import LineBlock

    Told = Callable[[Literal["camera-away", "camera-back"], str], None]
    """Is given what happened, and a line for a person."""

_log = logging.getLogger(__name__)

GRAB_S: Final = 0.1
"""How long a block is waited for at once: as long the run's end may be held up."""
SILENT_S: Final = 1.0
"""Without a block from a camera that runs free, after which it is taken for dead. assumed: its blocks come in less than
a quarter of that; an operator is told within 2 s."""
REOPEN_S: Final = 0.5
"""Between two tries to open it again."""
RATE_BLOCKS: Final = 16
"""Blocks over which the line rate is measured."""


class CameraLines:
    """The lines of one camera; see ``LineSource``."""

    def __init__(
        self,
        opened: Callable[[], Camera],
        *,
        name: str,
        runs_free: bool = False,
        tell: Told = lambda _kind, _text: None,
        silent_s: float = SILENT_S,
        reopen_s: float = REOPEN_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """opened: opens the camera and sets it up; called at once, and again whenever it has died. runs_free: whether
        lines must always come; if not, a press may stand still, and the camera itself must say that it is gone. tell:
        called from the reading thread. Errors of ``opened`` are raised.
        """
        self._opened, self._name, self._runs_free, self.tell = opened, name, runs_free, tell
        self._silent_s, self._reopen_s, self._clock = silent_s, reopen_s, clock
        self._closed = threading.Event()
        self._camera: Camera | None = opened()
        self._counter = LineCounter(name=name)
        self._times: deque[tuple[float, int]] = deque(maxlen=RATE_BLOCKS)
        self._rate_before_hz = 0.0
        self._away = 0
        self._reading = False
        try:
            self.pixels = int(value_of(self._camera, "Width"))
            self.form = pixel_format(value_of(self._camera, "PixelFormat"), where=name)
        except BaseException:
            self._camera.close()
            raise
        self.sensors = self.form.sensors
        self._counter.pixels, self._counter.sensors = self.pixels, self.sensors

    def blocks(self) -> Generator[LineBlock, None, None]:
        """See ``LineSource``; ends only by ``close``. ScanError: the camera cannot be started, or its lines read."""
        camera, self._reading = self._camera, True
        if camera is None:
            return
        try:
            camera.start()
            yield from self._read(camera)
        finally:
            self._let_go(self._camera)

    def _read(self, camera: Camera) -> Iterator[LineBlock]:
        heard_s = waited_s = (
            self._clock()
        )  # the last line; since when this camera has been listened to in vain
        away = False
        while not self._closed.is_set():
            grab, why = self._grabbed(camera, waited_s)
            if grab is not None:
                if away:
                    self._returned(grab, heard_s)
                away, heard_s, waited_s = False, grab.time_s, self._clock()
                yield from self._counted(grab)
            elif why:
                if not away:
                    self._away += 1
                    self.tell("camera-away", f"{self._name} {why}; it is opened again as soon as it answers")
                again = self._again(camera)
                if again is None:
                    return
                camera, away, waited_s = again, True, self._clock()

    def _grabbed(self, camera: Camera, waited_s: float) -> tuple[Grab | None, str]:
        """The next block, if one comes soon; and why none will, if that is known."""
        try:
            grab = camera.grab(GRAB_S)
        except ScanError as error:
            return None, error.what
        silent_s = self._clock() - waited_s
        if grab is None and self._runs_free and silent_s > self._silent_s:
            return None, f"has sent no line for {silent_s:.1f} s"
        return grab, ""

    def _returned(self, grab: Grab, heard_s: float) -> None:
        """Reckon what passed since the last line was heard."""
        away_s = grab.time_s - heard_s
        lines = max(round(away_s * self._rate_hz()) - grab.lines, 0)
        self._counter.restarted(lines=lines, why=f"the camera was away for {away_s:.1f} s")
        self._times.clear()
        self.tell("camera-back", f"{self._name} is back after {away_s:.1f} s; about {lines} lines were lost")

    def _counted(self, grab: Grab) -> Iterator[LineBlock]:
        yield from self._counter.take(grab)
        self._times.append((grab.time_s, self._counter.next_line))

    def _rate_hz(self) -> float:
        """Lines a second over the last blocks; 0: not known yet."""
        if len(self._times) < 2:
            return self._rate_before_hz
        (begun_s, first), (end_s, last) = self._times[0], self._times[-1]
        if end_s > begun_s:
            self._rate_before_hz = (last - first) / (end_s - begun_s)
        return self._rate_before_hz

    def _again(self, dead: Camera) -> Camera | None:
        """The camera, opened and started anew by another thread; None: the source was closed meanwhile."""
        ready: queue.SimpleQueue[Camera] = queue.SimpleQueue()
        threading.Thread(target=self._bring_back, args=(dead, ready), name="reopen", daemon=True).start()
        while not self._closed.is_set():
            with contextlib.suppress(queue.Empty):
                return ready.get(timeout=GRAB_S)
        return None

    def _bring_back(self, dead: Camera, ready: queue.SimpleQueue[Camera]) -> None:
        self._let_go(dead)
        while not self._closed.is_set():
            camera = None
            try:
                camera = self._opened()
                camera.start()
            except Exception as error:  # whatever it is: a camera that is away must be tried again
                _log.debug("%s cannot be opened again", self._name, exc_info=error)
                self._let_go(camera)
                self._closed.wait(self._reopen_s)
                continue
            if self._closed.is_set():
                self._let_go(camera)
                return
            self._camera = camera
            ready.put(camera)
            return

    def _let_go(self, camera: Camera | None) -> None:
        if camera is not None:
            if camera is self._camera:
                self._camera = None
            camera.close()

    def close(self) -> None:
        """See ``LineSource``."""
        self._closed.set()
        if not self._reading:
            self._let_go(self._camera)

    def health(self) -> Health:
        """Lines, losses, and what the camera itself says."""
        camera, counter = self._camera, self._counter
        own = Health() if camera is None else camera.health()
        return replace(
            own,
            lines=counter.lines,
            lines_lost=counter.lost,
            lines_per_s=self._rate_hz(),
            blocks=counter.blocks,
            blocks_broken=counter.broken,
            away=self._away,
        )
