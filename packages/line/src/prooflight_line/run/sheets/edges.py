"""Detection of the edges of sheets in the lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.kernels.thumbnails import SHRINK

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight_line.run.sheets.store import LineStore

STRETCH: Final = 0.013
"""Tolerance of a whole sheet's length, as a share of its page's: 1 % of stretch, and some for its edges."""
EDGE_LINES: Final = 12
"""Tolerance of any sheet's length, in addition: a skew of 0.1 degrees slants an edge by 4 lines."""
GAP_ROWS: Final = 2
"""Number of rows of backing that end a sheet of any other length; one of a page's length ends at the
first."""
LENGTH_CHECK_ROWS: Final = 16
"""Interval, in rows, of the check whether a sheet is longer than any page."""
BEGUN_ROWS: Final = 5
"""Number of rows after a sheet's first from which its edge is measured, 4 mm."""
DUST_SHARE: Final = 0.05
"""Share of a line's pixels that may differ from the backing by dust or noise."""
BLEED_LINES: Final = 1
"""Correction for blur, which shows an edge a line early: 20 good prints measured 1.9 lines too long (sd 0.7)
at both edges together."""
SLOPE_LINES: Final = 16
"""Number of lines from a sheet's first corner until its whole edge has passed: 0.4 degrees over 210 mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """Extent of one sheet, by positions of lines."""

    start: int
    end: int
    """Position after its last line."""
    free: bool = True
    """Whether there was a gap after it; if not, it was ended where a page would end."""


class SheetFinder:
    """Detector of sheets in a stream of rows; its result does not depend on the division into blocks."""

    def __init__(
        self,
        store: LineStore,
        *,
        lengths: Callable[[], list[int]],
        like_gap: Callable[[int], bool],
    ) -> None:
        """lengths: returns the lengths in lines of the sheets to be expected, the next one's first.

        like_gap: returns whether the expected page resembles the backing so many lines below its edge.
        """
        self._store, self._lengths, self._like_gap = store, lengths, like_gap
        self._row, self._run, self._run_seen = 1, 0, 0
        self._begun: int | None = None
        self._start: int | None = None
        self._ended_at: int | None = None
        self._gap = 0  # lines of the last gap seen between two sheets

    @property
    def needed_from(self) -> int:
        """Position of the first line that may still be read."""
        if self._start is not None:
            return self._start
        return SHRINK * ((self._row if self._begun is None else self._begun) - 2)

    def sheets(self) -> list[Sheet]:
        """Return the sheets whose end has been seen since the last call."""
        sheets = []
        while self._row < self._store.end_row:
            sheet = self._scan_row(self._row)
            self._row += 1
            if sheet is not None:
                sheets.append(sheet)
        return sheets

    def last(self) -> Sheet | None:
        """Return the sheet that has begun, at the end of the lines."""
        if self._start is None:
            return None
        return self._ended(self._start, self._last_line(self._store.end), free=self._run > 0)

    def _scan_row(self, row: int) -> Sheet | None:
        gap = self._store.is_gap(row)
        if self._start is None:
            self._maybe_begun(row)
            return None
        length = SHRINK * row - self._start
        if gap:
            self._run += 1
            # The filling of lost lines may resemble a gap: it ends a sheet only at a page's length.
            self._run_seen += not self._store.is_lost(row)
            below = length - SHRINK * self._run
            whole = any(abs(below - known) <= STRETCH * known + EDGE_LINES for known in self._lengths())
            if whole or (self._run_seen >= GAP_ROWS and not self._like_gap(below)):
                return self._ended(self._start, self._last_line(SHRINK * (row - self._run + 2)), free=True)
            return None
        self._run = self._run_seen = 0
        lengths = self._lengths() if row % LENGTH_CHECK_ROWS == 0 else []
        if lengths and length > (1 + STRETCH) * max(lengths) + EDGE_LINES + SHRINK:
            sheet = self._ended(self._start, self._start + lengths[0], free=False)
            last = range(sheet.end // SHRINK - GAP_ROWS, row + 1)
            # If lines were lost at its end, so was the gap, and the next sheet begins after one of the usual length.
            hidden = any(self._store.is_lost(one) for one in last)
            self._start = sheet.end + (self._gap if hidden else 0)
            return sheet
        return None

    def _maybe_begun(self, row: int) -> None:
        """Test whether a sheet begins: two successive rows show something as wide; its edge is measured later."""
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
        """Return the first line of the sheet whose first row this is: where half of its width shows.

        It is measured from the lines alone, so that the cut of a sheet does not depend on the phase of its rows.
        """
        first = SHRINK * (row - 1)
        share = self._store.profile(first, SHRINK * (BEGUN_ROWS + 1))
        return first + _half(share) + BLEED_LINES

    def _last_line(self, after: int) -> int:
        """Return the position after the last line of the sheet that ends before this position."""
        first = max(after - 2 * SHRINK * (BEGUN_ROWS - 1), 0)
        share = self._store.profile(first, after - first)
        return after - _half(share[::-1]) - BLEED_LINES


def _half(share: NDArray[np.float64]) -> int:
    """Return the first line whose share is half of that some lines further in, past the slope of a skewed edge."""
    begun = int(np.argmax(share > DUST_SHARE))
    inside = share[begun + SLOPE_LINES : begun + SLOPE_LINES + SHRINK]
    return begun + int(np.argmax(share[begun:] >= (np.median(inside) if inside.size else share.max()) / 2))
