"""One scan under our detector: what good prints do taken out, the rest weighed and explained."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import cv2

from prooflight.detectors.base import Verdict
from prooflight.detectors.matched_filter.analysis import look
from prooflight.detectors.matched_filter.calibrated import page_score, shows_another
from prooflight.detectors.matched_filter.explaining import inks_found, reason_for, regions_of, whole_page
from prooflight.detectors.matched_filter.naming import UNKNOWN, kind_of, named
from prooflight.detectors.matched_filter.statistics.families import all_said
from prooflight.detectors.matched_filter.statistics.local_evidence import MODES, statistic
from prooflight.detectors.matched_filter.statistics.statistic import stated
from prooflight.detectors.paper.evidence import BLOCK_PIXELS
from prooflight.inspection.finding import inside
from prooflight.inspection.inspection import Inspection, block_means
from prooflight.scans.placement import IN_PLACE

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.detectors.base import Region
    from prooflight.detectors.matched_filter.analysis import Looked
    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.statistics.families import Said
    from prooflight.inspection.inspection import Prepared
    from prooflight.press.artefact import Press

PICTURED_TILES: Final = 2
"""Side of the boxes that pictures show, 1 mm. [tiles]"""
STRONGEST: Final = 4
"""Families that are asked for kind and place."""
WRONG: Final = "wrong-page"
PARTS: Final = "parts of the page do not look as designed"


def weigh(
    prepared: Prepared, scan: NDArray[np.uint16], *, press: Press, ours: CalibratedDetector
) -> Inspection:
    """Look at a scan (sensors, lines, pixels) [DN] and judge it; the verdict's time is for the caller to add."""
    assert prepared.known is not None
    page, known = prepared.page, prepared.known
    looked = look(
        known,
        scan,
        sensors=press.sensors,
        geometry=press.geometry,
        tolerance=ours.tolerance.prior,
        spread=ours.tolerance.spread,
    )
    said = all_said(looked.sums, looked.fit, looked.found, ours.tolerance.scatter)
    judgement = ours.judge(page_score(ours.tolerance, said, known.portrait, looked.found))
    strongest = ours.tolerance.strongest(said, known.portrait, most=STRONGEST)
    placement = looked.found.placement if looked.found.found else IN_PLACE
    inks = inks_found(looked, prepared.inks)
    kind, reason = None, ""
    regions: tuple[Region, ...] = ()
    if judgement.misprint:
        another = shows_another(looked.found)
        learned = ours.tolerance.kinds_of(stated(said)[None], known.portrait[None])[0]
        kind = WRONG if another else learned or _kind(strongest)
        regions = _regions(strongest, kind, looked, press, prepared)
        speaking = next((said for _, said in strongest if kind_of(said) == kind), None)
        place = regions[0] if regions else None
        reason = (
            PARTS if kind == WRONG and not another else reason_for(kind, speaking, place, inks, looked.found)
        )
    verdict = Verdict.judged(
        page.name,
        judgement,
        costs=press.costs,
        kind=kind,
        regions=regions,
        shift_mm=_shift(looked),
        detector=ours.name,
        family=strongest[0][0] if strongest else None,
        reason=reason,
        inks=inks,
    )
    area = inside(page, press, placement, lines=scan.shape[1])
    return Inspection(
        verdict=verdict,
        placement=placement,
        area=area,
        measured_dn=scan[(slice(None), *area)],
        block_z=_pictured(looked, ours, press, area),
        prediction=None,
        looked=looked,
    )


def _kind(strongest: list[tuple[str, Said]]) -> str:
    """What the evidence speaks of, where no misprint taught kinds.

    That tiles do not look as designed says least of what is wrong with them.
    """
    kind, _ = named(strongest)
    if kind != WRONG:
        return kind
    others = (kind_of(said) for _, said in strongest)
    return next((other for other in others if other not in (WRONG, UNKNOWN)), WRONG)


def _regions(
    strongest: list[tuple[str, Said]], kind: str, looked: Looked, press: Press, prepared: Prepared
) -> tuple[Region, ...]:
    """Places, those of the verdict's kind first; a wrong page is wrong as a whole."""
    size_mm = prepared.page.width_mm, prepared.page.height_mm
    shift_mm = looked.found.placement.shift_mm if looked.found.found else (0.0, 0.0)
    if kind == WRONG:  # no place says more than another
        return (whole_page(size_mm, strongest[0][1], kind),) if strongest else ()
    kinds = [kind if (one := kind_of(said)) == UNKNOWN else one for _, said in strongest]
    order = sorted(range(len(kinds)), key=lambda i: kinds[i] != kind)
    return regions_of(
        [strongest[i] for i in order], [kinds[i] for i in order], shift_mm=shift_mm, size_mm=size_mm
    )


def _shift(looked: Looked) -> tuple[float, float] | None:
    x, y = looked.found.placement.shift_mm
    return (round(x, 4), round(y, 4)) if looked.found.found else None


def _pictured(
    looked: Looked, ours: CalibratedDetector, press: Press, area: tuple[slice, slice]
) -> NDArray[np.float32]:
    """Where the print is lighter (above 0) or darker than it should be, in standard deviations of good prints."""
    sums = looked.sums
    push, power, edges = (
        cv2.blur(one, (PICTURED_TILES, PICTURED_TILES), borderType=cv2.BORDER_REPLICATE) * PICTURED_TILES**2
        for one in sums.tiles[[0, 1, 3], MODES.index("light")]
    )
    t = statistic(push, power, edges, ours.tolerance.scatter.boxes[MODES.index("light"), 0])
    return block_means(t, round(sums.tile_mm / press.geometry.pixel_pitch_mm), area, block=BLOCK_PIXELS)[None]
