"""The three numbers of the error map's window means on which the paper learns (section 4.2)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

Reading = Literal["signed", "absolute"]
"""What "mean" and "minimum" are of: the window means as they are, or their magnitudes. The paper's text allows both."""
SHARE_SIGMAS: Final = 0.675
"""The paper's limit: on a good page half of the errors lie below it. [-]"""
STATISTICS: Final = ("mean", "minimum", "share")


def window_statistics(
    means: NDArray[np.float32], *, reading: Reading = "signed", unit: float | NDArray[np.float64] = 1.0
) -> NDArray[np.float64]:
    """Mean, minimum and share below 0.675 of window means (..., rows, columns). (..., 3)

    The share is of magnitudes in either reading: signed errors below 0.675 would be three quarters of a good page, not
    the half that the number stands for. unit: what counts as one standard deviation, (...) or one for all; the paper's
    is 1. With a unit learned from good pages all three are unmoved by a sigma wrong by any one factor
    (paper, equation 4); with 1, the share is not.
    """
    scaled = means / np.asarray(unit, np.float64)[..., None, None]
    magnitude = np.abs(scaled)
    counted = scaled if reading == "signed" else magnitude
    place = (-2, -1)
    return np.stack(
        [counted.mean(axis=place), counted.min(axis=place), (magnitude < SHARE_SIGMAS).mean(axis=place)],
        axis=-1,
    )
