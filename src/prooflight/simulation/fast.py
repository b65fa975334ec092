"""Scan in the press world from tables, as fast as prediction: every effect physical, through the true tables."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import special

from prooflight.kernels.simulation.inks import PrintedInks, TrueTable, no_fields
from prooflight.kernels.simulation.lines import NoisySensor, PrintLight, add_noise, light_lines, scan_lines
from prooflight.prediction.lens_correction import correct_light
from prooflight.prediction.predict import Prediction
from prooflight.prediction.sampling_grid import sampling_grid
from prooflight.simulation.halftone import halftoned
from prooflight.simulation.prints import CLOUD_PITCH_MM, CONTRAST_PITCH_MM, Print, plane_pixels, speck_pixels
from prooflight.simulation.session import Session, TrueSensor, true_sensors
from prooflight.simulation.sheets import FIELD_PITCH_MM

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


def fast_scan(
    page: Page, press: Press, session: Session, print_: Print, *, rng: np.random.Generator
) -> NDArray[np.uint16]:
    """Simulate one print of a page as the camera records it, (sensors, lines, pixels) [DN]."""
    return noisy(fast_mean_variance(page, press, session, print_), press, rng)


def fast_mean_variance(page: Page, press: Press, session: Session, print_: Print) -> Prediction:
    """Simulate the same without noise: mean and variance (temporal, halftone and rounding) of every pixel.

    Every ink is read from its own displaced plane, its area changed by gain, tilt and dot gain, and looked up
    in the session's true tables; then filtered under the print's placement as prediction does, and lit.
    """
    if session.screen is not None:
        page = halftoned(page, session.screen, press.ink_light)
    where = sampling_grid(page, press.geometry, print_.placement)
    gains = np.concatenate([(session.ink_gain + print_.ink_gain)[:, None], print_.ink_tilt], axis=1)
    places, recipes = speck_pixels(print_, page)
    gain_field, dot_field, pitch = no_fields()
    if (fields := print_.fields) is not None:
        gain_field, dot_field = fields.gain, fields.dot_gain * np.float32(session.dots)
        pitch = np.float32(FIELD_PITCH_MM / page.pixel_mm)
    inks = PrintedInks(
        planes=plane_pixels(print_, page),
        gains=gains.astype(np.float32),
        dot_gains=(session.dots * print_.dot_gain).astype(np.float32),
        speck_places=places,
        packed_specks=np.ascontiguousarray(recipes).view(np.uint32)[:, 0],
        gain_field=gain_field,
        dot_field=dot_field,
        field_pitch=pitch,
    )
    lines = print_.flicker.size
    mean = np.empty((len(press.sensors), lines, press.geometry.pixels), np.float32)
    variance = np.empty_like(mean)
    for index, sensor in enumerate(true_sensors(session, press)):
        footprint = sensor.model.footprint
        crossed = np.ptp(where.along.places, axis=1).max()
        table = TrueTable(
            nodes=sensor.nodes,
            bends=sensor.bends,
            white=np.float32(print_.white[index]),
            backing=np.float32(sensor.model.backing_dn),
        )
        scan_lines(
            page.packed,
            inks,
            table,
            *where.passes(footprint, page.pixel_mm),
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
    """Convert light above the backing's [DN] and texture [DN^2] to mean and variance, in place; (lines, pixels) each.

    It applies the effects on the light as a whole: cloudy paper, lamps, flicker, columns; and then the noise.
    """
    geometry, model = press.geometry, sensor.model
    contrast = session.amounts.ink.halftone_contrast * CONTRAST_PITCH_MM / geometry.pixel_pitch_mm
    light = PrintLight(
        columns=(sensor.columns * print_.lamp).astype(np.float32),
        flicker=print_.flicker.astype(np.float32),
        cloud=print_.cloud.astype(np.float32),
        cloud_down=cloud_places(geometry.centres_y_mm(above_backing.shape[0]), page.height_mm),
        cloud_across=cloud_places(geometry.centres_x_mm(page.width_mm), page.width_mm),
        contrast=np.float32(contrast),
    )
    noisy_sensor = NoisySensor(
        column_offset=model.column_offset_dn,
        column_gain=model.column_gain,
        backing=np.float32(model.backing_dn),
        noise=sensor.noise_dn2,
        noise_top=np.float32(sensor.noise_top_dn),
        top_code=np.float32(model.top_code_dn),
    )
    light_lines(above_backing, texture, light, noisy_sensor)


def noisy(seen: Prediction, press: Press, rng: np.random.Generator) -> NDArray[np.uint16]:
    """Draw digital numbers of that mean and variance, rounded and clipped to each sensor's codes."""
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
    """Return 2^16 even quantiles of a normal distribution of variance 1/2: two draws make a normal number."""
    quantiles = special.ndtri((np.arange(2**16) + 0.5) / 2**16)
    return (quantiles * (np.sqrt(0.5) / quantiles.std())).astype(np.float32)


def cloud_places(centres_mm: NDArray[np.float64], extent_mm: float) -> NDArray[np.float32]:
    """Return the positions of camera pixels among the cloud's nodes.

    Off the page, where there is no paper, they are -1.
    """
    on_page = (centres_mm >= 0) & (centres_mm < extent_mm)
    return np.where(on_page, centres_mm / CLOUD_PITCH_MM, -1).astype(np.float32)
