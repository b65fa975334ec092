"""One specimen of a press and its exact camera, and the methods to predict its signal of a PDF page."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import fft, ndimage

from prooflight.camera.camera import with_pixels
from prooflight.camera.lens_correction import transfers
from prooflight.camera.sensor import draw_fixed_pattern
from prooflight.commissioning.build import build_press
from prooflight.errors import RequestError
from prooflight.pages.lens_correction import LensCorrection
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.raster import MM_PER_INCH, POINTS_PER_INCH
from prooflight.prediction.lens_correction import correct_light
from prooflight.prediction.predict import predict
from prooflight.rng import stream
from prooflight.scans.placement import Placement
from prooflight_studies.exact.exposure import MARGIN_PIXELS, page_electrons, page_taps
from prooflight_studies.harness.exact_tables import exact_lookup

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.camera.camera import Camera
    from prooflight.camera.sensor import FixedPattern
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile

EDGE_CONTRAST: Final = 0.2
"""A pixel is at an edge where the truth spans more than this share of white in its 3 x 3 neighbourhood."""
BAND_MM: Final = 40.0
BAND_CENTRES: Final = (0.2, 0.5, 0.8)
"""Centres of the bands in which truth and prediction are compared, as shares of the page's height. [-]"""
SEED: Final = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rig:
    """One specimen: its exact camera, and the press made from it."""

    press_file: PressFile
    camera: Camera
    patterns: tuple[FixedPattern, ...]
    press: Press

    @classmethod
    def build(cls, press_file: PressFile, *, seed: int = SEED, pixels: int | None = None) -> Rig:
        """Build the specimen that ``build_press`` draws first from the same seed."""
        press = build_press(press_file, seed=seed, pixels=pixels)
        camera = with_pixels(press_file.camera(), press.geometry.pixels)
        rng = stream(seed, "specimen")
        patterns = tuple(draw_fixed_pattern(sensor, rng) for sensor in camera.sensors)
        return cls(press_file=press_file, camera=camera, patterns=patterns, press=press)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Band:
    """Some lines of one page as the first sensor truly sees them."""

    lines: slice
    mean_dn: NDArray[np.float64]
    """Mean signal without noise or rounding, (lines, pixels). [DN]"""
    sigma_dn: NDArray[np.float64]
    """Temporal standard deviation, (lines, pixels). [DN]"""
    edges: NDArray[np.bool_]

    @classmethod
    def seen(cls, rig: Rig, lines: slice, electrons: NDArray[np.floating]) -> Band:
        """Convert mean photo-electrons (lines, pixels) to digital numbers of the specimen, and find their edges."""
        sensor, pattern = rig.camera.sensors[0], rig.patterns[0]
        light = electrons.astype(np.float64)
        mean = (
            (light + sensor.dark_e) * pattern.gain + pattern.offset_e
        ) * sensor.dn_per_e + sensor.black_level_dn
        variance = sensor.variance_temporal_e2(light) * (pattern.gain * sensor.dn_per_e) ** 2 + 1 / 12
        span = ndimage.maximum_filter(mean, 3) - ndimage.minimum_filter(mean, 3)
        edges = span > EDGE_CONTRAST * rig.press.sensors[0].white_dn
        return cls(lines=lines, mean_dn=mean, sigma_dn=np.sqrt(variance), edges=edges)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sheet:
    """The PDF page under study, and its position in the scan."""

    pdf: Path
    width_mm: float
    height_mm: float
    lines: int
    bands: tuple[slice, ...]
    """Lines of the scan in which truth and prediction are compared."""

    @classmethod
    def lay(cls, rig: Rig, pdf: Path, *, band_mm: float = BAND_MM) -> Sheet:
        """Place a page with bands at ``BAND_CENTRES``.

        RequestError: the page does not fit or is not printed as its MediaBox.
        """
        with PdfJob(pdf) as job:
            width_mm, height_mm = job.page_sizes_mm[0]
        geometry = rig.press.geometry
        if not geometry.sees(width_mm):
            remedy = f"choose pages at most {geometry.field_mm:.1f} mm wide"
            raise RequestError(pdf, f"is {width_mm:.1f} mm wide", remedy=remedy)
        last, half = geometry.lines(height_mm), round(band_mm / geometry.line_pitch_mm / 2)
        places = (geometry.lead_in_mm + np.array(BAND_CENTRES) * height_mm) / geometry.line_pitch_mm
        bands = tuple(slice(max(round(at) - half, 0), min(round(at) + half, last)) for at in places)
        return cls(pdf=pdf, width_mm=width_mm, height_mm=height_mm, lines=last, bands=bands)

    def part(self, rig: Rig, band: slice, supersampling: int) -> tuple[Page, float]:
        """Return a raster of the page around a band, as far as light spreads, and the height of its top [mm]."""
        centres = rig.press.geometry.centres_y_mm(self.lines)[band]
        margin_mm = (MARGIN_PIXELS + 2) * rig.press.geometry.line_pitch_mm
        top_mm = max(float(centres[0]) - margin_mm, 0.0)
        bottom_mm = min(float(centres[-1]) + margin_mm, self.height_mm)
        dpi = rig.press.geometry.raster_dpi(supersampling)
        return rip_part(self.pdf, top_mm, bottom_mm, dpi=dpi), top_mm


