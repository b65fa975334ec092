"""Pictures of misprints from their stored evidence: the part of the scan, and where on the page it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight_line.journal.cuts import cuts_of, stretched, whole_cut

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.verdict import Region
    from prooflight_line.journal.cuts import Cut
    from prooflight_line.journal.records import PageRecord

Box = tuple[float, float, float, float]
A4_MM: Final = (210.0, 297.0)
"""Size at which a page is drawn at least: the journal does not store the size of pages."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenPicture:
    """A part of a sheet as the camera saw it."""

    grey: NDArray[np.uint8]
    """(lines, pixels), with the contrast of the defect."""
    box_mm: Box
    """x, y, width and height on the page."""
    region: Region | None
    """The place that it shows; None: the whole sheet."""


def seen_pictures(page: PageRecord) -> list[SeenPicture]:
    """Return the pictures of a sheet, the strongest place first; of a whole sheet where only that is stored.

    page: with its evidence. The press is not asked for the gains of its camera's columns, so that the same journal
    gives the same pictures wherever its press is.
    """
    placed: Any = {"page_width_mm": None, "shift_mm": None}
    cuts = cuts_of(page.evidence, None, **placed) or whole_cut(page.evidence, None, **placed)
    return [_picture(cut, page) for cut in cuts]


def _picture(cut: Cut, page: PageRecord) -> SeenPicture:
    regions = page.verdict.regions
    region = regions[cut.region] if cut.region is not None and cut.region < len(regions) else None
    light = np.clip(stretched(cut, region), 0, 1)
    return SeenPicture(grey=np.rint(255 * light).astype(np.uint8), box_mm=cut.box_mm, region=region)
