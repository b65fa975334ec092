"""Equation 2: how far each pixel lies from what was expected, in standard deviations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def normalised_error(
    measured_dn: NDArray[np.uint16],
    expected_dn: NDArray[np.float32],
    variance_dn2: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Z = (measured - expected) / sigma (paper, equation 2).

    All (..., lines, pixels); variance_dn2 > 0 is the tables' promise and not checked again. Inputs are not changed.
    """
    error: NDArray[np.float32] = measured_dn.astype(np.float32) - expected_dn
    error /= np.sqrt(variance_dn2)
    return error
