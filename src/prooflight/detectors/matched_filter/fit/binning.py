"""Binning of camera pixels: the detector's features are millimetres wide, and finer pixels only cost time.

Registration uses the camera's own pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.kernels.residuals.binning import binned_rows, take_turns
from prooflight.pages.lens_correction import correction_frequencies, correction_to
from prooflight.pages.sampling import Footprint, transfer
from prooflight.prediction.tables import SameArray
from prooflight.scans.geometry import ScanGeometry

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.lens_correction import LensCorrection
    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel

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
