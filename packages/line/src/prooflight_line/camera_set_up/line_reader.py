"""Reader of a camera's lines on demand: without a gap, and exposed after a change of settings."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.errors import ScanError
from prooflight.scans.camera_settings import NAMES
from prooflight_line.cameras.counting import LineCounter
from prooflight_line.cameras.pixel_formats import pixel_format
from prooflight_line.cameras.setting_up import FEATURES_REMEDY, value_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

    from prooflight_line.cameras.camera import Camera, Feature, Health

GRAB_S: Final = 0.1
PATIENCE_S: Final = 10.0
"""Time without a line after which a camera counts as silent."""
STALE_BLOCKS: Final = 2
"""Number of blocks that are dropped after a change.

One was being exposed, one was on its way. assumed: cameras hold no more.
"""
SILENT: Final = 'start the paper; check encoder and TriggerSource, or set trigger = "free" under [camera]'
RATE_BLOCKS: Final = 64
"""Number of blocks over which the line rate is counted."""
WAITED_S: Final = 1e-3
"""Least time waited for a block that has just arrived."""
MOST_WAITING: Final = 4096
"""Greatest number of blocks that a backend may hold."""


@dataclass(slots=True, kw_only=True)
class LastLines:
    """Latest contiguous lines of an endless stream."""

    window: int
    """Greatest number of lines that are stored, to a block."""
    came: int = 0
    """Number of all lines, stored or not."""
    count: int = 0
    _blocks: deque[NDArray[np.uint16]] = field(default_factory=deque)

    def add(self, block: NDArray[np.uint16], *, torn: bool) -> None:
        """Add a block (sensors, n, pixels).

        torn: lines are missing before it, so that earlier ones are dropped.
        """
        if torn:
            self._blocks.clear()
            self.count = 0
        self._blocks.append(block)
        self.count += block.shape[1]
        self.came += block.shape[1]
        while self.count - self._blocks[0].shape[1] >= self.window:
            self.count -= self._blocks.popleft().shape[1]

    def lines(self) -> NDArray[np.uint16]:
        """Return the stored lines, (sensors, count, pixels). [DN]"""
        return np.concatenate(list(self._blocks), axis=1)


class CameraLineReader:
    """Open camera whose lines are requested when they are needed, and dropped meanwhile."""

    def __init__(
        self,
        camera: Camera,
        *,
        names: Mapping[str, str] | None = None,
        clock: Callable[[], float] = time.monotonic,
        patience_s: float = PATIENCE_S,
    ) -> None:
        """Take over an open camera, which is started at the first request for lines.

        names: this model's names for features of ``setting_up.NAMES``. ScanError: its pixels cannot be read.
        """
        self.camera, self._names, self._clock, self._patience_s = camera, names or {}, clock, patience_s
        self.name = camera.info.id
        self.pixels = int(value_of(camera, "Width"))
        self.form = pixel_format(value_of(camera, "PixelFormat"), where=self.name)
        self.sensors = self.form.sensors
        self._counter = LineCounter(name=self.name, pixels=self.pixels, sensors=self.sensors)
        self._times: deque[tuple[float, int]] = deque(maxlen=RATE_BLOCKS)
        self._started = False

    @property
    def top_code_dn(self) -> int:
        """Return the greatest number of its pixel format. [DN]"""
        return self.form.top_code_dn

    def feature(self, feature: str) -> Feature | None:
        """Return the camera's feature of a standard name, as it stands; None: it has none."""
        own = self._names.get(feature)
        names = NAMES[feature] if own is None else (own,)
        return next((one for name in names if (one := self.camera.feature(name)) is not None), None)

    def set(self, feature: str, value: float) -> float:
        """Set a feature, within the camera's limits, and return the value that it then reports.

        ScanError: it cannot be set.
        """
        one = self.feature(feature)
        if one is None or not one.writable:
            raise ScanError(
                self.name, f"does not allow {NAMES[feature][0]} to be set", remedy=FEATURES_REMEDY
            )
        low = value if one.least is None else max(value, one.least)
        clamped = low if one.greatest is None else min(low, one.greatest)
        self.camera.set(one.name, f"{clamped:.12g}" if one.kind == "float" else str(round(clamped)))
        reported = self.camera.feature(one.name)
        return clamped if reported is None or not reported.value else float(reported.value)

    def lines(self, count: int, *, fresh: bool = True) -> NDArray[np.uint16]:
        """Return contiguous lines, (sensors, count, pixels) [DN]; fresh: that were exposed after this call.

        ScanError: none come, or the camera is disconnected.
        """
        last = next(last for last in self.endless(count, fresh=fresh) if last.count >= count)
        return last.lines()[:, :count]

    def endless(self, window: int, *, fresh: bool = True) -> Iterator[LastLines]:
        """Yield the latest contiguous lines with each block that comes: the same object, which is updated."""
        last = LastLines(window=window)
        for block, torn in self._blocks(fresh=fresh):
            last.add(block, torn=torn)
            yield last

    def rate_hz(self) -> float:
        """Return the lines a second over the last blocks; 0: not known yet."""
        if len(self._times) < 2:
            return 0.0
        (begun_s, first), (end_s, last) = self._times[0], self._times[-1]
        return (last - first) / (end_s - begun_s) if end_s > begun_s else 0.0

    def health(self) -> Health:
        """Return lines, losses, and the camera's own report."""
        counter = self._counter
        return replace(
            self.camera.health(),
            lines=counter.lines,
            lines_lost=counter.lost,
            lines_per_s=self.rate_hz(),
            blocks=counter.blocks,
            blocks_broken=counter.broken,
        )

    def close(self) -> None:
        """Close the camera."""
        self.camera.close()

    def _blocks(self, *, fresh: bool) -> Iterator[tuple[NDArray[np.uint16], bool]]:
        """Yield blocks as they come, and whether each does not continue the one before."""
        if not self._started:
            self.camera.start()
            self._started = True
        stale = self._drained() if fresh else 0
        heard_s, next_line, silent = self._clock(), -1, False
        while True:
            begun_s = self._clock()
            grab = self.camera.grab(GRAB_S)
            now_s = self._clock()
            if grab is None:
                silent = True
                if now_s - heard_s > self._patience_s:
                    raise ScanError(self.name, f"has sent no line for {now_s - heard_s:.0f} s", remedy=SILENT)
                continue
            # A block that had waited to be read does not say when it came.
            waited, silent, heard_s = silent or now_s - begun_s > WAITED_S, False, now_s
            blocks = list(self._counter.take(grab))
            if waited:
                self._times.append((now_s, self._counter.next_line))
            for block in blocks if stale <= 0 else ():
                yield block.lines, block.first_line != next_line
                next_line = block.next_line
            stale -= 1

    def _drained(self) -> int:
        """Drop blocks that came while they were not read, and return the number of further ones to drop."""
        self._times.clear()
        for _ in range(MOST_WAITING):
            grab = self.camera.grab(0.0)
            if grab is None:
                break
            for _block in self._counter.take(grab):
                pass
        return STALE_BLOCKS
