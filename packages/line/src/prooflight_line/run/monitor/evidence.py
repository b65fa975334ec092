"""Contribution of one inspection to the monitoring of its run: nuisance amounts, and the light of narrow columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import ndimage

from prooflight.inspection.guarantee import summary_of
from prooflight_line.run.monitor.run import PageEvidence

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection
    from prooflight.press.artefact import Press

COLUMN_MM: Final = 0.5
"""Width of columns: the narrowest streaks of worlds.toml fill a third of one."""
NEARBY_MM: Final = 15.0
"""Width of the median filter that is subtracted: variation on this scale is lamp, paper or ink, not a
streak."""
UNIT: Final = 1e-9


def columns_mm(press: Press) -> NDArray[np.float64]:
    """Return the centres of the columns of the widest page in the field, from the page's left edge."""
    return np.asarray((np.arange(int(press.geometry.field_mm / COLUMN_MM)) + 0.5) * COLUMN_MM)


def run_evidence(inspection: Inspection, press: Press, *, page_width_mm: float) -> PageEvidence:
    """Return the amounts and columns of one page, for any detector; empty if the page was not located."""
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
    """Return columns' light relative to the expected, less the median of nearby columns.

    Parameters
    ----------
    excess, light
        (parts, pixels) sums over lines of the excess light and of the expected light.
    at_mm
        (pixels,) positions of the pixels on the page.
    count
        Number of columns.

    Returns
    -------
        (count,) [-]; not finite for columns without enough light.
    """
    place = np.floor(at_mm / COLUMN_MM).astype(np.intp)
    inside = (place >= 0) & (place < count)
    binned = np.zeros((2, len(light), count))
    for part in range(len(light)):
        for k, sums in enumerate((excess, light)):
            binned[k, part] = np.bincount(place[inside], weights=sums[part, inside], minlength=count)
    lit = binned[1] > UNIT
    ratio = np.where(lit, binned[0] / np.where(lit, binned[1], 1), np.nan)
    ratios = np.full(count, np.nan)
    enough = lit.sum(axis=0) > len(light) // 2
    ratios[enough] = np.nanmedian(ratio[:, enough], axis=0)
    if enough.any():
        at = np.flatnonzero(enough)
        whole = np.interp(np.arange(count), at, ratios[at])
        ratios -= ndimage.median_filter(whole, size=round(NEARBY_MM / COLUMN_MM) | 1, mode="nearest")
    return ratios.astype(np.float32)
