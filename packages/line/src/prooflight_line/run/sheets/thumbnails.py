"""Thumbnails of pages and scans, small enough for comparison with many pages of a job."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Self

import cv2
import numpy as np

from prooflight.kernels.thumbnails import SHRINK, STEPS, shrink
from prooflight.registration.foreign import detail

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.prediction.predict import Prediction
    from prooflight.press.artefact import Press

ROWS_AT_ONCE: Final = 8
"""Number of thumbnail rows computed at once: a whole prediction fits no cache."""
CELL: Final = 16
"""Width of a signature's cells in thumbnail pixels, 13 mm: a shift of 1 mm hardly changes them."""


class Shrinker:
    """Reduction of camera lines to light, as means of 8 x 8 pixels.

    Light is a share of paper white, averaged over sensors, with the columns' gains equalised.
    """

    def __init__(self, press: Press) -> None:
        sensors = press.sensors
        self.columns = press.geometry.pixels // SHRINK
        scales = [
            1 / (sensor.column_gain * (sensor.white_dn * SHRINK**2 * len(sensors))) for sensor in sensors
        ]
        used = self.columns * SHRINK
        self._scale = np.ascontiguousarray(np.stack(scales)[:, :used], dtype=np.float32)
        dark = [
            scale * sensor.column_offset_dn[:used] for scale, sensor in zip(self._scale, sensors, strict=True)
        ]
        self._dark = (
            np.sum(dark, axis=0, dtype=np.float64).reshape(self.columns, SHRINK).sum(axis=1) * SHRINK
        ).astype(np.float32)
        self._sums = np.zeros((len(sensors), press.geometry.pixels), np.uint32)
        self._pending = 0

    def rows(self, lines: NDArray[np.uint16]) -> NDArray[np.float32]:
        """Return the rows that are complete with these lines, and store the remaining lines.

        lines: (sensors, n, pixels) [DN]. Returns (rows, columns).
        """
        rows, left = divmod(self._pending + lines.shape[1], SHRINK)
        light = np.tile(-self._dark, (rows, 1))
        for sensor, sums, scale in zip(lines, self._sums, self._scale, strict=True):
            shrink(np.ascontiguousarray(sensor), self._pending, sums, scale, light)
        self._pending = left
        return light

    def picture(self, lines: NDArray[np.uint16]) -> NDArray[np.float32]:
        """Return the rows of a whole scan; nothing is stored."""
        return self.rows(lines[:, : lines.shape[1] // SHRINK * SHRINK])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Thumbnail:
    """Thumbnail of a page of the job at its nominal position."""

    light: NDArray[np.uint8]
    """(rows, columns) in 1/200 of paper white; the first rows are lead-in, as in a scan."""
    width_mm: float
    height_mm: float
    signature: NDArray[np.float32] = field(repr=False)
    """Features that are insensitive to a shift of the scan: mean and detail of 13 mm cells, normalised to
    length 1."""

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Return the thumbnail that gave these arrays."""
        width_mm, height_mm = arrays["size_mm"].tolist()
        return cls(
            light=arrays["light"], width_mm=width_mm, height_mm=height_mm, signature=arrays["signature"]
        )

    @property
    def white(self) -> NDArray[np.float32]:
        """Its light (rows, columns). [white]"""
        return self.light.astype(np.float32) / np.float32(STEPS)

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Its values as arrays, by name."""
        size_mm = np.array([self.width_mm, self.height_mm])
        return {"light": self.light, "size_mm": size_mm, "signature": self.signature}


def signature(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the signature of light (rows, columns): see ``Thumbnail.signature``."""
    rows, columns = (max(extent // CELL, 1) for extent in light.shape)
    mean = cv2.resize(light, (columns, rows), interpolation=cv2.INTER_AREA)
    busy = cv2.resize(np.abs(detail(light)), (columns, rows), interpolation=cv2.INTER_AREA)
    parts = [(part - part.mean()) / (part.std() + 0.01) for part in (mean, busy)]
    whole = np.concatenate([part.ravel() for part in parts])
    return (whole / max(float(np.linalg.norm(whole)), 1e-9)).astype(np.float32)


def thumbnail_of(page: Page, prediction: Prediction, press: Press) -> Thumbnail:
    """Return the thumbnail of a page in the press, from its prediction at its nominal position."""
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
