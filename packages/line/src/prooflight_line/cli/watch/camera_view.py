"""View of a run's camera for the console, computed while somebody watches, at most once a second.

The blocks of lines are only referenced as they pass. All else happens in a thread of lowest priority, so a
verdict waits for none of it.
"""

from __future__ import annotations

import base64
import contextlib
import logging
import os
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight.scans.lines import LineBlock, LineSource
    from prooflight_line.camera_set_up.seen import SensorView
    from prooflight_line.cameras.camera import Health
    from prooflight_line.journal.camera_view import CameraExchange

_log = logging.getLogger(__name__)

POLL_S: Final = 1.0
"""Time between two views: each costs some 0.15 s of CPU at 7,296 pixels, 0.3 s where print moves."""
WINDOW_LINES: Final = 512
"""Lines that are analysed. assumed: enough for percentiles and still edges; the ruler of `camera view`
needs more."""
RATE_BLOCKS: Final = 64
PLACES: Final = 240
"""Positions along the line: more cannot be distinguished on a screen."""
PICTURE_PIXELS: Final = 480
"""Greatest width of the picture of the lines: at 7,296 pixels it has 45 kB at most, so that all sensors fit into the
exchanged file."""
RED: Final = (36, 28, 194)
"""Colour of saturated places: blue, green, red."""
LEAST_PRIORITY: Final = 15


class ShownLines:
    """A source whose last lines are shown; see ``LineSource``. Use it as a context around the run."""

    def __init__(
        self,
        source: LineSource,
        *,
        exchange: CameraExchange,
        press: Press,
        name: str,
        healths: Callable[[], Mapping[str, Health]] | None = None,
        poll_s: float = POLL_S,
    ) -> None:
        """Wrap a source.

        ``name`` is that of the source, for people. ``healths`` returns the health of cameras; None: the
        source is no camera.
        """
        self._source, self._exchange, self._press = source, exchange, press
        self._name, self._healths, self._poll_s = name, healths, poll_s
        self._blocks: deque[LineBlock] = deque()
        self._times: deque[tuple[float, int]] = deque(maxlen=RATE_BLOCKS)
        self._count = self._lines = self._lost = 0
        self._guard, self._ended = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._show_all, name="camera-view", daemon=True)

    @property
    def sensors(self) -> int:
        """Number of sensors, as in ``LineSource``."""
        return self._source.sensors

    @property
    def pixels(self) -> int:
        """Number of pixels, as in ``LineSource``."""
        return self._source.pixels

    def blocks(self) -> Iterator[LineBlock]:
        """Yield the blocks as in ``LineSource``, and store the last ones."""
        for block in self._source.blocks():
            self._hold(block)
            yield block

    def close(self) -> None:
        """Close the source, as in ``LineSource``."""
        self._source.close()

    def __enter__(self) -> ShownLines:
        self._thread.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._ended.set()
        self._thread.join()
        self._exchange.clear()

    def current_view(self) -> dict[str, Any] | None:
        """Return the current view in the form of JSON; None if no line has come yet."""
        from prooflight_line.camera_set_up.seen import sensor_views

        with self._guard:
            blocks, times = list(self._blocks), list(self._times)
            lines, lost = self._lines, self._lost
        if not blocks:
            return None
        press = self._press
        image = np.concatenate([block.lines for block in blocks], axis=1)[:, -WINDOW_LINES:]
        top = max(sensor.top_code_dn for sensor in press.sensors)
        if self._healths is not None and (healths := list(self._healths().values())):
            lines = max(one.lines for one in healths)
            lost = sum(one.lines_lost for one in healths)
        return {
            "camera": self._name,
            "press": press.name,
            "lines": int(image.shape[1]),
            "lines_seen": lines,
            "lines_lost": lost,
            "lines_per_s": _rate(times),
            "top_code_dn": int(top),
            "width_mm": press.geometry.pixels * press.geometry.pixel_pitch_mm,
            "sensors": [
                {"name": sensor.name} | _facts(view) | {"picture": picture_of(lines_of, int(top))}
                for sensor, view, lines_of in zip(
                    press.sensors,
                    sensor_views(image, top_code_dn=top, where=self._name),
                    image,
                    strict=True,
                )
            ],
        }

    # --- parts ---

    def _hold(self, block: LineBlock) -> None:
        lines = block.lines.shape[1]
        with self._guard:
            self._blocks.append(block)
            self._count += lines
            self._lines += lines
            self._lost += sum(fault.lines for fault in block.faults if fault.unseen)
            self._times.append((time.monotonic(), block.next_line))
            while self._count - self._blocks[0].lines.shape[1] >= WINDOW_LINES:
                self._count -= self._blocks.popleft().lines.shape[1]

    def _show_all(self) -> None:
        if hasattr(os, "setpriority"):
            with contextlib.suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), LEAST_PRIORITY)
        while not self._ended.wait(self._poll_s):
            if not self._exchange.is_requested():
                continue
            try:
                view = self.current_view()
                if view is not None:
                    self._exchange.write(view)
            except Exception:  # whoever looks must not end the inspection
                _log.exception("the camera's view")
                return


def _rate(times: list[tuple[float, int]]) -> float:
    """Return lines a second over the last blocks; 0 if not known, or none come."""
    if len(times) < 2:
        return 0.0
    (begun_s, first), (_, last) = times[0], times[-1]
    return (last - first) / max(time.monotonic() - begun_s, 1e-3)


def _facts(view: SensorView) -> dict[str, Any]:
    focus = view.focus
    return {
        "mean_dn": _places(view.mean_dn),
        "paper_dn": _places(view.paper_dn),
        "saturated_share": view.saturated,
        "black_dn": view.black_dn,
        "noise_dn": view.noise_dn,
        "flatness": view.flatness,
        "focus_by": None if focus is None else focus.by,
        "mtf50_across": None if focus is None else focus.across.value,
        "mtf50_along": None if focus is None or focus.along is None else focus.along.value,
    }


def picture_of(lines: NDArray[np.uint16], top_code_dn: int) -> str:
    """Return a picture of one sensor's lines (lines, pixels) [DN], in which saturated places are red: PNG, base64.

    A place of the picture is saturated if any number in it is: a single column that clips must be seen.
    """
    import cv2

    step = max(-(-lines.shape[1] // PICTURE_PIXELS), 1)
    rows, columns = (extent // step * step for extent in lines.shape)
    if not rows or not columns:
        return ""
    parts = lines[:rows, :columns].reshape(rows // step, step, columns // step, step)
    grey = np.rint(parts.mean(axis=(1, 3)) * (255 / top_code_dn)).clip(0, 255).astype(np.uint8)
    picture = np.repeat(grey[:, :, None], 3, axis=2)
    picture[(parts >= top_code_dn).any(axis=(1, 3))] = RED
    _, encoded = cv2.imencode(".png", picture)
    return base64.b64encode(encoded.tobytes()).decode("ascii")


def _places(profile: NDArray[np.float64]) -> list[float]:
    """Return (pixels,) as means of ``PLACES`` parts of the line, or as it is if it has fewer pixels. [DN]"""
    parts = np.array_split(profile, min(PLACES, profile.size))
    return [round(float(part.mean()), 1) for part in parts]
