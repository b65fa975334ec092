"""A streak's place comes out to a hundredth of a millimetre, on a page that lies askew, from sums written out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.matched_filter.extents import ColumnEvidence, streak_centre
from prooflight.detectors.matched_filter.fit.modes import pixel_map
from prooflight.detectors.matched_filter.statistics.local_evidence import SEGMENTS
from prooflight.pages.raster import Page
from prooflight.scans.placement import Placement

if TYPE_CHECKING:
    from prooflight.press.artefact import Press

BLANK = Page(cmyk=np.zeros((835, 683, 4), np.uint8), dpi=481.8, name="blank", number=1)


@pytest.mark.parametrize("skew_deg", [0.0, 0.1])
@pytest.mark.parametrize("width_mm", [0.04, 0.4])
def test_a_streak_lies_where_it_was_printed(press: Press, skew_deg: float, width_mm: float) -> None:
    geometry, true_mm = press.geometry, 15.237
    pitch = geometry.pixel_pitch_mm
    placement = Placement(shift_mm=(0.31, -0.2), skew_deg=skew_deg, stretch_percent=(0.03, 0.0))
    where = pixel_map(BLANK, geometry, placement)
    x_mm, y_mm = np.meshgrid(geometry.centres_x_mm(BLANK.width_mm), geometry.centres_y_mm(len(where.inside)))
    seen_mm, _ = placement.seen_mm(x_mm, y_mm, page_width_mm=BLANK.width_mm, page_height_mm=BLANK.height_mm)
    footprint = press.sensors[0].footprint
    at = np.linspace(-footprint.reach_mm, footprint.reach_mm, footprint.across.size)
    right, left = (
        np.interp(true_mm + side * width_mm / 2 - seen_mm, at, footprint.across) for side in (1, -1)
    )
    moved = -np.rint(where.slant()).astype(int)
    push = 100 * sum(np.roll(row, -by) for row, by in zip(right - left, moved, strict=True))
    seen = np.flatnonzero(push > push.max() / 2)
    evidence = ColumnEvidence(
        push=np.asarray(push, np.float64),
        power=np.full(push.size, 1e4),
        rows=slice(0, SEGMENTS),
        columns=slice(int(seen[0]), int(seen[-1]) + 1),
    )
    centre = streak_centre(evidence, where, press.sensors[:1], pitch)
    assert centre * pitch + geometry.centres_x_mm(BLANK.width_mm)[0] == pytest.approx(true_mm, abs=0.01)
