"""How far the gate must be: the tail of the times from a sheet's last line to its result in the register.

Times above a high quantile are modelled by a generalised Pareto distribution (J. Pickands, "Statistical inference using
extreme order statistics", Annals of Statistics 3, 1975), fitted by maximum likelihood. What is asked, one miss in a
million, lies far beyond what was measured: the figure is a model's, and its interval is of the fit alone.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.stats import genpareto

from prooflight.rng import stream

if TYPE_CHECKING:
    from numpy.typing import NDArray

TAIL_SHARE: Final = 0.1
"""assumed: the largest tenth is the tail."""
MISS: Final = 1e-6
RESAMPLES: Final = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Tail:
    """The tail of times, and what it comes to at one miss in a million."""

    count: int
    median_ms: float
    p99_ms: float
    p999_ms: float
    greatest_ms: float
    threshold_ms: float
    shape: float
    """0: exponential; above: heavier; below: it ends."""
    scale_ms: float
    miss_ms: float
    """Time that one in a million exceeds."""
    miss_low_ms: float
    miss_high_ms: float
    """95 % of resampled times."""


def fitted(times_ms: NDArray[np.float64], *, seed: int) -> Tail:
    """Fit the tail of times (n,). ValueError: they are too few."""
    if times_ms.size < 50:
        raise ValueError(f"{times_ms.size} times are too few for a tail")
    rng = stream(seed, "gate-bootstrap")
    threshold, shape, scale, miss = _fit(times_ms)
    drawn = [_fit(rng.choice(times_ms, times_ms.size))[3] for _ in range(RESAMPLES)]
    low, high = np.quantile(drawn, [0.025, 0.975])
    median, p99, p999 = np.quantile(times_ms, [0.5, 0.99, 0.999])
    return Tail(
        count=int(times_ms.size),
        median_ms=float(median),
        p99_ms=float(p99),
        p999_ms=float(p999),
        greatest_ms=float(times_ms.max()),
        threshold_ms=threshold,
        shape=shape,
        scale_ms=scale,
        miss_ms=miss,
        miss_low_ms=float(low),
        miss_high_ms=float(high),
    )


def distance_mm(time_ms: float, *, sheets_per_s: float, pitch_mm: float, sheet_mm: float) -> float:
    """Return the distance from camera to gate.

    The sheet has passed the camera when time begins; its leading edge then moves on.
    """
    return sheet_mm + sheets_per_s * pitch_mm * time_ms / 1e3


def _fit(times_ms: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Threshold, shape, scale, and the time that one in a million exceeds. [ms]"""
    threshold = float(np.quantile(times_ms, 1 - TAIL_SHARE))
    over = times_ms[times_ms > threshold] - threshold
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of the search's way through impossible shapes
        shape, _, scale = genpareto.fit(over, floc=0.0)
    miss = threshold + float(genpareto.ppf(1 - MISS / TAIL_SHARE, shape, 0.0, scale))
    return threshold, float(shape), float(scale), max(miss, float(times_ms.max()))
