"""Where sheets begin and end in the lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.kernels.thumbnails import SHRINK

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.line.sheets.store import LineStore

STRETCH: Final = 0.013
"""How much longer or shorter than a page a sheet may be and still be whole: 1 % of stretch, and some for its edges."""
EDGE_LINES: Final = 12
"""The same for a sheet of any length: a skew of 0.1 degrees slants an edge by 4 lines."""
GAP_ROWS: Final = 2
"""Rows of backing that end a sheet of an odd length; one of a page's length ends at the first."""
LOOK_ROWS: Final = 16
"""Now and then it is asked whether a sheet is longer than any page."""
BEGUN_ROWS: Final = 5
"""Rows behind a sheet's first from which its edge is measured, 4 mm."""
DUST_SHARE: Final = 0.05
"""Of a line's pixels; so many beside the backing's level may be dust or noise."""
BLEED_LINES: Final = 1
"""A blurred edge shows a line before it comes: 20 good prints measured 1.9 lines too long (sd 0.7) at both together."""
SLOPE_LINES: Final = 16
"""Lines from a sheet's first corner to where its whole edge has passed: 0.4 degrees over 210 mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """One sheet in the lines, by position."""

    start: int
    end: int
    """Behind its last line."""
    free: bool = True
    """Whether there was a gap behind it; else it was ended where a page would end."""


class SheetFinder:
    """Finds sheets as rows come in; what it finds does not depend on how lines came in blocks."""

    def __init__(
        self,
        store: LineStore,
        *,
        lengths: Callable[[], list[int]],
        like_gap: Callable[[int], bool],
    ) -> None:
        """lengths: lines of the sheets to be expected, the next one's first. like_gap: whether the page to be expected
        looks like backing so many lines below its edge.
        """
        self._store, self._lengths, self._like_gap = store, lengths, like_gap
        self._row, self._run, self._run_seen = 1, 0, 0
        self._begun: int | None = None
        self._start: int | None = None
        self._ended_at: int | None = None
        self._gap = 0  # lines of the last that was seen between two sheets

    @property
    def needed_from(self) -> int:
        """Position of the first line that may still be asked for."""
        if self._start is not None:
            return self._start
        return SHRINK * ((self._row if self._begun is None else self._begun) - 2)

    def sheets(self) -> list[Sheet]:
        """Those whose end has been seen since the last call."""
        found = []
        while self._row < self._store.end_row:
            sheet = self._look(self._row)
            self._row += 1
            if sheet is not None:
                found.append(sheet)
        return found

    def last(self) -> Sheet | None:
        """The sheet that has begun, when the lines have ended."""
        if self._start is None:
            return None
        return self._ended(self._start, self._last_line(self._store.end), free=self._run > 0)

    def _look(self, row: int) -> Sheet | None:
        gap = self._store.is_gap(row)
        if self._start is None:
            self._maybe_begun(row)
            return None
        length = SHRINK * row - self._start
        if gap:
            self._run += 1
            # What stands in place of lost lines may look like a gap: it ends a sheet at a page's length alone.
            self._run_seen += not self._store.is_lost(row)
            below = length - SHRINK * self._run
            whole = any(abs(below - known) <= STRETCH * known + EDGE_LINES for known in self._lengths())
            if whole or (self._run_seen >= GAP_ROWS and not self._like_gap(below)):
                return self._ended(self._start, self._last_line(SHRINK * (row - self._run + 2)), free=True)
            return None
        self._run = self._run_seen = 0
        lengths = self._lengths() if row % LOOK_ROWS == 0 else []
        if lengths and length > (1 + STRETCH) * max(lengths) + EDGE_LINES + SHRINK:
            sheet = self._ended(self._start, self._start + lengths[0], free=False)
            last = range(sheet.end // SHRINK - GAP_ROWS, row + 1)
            # Where lines were lost at its end the gap went with them, and the next sheet begins behind such a one.
            hidden = any(self._store.is_lost(one) for one in last)
            self._start = sheet.end + (self._gap if hidden else 0)
            return sheet
        return None

    def _maybe_begun(self, row: int) -> None:
        """A sheet begins where two rows on end show something as wide; its edge is measured some rows later."""
        if self._begun is None:
            self._begun = row if self._store.is_wide(row) else None
        elif row == self._begun + 1 and not self._store.is_wide(row):
            self._begun = None
        elif row - self._begun >= BEGUN_ROWS:
            self._start, self._run, self._run_seen = self._first_line(self._begun), 0, 0
            self._begun = None
            if self._ended_at is not None:
                between = range(self._ended_at // SHRINK, self._start // SHRINK + 1)
                if not any(self._store.is_lost(one) for one in between):
                    self._gap = self._start - self._ended_at

    def _ended(self, start: int, end: int, *, free: bool) -> Sheet:
        sheet = Sheet(start=start, end=end, free=free)
        self._start, self._run, self._run_seen = None, 0, 0
        self._ended_at = end if free else None
        return sheet

    def _first_line(self, row: int) -> int:
        """Where the sheet begins whose first row this is: half of its width shows.

        It is measured from the lines alone, so that a sheet is cut alike wherever its rows happen to lie.
        """
        first = SHRINK * (row - 1)
        share = self._store.profile(first, SHRINK * (BEGUN_ROWS + 1))
        return first + _half(share) + BLEED_LINES

    def _last_line(self, behind: int) -> int:
        """Behind the last line of the sheet that ends before this position."""
        first = max(behind - 2 * SHRINK * (BEGUN_ROWS - 1), 0)
        share = self._store.profile(first, behind - first)
        return behind - _half(share[::-1]) - BLEED_LINES


def _half(share: NDArray[np.float64]) -> int:
    """The first line whose share is half of that some lines further in, where a skew's slope is over."""
    begun = int(np.argmax(share > DUST_SHARE))
    inside = share[begun + SLOPE_LINES : begun + SLOPE_LINES + SHRINK]
    return begun + int(np.argmax(share[begun:] >= (np.median(inside) if inside.size else share.max()) / 2))
