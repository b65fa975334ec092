"""A press with a wrong model of its camera, and the resulting expectation (paper, section 4.4)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from prooflight.camera.sensor import ROUNDING_DN2
from prooflight.prediction.predict import Prediction, predict
from prooflight.rng import stream

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel
    from prooflight.press.artefact import Press
    from prooflight.scans.placement import Placement

Belief = Literal[
    "nothing", "sigma factor", "sigma offset", "gain", "swing", "swing, calibrated", "table noise"
]
LEAST_SIGMA_DN: Final = 0.1
"""assumed: least sigma of a table; 1/12 DN^2 of rounding alone is 0.29 DN."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """Kind and size of the error of the model; the scans themselves are right."""

    belief: Belief
    size: float
    """Size of the error.

    Sigma factor, gain, swings: believed over true [-]. Sigma offset: added, over paper's sigma [-]. Table noise:
    exposures of each node that mean and variance were taken from.
    """

    def __str__(self) -> str:
        return self.belief if self.belief == "nothing" else f"{self.belief} {self.size:g}"

    def expected(self, seen: Prediction, press: Press) -> Prediction:
        """Return the wrong expectation from the right one, (sensors, lines, pixels). ValueError: for table noise."""
        pairs = [
            self._of_sensor(mean, variance, sensor)
            for mean, variance, sensor in zip(seen.expected_dn, seen.variance_dn2, press.sensors, strict=True)
        ]
        return Prediction(
            expected_dn=np.stack([mean for mean, _ in pairs]),
            variance_dn2=np.stack([variance for _, variance in pairs]),
        )

    def predicted(self, page: Page, press: Press, placement: Placement, seen: Prediction) -> Prediction:
        """Return the wrong expectation of a page at this placement; ``seen`` is the right one."""
        if self.belief != "table noise":
            return self.expected(seen, press)
        sensors = noisy_sensors(press, round(self.size))
        return predict(page, sensors=sensors, geometry=press.geometry, placement=placement, threads=1)

    def _of_sensor(
        self, mean: np.ndarray, variance: np.ndarray, sensor: SensorModel
    ) -> tuple[np.ndarray, np.ndarray]:
        size, rounding = np.float32(self.size), np.float32(ROUNDING_DN2)
        match self.belief:
            case "nothing":
                return mean, variance
            case "sigma factor":
                return mean, variance * size**2
            case "sigma offset":
                added = size * np.float32(np.sqrt(sensor.variance_dn2[0, 0, 0, 0]))
                return mean, np.maximum(np.sqrt(variance) + added, np.float32(LEAST_SIGMA_DN)) ** 2
            case "gain":
                dark = sensor.column_offset_dn
                return dark + size * (mean - dark), variance
            case "swing":  # a code is thought worth so many volts more: every number but rounding shrinks
                return mean / size, (variance - rounding) / size**2 + rounding
            case "swing, calibrated":
                # A white tile then gives every column the gain that the swing took, which leaves dark noise over
                # swing^2 and shot noise over swing.
                dark_dn2 = np.float32(sensor.dark_variance_dn2)
                return mean, (dark_dn2 - rounding) / size**2 + rounding + (variance - dark_dn2) / size
            case "table noise":
                message = "noise of the tables is not that of a pixel; use predicted"
                raise ValueError(message)


NOTHING: Final = Disturbance(belief="nothing", size=1.0)
SIZES: Final[dict[Belief, tuple[float, ...]]] = {
    "sigma factor": (0.5, 0.8, 0.95, 1.05, 1.25, 2.0),
    "sigma offset": (-0.05, 0.05, 0.1, 0.2, 0.5, 1.0),
    "gain": (0.97, 0.99, 0.997, 1.003, 1.01, 1.03),
    "swing": (0.8, 0.9, 0.97, 1.03, 1.1, 1.25),
    "swing, calibrated": (0.5, 0.8, 1.25, 2.0),
    "table noise": (4, 32, 256),  # predicting keeps 16 tables at hand, and these are 12
}
AXES: Final[dict[Belief, str]] = {
    "sigma factor": "believed over true sigma [-]",
    "sigma offset": "added to sigma, over paper's sigma [-]",
    "gain": "believed over true gain of the signal [-]",
    "swing": "believed over true voltage swing [-]",
    "swing, calibrated": "believed over true voltage swing [-]",
    "table noise": "exposures behind each node of the tables",
}
"""Labels of ``Disturbance.size`` in figures."""
UNDISTURBED: Final[dict[Belief, float | None]] = {
    "sigma factor": 1.0,
    "sigma offset": 0.0,
    "gain": 1.0,
    "swing": 1.0,
    "swing, calibrated": 1.0,
    "table noise": None,
}
"""Size without an error; None: it would be infinite."""


def all_disturbances() -> tuple[Disturbance, ...]:
    """Return the undisturbed case first, then every belief at every size."""
    wrong = (Disturbance(belief=belief, size=size) for belief, sizes in SIZES.items() for size in sizes)
    return (NOTHING, *wrong)


@lru_cache(maxsize=8)
def noisy_sensors(press: Press, exposures: int) -> tuple[SensorModel, ...]:
    """Return the press's sensors with tables measured by ``exposures`` (at least 2) repeated exposures of each node.

    Gaussian noise: the mean errs by sigma / sqrt(n), the variance is chi-square with n - 1 degrees of freedom.
    """
    rng = stream(None, "table-noise", exposures)
    return tuple(_noisy(sensor, exposures, rng) for sensor in press.sensors)


def _noisy(sensor: SensorModel, exposures: int, rng: np.random.Generator) -> SensorModel:
    shape, sigma = sensor.mean_dn.shape, np.sqrt(sensor.variance_dn2)
    off = rng.standard_normal(shape, np.float32) * (sigma / np.float32(np.sqrt(exposures)))
    share = rng.chisquare(exposures - 1, shape).astype(np.float32) / np.float32(exposures - 1)
    variance = np.maximum(sensor.variance_dn2 * share, np.float32(LEAST_SIGMA_DN**2))
    return replace(sensor, mean_dn=(sensor.mean_dn + off).astype(np.float32), variance_dn2=variance)
