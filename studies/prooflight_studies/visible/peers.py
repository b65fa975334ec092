"""Other methods on the prints that the matched filter judges: absolute difference, SSIM and a variation model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import cv2
import numpy as np

from prooflight_studies.harness.baselines import LEAST_PIXELS, dissimilarity

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection
    from prooflight.press.artefact import Press

WINDOWS: Final = (1, 3, 5)
"""Sides of the squares over which absolute differences are averaged. [pixels]"""
FLOORS: Final = (0.005, 0.02)
"""Least spreads that the variation model assumes, as shares of paper white."""
MARGIN_PIXELS: Final = 2
"""Rim of the page that the variation model ignores, because prints are not placed alike."""
MEASURES: Final = (
    *(f"difference, {side} x {side}" for side in WINDOWS),
    "SSIM, worst",
    "SSIM, mean",
    *(f"variation, {floor:.1%}" for floor in FLOORS),
)
"""Names in the order of ``peer_scores``."""
PEERS: Final = {"difference": (0, 1, 2), "SSIM": (3, 4), "variation": (5, 6)}
"""Measures that are one method with different settings."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageVariation:
    """Mean and spread of a page's good prints at every pixel, as HALCON's variation model has them."""

    mean: NDArray[np.float32]
    """(sensors, lines, pixels), each print moved to the page's nominal place. [DN]"""
    spread: NDArray[np.float32]
    """Standard deviation, of the same shape. [DN]"""

    @classmethod
    def learn(cls, aligned: Sequence[NDArray[np.float32]]) -> Self:
        """Learn from two or more good prints at the page's nominal place (``in_place``)."""
        total = np.zeros(aligned[0].shape)
        squares = np.zeros_like(total)
        for one in aligned:
            total += one
            squares += one.astype(np.float64) ** 2
        mean = total / len(aligned)
        variance = np.maximum(squares / len(aligned) - mean**2, 0) * len(aligned) / (len(aligned) - 1)
        return cls(mean=mean.astype(np.float32), spread=np.sqrt(variance).astype(np.float32))

    def score(self, aligned: NDArray[np.float32], white_dn: Sequence[float], floor: float) -> float:
        """Return the greatest k at which 4 pixels of a sensor differ from the mean by k max(spread, floor). [-]"""
        inside = slice(MARGIN_PIXELS, -MARGIN_PIXELS)
        worst = 0.0
        for seen, mean, spread, white in zip(aligned, self.mean, self.spread, white_dn, strict=True):
            off = np.abs(seen - mean) / np.maximum(spread, np.float32(floor * white))
            far = off[inside, inside].ravel()
            worst = max(worst, float(np.partition(far, -LEAST_PIXELS)[-LEAST_PIXELS]))
        return worst


def in_place(inspection: Inspection, press: Press) -> NDArray[np.float32]:
    """Move a print to the page's nominal place; (sensors, lines, pixels) of the page alone. [DN]

    The placement is that of our registration; interpolation is linear. Pixels beyond the judged area repeat the last.
    """
    assert inspection.planned is not None
    page, geometry = inspection.planned.page, press.geometry
    rows, columns = geometry.on_page(page.width_mm, page.height_mm)
    x, y = np.meshgrid(
        geometry.centres_x_mm(page.width_mm)[columns],
        geometry.centres_y_mm(geometry.lines(page.height_mm))[rows],
    )
    seen_x, seen_y = inspection.placement.seen_mm(
        x, y, page_width_mm=page.width_mm, page_height_mm=page.height_mm
    )
    # The page point p is seen near p + (p - q(p)): shifts are of a millimetre and vary over the page by far less.
    lines, pixels = (extent.start for extent in inspection.area)
    from_x = np.arange(columns.start, columns.stop) - pixels + (x - seen_x) / geometry.pixel_pitch_mm
    from_y = np.arange(rows.start, rows.stop)[:, None] - lines + (y - seen_y) / geometry.line_pitch_mm
    at = from_x.astype(np.float32), from_y.astype(np.float32)
    return np.stack(
        [
            cv2.remap(image.astype(np.float32), *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for image in inspection.measured_dn
        ]
    )


def peer_scores(inspection: Inspection, press: Press, variation: PageVariation) -> NDArray[np.float64]:
    """Return every measure of one print, of the worst sensor, in the order of ``MEASURES``; higher is worse.

    Differences and SSIM compare with the page's prediction at the placement of our registration.
    """
    white = [sensor.white_dn for sensor in press.sensors]
    measured, expected = inspection.measured_dn, inspection.expect().expected_dn
    differences = [local_difference(measured, expected, white_dn=white, side=side) for side in WINDOWS]
    unlike = dissimilarity(measured, expected, white_dn=white)
    aligned = in_place(inspection, press)
    return np.array(
        [
            *differences,
            unlike.worst,
            unlike.mean,
            *(variation.score(aligned, white, floor) for floor in FLOORS),
        ]
    )


def local_difference(
    measured_dn: NDArray[np.uint16],
    expected_dn: NDArray[np.float32],
    *,
    white_dn: Sequence[float],
    side: int,
) -> float:
    """Return the greatest mean absolute difference over squares of ``side`` pixels, as a share of paper white. [-]"""
    worst = 0.0
    for measured, expected, white in zip(measured_dn, expected_dn, white_dn, strict=True):
        share = cv2.absdiff(measured.astype(np.float32), expected)
        worst = max(worst, float(cv2.boxFilter(share, -1, (side, side)).max()) / white)
    return worst
