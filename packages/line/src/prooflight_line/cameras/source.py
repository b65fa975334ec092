"""A camera as an endless source of lines, which survives disconnections without losing count.

One thread reads. Where no lines come though they should, or the camera is disconnected, another thread closes
it and opens it again until it answers: both take seconds, and the run can be ended meanwhile. A camera that
waits for an encoder is queried beside the reading (``asking``). The number of lines that passed is taken from
the camera's own count of triggers; else it is estimated from the time and the line rate, so that nothing is
counted twice, and it is reported as approximate.
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
from prooflight.scans.camera_settings import CameraSettings
from prooflight.scans.lines import BLOCK_LINES, CAMERA_AWAY
from prooflight_line.cameras.camera import Health
from prooflight_line.cameras.counting import LineCounter
from prooflight_line.cameras.pixel_formats import pixel_format
from prooflight_line.cameras.setting_up import position, value_of

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator, Mapping

    from prooflight.scans.lines import LineBlock
    from prooflight_line.cameras.camera import Camera, Grab

    Notify = Callable[[Literal["camera-away", "camera-back"], str], None]
    "Callback with what happened, and a line for a person."
    from collections.abc import Callable

_log = logging.getLogger(__name__)

GRAB_S: Final = 0.1
"""Longest wait for a block at once, which also bounds the delay of the run's end."""
SILENT_S: Final = 1.0
"""Time without a block, after which a free-running camera counts as dead. assumed: its blocks come in less
than a quarter of that; an operator is informed within 2 s."""
REOPEN_S: Final = 0.5
"""Time between two attempts to open it again."""
RATE_BLOCKS: Final = 16
"""Blocks over which the line rate is measured."""
STEPS_UNKNOWN: Final = 8
"""Encoder steps from line to line, where the press file does not state them. assumed: few are more finely
divided."""
SILENT_BLOCKS: Final = 2.0
"""Blocks for which the encoder may move without one coming: one that is being read, one on its way."""
WARM_S: Final = 5.0
"""Time for which the camera's own report of its health is valid."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Relation between this count of a camera's lines and the camera's own count of triggers."""

    base: int | None
    """The camera's own count minus this one; None if it has none."""
    period: int
    """Lines after which the camera's own count wraps around."""
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
        tell: Notify = lambda _kind, _text: None,
        silent_s: float = SILENT_S,
        reopen_s: float = REOPEN_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open a camera as a source; errors of ``opened`` are raised.

        Parameters
        ----------
        opened : opens the camera and sets it up; called at once, and again whenever it has died
        settings : as it was set up. Lines of a free-running camera must always come; otherwise the press may
            stand still, and the camera is queried
        tell : called from the reading thread
        """
        self.settings = settings or CameraSettings()
        self._opened, self.name, self.tell = opened, name, tell
        self._runs_free = self.settings.trigger == "free"
        self._silent_s, self._reopen_s, self._clock = silent_s, reopen_s, clock
        self._closed = threading.Event()
        self._camera: Camera | None = opened()
        self._counter = LineCounter(name=name, encoder_steps=self.settings.encoder_steps)
        self._request_lock = threading.Lock()  # one request beside the lines at a time
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
        )  # time of the last line, and time since which the open camera has been silent
        away, watchdog = False, self._new_watchdog(camera)
        while not self._closed.is_set():
            grab, why = self._grabbed(camera, watchdog, waited_s)
            if grab is not None:
                if away:
                    self._returned(grab, heard_s)
                away, heard_s, waited_s = False, grab.time_s, self._clock()
                watchdog.heard()
                yield from self._counted(grab)
            elif why:
                if not away:
                    self._away += 1
                    self.tell("camera-away", f"{self.name} {why}; it is opened again as soon as it answers")
                again = self._again(camera)
                if again is None:
                    return
                (camera, watchdog), away, waited_s = again, True, self._clock()

    def _grabbed(self, camera: Camera, watchdog: Watchdog, waited_s: float) -> tuple[Grab | None, str]:
        """Return the next block, if one comes soon, and why none will come, if that is known."""
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
        return None, suspected or watchdog.silent(silent_s)

    def suspect(self, why: str) -> None:
        """Report from any thread that lines should come; the camera is opened again unless one has come since."""
        self._suspected = why

    def _new_watchdog(self, camera: Camera) -> Watchdog:
        steps = self.settings.encoder_steps or STEPS_UNKNOWN
        height = camera.feature("Height")
        lines = float(height.value) if height is not None and height.value else BLOCK_LINES
        return Watchdog(
            camera,
            position=self._position,
            most_steps=round(SILENT_BLOCKS * lines * steps),
            clock=self._clock,
        )

    def _position(self, camera: Camera) -> int | None:
        with self._request_lock:
            return position(camera, self.settings)

    def _returned(self, grab: Grab, heard_s: float) -> None:
        """Count the lines that passed since the last one came."""
        away_s = grab.time_s - heard_s
        lines = max(round(away_s * self._rate_hz()) - grab.lines, 0)
        lost = self._counter.restarted(lines=lines, why=f"{CAMERA_AWAY} for {away_s:.1f} s", grab=grab)
        about = "" if self._counter.exact else "about "
        self._times.clear()
        self.tell("camera-back", f"{self.name} is back after {away_s:.1f} s; {about}{lost} lines were lost")

    @property
    def place(self) -> Place:
        """Relation of this count to the camera's own."""
        counter = self._counter
        return Place(base=counter.base, period=counter.period, exact=counter.exact)

    def _counted(self, grab: Grab) -> Iterator[LineBlock]:
        yield from self._counter.take(grab)
        self._times.append((grab.time_s, self._counter.next_line))

    def _rate_hz(self) -> float:
        """Return the lines per second over the last blocks; 0 if not known yet."""
        if len(self._times) < 2:
            return self._rate_before_hz
        (begun_s, first), (end_s, last) = self._times[0], self._times[-1]
        if end_s > begun_s:
            self._rate_before_hz = (last - first) / (end_s - begun_s)
        return self._rate_before_hz

    def _again(self, dead: Camera) -> tuple[Camera, Watchdog] | None:
        """Return the camera, opened and started again by another thread; None if the source was closed meanwhile."""
        ready: queue.SimpleQueue[tuple[Camera, Watchdog]] = queue.SimpleQueue()
        threading.Thread(target=self._bring_back, args=(dead, ready), name="reopen", daemon=True).start()
        while not self._closed.is_set():
            with contextlib.suppress(queue.Empty):
                return ready.get(timeout=GRAB_S)
        return None

    def _bring_back(self, dead: Camera, ready: queue.SimpleQueue[tuple[Camera, Watchdog]]) -> None:
        with self._request_lock:  # a request in progress ends by itself
            self._let_go(dead)
        while not self._closed.is_set():
            camera = None
            try:
                camera = self._opened()
                watchdog = self._new_watchdog(camera)
                camera.start()
            except Exception as error:  # whatever the error, a disconnected camera must be tried again
                _log.debug("%s cannot be opened again", self.name, exc_info=error)
                self._let_go(camera)
                self._closed.wait(self._reopen_s)
                continue
            if self._closed.is_set():
                self._let_go(camera)
                return
            self._camera = camera
            ready.put((camera, watchdog))
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
        """Return its health, by its name."""
        return {self.name: self.health()}

    def health(self) -> Health:
        """Return lines, losses, and the camera's last own report, which is requested now and then in another thread."""
        camera, counter = self._camera, self._counter
        if camera is None:
            self._own, self._own_s = Health(), -math.inf
        elif self._clock() - self._own_s > WARM_S:
            self._own_s = self._clock()
            request = threading.Thread(
                target=self._ask_health, args=(camera,), name="camera health", daemon=True
            )
            request.start()
            request.join(GRAB_S)
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
        with self._request_lock:
            if camera is not self._camera:
                return  # it has been closed meanwhile
            try:
                self._own = camera.health()
            except Exception as error:  # no error of a library may end a run
                _log.debug("%s does not report its health", self.name, exc_info=error)


