"""What one inspection adds to its run: amounts of what good prints do, and the light of narrow columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import ndimage

from prooflight.inspection.promise import summary_of
from prooflight.line.monitor.run import PageEvidence

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection
    from prooflight.press.artefact import Press

COLUMN_MM: Final = 0.5
"""Width of columns: the narrowest streaks of worlds.toml fill a third of one."""
NEARBY_MM: Final = 15.0
"""What is alike over so much is lamp, paper or ink, and no streak: the median of the columns about is taken off."""
UNIT: Final = 1e-9


def columns_mm(press: Press) -> NDArray[np.float64]:
    """Middles of the columns of the widest page that the field holds, from its left edge."""
    return np.asarray((np.arange(int(press.geometry.field_mm / COLUMN_MM)) + 0.5) * COLUMN_MM)


def run_evidence(inspection: Inspection, press: Press, *, page_width_mm: float) -> PageEvidence:
    """Amounts and columns of one page, whatever its detector; empty where the page was not found."""
    shift_mm = inspection.verdict.shift_mm
    if shift_mm is None:
        return PageEvidence()
    state = inspection.state()
    values = {"shift-x": shift_mm[0], "shift-y": shift_mm[1], **state.amounts}
    left_mm = press.geometry.left_mm(page_width_mm) + shift_mm[0]
    at_mm = np.asarray((np.arange(state.excess.shape[1]) + 0.5) * state.pitch_mm - left_mm)
    return PageEvidence(
        values=values,
        columns=columns(state.excess, state.light, at_mm, columns_mm(press).size),
        summary=summary_of(inspection),
    )


def columns(
    excess: NDArray[np.floating], light: NDArray[np.floating], at_mm: NDArray[np.float64], count: int
) -> NDArray[np.float32]:
    """Light of columns over what was expected, less the columns about: (count,) [-]; not finite where nothing tells.

    excess, light (parts, pixels): sums over lines; at_mm (pixels,): where pixels lie on the page.
    """
    place = np.floor(at_mm / COLUMN_MM).astype(np.intp)
    inside = (place >= 0) & (place < count)
    binned = np.zeros((2, len(light), count))
    for part in range(len(light)):
        for k, sums in enumerate((excess, light)):
            binned[k, part] = np.bincount(place[inside], weights=sums[part, inside], minlength=count)
    known = binned[1] > UNIT
    ratio = np.where(known, binned[0] / np.where(known, binned[1], 1), np.nan)
    found = np.full(count, np.nan)
    enough = known.sum(axis=0) > len(light) // 2
    found[enough] = np.nanmedian(ratio[:, enough], axis=0)
    if enough.any():
        at = np.flatnonzero(enough)
        whole = np.interp(np.arange(count), at, found[at])
        found -= ndimage.median_filter(whole, size=round(NEARBY_MM / COLUMN_MM) | 1, mode="nearest")
    return found.astype(np.float32)
