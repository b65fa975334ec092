"""The whole camera on a whole page, exactly: every wavelength blurred by its own diffraction, round, not separable.

It is the reference for the fast prediction. Light of band l from a raster pixel reaches the camera's pixel through the
MTF of that band. Weighted by light x QE and summed over bands, the 36 MTFs span few shapes: the white-paper mean and
two corrections (``spectral_blur``), so a page is a few scalar images, each filtered once by FFT.

A raster pixel is a square of even light. Its spectrum repeats at the raster's frequency, and all repeats within the
lens's cut-off are summed, so that the raster's own sampling loses nothing. Pages are processed in tiles. Beyond a
tile's margin light is taken from the wrong place of the same tile (an FFT is circular): diffraction's tail holds about
2 / (pi^3 f_c d) of an edge beyond d pixels, f_c the cut-off in cycles a pixel; see ``MARGIN_PIXELS``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft

from prooflight import spectra
from prooflight.camera.lens_correction import RANK, spectral_blur
from prooflight.camera.sensor import Noise, read_out
from prooflight.errors import RequestError
from prooflight.pages.sampling import taps

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.camera.camera import Camera
    from prooflight.camera.lens_correction import SpectralBlur
    from prooflight.camera.sensor import FixedPattern, LineSensor
    from prooflight.inks.reflectance import ReflectanceModel
    from prooflight.pages.raster import Page
    from prooflight.pages.sampling import Footprint, Taps

MARGIN_PIXELS = 48
"""Camera pixels around a tile that are computed and discarded; 0.02 % of an edge is beyond them (f_c = 7.5)."""
TILE_PIXELS = 512
"""Camera pixels along a tile's side, margins included: at 8 raster pixels each, 67 MB an image."""
_FILTER_ROWS = 128  # rows of a filter at a time, to stay in cache
_COLOUR_CHUNK = 65536


def page_electrons(
    camera: Camera,
    inks: ReflectanceModel,
    page: Page,
    *,
    centres_x_mm: NDArray[np.float64],
    centres_y_mm: NDArray[np.float64],
    backing_reflectance: float,
    falloff: bool = True,
    rank: int = RANK,
    tile_pixels: int = TILE_PIXELS,
) -> NDArray[np.float32]:
    """Compute the mean photo-electrons of a page by the full spectral path, without dark signal or noise.

    centres_x_mm (pixels,) and centres_y_mm (lines,): positions of camera pixels on the page, as evenly as the camera
    samples; both pitches must be whole numbers of raster pixels. Off the page is a backing of even reflectance.
    falloff: whether to apply the lens's cos^4. Returns (sensors, lines, pixels) [e-]. RequestError: the raster does not
    fit.
    """
    grid = _Grid.fit(camera, page, centres_x_mm, centres_y_mm, tile_pixels)
    codes = page.packed
    colours = distinct_colours(codes)
    electrons = np.empty((len(camera.sensors), grid.lines, grid.pixels), np.float32)
    backing = np.full(spectra.BANDS, backing_reflectance)
    for sensor, out in zip(camera.sensors, electrons, strict=True):
        blur = spectral_blur(camera, sensor, rank=rank)
        # Only the light above the backing's is filtered, so what is off the page comes out as backing.
        amounts = _amounts(colours, inks, blur) - (backing @ blur.bands_e).astype(np.float32)
        filters = _filters(grid, blur, camera, sensor)
        for line, column in grid.tiles():
            seen = _tile(grid, codes, colours, amounts, filters, line, column)
            part = out[line : line + grid.tile_lines, column : column + grid.tile_columns]
            part[:] = seen[: part.shape[0], : part.shape[1]]
        out += np.float32(backing @ blur.bands_e[:, 0])
    if falloff:
        electrons *= camera.column_light().astype(np.float32)
    return electrons


def read_out_page(
    camera: Camera,
    electrons: NDArray[np.float32],
    *,
    patterns: Sequence[FixedPattern],
    rng: np.random.Generator,
    noise: Noise = Noise.ALL,
) -> NDArray[np.uint16]:
    """Return a scan of what ``page_electrons`` returns: (sensors, lines, pixels) [e-] -> [DN]."""
    # An FFT in single precision may put the blackest ink a little below no light at all.
    return np.stack(
        [
            read_out(sensor, light.clip(min=0).astype(np.float64), pattern=pattern, rng=rng, noise=noise)
            for sensor, light, pattern in zip(camera.sensors, electrons, patterns, strict=True)
        ]
    )


