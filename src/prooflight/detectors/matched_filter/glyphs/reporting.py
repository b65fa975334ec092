"""Descriptions of wrong glyphs: what is wrong, in which line of text, and where."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.placing import WRONG_PAGE_KIND
from prooflight.detectors.verdict import Region

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.glyphs.scoring import PageGlyphs, ScoredGlyph

EXCHANGED: Final = "exchanged-glyph"
MISSING: Final = "missing-glyph"
KINDS: Final = frozenset({EXCHANGED, MISSING})
FAMILY: Final = "glyph"
FEW: Final = 6
"""Maximum number of wrong glyphs for which a misprint with other evidence may be described by its glyphs."""
LONE: Final = 3
"""Maximum number of wrong glyphs (two that were exchanged and a neighbour) of which a small outlying place is
the sign."""
AT_GLYPH_MM: Final = 1.0
SMALL_MM: Final = 5.0
"""Maximum width and height of a place that is no larger than a glyph and its neighbours."""
MOST_REGIONS: Final = 8


def glyphs_name(
    glyphs: PageGlyphs, wrong: Sequence[ScoredGlyph], others: Sequence[Region], *, kind: str
) -> bool:
    """Return whether glyphs describe a page that also alarms by other evidence, of another kind and place.

    The strongest evidence of the whole page, in standard deviations, describes it. A spot or streak over
    letters replaces these as well, and is then stronger as a whole than any one of them; one wrong digit is a
    spot by itself.
    """
    if not wrong or len(wrong) > FEW or kind == WRONG_PAGE_KIND:
        return False
    strongest = max(others, key=lambda one: one.score, default=None)
    if strongest is None or strongest.score < max(abs(one.deviation) for one in wrong):
        return True
    return len(wrong) <= LONE and any(_is_of(strongest, glyphs.box_mm[one.glyph]) for one in wrong)


def _is_of(place: Region, box_mm: NDArray[np.float64]) -> bool:
    x, y, width, height = box_mm
    across = min(place.x_mm + place.width_mm, x + width) - max(place.x_mm, x)
    along = min(place.y_mm + place.height_mm, y + height) - max(place.y_mm, y)
    small = max(place.width_mm, place.height_mm) <= SMALL_MM
    return bool(small and min(across, along) >= -AT_GLYPH_MM)


def glyph_explanation(
    glyphs: PageGlyphs, wrong: Sequence[ScoredGlyph], others: Sequence[Region]
) -> dict[str, Any]:
    """Return kind, places and reason; wrong: the worst first; others: places of other evidence."""
    kinds = [MISSING if one.missing else EXCHANGED for one in wrong]
    regions = [
        Region.rounded(tuple(glyphs.box_mm[one.glyph]), score=abs(one.deviation), kind=kind)
        for one, kind in zip(wrong[:MOST_REGIONS], kinds, strict=False)
    ]
    adjective = "missing" if kinds[0] == MISSING else "exchanged"
    x, y, width, height = glyphs.box_mm[wrong[0].glyph]
    where = (
        f"line {glyphs.line[wrong[0].glyph]} of text, x = {x + width / 2:.0f} mm, y = {y + height / 2:.0f} mm"
    )
    if len(wrong) == 1:
        reason = f"{adjective} glyph in {where}"
    else:
        lines = np.unique([glyphs.line[one.glyph] for one in wrong]).size
        in_lines = "" if lines == 1 else f" in {lines} lines of text"
        reason = f"{len(wrong)} wrong glyphs{in_lines}, the worst {adjective} in {where}"
    return {"kind": kinds[0], "regions": (*regions, *others), "reason": reason}
