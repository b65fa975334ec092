"""What a print did as good ones do, from the fit: lamp, paper, inks and register; and the light of its columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INK_NAMES
from prooflight.detectors.base import PrintState

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.analysis import Looked
    from prooflight.detectors.matched_filter.fit.nuisance import Fit
    from prooflight.prediction.tables import SensorModel

LEAST_KNOWN: Final = 0.4
"""Share of an ink's amount that a page must tell, instead of the prior, to count at all."""


def print_state(looked: Looked, sensors: Sequence[SensorModel]) -> PrintState:
    """Of one scan."""
    excess, light = looked.sums.columns[:2, 0]
    amounts = fitted_amounts(looked, sensors)
    return PrintState(amounts=amounts, excess=excess, light=light, pitch_mm=looked.sums.pixel_mm)


def fitted_amounts(looked: Looked, sensors: Sequence[SensorModel]) -> dict[str, float]:
    """What our detector's fit says of lamp, paper, inks and register, by channel."""
    fit, values = looked.fit, {}
    for sensor, white in zip(sensors, fit.white, strict=True):
        values[f"light-{sensor.name}"] = float(white)
    values |= {f"lamp-{k}": float(one) for k, one in enumerate(fit.lamp, start=1)}
    known = known_shares(fit)
    for ink, name in enumerate(INK_NAMES):
        if known[ink] >= LEAST_KNOWN:
            values[f"gain-{name}"] = float(fit.gain[ink, 0] / known[ink])
        if looked.found.plane_parts[:, ink].min() > 0:
            for axis, letter in enumerate("xy"):
                values[f"register-{name}-{letter}"] = float(looked.found.planes_mm[ink, axis])
    return values


def known_shares(fit: Fit) -> NDArray[np.float64]:
    """How much of each ink's amount (4,) is the page's own word and not the prior's: 1 - posterior variance over prior.

    ``Fit.surprise`` is amount over the standard deviation it has on good prints, which is that share's root.
    """
    surprise = fit.surprises.gain[:, 0]
    amount = fit.gain[:, 0] / fit.tolerance.gain
    share = (amount / np.where(surprise == 0, 1, surprise)) ** 2
    return np.where(surprise == 0, 0.0, share.clip(max=1.0))
