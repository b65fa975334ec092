"""One prediction for all copies of a page: moved to where a print lies, with each ink plane where it was printed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from prooflight.detectors.matched_filter.fit.binning import binned, phased
from prooflight.detectors.matched_filter.fit.modes import shadow_sensors
from prooflight.kernels.residuals.moving import move, move_shadow
from prooflight.prediction.predict import Prediction, predict_light, shot_slope, to_columns_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.modes import PixelMap
    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry

INKS: Final = 4
LEAST_PLANE_PIXELS: Final = 0.02
"""Planes closer to their place are left to the fit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SharedPrediction:
    """What the camera would see of a page in its place in bare columns of gain 1; ``bins`` pixels each way as one."""

    light: NDArray[np.float32]
    """(sensors, bins, bins, lines, pixels) above the backing's, ``phased``. [DN]"""
    variance: NDArray[np.float32]
    """The same of the temporal variance; only of sensors where that is not linear in the light. [DN^2]"""
    shadows: NDArray[np.float32]
    """(sensors, 4, lines, pixels) how much lighter it would be without an ink; 0 of one that the page does not have."""

    @classmethod
    def of(
        cls,
        page: Page,
        expected: Prediction,
        *,
        sensors: Sequence[SensorModel],
        geometry: ScanGeometry,
        bins: int = 1,
    ) -> Self:
        """From a page's prediction in its place."""
        light = []
        shape = (-(-expected.expected_dn.shape[1] // bins), geometry.pixels // bins)
        variance = np.zeros((0, *shape), np.float32)
        shadows = np.zeros((len(sensors), INKS, *shape), np.float32)
        kept = []
        for index, sensor in enumerate(sensors):
            gain = np.maximum(sensor.column_gain, np.float32(1e-3))
            bare = (expected.expected_dn[index] - sensor.column_offset_dn) / gain
            light.append(phased(bare - np.float32(sensor.backing_dn), bins))
            if shot_slope(sensor) == 0:
                dark = np.float32(sensor.dark_variance_dn2)
                above = np.float32(sensor.backing_variance_dn2 - sensor.dark_variance_dn2)
                kept.append(binned((expected.variance_dn2[index] - dark) / gain - above, bins))
            for ink in range(INKS):
                if page.cmyk[::2, ::2, ink].any():
                    shadow = np.empty_like(expected.expected_dn[index])
                    predict_light(page, [shadow_sensors(sensor)[ink]], [shadow], geometry=geometry)
                    shadows[index, ink] = binned(shadow, bins)
        if kept:
            variance = np.stack(kept)
        return cls(light=np.stack(light), variance=variance, shadows=shadows)

    def seen(
        self, where: PixelMap, planes: NDArray[np.float64], *, sensors: Sequence[SensorModel]
    ) -> Prediction:
        """What the camera sees of a print that lies so; planes (4, 2): how far each lies too far right and down.

        A plane that is displaced casts its shadow where it lies: exact where one ink lies on paper, and where what
        others print is alike nearby. [pixels] Sensors, pixels and planes' displacements are binned ones.
        """
        bins, expected = self.light.shape[1], np.empty_like(self.light[:, 0, 0])
        variance, lines = np.zeros_like(expected), expected.shape[1]
        off = [ink for ink in range(INKS) if np.abs(planes[ink]).max() > LEAST_PLANE_PIXELS]
        stated = 0
        for index, sensor in enumerate(sensors):
            move(self.light[index], where.across, where.along, expected[index])
            for ink in off:
                shadow = self.shadows[index, ink]
                if shadow[::8].any():
                    right, down = (np.float32(value) for value in planes[ink])
                    move_shadow(shadow[None, None], where.across, where.along, right, down, expected[index])
            if shot_slope(sensor) == 0:
                move(self.variance[stated][None, None], where.across, where.along, variance[index])
                stated += 1
            to_columns_of(sensor)(0, lines, expected[index], variance[index])
        variance /= np.float32(bins * bins)
        return Prediction(expected_dn=expected, variance_dn2=variance)


def planes_taken(
    planes_mm: NDArray[np.float64], *, good_mm: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Displacements of planes (4, 2) that prediction follows, no more than good prints have, and what is left [mm].

    A plane that is a misprint's stays one.
    """
    taken = planes_mm.clip(-good_mm, good_mm)
    return taken, planes_mm - taken
