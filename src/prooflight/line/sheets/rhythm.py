"""Whether sheets come when they should, from the gaps between them."""

from __future__ import annotations

from collections import deque
from itertools import accumulate
from typing import Final

FEWEST: Final = 3
"""Gaps to be seen before a sheet is called late."""
GAPS: Final = 33
"""Gaps whose mean is the usual one: good sheets' shifts cancel in it but for the first and the last."""
PLACES: Final = 6
"""Sheets whose mean place is where sheets lie."""


class Rhythm:
    """The usual gap, and how far sheets lie from where it would put them.

    A sheet's place is the sum of what gaps had over the usual one, so that its own shift counts and not that of the
    sheet before. A belt that slipped leaves all sheets behind it in a new place; a sheet alone off its place is
    followed by one back in the old.
    """

    def __init__(self, *, tolerance: float) -> None:
        """tolerance: how far off a sheet in time may lie. [lines]"""
        self._tolerance = tolerance
        self._gaps: deque[float] = deque(maxlen=GAPS)
        self._places: deque[float] = deque([0.0], maxlen=PLACES)
        self._left: deque[float] | None = None

    def room(self, gap: float, sheet: float) -> int:
        """For how many sheets of so many lines there was room in a gap. [lines]"""
        usual = self._usual(gap, sheet)
        return max(round((gap - usual) / (sheet + usual)), 0)

    def beat(self, gap: float, sheet: float) -> float:
        """How late the sheet of so many lines behind a gap is; negative: it is early. [lines]

        0: it is in time, or nobody can tell yet.
        """
        usual, skipped = self._usual(gap, sheet), self.room(gap, sheet)
        over = gap - usual - skipped * (sheet + usual)
        if len(self._gaps) < FEWEST:
            if not skipped:
                self._gaps.append(gap)
                usual = _mean(self._gaps)
                steps = accumulate((each - usual for each in self._gaps), initial=0.0)
                self._places = deque(steps, maxlen=PLACES)
            return 0.0
        place = self._places[-1] + over
        late, left, self._left = place - _mean(self._places), self._left, None
        if left is not None and abs(place - _mean(left)) < abs(late):
            self._places, late = left, place - _mean(left)
        elif abs(late) <= self._limit():
            self._gaps.append(usual + over)
        if abs(late) <= self._limit():
            self._places.append(place)
            return 0.0
        self._left, self._places = self._places, deque([place], maxlen=PLACES)
        return late

    def _usual(self, gap: float, sheet: float) -> float:
        return _mean(self._gaps) if self._gaps else min(gap, sheet / 2)

    def _limit(self) -> float:
        """How far off is late: the usual gap errs by the first and last sheet's shifts, the mean place by a share."""
        return self._tolerance * (1 + 1 / len(self._places) + 3 / len(self._gaps))


def _mean(values: deque[float]) -> float:
    return sum(values) / len(values)
