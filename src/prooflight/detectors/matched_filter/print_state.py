"""What a print did as good ones do, from the fit: lamp, paper, inks and register; and the light of its columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.base import INK_NAMES, PrintState
from prooflight.detectors.matched_filter.fit.nuisance import INKS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.analysis import ScanAnalysis
    from prooflight.detectors.matched_filter.fit.nuisance import Fit
    from prooflight.prediction.tables import SensorModel

LEAST_KNOWN: Final = 0.4
"""Share of an ink's amount that a page must tell, instead of the prior, to count at all."""


def print_state(analysis: ScanAnalysis, sensors: Sequence[SensorModel]) -> PrintState:
    """Of one scan."""
    excess, light = analysis.sums.columns[:2, 0]
    amounts = fitted_amounts(analysis, sensors)
    return PrintState(amounts=amounts, excess=excess, light=light, pitch_mm=analysis.sums.pixel_mm)


def fitted_amounts(analysis: ScanAnalysis, sensors: Sequence[SensorModel]) -> dict[str, float]:
    """What our detector's fit says of lamp, paper, inks and register, by channel."""
    fit, values = analysis.fit, {}
    for sensor, white in zip(sensors, fit.white, strict=True):
        values[f"light-{sensor.name}"] = float(white)
    values |= {f"lamp-{k}": float(one) for k, one in enumerate(fit.lamp, start=1)}
    known = known_shares(fit)
    for ink, name in enumerate(INK_NAMES):
        if known[ink] >= LEAST_KNOWN:
            values[f"gain-{name}"] = float(fit.gain[ink, 0] / known[ink])
        if analysis.found.plane_parts[:, ink].min() > 0:
            for axis, letter in enumerate("xy"):
                values[f"register-{name}-{letter}"] = float(analysis.found.planes_mm[ink, axis])
    return values


def known_shares(fit: Fit) -> NDArray[np.float64]:
    """How much of each ink's amount (4,) is the page's own word and not the prior's: 1 - posterior variance over prior.

    ``Fit.pulls`` is amount over the standard deviation it has on good prints, which is that share's root.
    """
    first = fit.white.size + 1 + fit.lamp.size + fit.shape.size
    pulls = fit.pulls[first : first + 3 * INKS : 3]
    amount = fit.gain[:, 0] / fit.prior.gain
    share = (amount / np.where(pulls == 0, 1, pulls)) ** 2
    return np.where(pulls == 0, 0.0, share.clip(max=1.0))