def rip_part(pdf: Path, top_mm: float, bottom_mm: float, *, dpi: float) -> Page:
    """Rasterise the first page between two heights.

    A whole page at 8 times the camera's pixels is more than MuPDF draws.
    """
    import pymupdf  # imported late: an extra

    to_points = POINTS_PER_INCH / MM_PER_INCH
    with PdfJob(pdf) as job:
        width_mm, height_mm = job.page_sizes_mm[0]
    with pymupdf.open(pdf) as document, tempfile.TemporaryDirectory() as folder:
        first = document[0]
        box = first.mediabox
        wrong = max(abs(box.width - width_mm * to_points), abs(box.height - height_mm * to_points))
        if wrong > 0.01 or first.rotation:
            what = "is turned, scaled or cropped"
            raise RequestError(pdf, what, remedy="choose a page printed as its MediaBox")
        part = (box.x0, box.y1 - bottom_mm * to_points, box.x1, box.y1 - top_mm * to_points)
        document.xref_set_key(first.xref, "TrimBox", f"[{' '.join(f'{edge:.6f}' for edge in part)}]")
        document.save(Path(folder) / "part.pdf")
        with PdfJob(Path(folder) / "part.pdf") as job:
            return job.page(1, dpi)


def truth(rig: Rig, sheet: Sheet, page: Page, band: slice, *, top_mm: float = 0.0) -> Band:
    """Compute a band through the full spectral path; ``page``: a raster that begins top_mm below the page's top."""
    geometry = rig.press.geometry
    electrons = page_electrons(
        replace(rig.camera, sensors=rig.camera.sensors[:1]),
        rig.press_file.inks(),
        page,
        centres_x_mm=geometry.centres_x_mm(sheet.width_mm),
        centres_y_mm=geometry.centres_y_mm(sheet.lines)[band] - top_mm,
        backing_reflectance=rig.press_file.backing_reflectance,
    )
    return Band.seen(rig, band, electrons[0])


def predicted(
    rig: Rig, sheet: Sheet, page: Page, *, top_mm: float = 0.0, corrected: bool = True
) -> NDArray[np.float32]:
    """Return the press's prediction of the first sensor, without its columns' gains and offsets, (lines, pixels) [DN].

    The raster's width is the page's rounded to whole pixels: its left edge is placed at the page's. corrected: False
    leaves out the lens correction.
    """
    geometry = rig.press.geometry
    shift_mm = geometry.left_mm(sheet.width_mm) - geometry.left_mm(page.width_mm)
    geometry = replace(geometry, lead_in_mm=geometry.lead_in_mm + top_mm)
    model = rig.press.sensors[0]
    pixels = np.ones(geometry.pixels, np.float32)
    correction = model.correction if corrected else LensCorrection.none()
    bare = replace(model, column_offset_dn=0 * pixels, column_gain=pixels, correction=correction)
    moved = Placement(shift_mm=(shift_mm, 0.0))
    return predict(page, sensors=[bare], geometry=geometry, placement=moved, threads=1).expected_dn[0]


