"""Columns of a camera that answer otherwise than they were calibrated, by the light of the backing beyond the sheet.

A column that lost half its gain shows a dark line from the top of the page to its bottom, as a streak does. A streak
ends with the sheet; a column that is off is off on the backing too, above and below the sheet.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.ndimage import median_filter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry

MARGIN_MM: Final = 1.0
"""Distance from the page's place within which a good print's sheet may reach. Assumed: 0.76 mm and its skew."""
FEWEST_LINES: Final = 3
"""Least number of lines of backing above and below the sheet."""
BACKING_OFF: Final = 0.5
"""Greatest relative deviation of such lines' light from the backing's; beyond it they show something else."""
NEIGHBOURS: Final = 9
"""Width of the running median that columns are compared with. [pixels]"""
COLUMN_OFF: Final = 0.1
"""Least relative deviation of a faulty column, as of the floor: less is what columns' residual gain explains. [-]"""
SURE: Final = 8.0
"""Least deviation of a faulty column, above and below alike. [standard deviations]"""
MOST_COLUMNS: Final = 0.01
"""Greatest share of faulty columns; beyond it they are no fault of single columns. (assumed)"""


def faulty_columns(
    scan: NDArray[np.uint16], sensors: Sequence[SensorModel], geometry: ScanGeometry, *, page_height_mm: float
) -> NDArray[np.bool_]:
    """Return which columns see the backing otherwise than their neighbours, above and below the sheet.

    Parameters
    ----------
    scan : (sensors, lines, pixels) scan of a whole page [DN].
    sensors, geometry : calibrated columns and place of the page.
    page_height_mm : height of the page [mm].

    Returns
    -------
    (sensors, pixels); none where too little backing is in view.
    """
    faulty = np.zeros((len(sensors), scan.shape[2]), bool)
    lines = geometry.lines(page_height_mm)
    above, below = (
        int((extent - MARGIN_MM) / geometry.line_pitch_mm)
        for extent in (geometry.lead_in_mm, geometry.lead_out_mm)
    )
    if min(above, below) < FEWEST_LINES or scan.shape[1] < lines:
        return faulty
    ends = scan[:, :above], scan[:, lines - below : lines]
    for index, sensor in enumerate(sensors):
        signs = [_signs(end[index], sensor) for end in ends]
        faulty[index] = (signs[0] != 0) & (signs[0] == signs[1])
    return faulty if faulty.mean() <= MOST_COLUMNS else np.zeros_like(faulty)


def _signs(lines: NDArray[np.uint16], sensor: SensorModel) -> NDArray[np.int8]:
    """Return the sign of each column's deviation from its neighbours in lines of backing; 0: it does not deviate."""
    light = (lines.mean(axis=0) - sensor.column_offset_dn) / sensor.column_gain
    if abs(np.median(light) / sensor.backing_dn - 1) > BACKING_OFF:
        return np.zeros(light.size, np.int8)
    usual = median_filter(light, NEIGHBOURS, mode="nearest")
    off = light - usual
    scatter = 1.4826 * np.median(np.abs(off))  # of a Gaussian, by its median deviation
    noise = np.sqrt(sensor.backing_variance_dn2 / len(lines))
    sure = np.abs(off) > np.maximum(SURE * max(scatter, noise), COLUMN_OFF * np.abs(usual))
    return np.where(sure, np.sign(off), 0).astype(np.int8)


def bridged(
    scan: NDArray[np.uint16], faulty: NDArray[np.bool_], sensors: Sequence[SensorModel]
) -> NDArray[np.uint16]:
    """Return the scan with faulty columns (sensors, pixels) interpolated, so that registration sees no line there."""
    if not faulty.any():
        return scan
    whole = scan.copy()
    for index in np.flatnonzero(faulty.any(axis=1)).tolist():
        good = np.flatnonzero(~faulty[index])
        offset, gain = sensors[index].column_offset_dn, sensors[index].column_gain
        for column in np.flatnonzero(faulty[index]):
            after = min(int(np.searchsorted(good, column)), good.size - 1)
            pair = good[[max(after - 1, 0), after]]
            light = ((scan[index][:, pair] - offset[pair]) / gain[pair]).mean(axis=1)
            whole[index, :, column] = np.rint(np.clip(offset[column] + gain[column] * light, 0, 65535))
    return whole
