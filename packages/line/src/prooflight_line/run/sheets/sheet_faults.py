"""Faults of a sheet: it is early or late, of a wrong length at one place or overall, or has a tape across it."""

from __future__ import annotations

from collections import deque
from itertools import accumulate
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.kernels.thumbnails import SHRINK
from prooflight_line.run.sheets.fitting import taped_rows
from prooflight_line.run.sheets.records import Fault

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight_line.run.sheets.fitting import Fit

LENGTH_SHARE, LENGTH_LINES = 0.0008, 2.5
"""Bound of a good sheet's error of length: 0.03 % of scale in the press world, warp, and a line for each
edge."""
MOST_STRETCH: Final = 0.013
"""Greatest change of length that counts as stretch, as a share; beyond it lines were lost or are too many."""
TAPE_MM: Final = 4.0, 80.0
"""Least and greatest height of a splice's tape."""


def length_fault(fit: Fit, *, longer_lines: float, page_lines: int, start_line: int) -> Fault | None:
    """Return the fault of a sheet's length; None: it has none. start_line: the camera's count at its edge."""
    if abs(longer_lines) <= LENGTH_SHARE * page_lines + LENGTH_LINES:
        return None
    step = _step(fit.rows, fit.drop)
    at_one_place = step is not None and step[1] < _straight(fit.rows, fit.drop)
    longer = longer_lines > 0
    if step is None or not at_one_place:
        if abs(longer_lines) <= MOST_STRETCH * page_lines + LENGTH_LINES:
            what = f"the sheet is {abs(longer_lines) / page_lines:.2%} too {'long' if longer else 'short'}"
            return Fault(kind="stretch", first_line=start_line, detail=what)
        where = start_line
    else:
        where = start_line + max(round((step[0] - fit.box[0]) * SHRINK), 0)
    what = f"the sheet has {abs(longer_lines):.0f} lines too {'many' if longer else 'few'}"
    return Fault(kind="extra-lines" if longer else "lost-lines", first_line=where, detail=what)


def splice_fault(fit: Fit, *, start_line: int, line_pitch_mm: float) -> Fault | None:
    """Return the fault of a tape across the whole sheet; None: there is none."""
    rows = _longest(taped_rows(fit))
    height_mm = (rows[1] - rows[0]) * SHRINK * line_pitch_mm
    if not TAPE_MM[0] <= height_mm <= TAPE_MM[1]:
        return None
    first = start_line + (rows[0] - fit.box[0]) * SHRINK
    return Fault(kind="splice", first_line=first, detail=f"a tape of {height_mm:.0f} mm crosses the sheet")


def _straight(rows: NDArray[np.float64], drop: NDArray[np.float64]) -> float:
    """Return the residual sum of squares of displacements about a straight line. [rows^2]"""
    if rows.size < 2:
        return 0.0
    return float(np.sum((drop - np.polyval(np.polyfit(rows, drop, 1), rows)) ** 2))


def _step(rows: NDArray[np.float64], drop: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the place of the best-fitting step, and its residual sum of squares; None: too few points."""
    if rows.size < 4:
        return None
    candidates = [
        (
            float(
                np.sum((drop[:cut] - drop[:cut].mean()) ** 2) + np.sum((drop[cut:] - drop[cut:].mean()) ** 2)
            ),
            float(rows[cut - 1] + rows[cut]) / 2,
        )
        for cut in range(1, rows.size)
    ]
    residual, where = min(candidates)
    return where, residual


def _longest(flags: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the first index of the longest run of set flags, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    if not edges.size:
        return 0, 0
    starts, ends = edges[::2], edges[1::2]
    most = int((ends - starts).argmax())
    return int(starts[most]), int(ends[most])


# --- early and late sheets, from the gaps between them ---

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
