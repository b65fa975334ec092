"""Positions of sheets between camera and gate, and the time at which each is due, by lines and encoder counts.

The camera's lines and the controller's count come from the same transport, so they differ by a constant. Each
reading of the count bounds it: the count was read at some moment between question and answer, and lines
passed at known times of the monotonic clock. The bounds of the last readings are intersected (K. Marzullo and
S. Owicki, "Maintaining the time in a distributed system", 1983, for clocks). If the intersection is empty,
the camera lost lines or the encoder slipped; the constant is then unknown until readings agree again.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, field
from threading import Lock
from typing import TYPE_CHECKING, Final

from prooflight_line.plant.gate.registers import WRAP, count_distance

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight.scans.lines import LineBlock, LineSource

READINGS: Final = 64
"""Readings that must agree: 1.3 s of them at 20 ms. A scale error of 0.5 % moves the constant by 13 mm in
this time at 2 m/s."""
ENOUGH: Final = 8
"""Number of readings from which the constant is used."""
POINTS: Final = 4096
"""Blocks whose times are stored: 94 s of the prototype's camera."""
SPEED_S: Final = 1.0
"""Time over which the speed is averaged."""
MOST_STEP: Final = 0.25
"""Largest difference between the lines from block to block and those expected from the speed, as a share
of these lines and of a second's lines; beyond it the count is taken to have jumped. assumed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transport:
    """Conversion of lines and counts to millimetres."""

    line_pitch_mm: float
    counts_per_mm: float

    @property
    def counts_per_line(self) -> float:
        """Encoder counts from line to line."""
        return self.line_pitch_mm * self.counts_per_mm


@dataclass(slots=True)
class _Stretch:
    """Lines without a break of their count, and the bounds of the constant during them."""

    first_line: int
    lines: deque[int] = field(default_factory=lambda: deque(maxlen=POINTS))
    times_s: deque[float] = field(default_factory=lambda: deque(maxlen=POINTS))
    bounds: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=READINGS))
    """Least and greatest count at line 0, of each reading."""
    agreed: tuple[float, float] | None = None
    """Intersection of the bounds; None: too few readings yet."""

    def line_at(self, time_s: float) -> float | None:
        """Return the lines that had passed at a time; None before the first stored time, or after the last."""
        at = bisect_right(self.times_s, time_s)
        if not 0 < at < len(self.times_s):
            return None
        since_s, until_s = self.times_s[at - 1], self.times_s[at]
        share = (time_s - since_s) / (until_s - since_s)
        return self.lines[at - 1] + share * (self.lines[at] - self.lines[at - 1])

    def lines_per_s(self) -> float | None:
        """Return the speed over the last second; None if there are too few lines yet."""
        if len(self.times_s) < 2:
            return None
        at = min(bisect_right(self.times_s, self.times_s[-1] - SPEED_S), len(self.times_s) - 2)
        span_s = self.times_s[-1] - self.times_s[at]
        return (self.lines[-1] - self.lines[at]) / span_s if span_s > 0 else None


class Tracker:
    """Alignment of lines and counts. Lines come from one thread, readings from another."""

    def __init__(self, transport: Transport, *, distance_mm: float, tolerance_mm: float) -> None:
        """Begin without lines and readings.

        ``distance_mm`` is the distance from camera to gate. A sheet within ``tolerance_mm`` of the expected
        position at the gate is the expected one; the constant must be known to a third of the tolerance.
        """
        self._transport = transport
        self._distance_mm = distance_mm
        self._room = tolerance_mm * transport.counts_per_mm / 3
        self._guard = Lock()
        self._stretches: deque[_Stretch] = deque(maxlen=8)
        self._readings: deque[tuple[int, float, float]] = deque(maxlen=READINGS)
        """Readings whose lines have not come yet: the count, and the times of request and answer."""
        self._last_count = 0
        self._counted_s: float | None = None

    def lines(self, block: LineBlock) -> None:
        """Take lines that have passed."""
        broken = any(fault.kind in ("camera-away", "lost-triggers") for fault in block.faults)
        with self._guard:
            now = self._stretches[-1] if self._stretches else None
            if now is None or broken or self._jumps(now, block):
                now = _Stretch(first_line=block.first_line)
                self._stretches.append(now)
            if not now.times_s or block.time_s > now.times_s[-1]:
                now.lines.append(block.next_line)
                now.times_s.append(block.time_s)
            self._update_bounds(now)

    def counted(self, count: int, *, request_s: float, answered_s: float) -> None:
        """Take the controller's count, with the times of request and answer by the lines' clock."""
        with self._guard:
            step = (count - self._last_count) % WRAP
            self._last_count += step if step < WRAP // 2 else step - WRAP
            self._counted_s = answered_s
            self._readings.append((self._last_count, request_s, answered_s))
            if self._stretches:
                self._update_bounds(self._stretches[-1])

    @property
    def aligned(self) -> bool:
        """Whether a sheet's position at the gate is known now."""
        with self._guard:
            return bool(self._stretches) and self._stretches[-1].agreed is not None

    def position(self, line: int) -> int | None:
        """Return the controller's count when ``line`` has moved on to the gate; None if it is not known."""
        with self._guard:
            stretch = self._stretch_of(line)
            if stretch is None or stretch.agreed is None:
                return None
            start = sum(stretch.agreed) / 2
            travel = self._distance_mm * self._transport.counts_per_mm
            return round(start + line * self._transport.counts_per_line + travel) % WRAP

    def due_s(self, line: int) -> float | None:
        """Return the time at which it does, by the lines' clock at the speed of the last second; None without
        a speed.
        """
        with self._guard:
            stretch = self._stretch_of(line)
            speed = None if stretch is None else stretch.lines_per_s()
            if stretch is None or not speed or speed <= 0:
                return None
            left = line + self._distance_mm / self._transport.line_pitch_mm - stretch.lines[-1]
            return stretch.times_s[-1] + left / speed

    def due_at_s(self, position: int) -> float | None:
        """Return the time at which the controller's count is ``position``; None: not known yet.

        A count that was passed, or that no sheet on its way can have because the controller counts from 0 again, is
        minus infinity.
        """
        with self._guard:
            if self._counted_s is None:
                return None
            left = count_distance(position, self._last_count % WRAP)
            if not 0 < left <= 2 * self._distance_mm * self._transport.counts_per_mm:
                return -math.inf
            speed = self._stretches[-1].lines_per_s() if self._stretches else None
            if not speed or speed <= 0:
                return math.inf
            return self._counted_s + left / self._transport.counts_per_line / speed

    @property
    def speed_mm_s(self) -> float | None:
        """Speed over the last second; None: not known."""
        with self._guard:
            speed = self._stretches[-1].lines_per_s() if self._stretches else None
        return None if speed is None else speed * self._transport.line_pitch_mm

    def forget_readings(self) -> None:
        """Discard the readings, because the controller's count may have begun from 0 again."""
        with self._guard:
            self._readings.clear()
            self._counted_s = None
            for stretch in self._stretches:
                stretch.bounds.clear()
                stretch.agreed = None

    # --- parts ---

    def _stretch_of(self, line: int) -> _Stretch | None:
        for stretch in reversed(self._stretches):
            if line >= stretch.first_line:
                return stretch
        return None

    @staticmethod
    def _jumps(now: _Stretch, block: LineBlock) -> bool:
        """Return whether the line count goes back, or on by more lines than can have passed."""
        if block.first_line < now.lines[-1]:
            return True
        speed = now.lines_per_s()
        if speed is None:
            return False
        passed = speed * (block.time_s - now.times_s[-1])
        return abs(block.next_line - now.lines[-1] - passed) > MOST_STEP * (speed + passed)

    def _update_bounds(self, now: _Stretch) -> None:
        """Bound the constant by the readings whose lines have come."""
        while self._readings:
            count, request_s, answered_s = self._readings[0]
            if not now.times_s or answered_s >= now.times_s[-1]:
                return
            self._readings.popleft()
            since, until = now.line_at(request_s), now.line_at(answered_s)
            if since is None or until is None:
                continue  # of another stretch
            per_line = self._transport.counts_per_line
            bound = (count - until * per_line, count - since * per_line)
            if bound[1] - bound[0] > 2 * self._room:
                continue  # the answer took too long to say anything
            now.bounds.append(bound)
            self._agree(now)

    def _agree(self, now: _Stretch) -> None:
        low, high = max(one[0] for one in now.bounds), min(one[1] for one in now.bounds)
        slack = self._room  # rounding of counts, and jitter of the lines' times
        if low - high > slack:
            last = now.bounds[-1]
            now.bounds.clear()
            now.bounds.append(last)
            now.agreed = None
        elif len(now.bounds) >= ENOUGH:
            now.agreed = (min(low, high), max(low, high))


class TrackedLines:
    """A line source that passes its lines to a tracker as well."""

    def __init__(self, source: LineSource, tracker: Tracker) -> None:
        self.sensors, self.pixels = source.sensors, source.pixels
        self._source, self._tracker = source, tracker

    def blocks(self) -> Iterator[LineBlock]:
        """Yield the blocks of the source."""
        for block in self._source.blocks():
            self._tracker.lines(block)
            yield block

    def close(self) -> None:
        """Close the source."""
        self._source.close()