def in_columns(rig: Rig, signal_dn: NDArray[np.floating]) -> NDArray[np.float64]:
    """Apply the gains and offsets of the specimen's columns to a signal (lines, pixels)."""
    model = rig.press.sensors[0]
    return np.asarray(model.column_offset_dn + model.column_gain * signal_dn, dtype=np.float64)


def with_round_footprint(rig: Rig, signal_dn: NDArray[np.float32]) -> NDArray[np.float32]:
    """Convert a signal predicted without lens correction (lines, pixels) to that of a round, endless footprint.

    The short separable footprint's transfer function is divided out and replaced by the exact one, by FFT at the
    camera's resolution, which suffices since their difference is smooth. The image is padded with backing.
    """
    model = rig.press.sensors[0]
    lines, pixels = signal_dn.shape
    rows = fft.next_fast_len(lines + MARGIN_PIXELS, real=True)
    columns = fft.next_fast_len(pixels + MARGIN_PIXELS, real=True)
    # Binning and other speeds lay lines further apart than pixels: frequencies are in cycles a camera pixel.
    pitch = rig.camera.line_pitch_mm / rig.camera.pixel_pitch_mm
    fy = np.fft.fftfreq(rows, pitch).astype(np.float64)
    fx = np.fft.rfftfreq(columns).astype(np.float64)
    exact, ours = transfers(rig.camera, rig.camera.sensors[0], model.footprint, fy, fx)
    image = np.zeros((rows, columns), np.float32)
    image[:lines, :pixels] = signal_dn - np.float32(model.backing_dn)
    correction = (exact / ours).astype(np.float32)
    result = fft.irfft2(fft.rfft2(image) * correction, s=image.shape)[:lines, :pixels]
    return np.asarray(result + np.float32(model.backing_dn), dtype=np.float32)


def averaged(rig: Rig, page: Page, blocks: int) -> NDArray[np.float32]:
    """Return signals of a raster, looked up one by one, then averaged over square blocks. [DN]

    The result has the raster's rows and columns divided by blocks.
    """
    rows, columns = (extent // blocks * blocks for extent in page.cmyk.shape[:2])
    result = np.zeros((rows // blocks, columns // blocks), np.float32)
    signal, _ = exact_lookup(page.cmyk[:rows].reshape(-1, 4), rig.press.sensors[0])
    for row, line in enumerate(signal.reshape(rows, -1)):
        result[row // blocks] += line[:columns].reshape(-1, blocks).sum(axis=1)
    result /= blocks * blocks
    return result


def sampled(
    rig: Rig, sheet: Sheet, signal_dn: NDArray[np.float32], *, raster_pixel_mm: float, top_mm: float
) -> NDArray[np.float32]:
    """Sample a signal on a raster that begins top_mm below the page's top at every pixel of the scan. [DN]"""
    geometry, model = rig.press.geometry, rig.press.sensors[0]
    across, along = page_taps(
        model.footprint,
        centres_x_mm=geometry.centres_x_mm(sheet.width_mm),
        centres_y_mm=geometry.centres_y_mm(sheet.lines) - top_mm,
        raster_pixel_mm=raster_pixel_mm,
        raster_shape=signal_dn.shape,
    )
    seen = np.ascontiguousarray(across.apply(along.apply(signal_dn - np.float32(model.backing_dn)).T).T)
    correct_light(seen, model.correction)
    return np.asarray(seen + np.float32(model.backing_dn), dtype=np.float32)
