"""A page ready for its scans, and what one scan of it came to."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.prediction.predict import cut, predict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.base import Verdict
    from prooflight.detectors.matched_filter.analysis import Looked, PreparedPage
    from prooflight.detectors.paper.evidence import Evidence
    from prooflight.inspection.finding import SoughtPage
    from prooflight.inspection.light_level import LitSquares
    from prooflight.pages.raster import Page
    from prooflight.prediction.predict import Prediction
    from prooflight.press.artefact import Press
    from prooflight.scans.placement import Placement

ROWS_AT_ONCE: Final = 64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """A page as it enters the press, with all that its detector can know ahead of its scans."""

    page: Page
    sought: SoughtPage | None
    """For the paper's detectors."""
    known: PreparedPage | None
    """For ours."""
    inks: str
    """Letters of CMYK that the page has."""
    lit: LitSquares
    """By which it is seen whether a scan was made under the light that the press was calibrated for."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inspection:
    """A verdict and what it rests on; arrays cover the page's area of the scan."""

    verdict: Verdict
    placement: Placement
    """Where the page lies."""
    area: tuple[slice, slice]
    """Lines and columns of the scan that were judged."""
    measured_dn: NDArray[np.uint16]
    block_z: NDArray[np.float32]
    """(sensors or 1, block rows, block columns) how far squares of 8 x 8 pixels are lighter than they should be, in
    standard deviations of good prints."""
    prediction: Prediction | None
    """Of the page as it lies; None where the detector needs none: ``pictured`` adds it."""
    evidence: Evidence | None = None
    """What the paper's detectors look at."""
    looked: Looked | None = None
    """What ours looks at."""


def pictured(inspection: Inspection, page: Page, press: Press) -> Inspection:
    """The same with a prediction, for people to look at."""
    if inspection.prediction is not None:
        return inspection
    whole = predict(page, sensors=press.sensors, geometry=press.geometry, placement=inspection.placement)
    return replace(inspection, prediction=cut(whole, inspection.area))


def present_inks(page: Page) -> str:
    """Letters of CMYK that a page has."""
    words = np.ascontiguousarray(page.cmyk).view(np.uint32)
    any_of = np.uint32(0)
    for first in range(0, len(words), ROWS_AT_ONCE):
        any_of |= np.bitwise_or.reduce(words[first : first + ROWS_AT_ONCE], axis=None)
        inks = np.array([any_of]).view(np.uint8)
        if inks.all():
            break
    return "".join(letter for letter, ink in zip("CMYK", inks, strict=True) if ink)


def block_means(
    values: NDArray[np.floating], side: int, area: tuple[slice, slice], *, block: int
) -> NDArray[np.float32]:
    """Values of a scan's tiles of side x side pixels (tile rows, tile columns), at the middles of an area's blocks."""
    places = []
    for extent, tiles in zip(area, values.shape, strict=True):
        count = (extent.stop - extent.start) // block
        middle = extent.start + block * (np.arange(count) + 0.5)
        places.append(np.minimum((middle / side).astype(np.intp), tiles - 1))
    return np.asarray(values[np.ix_(*places)], np.float32)
