"""A scan in the press world from tables, as fast as prediction: every effect physical, through the true tables."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage, special

from prooflight.kernels.simulation.lines import add_noise, light_lines, scan_lines
from prooflight.prediction.lens_correction import correct_light
from prooflight.prediction.predict import Prediction
from prooflight.prediction.sampling_grid import sampling_grid
from prooflight.simulation.prints import CLOUD_PITCH_MM, CONTRAST_PITCH_MM, plane_pixels, speck_pixels
from prooflight.simulation.session import true_sensors

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.simulation.prints import Print
    from prooflight.simulation.session import Session, TrueSensor


def fast_scan(
    page: Page, press: Press, session: Session, print_: Print, *, rng: np.random.Generator
) -> NDArray[np.uint16]:
    """One print of a page as the camera records it, (sensors, lines, pixels) [DN]."""
    return noisy(fast_mean_variance(page, press, session, print_), press, rng)


def fast_mean_variance(page: Page, press: Press, session: Session, print_: Print) -> Prediction:
    """The same without noise: mean and variance (temporal, halftone and rounding) of every pixel.

    Every ink is read from its own displaced plane, its area changed by gain, tilt and dot gain, and looked up in the
    session's true tables; then filtered under the print's placement as prediction does, and lit.
    """
    where = sampling_grid(page, press.geometry, print_.placement)
    packed = page.packed
    gains = np.concatenate([(session.ink_gain + print_.ink_gain)[:, None], print_.ink_tilt], axis=1)
    places, recipes = speck_pixels(print_, page)
    lines = press.geometry.lines(page.height_mm)
    mean = np.empty((len(press.sensors), lines, press.geometry.pixels), np.float32)
    variance = np.empty_like(mean)
    for index, sensor in enumerate(true_sensors(session, press)):
        footprint = sensor.model.footprint
        step = (footprint.across.size - 1) / (2 * footprint.reach_mm) * page.pixel_mm
        crossed = np.ptp(where.along.places, axis=1).max()
        scan_lines(
            packed,
            plane_pixels(print_, page),
            gains.astype(np.float32),
            print_.dot_gain.astype(np.float32),
            places,
            np.ascontiguousarray(recipes).view(np.uint32)[:, 0],
            sensor.nodes,
            sensor.bends,
            np.array([print_.white[index], sensor.model.backing_dn], np.float32),
            where.across.places,
            where.across.pitch,
            where.across.segment,
            footprint.across,
            where.along.places,
            where.along.pitch,
            where.along.segment,
            footprint.along,
            step,
            int(np.ceil(2 * footprint.reach_mm / page.pixel_mm + crossed)) + 4,
            mean[index],
            variance[index],
        )
        correct_light(mean[index], sensor.model.correction)
        light_scan(mean[index], variance[index], sensor, page, press, session, print_)
    return Prediction(expected_dn=mean, variance_dn2=variance)


def light_scan(
    above_backing: NDArray[np.float32],
    texture: NDArray[np.float32],
    sensor: TrueSensor,
    page: Page,
    press: Press,
    session: Session,
    print_: Print,
) -> None:
    """Light above the backing's [DN] and texture [DN^2] -> mean and variance, in place; (lines, pixels) each.

    What acts on the light as a whole: cloudy paper, lamps, flicker, columns; and the noise that then comes.
    """
    geometry, model = press.geometry, sensor.model
    light_lines(
        above_backing,
        texture,
        np.float32(model.backing_dn),
        (sensor.columns * print_.lamp).astype(np.float32),
        print_.flicker.astype(np.float32),
        print_.cloud.astype(np.float32),
        _cloud_place(geometry.centres_y_mm(above_backing.shape[0]), page.height_mm),
        _cloud_place(geometry.centres_x_mm(page.width_mm), page.width_mm),
        model.column_offset_dn,
        model.column_gain,
        np.float32(session.amounts.ink.halftone_contrast * CONTRAST_PITCH_MM / geometry.pixel_pitch_mm),
        sensor.noise_dn2,
        np.float32(sensor.noise_top_dn),
        np.float32(model.top_code_dn),
    )


def noisy(seen: Prediction, press: Press, rng: np.random.Generator) -> NDArray[np.uint16]:
    """Digital numbers of that mean and variance, rounded and clipped to each sensor's codes."""
    dn = np.empty(seen.expected_dn.shape, np.uint16)
    for sensor, mean, variance, out in zip(
        press.sensors, seen.expected_dn, seen.variance_dn2, dn, strict=True
    ):
        key = rng.integers(0, 2**64, dtype=np.uint64)
        top = np.float32(sensor.top_code_dn)
        add_noise(mean.ravel(), variance.ravel(), top, half_normals(), key, out.reshape(-1))
    return dn


@cache
def half_normals() -> NDArray[np.float32]:
    """2^16 even quantiles of a normal distribution, scaled to the variance 1/2: two draws make a normal number."""
    quantiles = special.ndtri((np.arange(2**16) + 0.5) / 2**16)
    return (quantiles * (np.sqrt(0.5) / quantiles.std())).astype(np.float32)


def _cloud_place(centres_mm: NDArray[np.float64], extent_mm: float) -> NDArray[np.float32]:
    """Where camera pixels lie among the cloud's nodes; -1 off the page, where there is no paper."""
    on_page = (centres_mm >= 0) & (centres_mm < extent_mm)
    return np.where(on_page, centres_mm / CLOUD_PITCH_MM, -1).astype(np.float32)


def cloud_factor(print_: Print, page: Page, press: Press) -> NDArray[np.float64]:
    """What cloudy paper does to every pixel's light, as ``light_lines`` does it: (lines, pixels) [-]."""
    geometry = press.geometry
    down = _cloud_place(geometry.centres_y_mm(geometry.lines(page.height_mm)), page.height_mm)
    across = _cloud_place(geometry.centres_x_mm(page.width_mm), page.width_mm)
    places = np.stack(np.meshgrid(down, across, indexing="ij"))
    factor = 1 + ndimage.map_coordinates(print_.cloud, places.clip(min=0), order=1)
    return np.asarray(np.where((places >= 0).all(axis=0), factor, 1.0))