# --- liveness of the camera, which may answer after seconds or never ---

ASK_AFTER_S: Final = 0.4
"""Time without a block, after which a camera is queried."""
ASK_AGAIN_S: Final = 0.2
ANSWER_S: Final = 1.0
"""Longest time for an answer; with ``ASK_AFTER_S`` an operator is informed within 2 s."""


@dataclass(slots=True, eq=False)
class Query:
    """One query, and its answer once it has come."""

    requested_s: float
    answered: bool = False
    position: int | None = None
    """Position of the encoder, in steps; None if the camera does not report it."""
    error: str = ""
    """Why the camera cannot answer; empty if it does."""


class Watchdog:
    """Queries one open camera, one query at a time, and decides what its silence means.

    ``silent`` is called by the reading thread whenever no block has come. A stopped press is no dead camera:
    where the camera reports the encoder's position, it must have sent the lines for its movement.
    """

    def __init__(
        self,
        camera: Camera,
        *,
        position: Callable[[Camera], int | None],
        most_steps: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Watch one camera.

        Parameters
        ----------
        position : the query itself; ScanError: the camera does not answer
        most_steps : greatest movement of the encoder without a block, that of two blocks
        """
        self._camera, self._position = camera, position
        self._most_steps, self._clock = most_steps, clock
        self._query: Query | None = None
        self._position_at_first: int | None = None

    def heard(self) -> None:
        """Reset the check, as a block has come."""
        self._query = self._position_at_first = None

    def silent(self, silent_s: float) -> str:
        """Return why a camera that has sent no block for so long is dead; empty if nothing indicates it."""
        query = self._query
        if query is None:
            if silent_s >= ASK_AFTER_S:
                self._ask()
            return ""
        if not query.answered:
            waited_s = self._clock() - query.requested_s
            return f"has not answered for {waited_s:.1f} s" if waited_s > ANSWER_S else ""
        if query.error:
            return query.error
        if query.position is not None:
            if self._position_at_first is None:
                self._position_at_first = query.position
            steps = abs(query.position - self._position_at_first)
            if steps > self._most_steps:
                return f"has sent no line for {silent_s:.1f} s, although its encoder has advanced by {steps} steps"
        if self._clock() - query.requested_s >= ASK_AGAIN_S:
            self._ask()
        return ""

    def _ask(self) -> None:
        query = Query(self._clock())
        self._query = query
        threading.Thread(target=self._answer, args=(query,), name="ask camera", daemon=True).start()

    def _answer(self, query: Query) -> None:
        try:
            query.position = self._position(self._camera)
        except ScanError as failure:
            query.error = failure.what
        except Exception as failure:  # any error of a library means that the camera did not answer
            query.error = f"does not answer ({failure})"
        query.answered = True
