"""Conversion of a camera's lines to the picture that a code reader takes: one picture, paper light."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.prediction.tables import SensorModel

PAPER: Final = 220
"""Grey value of bare paper: gloss and a brighter lamp still have room above it."""

LEAST_GAIN_DN: Final = np.float32(1e-3)
"""Least gain of a column: a dead one then shows as black instead of as no number."""


def paper_light(
    dn: NDArray[np.generic], sensors: Sequence[SensorModel], columns: slice
) -> NDArray[np.float32]:
    """Return the mean light over the sensors of a cut of a scan (sensors, lines, columns) [DN]: (lines, columns).

    Bare paper is 1. columns: of the scan, which the cut holds. A code reader sees red light alone; the
    camera's own light is the best approximation that is available here, and the grades state this.
    """
    total = np.zeros(dn.shape[1:], np.float32)
    for lines, sensor in zip(dn, sensors, strict=True):
        gain = sensor.column_gain[columns] * np.float32(sensor.white_dn * len(sensors))
        per_dn = (1 / np.maximum(gain, LEAST_GAIN_DN)).astype(np.float32)
        total += lines * per_dn
        total -= sensor.column_offset_dn[columns] * per_dn
    return total


def grey(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return light, bare paper 1, as a picture that code readers take."""
    return cv2.convertScaleAbs(np.maximum(light, 0), alpha=PAPER)
