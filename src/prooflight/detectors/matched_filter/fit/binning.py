"""Binning of camera pixels: the detector's features are millimetres wide, and finer pixels only cost time.

Registration uses the camera's own pixels.

Columns of a camera that answer otherwise than they were calibrated are bridged before. A column that lost half its gain
shows a dark line from the top of the page to its bottom, as a streak does. A streak ends with the sheet; a column that
is off is off on the backing too, above and below the sheet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from prooflight.kernels.residuals.binning import binned_rows, take_turns
from prooflight.pages.lens_correction import LensCorrection, correction_frequencies, correction_to
from prooflight.pages.sampling import Footprint, transfer
from prooflight.prediction.tables import SameArray, SensorModel
from prooflight.scans.geometry import ScanGeometry

if TYPE_CHECKING:
    from prooflight.pages.raster import Page

MOST_MM: Final = 0.26
"""Maximum pitch of binned pixels: that of the studies of the detector, at which a good press's register and a
streak are still seen."""


def bins_of(geometry: ScanGeometry) -> int:
    """Return the bins per axis: the most that divide a line of pixels, with a pitch below ``MOST_MM``."""
    pitch_mm = max(geometry.pixel_pitch_mm, geometry.line_pitch_mm)
    return next(n for n in range(max(int(MOST_MM / pitch_mm), 1), 0, -1) if geometry.pixels % n == 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class BinnedGeometry(ScanGeometry):
    """Geometry of binned pixels."""

    camera: ScanGeometry
    bins: int

    def lines(self, page_height_mm: float) -> int:
        """Return as many lines as ``binned`` makes of a scan.

        Millimetres over the pitch may round to another number.
        """
        return -(-self.camera.lines(page_height_mm) // self.bins)


def binned_geometry(geometry: ScanGeometry, bins: int) -> ScanGeometry:
    """Return the geometry of pixels binned ``bins`` x ``bins``."""
    if bins == 1:
        return geometry
    return BinnedGeometry(
        pixels=geometry.pixels // bins,
        pixel_pitch_mm=geometry.pixel_pitch_mm * bins,
        line_pitch_mm=geometry.line_pitch_mm * bins,
        lead_in_mm=geometry.lead_in_mm,
        lead_out_mm=geometry.lead_out_mm,
        camera=geometry,
        bins=bins,
    )


@lru_cache(maxsize=16)
def binned_sensor(sensor: SensorModel, bins: int, pitch_mm: tuple[float, float]) -> SensorModel:
    """Return a sensor whose pixels are means of bins x bins; pitch_mm: pixel pitch across and along."""
    if bins == 1:
        return sensor
    offset, gain = (
        one.reshape(-1, bins).mean(axis=1, dtype=np.float64).astype(np.float32)
        for one in (sensor.column_offset_dn, sensor.column_gain)
    )
    footprint, correction = _binned_optics(sensor.footprint, sensor.correction, bins, pitch_mm)
    return replace(
        sensor,
        column_offset_dn=offset,
        column_gain=gain,
        footprint=footprint,
        correction=correction,
        variance_dn2=_of_mean(SameArray(sensor.variance_dn2), bins),
        dark_variance_dn2=sensor.dark_variance_dn2 / bins**2,
        backing_variance_dn2=sensor.backing_variance_dn2 / bins**2,
    )


@lru_cache(maxsize=16)
def _of_mean(variance: SameArray, bins: int) -> NDArray[np.float32]:
    """Return the variance of the mean of bins x bins pixels; cached, because its table is quantised once."""
    return variance.array / np.float32(bins**2)


@lru_cache(maxsize=16)
def _binned_optics(
    footprint: Footprint, correction: LensCorrection, bins: int, pitch_mm: tuple[float, float]
) -> tuple[Footprint, LensCorrection]:
    """Return the footprint and the lens correction of binned pixels."""
    wide = widened(footprint, bins, pitch_mm)
    if correction.is_identity:
        return wide, correction
    frequency = correction_frequencies()
    across, along = (
        transfer(of, wide.reach_mm / (bins * pitch), frequency)
        for of, pitch in zip((wide.across, wide.along), pitch_mm, strict=True)
    )
    binned_transfer = along[:, None] * across
    return wide, correction_to(correction.transfer(frequency / bins) * binned_transfer, binned_transfer)


def widened(footprint: Footprint, bins: int, pitch_mm: tuple[float, float]) -> Footprint:
    """Return the footprint of bins x bins adjacent pixels; pitch_mm: across and along."""
    reach_mm = footprint.reach_mm + (bins - 1) / 2 * max(pitch_mm)
    places = np.linspace(-footprint.reach_mm, footprint.reach_mm, footprint.across.size)
    steps = round(reach_mm / footprint.reach_mm * (footprint.across.size - 1) / 2)
    wide = np.linspace(-reach_mm, reach_mm, 2 * steps + 1)
    across, along = (
        np.mean(
            [
                np.interp(wide - begin * pitch, places, of, left=0, right=1)
                for begin in np.arange(bins) - (bins - 1) / 2
            ],
            axis=0,
        )
        for of, pitch in zip((footprint.across, footprint.along), pitch_mm, strict=True)
    )
    return Footprint(reach_mm=reach_mm, across=across, along=along)


def thinned(page: Page, bins: int) -> Page:
    """Return a page with one of each bins x bins raster pixels.

    Its place within the square alternates to avoid bias.
    """
    if bins == 1:
        return page
    packed = page.packed
    taken = np.empty([-(-extent // bins) for extent in packed.shape], np.uint32)
    take_turns(packed, bins, taken)
    cmyk = taken[..., None].view(np.uint8)
    return replace(page, cmyk=cmyk, dpi=page.dpi / bins)


def binned(images: NDArray[np.generic], bins: int) -> NDArray[np.float32]:
    """Return means over squares of images (..., lines, pixels).

    The last line is repeated to fill a partial square.
    """
    lines, pixels = images.shape[-2:]
    flat = images.reshape(-1, lines, pixels)
    out = np.empty((len(flat), -(-lines // bins), pixels // bins), np.float32)
    for image, target in zip(flat, out, strict=True):
        binned_rows(image, bins, target)
    return out.reshape(*images.shape[:-2], *out.shape[1:])


def binned_scan(scan: NDArray[np.uint16], bins: int) -> NDArray[np.generic]:
    """Return a scan (sensors, lines, pixels) in binned pixels."""
    return scan if bins == 1 else binned(scan, bins)


def lengthened(scan: NDArray[np.generic], lines: int) -> NDArray[np.generic]:
    """Pad a scan (sensors, lines, pixels) with lines of 0 to a number of lines."""
    lacking = lines - scan.shape[1]
    return np.pad(scan, ((0, 0), (0, lacking), (0, 0))) if lacking > 0 else scan


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