def page_taps(
    footprint: Footprint,
    *,
    centres_x_mm: NDArray[np.float64],
    centres_y_mm: NDArray[np.float64],
    raster_pixel_mm: float,
    raster_shape: tuple[int, ...],
) -> tuple[Taps, Taps]:
    """Return taps across the web and along the travel of a raster of raster_shape (rows, columns)."""
    across = taps(
        footprint.across,
        reach_mm=footprint.reach_mm,
        centres_mm=centres_x_mm,
        raster_pixel_mm=raster_pixel_mm,
        raster_pixels=raster_shape[1],
    )
    along = taps(
        footprint.along,
        reach_mm=footprint.reach_mm,
        centres_mm=centres_y_mm,
        raster_pixel_mm=raster_pixel_mm,
        raster_pixels=raster_shape[0],
    )
    return across, along


def distinct_colours(codes: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Return the different values of a raster (rows, columns), in increasing order; runs make it fast on real pages."""
    bands = [np.unique(_runs(codes[top : top + 256])[0]) for top in range(0, len(codes), 256)]
    return np.unique(np.concatenate(bands))


def _runs(codes: NDArray[np.uint32]) -> tuple[NDArray[np.uint32], NDArray[np.int64]]:
    """Return values and lengths of the runs of equal pixels in a raster read row by row."""
    flat = codes.ravel()
    starts = np.concatenate([[0], np.flatnonzero(flat[1:] != flat[:-1]) + 1])
    return flat[starts], np.diff(starts, append=flat.size)


def _amounts(colours: NDArray[np.uint32], inks: ReflectanceModel, blur: SpectralBlur) -> NDArray[np.float32]:
    """Return the amount of each shape in each colour: (colours,) -> (colours, rank) [e-]."""
    amounts = np.empty((colours.size, blur.bands_e.shape[1]), np.float32)
    for start in range(0, colours.size, _COLOUR_CHUNK):
        chunk = colours[start : start + _COLOUR_CHUNK]
        cmyk = chunk.view(np.uint8).reshape(-1, 4) / 255
        amounts[start : start + _COLOUR_CHUNK] = inks.reflectance(cmyk) @ blur.bands_e
    return amounts


@dataclass(frozen=True, slots=True, kw_only=True)
class _Grid:
    """Position of a raster relative to the camera's pixels, and its tiles."""

    lines: int
    pixels: int
    rows_per_line: int
    columns_per_pixel: int
    first_row: int
    first_column: int
    """Index of the raster pixel whose centre is nearest to that of the first camera pixel."""
    row_offset: float
    column_offset: float
    """Distance of the camera pixel's centre beyond that one's. [raster pixels]"""
    tile: tuple[int, int]
    """Lines and columns of a tile, margins included. [camera pixels]"""

    @classmethod
    def fit(
        cls,
        camera: Camera,
        page: Page,
        centres_x_mm: NDArray[np.float64],
        centres_y_mm: NDArray[np.float64],
        tile_pixels: int,
    ) -> _Grid:
        if tile_pixels <= 2 * MARGIN_PIXELS:
            message = f"tile_pixels must be above {2 * MARGIN_PIXELS}, both margins, got {tile_pixels}"
            raise ValueError(message)
        fits = []
        axes = (("line", centres_y_mm, camera.line_pitch_mm), ("pixel", centres_x_mm, camera.pixel_pitch_mm))
        for what, centres, pitch_mm in axes:
            steps = np.diff(centres)
            if steps.size and np.abs(steps - pitch_mm).max() > 1e-6 * pitch_mm:
                message = f"centres must be spaced by a camera {what}, {pitch_mm} mm"
                raise ValueError(message)
            ratio = pitch_mm / page.pixel_mm
            # A page long, the last camera pixel may lie a hundredth of a raster pixel off.
            if round(ratio) < 1 or abs(ratio - round(ratio)) * len(centres) > 0.01:
                remedy = f"rip at a whole multiple of {25.4 / pitch_mm:.3f} dpi"
                raise RequestError(
                    f"page {page.name}", f"has {ratio:.4f} raster pixels a camera {what}", remedy=remedy
                )
            place = centres[0] / page.pixel_mm - 0.5
            extent = fft.next_fast_len(min(len(centres) + 2 * MARGIN_PIXELS, tile_pixels), real=True)
            fits.append((round(ratio), round(place), place - round(place), extent))
        (rows, first_row, row_offset, tile_lines), (columns, first_column, column_offset, tile_columns) = fits
        return cls(
            lines=len(centres_y_mm),
            pixels=len(centres_x_mm),
            rows_per_line=rows,
            columns_per_pixel=columns,
            first_row=first_row,
            first_column=first_column,
            row_offset=row_offset,
            column_offset=column_offset,
            tile=(tile_lines, tile_columns),
        )

    @property
    def raster_shape(self) -> tuple[int, int]:
        """Rows and columns of a tile, margins included."""
        return self.tile[0] * self.rows_per_line, self.tile[1] * self.columns_per_pixel

    @property
    def tile_lines(self) -> int:
        """Number of lines that a tile yields."""
        return self.tile[0] - 2 * MARGIN_PIXELS

    @property
    def tile_columns(self) -> int:
        """Number of columns that a tile yields."""
        return self.tile[1] - 2 * MARGIN_PIXELS

    def tiles(self) -> list[tuple[int, int]]:
        """Return the first line and column of every tile's yield."""
        return [
            (line, column)
            for line in range(0, self.lines, self.tile_lines)
            for column in range(0, self.pixels, self.tile_columns)
        ]


def _filters(grid: _Grid, blur: SpectralBlur, camera: Camera, sensor: LineSensor) -> NDArray[np.complex64]:
    """Return transfer functions from a tile's raster to camera pixels, one a shape: (rank, rows, columns // 2 + 1).

    They include raster square x lens x pixel aperture, and along the travel motion, TDI smear and binning, all boxes
    (as in ``Camera.footprint``); all repeats of the raster's spectrum; the sub-raster offset as a phase.
    """
    per_pixel = grid.columns_per_pixel  # raster pixels are square: the same along and across
    rows, columns = grid.raster_shape
    widths_along = (1.0, camera.binning_along * camera.travel_pixels, camera.smear_pixels(sensor))
    repeats = range(
        -int(blur.cutoff_per_pixel / per_pixel + 0.5), int(blur.cutoff_per_pixel / per_pixel + 0.5) + 1
    )
    fy = np.fft.fftfreq(rows, 1 / per_pixel).astype(np.float64)
    fx = np.fft.rfftfreq(columns, 1 / per_pixel).astype(np.float64)
    to_step = (blur.shapes.shape[1] - 1) / blur.cutoff_per_pixel
    shapes = np.concatenate([blur.shapes, np.zeros((len(blur.shapes), 1), np.float32)], axis=1)
    filters = np.zeros((len(shapes), rows, fx.size), np.complex64)

    def boxes(
        frequency: NDArray[np.float64], widths: Sequence[float], offset: float
    ) -> NDArray[np.complex64]:
        product = np.exp(2j * np.pi * frequency * (offset / per_pixel))
        for width in (1 / per_pixel, *widths):
            product = product * np.sinc(width * frequency)
        return product.astype(np.complex64)

    for shift_x in repeats:
        x = fx + shift_x * per_pixel
        across = boxes(x, (1.0,), grid.column_offset)
        for top in range(0, rows, _FILTER_ROWS):
            for shift_y in repeats:
                y = fy[top : top + _FILTER_ROWS] + shift_y * per_pixel
                if np.hypot(np.abs(x).min(), np.abs(y).min()) > blur.cutoff_per_pixel:
                    continue
                along = boxes(y, widths_along, grid.row_offset)
                radius = np.hypot(x.astype(np.float32), y.astype(np.float32)[:, None])
                step = np.minimum(radius * np.float32(to_step) + 0.5, shapes.shape[1] - 1).astype(np.int32)
                weight = along[:, None] * across
                for shape, target in zip(shapes, filters, strict=True):
                    target[top : top + _FILTER_ROWS] += shape[step] * weight
    return filters


def _tile(
    grid: _Grid,
    codes: NDArray[np.uint32],
    colours: NDArray[np.uint32],
    amounts: NDArray[np.float32],
    filters: NDArray[np.complex64],
    line: int,
    column: int,
) -> NDArray[np.float32]:
    """Return the electrons above the backing's of the camera pixels that a tile yields, from (line, column) on."""
    rows, columns = grid.raster_shape
    top = grid.first_row + (line - MARGIN_PIXELS) * grid.rows_per_line
    left = grid.first_column + (column - MARGIN_PIXELS) * grid.columns_per_pixel
    on_page = codes[max(top, 0) : max(top + rows, 0), max(left, 0) : max(left + columns, 0)]
    if not on_page.size:
        return np.zeros((grid.tile_lines, grid.tile_columns), np.float32)
    values, lengths = _runs(on_page)
    which = np.searchsorted(colours, values)
    inside = (
        slice(max(-top, 0), max(-top, 0) + on_page.shape[0]),
        slice(max(-left, 0), max(-left, 0) + on_page.shape[1]),
    )
    image = np.zeros((rows, columns), np.float32)
    spectrum = np.zeros((rows, columns // 2 + 1), np.complex64)
    for amount, transfer in zip(amounts.T, filters, strict=True):
        image[inside] = np.repeat(amount[which], lengths).reshape(on_page.shape)
        spectrum += fft.rfft2(image) * transfer
    # Every rows_per_line-th row of the result has the spectrum folded that many times.
    folded = spectrum.reshape(grid.rows_per_line, grid.tile[0], -1).sum(axis=0) / grid.rows_per_line
    seen = fft.irfft(fft.ifft(folded, axis=0), n=columns, axis=1)[:, :: grid.columns_per_pixel]
    inner = seen[MARGIN_PIXELS:-MARGIN_PIXELS, MARGIN_PIXELS:-MARGIN_PIXELS]
    return np.asarray(inner, dtype=np.float32)
