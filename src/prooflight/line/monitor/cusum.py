"""Sums of small deviations over pages: a change too small for any one page to show.

Each value of a channel (an ink's amount, a column's light) is ranked among all values of that channel so far. If pages
are exchangeable, whatever their values' distribution, sequential ranks are independent and uniform (Barndorff-Nielsen
1963), so their normal scores are independent N(0, 1), and the cumulative sums of Page (1954) upon them have a run
length that is known: Brook and Evans (1972). Scores are cut off, so that no single page can raise an alarm.
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
"""Taken off each score: shifts of twice as much are found soonest; so are drifts of a few hundredths a page. [sd]"""
CLIP: Final = 3.0
"""Scores are cut off here: with thresholds above 10, no four pages in a row alarm whatever they show. [sd]"""
STATES: Final = 200
"""Of the Markov chain that stands for the sum: the run length is right to 2 % (four times as many)."""
FIRST: Final = 24
"""Values that are kept as they are, before bins are laid around them."""
BINS: Final = 64
REACH_SD: Final = 5.0
"""Bins reach so far to both sides of the first values' median: a sixth of their standard deviation each."""
PAGES: Final = 100_000
"""Rates of false alarms are stated for so many pages."""


def run_length(threshold: float, *, clip: float = CLIP) -> float:
    """Mean number of pages to a false alarm of one one-sided sum of scores N(0, 1), from 0. [pages]

    The sum is a Markov chain on ``STATES`` intervals of 0..threshold (Brook and Evans 1972).
    """
    width = 2 * threshold / (2 * STATES - 1)  # state 0 is 0 itself: its interval is half as wide
    at = np.arange(STATES) * width
    upper = at[None, :] + width / 2 - at[:, None] + ALLOWANCE
    reached = np.where(upper >= clip, 1.0, np.where(upper < -clip, 0.0, special.ndtr(upper)))
    stays = np.diff(reached, axis=1, prepend=0.0)
    return float(np.linalg.solve(np.eye(STATES) - stays, np.ones(STATES))[0])


@cache
def threshold_for(pages: float) -> float:
    """The threshold whose run length is so many pages; run lengths grow with it exponentially. [sd]"""
    highest = np.log(pages) / (2 * ALLOWANCE) + 3

    def off(threshold: float) -> float:
        return float(np.log(run_length(threshold) / pages))

    return float(optimize.brentq(off, 0.1, highest, xtol=1e-5))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SequentialRanks:
    """Where each new value of every channel stands among those before; of fixed size however many come."""

    first: NDArray[np.float32]
    """(FIRST, channels) the first values as they came."""
    seen: NDArray[np.int64]
    """(channels,) values so far; a value that is not finite is none."""
    edges: NDArray[np.float32]
    """(2, channels) lower end and width of the bins."""
    counts: NDArray[np.int32]
    """(channels, BINS) values in each bin, the first and last open to the outside."""

    @classmethod
    def of(cls, channels: int) -> Self:
        """Before any page."""
        return cls(
            first=np.zeros((FIRST, channels), np.float32),
            seen=np.zeros(channels, np.int64),
            edges=np.zeros((2, channels), np.float32),
            counts=np.zeros((channels, BINS), np.int32),
        )

    def score(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """Normal scores of a page's values (channels,), which from now on count among those before.

        The middle of the rank's interval, and of values in one bin, is taken: scores vary by a little less than
        N(0, 1), so that false alarms are rarer than stated, and nothing is random. 0 where there is no value.
        """
        rank = np.full(values.shape, 0.5)
        known = np.isfinite(values)
        young, old = known & (self.seen < FIRST), known & (self.seen >= FIRST)
        if young.any():
            rank[young] = self._among_first(values, young)
        if old.any():
            rank[old] = self._among_bins(values, old)
        self.seen[known] += 1
        self._lay_bins(known & (self.seen == FIRST))
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
    """Two cumulative sums of every channel: of values that rise, and of values that fall."""

    total: NDArray[np.float64]
    """(2, channels) [sd]"""
    since: NDArray[np.int64]
    """(2, channels) the page after the one at which each last was 0: where the change seems to have begun."""

    @classmethod
    def of(cls, channels: int) -> Self:
        """Before any page."""
        return cls(total=np.zeros((2, channels)), since=np.zeros((2, channels), np.int64))

    def add(self, scores: NDArray[np.float64], page: int) -> None:
        """Add a page's scores (channels,), cut off, less the allowance."""
        cut = np.clip(scores, -CLIP, CLIP)
        self.total[:] = np.maximum(self.total + np.stack([cut, -cut]) - ALLOWANCE, 0)
        self.since[self.total == 0] = page + 1

    def restart(self, side: int, channel: int, page: int) -> None:
        """Begin again after an alarm."""
        self.total[side, channel], self.since[side, channel] = 0.0, page + 1
