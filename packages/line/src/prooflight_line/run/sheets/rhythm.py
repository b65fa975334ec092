"""Detection of early and late sheets from the gaps between them."""

from __future__ import annotations

from collections import deque
from itertools import accumulate
from typing import Final

FEWEST: Final = 3
"""Number of gaps that must be seen before a sheet is reported late."""
GAPS: Final = 33
"""Number of gaps whose mean is the usual gap: good sheets' displacements cancel in it but for the first and
the last."""
PLACES: Final = 6
"""Number of sheets whose mean position is the expected position."""


class Rhythm:
    """Estimate of the usual gap, and of each sheet's displacement from the position that it predicts.

    A sheet's position is the sum of the gaps' excesses over the usual one, so that its own displacement counts
    and not that of the sheet before. After a slip of the belt all sheets lie at a new position; a single
    displaced sheet is followed by one at the old position.
    """

    def __init__(self, *, tolerance: float) -> None:
        """tolerance: greatest displacement of a sheet in time. [lines]"""
        self._tolerance = tolerance
        self._gaps: deque[float] = deque(maxlen=GAPS)
        self._places: deque[float] = deque([0.0], maxlen=PLACES)
        self._left: deque[float] | None = None

    def room(self, gap: float, sheet: float) -> int:
        """Return the number of sheets, ``sheet`` lines long, that a gap of ``gap`` lines had room for."""
        usual = self._usual(gap, sheet)
        return max(round((gap - usual) / (sheet + usual)), 0)

    def beat(self, gap: float, sheet: float) -> float:
        """Return how late the sheet of so many lines after a gap is; negative: it is early. [lines]

        0: it is in time, or too few gaps were seen to tell.
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
        """Return the limit of displacement.

        The usual gap errs by the first and last sheet's displacements, the mean position by a share.
        """
        return self._tolerance * (1 + 1 / len(self._places) + 3 / len(self._gaps))


def _mean(values: deque[float]) -> float:
    return sum(values) / len(values)
