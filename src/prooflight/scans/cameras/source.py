"""A camera as an endless source of lines: it may die and come back, and the count goes on.

One thread reads. Where no lines come though they should, or the camera says that it is gone, another thread closes it
and opens it again until it answers: both take seconds, and the run can be ended meanwhile. A camera that waits for an
encoder is asked beside the reading (``asking``). The lines that passed are what the camera's own count of triggers
says; else they are reckoned by the time and the line rate, so that nothing is counted twice, and nobody claims to know
them to the line.
"""

from __future__ import annotations

import contextlib
import logging
import math
import queue
import threading
import time
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal

from prooflight.errors import ScanError
from prooflight.scans.cameras.asking import Asking
from prooflight.scans.cameras.camera import Health
from prooflight.scans.cameras.counting import LineCounter
from prooflight.scans.cameras.pixel_formats import pixel_format
from prooflight.scans.cameras.setting_up import CameraSettings, position, value_of
from prooflight.scans.lines import BLOCK_LINES, CAMERA_AWAY

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Mapping

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
STEPS_UNKNOWN: Final = 8
"""Encoder steps from line to line, where the press file does not say. assumed: few are more finely divided."""
SILENT_BLOCKS: Final = 2.0
"""Blocks for which the encoder may go on without one coming: one that is being read, one on its way."""
WARM_S: Final = 5.0
"""For which what the camera itself says of its health stands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where the count of a camera's lines stands beside the camera's own count of triggers."""

    base: int | None
    """What the camera's own is more; None: it tells none."""
    period: int
    """Lines after which the camera's own begins again."""
    exact: bool
    """Whether every line since the first was counted."""


