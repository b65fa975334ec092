"""Accuracy of the tables' interpolation against the exact model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from prooflight.commissioning.characterise import signal_dn, variance_dn2
from prooflight.prediction.predict import expected_light

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.camera.camera import Camera
    from prooflight.inks.reflectance import ReflectanceModel
    from prooflight.prediction.tables import SensorModel

RANDOM_RECIPES = 20_000


@dataclass(frozen=True, slots=True, kw_only=True)
class TableAccuracy:
    """Errors of one sensor's tables, the mean's in standard deviations of the temporal noise."""

    sensor: str
    mean_rms_sigma: float
    mean_max_sigma: float
    white_sigma: float
    """Error at bare paper."""
    sigma_rms_percent: float


def trial_recipes(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Draw recipes (n, 4) as pages have them: paper, ramps of one and of two inks, and random ones."""
    ramp = np.arange(256)
    recipes = [np.zeros((1, 4), np.int64), rng.integers(0, 256, (RANDOM_RECIPES, 4))]
    for first in range(4):
        single = np.zeros((256, 4), np.int64)
        single[:, first] = ramp
        recipes.append(single)
        for second in range(first + 1, 4):
            pair = single.copy()
            pair[:, second] = rng.permutation(ramp)
            recipes.append(pair)
    return np.concatenate(recipes).astype(np.uint8)


def table_accuracy(
    camera: Camera, inks: ReflectanceModel, sensors: tuple[SensorModel, ...], rng: np.random.Generator
) -> list[TableAccuracy]:
    """Compare interpolated mean and sigma with the exact closed form, over ``trial_recipes``."""
    recipes = trial_recipes(rng)
    irradiance = camera.irradiance_photons(inks.reflectance(recipes / 255))
    results = []
    for sensor, model in zip(camera.sensors, sensors, strict=True):
        electrons = sensor.electrons(irradiance)
        exact, sigma = signal_dn(sensor, electrons), np.sqrt(variance_dn2(sensor, electrons))
        mean, variance = expected_light(recipes, model)
        error, of_sigma = (mean - exact) / sigma, np.sqrt(variance) / sigma - 1
        results.append(
            TableAccuracy(
                sensor=model.name,
                mean_rms_sigma=round(float(np.sqrt(np.mean(error**2))), 4),
                mean_max_sigma=round(float(np.abs(error).max()), 4),
                white_sigma=round(float(abs(error[0])), 4),
                sigma_rms_percent=round(float(np.sqrt(np.mean(of_sigma**2))) * 100, 4),
            )
        )
    return results
