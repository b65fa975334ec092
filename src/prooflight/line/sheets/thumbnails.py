"""Pages and scans small enough to compare with many pages of a job."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.kernels.thumbnails import SHRINK, STEPS, shrink
from prooflight.registration.foreign import detail

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.prediction.predict import Prediction
    from prooflight.press.artefact import Press

ROWS_AT_ONCE: Final = 8
"""Of a prediction, which as a whole fits no cache."""
CELL: Final = 16
"""Thumbnail pixels in a cell of a signature, 13 mm: a shift of 1 mm hardly changes it."""


class Shrinker:
    """Camera lines -> light of 8 x 8 pixel means as a share of paper white, sensors averaged, columns evened out."""

    def __init__(self, press: Press) -> None:
        sensors = press.sensors
        self.columns = press.geometry.pixels // SHRINK
        worth = [
            1 / (sensor.column_gain * (sensor.white_dn * SHRINK**2 * len(sensors))) for sensor in sensors
        ]
        used = self.columns * SHRINK
        self._scale = np.ascontiguousarray(np.stack(worth)[:, :used], dtype=np.float32)
        dark = [
            scale * sensor.column_offset_dn[:used] for scale, sensor in zip(self._scale, sensors, strict=True)
        ]
        self._dark = (
            np.sum(dark, axis=0, dtype=np.float64).reshape(self.columns, SHRINK).sum(axis=1) * SHRINK
        ).astype(np.float32)
        self._sums = np.zeros((len(sensors), press.geometry.pixels), np.uint32)
        self._held = 0

    def rows(self, lines: NDArray[np.uint16]) -> NDArray[np.float32]:
        """Rows that are complete with these lines (sensors, n, pixels) [DN]: (rows, columns). The rest is kept."""
        rows, left = divmod(self._held + lines.shape[1], SHRINK)
        light = np.tile(-self._dark, (rows, 1))
        for sensor, sums, scale in zip(lines, self._sums, self._scale, strict=True):
            shrink(np.ascontiguousarray(sensor), self._held, sums, scale, light)
        self._held = left
        return light

    def picture(self, lines: NDArray[np.uint16]) -> NDArray[np.float32]:
        """The same of a whole scan; nothing is kept."""
        return self.rows(lines[:, : lines.shape[1] // SHRINK * SHRINK])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Thumbnail:
    """A page of the job where it should lie."""

    light: NDArray[np.uint8]
    """(rows, columns) in 1/200 of paper white; the first rows are lead-in, as in a scan."""
    width_mm: float
    height_mm: float
    signature: NDArray[np.float32] = field(repr=False)
    """What a shifted scan shares with it: mean and detail of 13 mm cells, of length 1."""


def signature(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Of light (rows, columns): see ``Thumbnail.signature``."""
    rows, columns = (max(extent // CELL, 1) for extent in light.shape)
    mean = cv2.resize(light, (columns, rows), interpolation=cv2.INTER_AREA)
    busy = cv2.resize(np.abs(detail(light)), (columns, rows), interpolation=cv2.INTER_AREA)
    parts = [(part - part.mean()) / (part.std() + 0.01) for part in (mean, busy)]
    whole = np.concatenate([part.ravel() for part in parts])
    return (whole / max(float(np.linalg.norm(whole)), 1e-9)).astype(np.float32)


def thumbnail_of(page: Page, prediction: Prediction, press: Press) -> Thumbnail:
    """Of a page as it lies in the press, from its prediction in its place."""
    expected, shrinker = prediction.expected_dn, Shrinker(press)
    light = np.empty((expected.shape[1] // SHRINK, shrinker.columns), np.float32)
    for row in range(0, len(light), ROWS_AT_ONCE):
        rows = light[row : row + ROWS_AT_ONCE]
        lines = expected[:, SHRINK * row : SHRINK * (row + len(rows))]
        rows[:] = shrinker.rows(np.rint(np.maximum(lines, 0)).astype(np.uint16))
    return Thumbnail(
        light=np.clip(np.rint(light * STEPS), 0, 255).astype(np.uint8),
        width_mm=page.width_mm,
        height_mm=page.height_mm,
        signature=signature(light),
    )
