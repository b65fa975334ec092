"""Regions from differences to a golden scan: joined where they are close, weighted, and enclosed in boxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.golden.differences import GoldenDifference

JOINING_PIXELS: Final = 8
"""Half of the distance within which differences are joined; tuned with the next on one half of
docs/results/detector/golden.md."""
LEAST_VOLUME: Final = 5.0
"""Minimum volume of a region that is reported. [contrast pixels]"""
AROUND: Final = 3
"""Side of the neighbourhood by which a pixel's difference is weighted. [pixels]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """One region where a scan differs from its golden; sides in pixels, the last ones exclusive."""

    left: int
    top: int
    right: int
    bottom: int
    volume: float
    """Sum of the difference, each pixel's weighted by the share of its 3 x 3 neighbourhood that differs as
    well: the edge strips that a tolerance leaves count little. A region of n pixels from dark to light has
    nearly n. [contrast pixels]"""
    lighter: bool
    """Whether the region is lighter than the golden."""

    def grown(self, margin: int) -> tuple[int, int, int, int]:
        """Return left, top, right and bottom with a margin all around. [pixels]"""
        return self.left - margin, self.top - margin, self.right + margin, self.bottom + margin


def marks(
    difference: GoldenDifference, *, joining_pixels: int = JOINING_PIXELS, least_volume: float = LEAST_VOLUME
) -> tuple[Mark, ...]:
    """Return regions that differ by at least ``least_volume``, the greatest first.

    Lighter differences are joined only with lighter ones, and darker with darker: missing content is not
    additional content.
    """
    result = []
    for lighter in (True, False):
        weight = np.where((difference.excess > 0) == lighter, difference.weight, np.float32(0))
        result += _of_sign(weight, lighter, joining_pixels, least_volume)
    return tuple(sorted(result, key=lambda mark: -mark.volume))


def _of_sign(
    weight: NDArray[np.float32], lighter: bool, joining_pixels: int, least_volume: float
) -> list[Mark]:
    counted = (weight > 0).astype(np.uint8)
    side = 2 * joining_pixels + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(cv2.dilate(counted, disc))
    dense = weight * cv2.blur(counted.astype(np.float32), (AROUND, AROUND), borderType=cv2.BORDER_REFLECT)
    volumes = np.bincount(labels.ravel(), dense.ravel(), count)
    result = []
    for label in range(1, count):
        if volumes[label] < least_volume:
            continue
        left, top, width, height = (int(value) for value in boxes[label, :4])
        inside = (slice(top, top + height), slice(left, left + width))
        own = (labels[inside] == label) & (counted[inside] > 0)
        right, down, columns, rows = cv2.boundingRect(own.astype(np.uint8))
        result.append(
            Mark(
                left=left + right,
                top=top + down,
                right=left + right + columns,
                bottom=top + down + rows,
                volume=float(volumes[label]),
                lighter=lighter,
            )
        )
    return result
