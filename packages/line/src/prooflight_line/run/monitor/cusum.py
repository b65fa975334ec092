"""Cumulative sums of small deviations over pages, for changes too small for any one page to show.

Each value of a channel (an ink's amount, a column's light) is ranked among all values of that channel so far. If
pages are exchangeable, whatever their values' distribution, sequential ranks are independent and uniform
(Barndorff-Nielsen 1963), so their normal scores are independent N(0, 1), and the run length of the cumulative
sums of Page (1954) on these scores is known: Brook and Evans (1972). Scores are clipped, so that no single page
can raise an alarm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from scipy import optimize, special

if TYPE_CHECKING:
    from numpy.typing import NDArray

ALLOWANCE: Final = 0.5
"""Reference value subtracted from each score: shifts of twice as much are detected soonest; so are drifts of
a few hundredths a page. [sd]"""
CLIP: Final = 3.0
"""Limit at which scores are clipped: with thresholds above 10, no four pages in a row alarm, whatever their
values. [sd]"""
STATES: Final = 200
"""Number of states of the Markov chain that approximates the sum: the run length is right to 2 % (compared
with four times as many)."""
FIRST: Final = 24
"""Number of first values that are stored exactly, before bins are placed around them."""
BINS: Final = 64
REACH_SD: Final = 5.0
"""Extent of the bins on either side of the first values' median: each is a sixth of their standard deviation
wide."""
PAGES: Final = 100_000
"""Number of pages for which false-alarm rates are stated."""


def run_length(threshold: float, *, clip: float = CLIP) -> float:
    """Return the mean number of pages to a false alarm of one one-sided sum of scores N(0, 1), from 0. [pages]"""
    width = 2 * threshold / (2 * STATES - 1)  # state 0 is 0 itself: its interval is half as wide
    at = np.arange(STATES) * width
    upper = at[None, :] + width / 2 - at[:, None] + ALLOWANCE
    reached = np.where(upper >= clip, 1.0, np.where(upper < -clip, 0.0, special.ndtr(upper)))
    stays = np.diff(reached, axis=1, prepend=0.0)
    return float(np.linalg.solve(np.eye(STATES) - stays, np.ones(STATES))[0])


@cache
def threshold_for(pages: float) -> float:
    """Return the threshold with this run length; run lengths grow exponentially with it. [sd]"""
    highest = np.log(pages) / (2 * ALLOWANCE) + 3

    def off(threshold: float) -> float:
        return float(np.log(run_length(threshold) / pages))

    return float(optimize.brentq(off, 0.1, highest, xtol=1e-5))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SequentialRanks:
    """Sequential ranks of every channel's values; the memory does not grow with the number of values."""

    first: NDArray[np.float32]
    """(FIRST, channels) first values, in order."""
    seen: NDArray[np.int64]
    """(channels,) number of values so far; a value that is not finite does not count."""
    edges: NDArray[np.float32]
    """(2, channels) lower end and width of the bins."""
    counts: NDArray[np.int32]
    """(channels, BINS) number of values in each bin; the first and last are open to the outside."""

    @classmethod
    def of(cls, channels: int) -> Self:
        """Return the state before any page."""
        return cls(
            first=np.zeros((FIRST, channels), np.float32),
            seen=np.zeros(channels, np.int64),
            edges=np.zeros((2, channels), np.float32),
            counts=np.zeros((channels, BINS), np.int32),
        )

    def score(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the normal scores of a page's values (channels,), and count these values for later ranks.

        A rank is taken at the middle of its interval, as are values in one bin: scores vary slightly less than
        N(0, 1), so that false alarms are rarer than stated, and nothing is random. The score is 0 where there is
        no value.
        """
        rank = np.full(values.shape, 0.5)
        finite = np.isfinite(values)
        young, old = finite & (self.seen < FIRST), finite & (self.seen >= FIRST)
        if young.any():
            rank[young] = self._among_first(values, young)
        if old.any():
            rank[old] = self._among_bins(values, old)
        self.seen[finite] += 1
        self._lay_bins(finite & (self.seen == FIRST))
        return np.asarray(special.ndtri(rank))

    def _among_first(self, values: NDArray[np.floating], which: NDArray[np.bool_]) -> NDArray[np.float64]:
        at, seen = np.flatnonzero(which), self.seen[which]
        before = self.first[:, at]
        counts = np.arange(FIRST)[:, None] < seen
        below = ((before < values[at]) & counts).sum(axis=0)
        tied = ((before == values[at]) & counts).sum(axis=0)
        self.first[seen, at] = values[at]
        return np.asarray((below + (tied + 1) / 2) / (seen + 1))

    def _among_bins(self, values: NDArray[np.floating], which: NDArray[np.bool_]) -> NDArray[np.float64]:
        at = np.flatnonzero(which)
        bins = self._bins(values[at], at)
        counts = self.counts[at]
        below = np.where(np.arange(BINS) < bins[:, None], counts, 0).sum(axis=1)
        tied = counts[np.arange(at.size), bins]
        self.counts[at, bins] += 1
        return np.asarray((below + (tied + 1) / 2) / (self.seen[at] + 1))

    def _bins(self, values: NDArray[np.floating], at: NDArray[np.intp]) -> NDArray[np.intp]:
        low, width = self.edges[:, at]
        return np.asarray(np.clip((values - low) / width, 0, BINS - 1).astype(np.intp))

    def _lay_bins(self, which: NDArray[np.bool_]) -> None:
        for at in np.flatnonzero(which):
            values = self.first[:, at]
            middle = np.median(values)
            sd = max(1.4826 * float(np.median(np.abs(values - middle))), float(values.std()) / 2, 1e-9)
            self.edges[:, at] = middle - REACH_SD * sd, 2 * REACH_SD * sd / BINS
            places = self._bins(values, np.full(FIRST, at))
            self.counts[at] = np.bincount(places, minlength=BINS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sums:
    """Two one-sided cumulative sums of every channel: of values that rise, and of values that fall."""

    total: NDArray[np.float64]
    """(2, channels) [sd]"""
    since: NDArray[np.int64]
    """(2, channels) page after the one at which each sum was last 0: the estimated start of the change."""

    @classmethod
    def of(cls, channels: int) -> Self:
        """Return the state before any page."""
        return cls(total=np.zeros((2, channels)), since=np.zeros((2, channels), np.int64))

    def add(self, scores: NDArray[np.float64], page: int) -> None:
        """Add a page's scores (channels,), clipped and less the reference value."""
        cut = np.clip(scores, -CLIP, CLIP)
        self.total[:] = np.maximum(self.total + np.stack([cut, -cut]) - ALLOWANCE, 0)
        self.since[self.total == 0] = page + 1

    def restart(self, side: int, channel: int, page: int) -> None:
        """Reset one sum after its alarm."""
        self.total[side, channel], self.since[side, channel] = 0.0, page + 1
