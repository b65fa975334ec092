"""How the expected signal answers to a little more of one ink: d mean / d ink (paper, section 3.3).

Not stored: 33^4 nodes of four inks would be 19 MB a sensor, and the mean table gives them in a fraction of a second.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight.kernels.prediction.look_up import NODE_STEP, NODES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.prediction.tables import SensorModel

EVERY = 2
SLOPE_NODES = (NODES - 1) // EVERY + 1
"""17 nodes an ink: byte values 0, 16, ..., 256."""


def mean_slopes(model: SensorModel) -> NDArray[np.float32]:
    """Slope of the mean by each ink at 17 nodes an ink, (17, 17, 17, 17, 4) [DN per whole ink], at column gain 1.

    Central differences over two steps of the mean table, 16 byte values; at an axis's ends the one-sided parabola
    through three nodes. 1.3 MB.
    """
    step = NODE_STEP / 255
    slopes = np.empty((*(SLOPE_NODES,) * 4, 4), np.float32)
    kept = slice(None, None, EVERY)
    for ink in range(4):
        along = np.moveaxis(model.mean_dn, ink, 0)
        other = np.moveaxis(slopes[..., ink], ink, 0)
        thin = along[:, kept, kept, kept].astype(np.float64)
        other[1:-1] = (thin[EVERY + 1 :: EVERY] - thin[EVERY - 1 : -EVERY : EVERY]) / (2 * step)
        other[0] = (4 * thin[1] - thin[2] - 3 * thin[0]) / (2 * step)
        other[-1] = (3 * thin[-1] + thin[-3] - 4 * thin[-2]) / (2 * step)
    return slopes
