"""Extrapolation of a run's change over the rest of the run, and the expected cost of each response."""

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
"""Response to a change: accept it, stop the run, or stop and print the doubtful pages again."""
SLOPE_SDS: Final = 2.0
"""Least significance of a slope, in standard errors: below it, the change counts as a step."""
LEAST_PAGES: Final = 12
"""Least number of pages to which a slope is fitted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Linear model of a channel since its change, with the scatter of single pages."""

    level: float
    """Level at the last page."""
    slope: float
    """Change per page; 0 if it is not significant."""
    scatter: float
    """Standard deviation of pages about the line."""

    @classmethod
    def fitted(cls, pages: NDArray[np.integer], values: NDArray[np.floating]) -> Self:
        """Fit a line by least squares to the pages since the estimated start of the change; (n,) each, n at least 1."""
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
        """Return the number of pages until the level leaves +-tolerance; 0: it has; None: it does not approach it."""
        if abs(self.level) >= tolerance:
            return 0
        if self.slope == 0:
            return None
        return math.ceil((tolerance - math.copysign(1, self.slope) * self.level) / abs(self.slope))

    def outside(self, pages: NDArray[np.integer], tolerance: float) -> NDArray[np.float64]:
        """Return the probability that pages (n,), counted from the last, are beyond +-tolerance."""
        level, scatter = self.level + self.slope * pages, max(self.scatter, 1e-9 * tolerance)
        beyond = special.ndtr((level - tolerance) / scatter) + special.ndtr(-(level + tolerance) / scatter)
        return np.asarray(beyond)


def expected_costs(
    change: Change, *, tolerance: float, pages_since: int, pages_left: int, costs: RunningCosts
) -> dict[Advice, float]:
    """Return the expected costs of going on, of stopping now, and of stopping and reprinting doubtful pages. [cent]

    A delivered misprint costs c_m, a stop c_f, and a reprinted page c_f, the cost of a false alarm. A slow drift
    is assumed to pass page by page; stopping removes the cause.
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
