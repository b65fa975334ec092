"""A change seen in a run, carried on over the rest of it, and what each way to go on would cost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, Self

import numpy as np
from scipy import special

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.cost import RunningCosts

Advice = Literal["accept", "stop", "reprint"]
"""How to go on with a run: as it is, stop, or stop and print again what was doubtful."""
SLOPE_SDS: Final = 2.0
"""A slope less sure than this counts as a step."""
LEAST_PAGES: Final = 12
"""For a slope to be fitted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A channel since it changed: a straight line, with the scatter of single pages about it."""

    level: float
    """At the last page."""
    slope: float
    """A page; 0 where none is sure."""
    scatter: float
    """Standard deviation of pages about the line."""

    @classmethod
    def fitted(cls, pages: NDArray[np.integer], values: NDArray[np.floating]) -> Self:
        """By least squares over the pages since the change seems to have begun; (n,) each, n at least 1."""
        level, slope = float(np.median(values)), 0.0
        off = values - level
        if values.size >= LEAST_PAGES and np.ptp(pages) > 0:
            x = pages - pages.mean()
            trend = float(x @ values / (x @ x))
            about = values - values.mean() - trend * x
            sd = float(np.sqrt(about @ about / (values.size - 2) / (x @ x)))
            if abs(trend) > SLOPE_SDS * sd:
                level, slope, off = float(values.mean() + trend * x.max()), trend, about
        return cls(level=level, slope=slope, scatter=float(off.std()))

    def pages_to(self, tolerance: float) -> int | None:
        """Pages until the level leaves +-tolerance: 0 if it has, None if it is not on its way."""
        if abs(self.level) >= tolerance:
            return 0
        if self.slope == 0:
            return None
        return math.ceil((tolerance - math.copysign(1, self.slope) * self.level) / abs(self.slope))

    def outside(self, pages: NDArray[np.integer], tolerance: float) -> NDArray[np.float64]:
        """Probability that pages (n,), counted from the last, are beyond +-tolerance."""
        level, scatter = self.level + self.slope * pages, max(self.scatter, 1e-9 * tolerance)
        beyond = special.ndtr((level - tolerance) / scatter) + special.ndtr(-(level + tolerance) / scatter)
        return np.asarray(beyond)


def expected_costs(
    change: Change, *, tolerance: float, pages_since: int, pages_left: int, costs: RunningCosts
) -> dict[Advice, float]:
    """Expected cost of going on, of stopping now, and of stopping and printing doubtful pages again. [cent]

    A misprint that is delivered costs c_m, a stop c_f, a page printed again c_f: the price of doubting a good one.
    What drifts slowly is taken to pass page by page; stopping removes the cause.
    """
    miss, stop = costs.missed_misprint_cents, costs.false_alarm_cents
    printed = change.outside(-np.arange(pages_since), tolerance)
    to_come = change.outside(np.arange(1, pages_left + 1), tolerance)
    delivered = miss * printed
    return {
        "accept": float(delivered.sum() + miss * to_come.sum()),
        "stop": float(stop + delivered.sum()),
        "reprint": float(stop + np.minimum(delivered, stop).sum()),
    }
