"""Smallest spots and narrowest hairs that a detector would catch on a page, as it states them ahead of the print."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceRow:
    """Detection limits on places of one class; sizes in millimetres, infinite: nothing alarms."""

    place: str
    """Description of the class."""
    share: float
    """Share of the inspected area. [-]"""
    spot_mm: float
    """Median over the places."""
    worst_spot_mm: float
    hair_mm: float
    worst_hair_mm: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VisibleMarks:
    """The smallest spot and the narrowest hair that alarm at each place of a page."""

    spot_mm: NDArray[np.float32]
    """(lines, pixels) diameter of a spot; infinite: none alarms; NaN: not inspected. [mm]"""
    hair_mm: NDArray[np.float32]
    """(lines, pixels) width of a hair; likewise. [mm]"""
    place: NDArray[np.uint8]
    """(lines, pixels) index in ``classes``; beyond them: not inspected."""
    classes: tuple[str, ...]
    """Descriptions of the classes of places."""
    left_mm: float
    """Position of the first pixel's corner on the page. [mm]"""
    top_mm: float
    pixel_mm: float
    line_mm: float
    page_mm: tuple[float, float]
    """Width and height of the page. [mm]"""

    def rows(self) -> list[PlaceRow]:
        """Return a row for each class of place on the page."""
        inspected = np.count_nonzero(self.place < len(self.classes))
        result = []
        for number, name in enumerate(self.classes):
            here = self.place == number
            if here.any():
                spot, hair = self.spot_mm[here], self.hair_mm[here]
                result.append(
                    PlaceRow(
                        place=name,
                        share=float(np.count_nonzero(here) / inspected),
                        spot_mm=_median(spot),
                        worst_spot_mm=float(spot.max()),
                        hair_mm=_median(hair),
                        worst_hair_mm=float(hair.max()),
                    )
                )
        return result


def _median(sizes: NDArray[np.float32]) -> float:
    """Return the upper median, because the mean of two values of which one is infinite is infinite."""
    return float(np.sort(sizes)[sizes.size // 2])
