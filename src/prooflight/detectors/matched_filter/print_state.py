"""Print state from the fit: the variation of lamp, paper, inks and register, and of the light of columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INK_NAMES
from prooflight.detectors.base import PrintState

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.analysis import ScanAnalysis
    from prooflight.detectors.matched_filter.fit.nuisance import Fit
    from prooflight.prediction.tables import SensorModel

LEAST_SHARE: Final = 0.4
"""Minimum share of an ink's amount that the page determines, instead of the prior, for it to count."""


def print_state(
    analysis: ScanAnalysis, sensors: Sequence[SensorModel], far: Callable[[], Mapping[str, float]] = dict
) -> PrintState:
    """Return the print state of one scan; far: returns the amounts that are further off than the fit follows."""
    excess, light = analysis.sums.columns[:2, 0]
    amounts = fitted_amounts(analysis, sensors) | dict(far())
    return PrintState(amounts=amounts, excess=excess, light=light, pitch_mm=analysis.sums.pixel_mm)


def fitted_amounts(analysis: ScanAnalysis, sensors: Sequence[SensorModel]) -> dict[str, float]:
    """Return the fitted amounts of lamp, paper, inks and register, by channel."""
    fit, values = analysis.fit, {}
    for sensor, white in zip(sensors, fit.white, strict=True):
        values[f"light-{sensor.name}"] = float(white)
    values |= {f"lamp-{k}": float(one) for k, one in enumerate(fit.lamp, start=1)}
    shares = determined_shares(fit)
    for ink, name in enumerate(INK_NAMES):
        if shares[ink] >= LEAST_SHARE:
            values[f"gain-{name}"] = float(fit.gain[ink, 0] / shares[ink])
        if analysis.registration.plane_parts[:, ink].min() > 0:
            for axis, letter in enumerate("xy"):
                values[f"register-{name}-{letter}"] = float(analysis.registration.planes_mm[ink, axis])
    return values


def determined_shares(fit: Fit) -> NDArray[np.float64]:
    """Return the share of each ink's amount (4,) that the page determines: 1 - posterior over prior variance.

    ``Fit.pulls`` is the amount over its standard deviation on good prints, which is the root of that share.
    """
    pulls = fit.surprises.gain[:, 0]
    amount = fit.gain[:, 0] / fit.prior.gain
    share = (amount / np.where(pulls == 0, 1, pulls)) ** 2
    return np.where(pulls == 0, 0.0, share.clip(max=1.0))