class CameraLines:
    """The lines of one camera; see ``LineSource``."""

    def __init__(
        self,
        opened: Callable[[], Camera],
        *,
        name: str,
        settings: CameraSettings | None = None,
        tell: Told = lambda _kind, _text: None,
        silent_s: float = SILENT_S,
        reopen_s: float = REOPEN_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """opened: opens the camera and sets it up; called at once, and again whenever it has died. settings: as which
        it was set up; of one that runs free, lines must always come; if it does not, a press may stand still, and the
        camera is asked. tell: called from the reading thread. Errors of ``opened`` are raised.
        """
        self.settings = settings or CameraSettings()
        self._opened, self.name, self.tell = opened, name, tell
        self._runs_free = self.settings.trigger == "free"
        self._silent_s, self._reopen_s, self._clock = silent_s, reopen_s, clock
        self._closed = threading.Event()
        self._camera: Camera | None = opened()
        self._counter = LineCounter(name=name, encoder_steps=self.settings.encoder_steps)
        self._asking = threading.Lock()  # of what is asked beside the lines, one thing at a time
        self._suspected = ""
        self._own, self._own_s = Health(), -math.inf
        self.started_s = math.inf
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
            self.started_s = self._clock()
            yield from self._read(camera)
        finally:
            self._let_go(self._camera)

    def _read(self, camera: Camera) -> Iterator[LineBlock]:
        heard_s = waited_s = (
            self._clock()
        )  # the last line; since when this camera has been listened to in vain
        away, asking = False, self._asked_of(camera)
        while not self._closed.is_set():
            grab, why = self._grabbed(camera, asking, waited_s)
            if grab is not None:
                if away:
                    self._returned(grab, heard_s)
                away, heard_s, waited_s = False, grab.time_s, self._clock()
                asking.heard()
                yield from self._counted(grab)
            elif why:
                if not away:
                    self._away += 1
                    self.tell("camera-away", f"{self.name} {why}; it is opened again as soon as it answers")
                again = self._again(camera)
                if again is None:
                    return
                (camera, asking), away, waited_s = again, True, self._clock()

    def _grabbed(self, camera: Camera, asking: Asking, waited_s: float) -> tuple[Grab | None, str]:
        """The next block, if one comes soon; and why none will, if that is known."""
        try:
            grab = camera.grab(GRAB_S)
        except ScanError as error:
            return None, error.what
        if grab is not None:
            self._suspected = ""
            return grab, ""
        silent_s = self._clock() - waited_s
        if self._runs_free:
            silent = silent_s > self._silent_s
            return None, f"has sent no line for {silent_s:.1f} s" if silent else ""
        suspected, self._suspected = self._suspected, ""
        return None, suspected or asking.silent(silent_s)

    def suspect(self, why: str) -> None:
        """Somebody else knows that lines should come; from any thread. It is opened again unless one has come since."""
        self._suspected = why

    def _asked_of(self, camera: Camera) -> Asking:
        steps = self.settings.encoder_steps or STEPS_UNKNOWN
        height = camera.feature("Height")
        lines = float(height.value) if height is not None and height.value else BLOCK_LINES
        return Asking(
            camera,
            position=self._position,
            most_steps=round(SILENT_BLOCKS * lines * steps),
            clock=self._clock,
        )

    def _position(self, camera: Camera) -> int | None:
        with self._asking:
            return position(camera, self.settings)

    def _returned(self, grab: Grab, heard_s: float) -> None:
        """Reckon what passed since the last line was heard."""
        away_s = grab.time_s - heard_s
        lines = max(round(away_s * self._rate_hz()) - grab.lines, 0)
        lost = self._counter.restarted(lines=lines, why=f"{CAMERA_AWAY} for {away_s:.1f} s", grab=grab)
        about = "" if self._counter.exact else "about "
        self._times.clear()
        self.tell("camera-back", f"{self.name} is back after {away_s:.1f} s; {about}{lost} lines were lost")

    @property
    def place(self) -> Place:
        """Where its count stands beside the camera's own."""
        counter = self._counter
        return Place(base=counter.base, period=counter.period, exact=counter.exact)

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

    def _again(self, dead: Camera) -> tuple[Camera, Asking] | None:
        """The camera, opened and started anew by another thread; None: the source was closed meanwhile."""
        ready: queue.SimpleQueue[tuple[Camera, Asking]] = queue.SimpleQueue()
        threading.Thread(target=self._bring_back, args=(dead, ready), name="reopen", daemon=True).start()
        while not self._closed.is_set():
            with contextlib.suppress(queue.Empty):
                return ready.get(timeout=GRAB_S)
        return None

    def _bring_back(self, dead: Camera, ready: queue.SimpleQueue[tuple[Camera, Asking]]) -> None:
        with self._asking:  # whoever asks it just now gives up by itself
            self._let_go(dead)
        while not self._closed.is_set():
            camera = None
            try:
                camera = self._opened()
                asking = self._asked_of(camera)
                camera.start()
            except Exception as error:  # whatever it is: a camera that is away must be tried again
                _log.debug("%s cannot be opened again", self.name, exc_info=error)
                self._let_go(camera)
                self._closed.wait(self._reopen_s)
                continue
            if self._closed.is_set():
                self._let_go(camera)
                return
            self._camera = camera
            ready.put((camera, asking))
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

    def healths(self) -> Mapping[str, Health]:
        """Its health, by its name."""
        return {self.name: self.health()}

    def health(self) -> Health:
        """Lines, losses, and what the camera itself said last: it is asked in a thread of its own, now and then."""
        camera, counter = self._camera, self._counter
        if camera is None:
            self._own, self._own_s = Health(), -math.inf
        elif self._clock() - self._own_s > WARM_S:
            self._own_s = self._clock()
            asked = threading.Thread(
                target=self._ask_health, args=(camera,), name="camera health", daemon=True
            )
            asked.start()
            asked.join(GRAB_S)
        return replace(
            self._own,
            lines=counter.lines,
            lines_lost=counter.lost,
            lines_per_s=0.0 if camera is None else self._rate_hz(),
            blocks=counter.blocks,
            blocks_broken=counter.broken,
            away=self._away,
            present=camera is not None,
        )

    def _ask_health(self, camera: Camera) -> None:
        with self._asking:
            if camera is not self._camera:
                return  # it has been let go of meanwhile
            try:
                self._own = camera.health()
            except Exception as error:  # whatever a library says: nobody must lose a run for it
                _log.debug("%s does not tell its health", self.name, exc_info=error)
