"""The same session and print by the full spectral path, the reference for the fast path.

Ink model -> spectra -> round diffraction of every wavelength (``exact.exposure``) -> electrons -> noise. Nothing is
taken from the press's tables.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import ndimage

from prooflight.kernels.prediction.lookup import NODE_STEP, NODES
from prooflight.pages.planes import displaced
from prooflight.prediction.predict import Prediction
from prooflight.simulation.fast import cloud_places, noisy
from prooflight.simulation.prints import CONTRAST_PITCH_MM, plane_pixels, speck_pixels
from prooflight_studies.exact.exposure import distinct_colours, page_electrons, page_taps

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight.camera.camera import Camera
    from prooflight.inks.reflectance import ReflectanceModel
    from prooflight.pages.raster import Page
    from prooflight.pages.sampling import Footprint
    from prooflight.press.artefact import Press
    from prooflight.simulation.prints import Print
    from prooflight.simulation.session import SensorDay, Session

FINE: Final = 4
"""Exposures a camera line for the interpolation of a placed page: 0.3 to 0.6 DN rms on a page of text."""
ACROSS: Final = 2
"""Factor on the exposures across, where no motion blurs.

4 a pixel would leave 3.6 DN rms, since the light that a pixel's aperture passes reaches beyond 2 cycles a pixel.
"""
SPLINE_ORDER: Final = 5
TILT_KNOTS: Final = (-1.0, 0.0, 1.0)
"""Positions on the page, from edge to edge, at which the inks' gain is exact; exposures are blended between them."""
_REPEATS: Final = 2
"""Factor by which raster pixels are divided.

page_electrons needs a whole number of them a narrow pixel (s = 2).
"""
_TILE_PIXELS: Final = 2048
MARGIN_PIXELS: Final = 12
"""Camera pixels beyond the scan that are exposed, since a displaced page shows what is there."""
_LAST: Final = (NODES - 1) * NODE_STEP / 255
_STEP: Final = NODE_STEP / 255


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PrintedInks:
    """Ink model of one print at one position of the page: a ``ReflectanceModel`` of nominal recipes."""

    inks: ReflectanceModel
    gain: NDArray[np.float64]
    """Relative gain of each ink, (4,). [-]"""
    dot_gain: NDArray[np.float64]
    """Ink area added at 50 %, (4,). [-]"""
    white: float
    """Reflectance of the paper over its nominal value. [-]"""
    day: SensorDay
    weight: NDArray[np.float64]
    """Light times quantum efficiency of the sensor, (36,). [any unit]"""

    @property
    def name(self) -> str:
        """Name of the underlying ink model."""
        return self.inks.name

    def area(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the printed area of nominal recipes, both (..., 4) [-]; above 1 where a solid's film is thicker."""
        dots = 4 * self.dot_gain * cmyk * (1 - cmyk)
        return np.asarray(cmyk * (1 + self.gain) + dots).clip(min=0)

    def reflectance(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the reflectance factor of nominal recipes (..., 4) -> (..., 36), see ``ReflectanceModel``."""
        return self.of_area(self.area(cmyk))

    def of_area(self, area: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the reflectance factor of printed areas.

        Beyond a solid the light continues to fall by the same factor at all wavelengths, the sensor's own over the
        ink's last step; assumed: no chart shows how the spectrum of more than a solid changes.
        """
        within = np.minimum(area, _LAST)
        result = self.inks.reflectance(within)
        for ink in range(4):
            beyond = np.maximum(area[..., ink] - _LAST, 0)
            if beyond.any():
                thinner, solid = within.copy(), within.copy()
                thinner[..., ink], solid[..., ink] = _LAST - _STEP, _LAST
                light = [self.inks.reflectance(recipe) @ self.weight for recipe in (solid, thinner)]
                result = result * ((light[0] / light[1]) ** (beyond / _STEP))[..., None]
        factor = self.white * self.day.shape_at(area)
        return np.asarray(result * factor[..., None])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Specimen:
    """A press, and the camera and inks that its tables were made from."""

    press: Press
    camera: Camera
    inks: ReflectanceModel
    backing_reflectance: float


def exact_scan(
    page: Page, specimen: Specimen, session: Session, print_: Print, *, rng: np.random.Generator
) -> NDArray[np.uint16]:
    """Return one print of a page as the camera records it, (sensors, lines, pixels) [DN]; ``fast_scan``'s reference."""
    return noisy(exact_mean_variance(page, specimen, session, print_), specimen.press, rng)


def exact_mean_variance(page: Page, specimen: Specimen, session: Session, print_: Print) -> Prediction:
    """Return mean and variance (temporal, halftone and rounding) of every pixel, without noise.

    The displaced planes are exposed FINE x FINE times a camera pixel and interpolated at the print's position; a tilt
    of the inks is blended between exposures with the inks of nine positions of the page.
    """
    press, geometry = specimen.press, specimen.press.geometry
    printed = printed_page(page, print_)
    lines = geometry.lines(page.height_mm)
    shape = (len(press.sensors), lines, geometry.pixels)
    mean, variance = np.empty(shape, np.float32), np.empty(shape, np.float32)
    fine_x = _fine_centres(geometry.centres_x_mm(page.width_mm), ACROSS * FINE)
    fine_y = _fine_centres(geometry.centres_y_mm(lines), FINE)
    seen = _seen_at(page, press, print_, fine_x[0], fine_y[0])
    for index, (sensor, model, day) in enumerate(
        zip(specimen.camera.sensors, press.sensors, session.sensors, strict=True)
    ):
        camera = replace(specimen.camera, sensors=(sensor,))
        light = np.zeros((fine_y.size, fine_x.size), np.float32)
        texture = np.zeros_like(light)
        for inks, down, across in _places(specimen, session, print_, index):
            blend = np.multiply.outer(
                _share(down, fine_y, page.height_mm), _share(across, fine_x, page.width_mm)
            )
            for first in range(ACROSS):
                part = (slice(None), slice(first, None, ACROSS))
                exposed = _fine_exposure(
                    camera,
                    inks,
                    printed,
                    fine_x[part[1]],
                    fine_y,
                    blend[part] > 0,
                    specimen.backing_reflectance,
                )
                light[part] += blend[part] * exposed * np.float32(sensor.dn_per_e)
            texture += blend * _texture(camera, model.footprint, inks, printed, fine_x, fine_y)
        coordinates = np.stack(seen)
        signal = ndimage.map_coordinates(light, coordinates, order=SPLINE_ORDER, mode="nearest")
        halftone = ndimage.map_coordinates(texture, coordinates, order=SPLINE_ORDER, mode="nearest")
        columns = model.column_gain * session.lamp * print_.lamp * day.table_gain * day.column_gain
        factor = columns * print_.flicker[:, None] * cloud_factor(print_, page, press)
        signal = signal * factor
        contrast = session.amounts.ink.halftone_contrast * CONTRAST_PITCH_MM / geometry.pixel_pitch_mm
        electrons = (signal / sensor.dn_per_e).clip(min=0)
        temporal = sensor.variance_temporal_e2(electrons) * (sensor.dn_per_e * day.sigma_error) ** 2
        variance[index] = temporal + (contrast * factor) ** 2 * halftone.clip(min=0) + 1 / 12
        mean[index] = (model.column_offset_dn + signal).clip(0, model.top_code_dn)
    return Prediction(expected_dn=mean, variance_dn2=variance)


def printed_page(page: Page, print_: Print) -> Page:
    """Return the raster with its planes displaced and its specks added."""
    printed = displaced(page, plane_pixels(print_, page))
    places, recipes = speck_pixels(print_, page)
    printed.cmyk[places[:, 0], places[:, 1]] = recipes
    return printed


def _fine_centres(centres_mm: NDArray[np.float64], fine: int) -> NDArray[np.float64]:
    """Return camera pixels' centres with fine - 1 more between each two, and a margin at both ends."""
    pitch = (centres_mm[-1] - centres_mm[0]) / (centres_mm.size - 1)
    count = (centres_mm.size + 2 * MARGIN_PIXELS) * fine
    return np.asarray(centres_mm[0] + (np.arange(count) / fine - MARGIN_PIXELS) * pitch)


def _seen_at(
    page: Page, press: Press, print_: Print, first_x_mm: float, first_y_mm: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return row and column among the fine centres of the point that each camera pixel sees, (lines, pixels) each."""
    geometry = press.geometry
    x, y = np.meshgrid(
        geometry.centres_x_mm(page.width_mm), geometry.centres_y_mm(geometry.lines(page.height_mm))
    )
    seen_x, seen_y = print_.placement.seen_mm(
        x, y, page_width_mm=page.width_mm, page_height_mm=page.height_mm
    )
    rows = (seen_y - first_y_mm) * (FINE / geometry.line_pitch_mm)
    columns = (seen_x - first_x_mm) * (ACROSS * FINE / geometry.pixel_pitch_mm)
    return rows, columns


def _places(
    specimen: Specimen, session: Session, print_: Print, sensor: int
) -> Iterator[tuple[PrintedInks, float, float]]:
    """Yield the inks at nine positions of the page (down, across), or at its centre, with nan, where nothing tilts."""
    camera_sensor = specimen.camera.sensors[sensor]
    knots = TILT_KNOTS if print_.ink_tilt.any() else (0.0,)
    for down in knots:
        for across in knots:
            gain = session.ink_gain + print_.ink_gain + print_.ink_tilt @ np.array([across, down])
            inks = PrintedInks(
                inks=specimen.inks,
                gain=gain,
                dot_gain=print_.dot_gain,
                white=float(print_.white[sensor]),
                day=session.sensors[sensor],
                weight=specimen.camera.light.radiance_photons * camera_sensor.quantum_efficiency,
            )
            alone = len(knots) == 1
            yield inks, np.nan if alone else down, np.nan if alone else across


def _share(knot: float, centres_mm: NDArray[np.float64], extent_mm: float) -> NDArray[np.float32]:
    """Return the weight of a knot at positions on the page: a hat between its neighbours; 1 everywhere for one knot."""
    if np.isnan(knot):
        return np.ones(centres_mm.size, np.float32)
    place = (2 * centres_mm / extent_mm - 1).clip(-1, 1)
    return (1 - np.abs(place - knot)).clip(min=0).astype(np.float32)


def _fine_exposure(
    camera: Camera,
    inks: PrintedInks,
    printed: Page,
    fine_x: NDArray[np.float64],
    fine_y: NDArray[np.float64],
    wanted: NDArray[np.bool_],
    backing_reflectance: float,
) -> NDArray[np.float32]:
    """Return electrons of whole pixels at the fine centres of the wanted rectangle, elsewhere 0.

    The rectangle is the smallest that holds all wanted pixels. A camera of pixels FINE times as narrow is exposed once.
    A pixel is FINE x FINE of its pixels, and its motion along the travel the mean of FINE positions of those: boxes
    made of boxes, so nothing is lost.
    """
    rows, columns = (np.flatnonzero(wanted.any(axis=axis)) for axis in (1, 0))
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    pitch_x, pitch_y = fine_x[1] - fine_x[0], fine_y[1] - fine_y[0]
    x = fine_x[left] + (np.arange(right - left + FINE - 1) - (FINE - 1) / 2) * pitch_x
    y = fine_y[top] + (np.arange(bottom - top + 2 * FINE - 2) - (FINE - 1)) * pitch_y
    narrow = replace(
        camera,
        speed_mm_s=None,
        sensors=tuple(replace(s, pixel_pitch_um=s.pixel_pitch_um / FINE) for s in camera.sensors),
    )
    squares = np.repeat(np.repeat(printed.cmyk, _REPEATS, axis=0), _REPEATS, axis=1)
    electrons = page_electrons(
        narrow,
        inks,
        replace(printed, cmyk=squares, dpi=printed.dpi * _REPEATS),
        centres_x_mm=x,
        centres_y_mm=y,
        backing_reflectance=backing_reflectance,
        falloff=False,
        tile_pixels=_TILE_PIXELS,
    )[0]
    across = _box(electrons, axis=1)
    exposed = np.zeros(wanted.shape, np.float32)
    exposed[top:bottom, left:right] = _box(_box(across, axis=0), axis=0) / FINE
    return exposed


def _box(image: NDArray[np.float32], *, axis: int) -> NDArray[np.float32]:
    """Return the sums of FINE neighbours."""
    count = image.shape[axis] - FINE + 1
    parts = [np.take(image, range(start, start + count), axis=axis) for start in range(FINE)]
    return np.asarray(sum(parts[1:], parts[0]))


def _texture(
    camera: Camera,
    footprint: Footprint,
    inks: PrintedInks,
    printed: Page,
    fine_x: NDArray[np.float64],
    fine_y: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Return the variance of a halftone of unit contrast at fine centres: J_p^2 a_p (1 - a_p) by the footprint.
    [DN^2]
    """
    sensor = camera.sensors[0]
    codes = printed.packed
    colours = distinct_colours(codes)
    area = inks.area(colours.view(np.uint8).reshape(-1, 4) / 255)
    texture = np.zeros(colours.size)
    for ink in range(4):
        signals = []
        for step in (-_STEP / 2, _STEP / 2):
            moved = area.copy()
            moved[:, ink] = (moved[:, ink] + step).clip(min=0)
            irradiance = camera.irradiance_photons(inks.of_area(moved))
            signals.append(sensor.electrons(irradiance) * sensor.dn_per_e)
        width = np.minimum(area[:, ink] + _STEP / 2, _STEP)
        slope = (signals[1] - signals[0]) / width
        texture += slope**2 * (area[:, ink] * (1 - area[:, ink])).clip(min=0)
    image = texture.astype(np.float32)[np.searchsorted(colours, codes)]
    across, along = page_taps(
        footprint,
        centres_x_mm=fine_x,
        centres_y_mm=fine_y,
        raster_pixel_mm=printed.pixel_mm,
        raster_shape=image.shape,
    )
    return across.apply(along.apply(image).T).T


def cloud_factor(print_: Print, page: Page, press: Press) -> NDArray[np.float64]:
    """Return the factor of cloudy paper on every pixel's light, as in ``light_lines``: (lines, pixels) [-]."""
    geometry = press.geometry
    down = cloud_places(geometry.centres_y_mm(geometry.lines(page.height_mm)), page.height_mm)
    across = cloud_places(geometry.centres_x_mm(page.width_mm), page.width_mm)
    places = np.stack(np.meshgrid(down, across, indexing="ij"))
    factor = 1 + ndimage.map_coordinates(print_.cloud, places.clip(min=0), order=1)
    return np.asarray(np.where((places >= 0).all(axis=0), factor, 1.0))
