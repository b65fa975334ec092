"""Rows of the robustness study: scans of right and wrong prints, measured under every wrong belief of the press."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from prooflight.camera.sensor import ROUNDING_DN2
from prooflight.detectors.paper.bayes import SHARE_SIGMAS, window_unit
from prooflight.detectors.paper.chi_square import pearson
from prooflight.detectors.paper.evidence import gather, interval_shares
from prooflight.prediction.predict import Prediction, predict
from prooflight.registration.register import register
from prooflight.rng import stream
from prooflight.scans.placement import IN_PLACE
from prooflight_studies.harness.baselines import (
    VariationModel,
    absolute_difference,
    dissimilarity,
    variation_moments,
)
from prooflight_studies.harness.measures import FIRST_SHARE, normalised_error, numbers_of, window_means
from prooflight_studies.harness.protocol import Bench, on_area, rows_of_copies

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel
    from prooflight.press.artefact import Press
    from prooflight.scans.placement import Placement
    from prooflight.simulation.captures import Printed
    from prooflight.simulation.corpus.corpus import Designs
    from prooflight_studies.harness.protocol import Day, Design, Plan
    from prooflight_studies.harness.result_cache import Rows

SIDES: Final = (4, 8, 16, 32)
"""Sides of separate windows. [pixels]"""
SHARE_AS_PRINTED, SHARE_KEPT, SHARE_LEARNED = range(FIRST_SHARE, FIRST_SHARE + 3)
"""Indices of statistics of a set of windows after those of ``measures``: shares below three limits.

The limits are 0.675, 0.675 of the unit learned from the right tables' good pages, and 0.675 of that of the wrong
tables' own.
"""
DIFFERENCE, SSIM, VARIATION_KEPT, VARIATION_LEARNED = range(4)
"""Indices of the baselines' scores.

There are two of the variation model, trained under the right tables and under the wrong ones.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Learned:
    """Models trained on good copies of the pilot's designs under each disturbance."""

    units: NDArray[np.float64]
    """Scatter of window means, ``detectors.paper.bayes.window_unit``. (disturbances, sides, sensors)"""
    variations: tuple[VariationModel, ...]


def believed(
    bench: Bench, design: Design, printed: Printed, rng: np.random.Generator
) -> Iterator[tuple[NDArray[np.uint16], Prediction]]:
    """Yield one scan of a print and the expectation of the page under each disturbance, both over the page's area.

    The page is registered with the right tables, so that only one thing is wrong at a time.
    """
    day, page, seen = bench.day, design.good.page, design.good.expected
    scan = day.recorded(day.seen(printed, rng), rng)
    placement = IN_PLACE
    if design.landmarks is not None:
        registration = register(design.landmarks, scan)
        if registration.located:
            placement = registration.placement
            seen = day.expected(page, placement)
    area = bench.area(page)
    measured = np.ascontiguousarray(scan[area])
    for disturbance in all_disturbances():
        yield measured, on_area(disturbance.predicted(page, day.press, placement, seen), area)


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnGood:
    """Measurement of good copies of the pilot's designs: columns ``units`` and ``moments``, one row a design."""

    press: Press
    pages: Designs
    plan: Plan

    def __call__(self, day: Day, /) -> Rows:
        """Return the rows of a day."""
        bench = Bench.of(day, self.press, self.pages, self.plan)
        white = bench.white_dn
        units, moments = [], []
        for index in day.designs:
            rng = stream(self.plan.seed, "pilot-print", index)
            design = bench.design(index)
            seen = list(believed(bench, design, design.good, rng))
            units.append([_units(normalised_error(dn, p.expected_dn, p.variance_dn2)) for dn, p in seen])
            moments.append(
                [
                    variation_moments(dn, p.expected_dn, p.variance_dn2, white_dn=white, rng=rng)
                    for dn, p in seen
                ]
            )
        return {"units": np.array(units), "moments": np.array(moments)}


def learned(rows: Rows) -> Learned:
    """Train the models on the pilot's rows."""
    return Learned(
        units=rows["units"].mean(axis=0),
        variations=tuple(VariationModel.learn(list(of_one)) for of_one in rows["moments"].swapaxes(0, 1)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchWrong:
    """Measurement of good copies and misprints of a day's designs, with a row for each scan.

    Columns: design, kind ("" where good), pixels; and, disturbances as their first axis, ``numbers`` (sides, sensors,
    7), ``chi_squares`` (2) and ``baselines`` (4).
    """

    press: Press
    pages: Designs
    plan: Plan
    learned: Learned

    def __call__(self, day: Day, /) -> Rows:
        """Return the rows of a day."""
        return rows_of_copies(Bench.of(day, self.press, self.pages, self.plan), day, self.plan, self._rows)

    def _rows(
        self, bench: Bench, design: Design, printed: Printed, index: int, rng: np.random.Generator
    ) -> Iterator[dict[str, Any]]:
        numbers, chi_squares, baselines, pixels = [], [], [], 0
        first: NDArray[np.float64] | None = None
        seen_first = design.good.expected
        for place, (measured, seen) in enumerate(believed(bench, design, printed, rng)):
            z = normalised_error(measured, seen.expected_dn, seen.variance_dn2)
            numbers.append(_numbers(z, self.learned.units[0], self.learned.units[place]))
            chi_squares.append(self._chi_squares(measured, seen, index))
            if first is None:
                seen_first, pixels = seen, measured[0].size
            same_mean = first is not None and np.array_equal(seen.expected_dn, seen_first.expected_dn)
            scores = self._baselines(measured, seen, place, first if same_mean else None)
            first = scores if first is None else first
            baselines.append(scores)
        facts = {"design": index, "kind": printed.kind, "pixels": pixels}
        measured_as = {"numbers": numbers, "chi_squares": chi_squares, "peers": baselines}
        yield facts | {name: np.array(values) for name, values in measured_as.items()}

    def _chi_squares(self, measured: NDArray[np.uint16], seen: Prediction, seed: int) -> tuple[float, float]:
        top_codes = [sensor.top_code_dn for sensor in self.press.sensors]
        evidence = gather(
            measured, seen.expected_dn, seen.variance_dn2, top_codes_dn=top_codes, seed=seed, threads=1
        )
        shares = interval_shares()
        page, tiles = pearson(evidence.histogram, shares), pearson(evidence.tile_histogram, shares)
        return float(page.sum()), float(tiles.sum(axis=0).max())

    def _baselines(
        self, measured: NDArray[np.uint16], seen: Prediction, place: int, same: NDArray[np.float64] | None
    ) -> NDArray[np.float64]:
        """Return the baselines' scores.

        same: those of a scan with the same expected signal, which is the only input of two of them.
        """
        white = [sensor.white_dn for sensor in self.press.sensors]
        if same is None:
            difference = absolute_difference(measured, seen.expected_dn, white_dn=white).local
            unlike = dissimilarity(measured, seen.expected_dn, white_dn=white).mean
        else:
            difference, unlike = same[DIFFERENCE], same[SSIM]
        far = [
            model.score(measured, seen.expected_dn, seen.variance_dn2, white_dn=white)
            for model in (self.learned.variations[0], self.learned.variations[place])
        ]
        return np.array([difference, unlike, *far])


def _units(z: NDArray[np.float32]) -> NDArray[np.float64]:
    return np.stack([window_unit(window_means(z, side=side)) for side in SIDES])


def _numbers(
    z: NDArray[np.float32], nominal: NDArray[np.float64], own: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the statistics (sides, sensors, 7); units (sides, sensors)."""
    numbers = np.empty((len(SIDES), len(z), SHARE_LEARNED + 1))
    for cut, side in enumerate(SIDES):
        units = (np.ones(len(z)), nominal[cut], own[cut])
        limits = [(SHARE_SIGMAS * unit)[:, None, None] for unit in units]
        numbers_of(window_means(z, side=side), limits, out=numbers[cut])
    return numbers


# --- a press with a wrong model of its camera (paper, section 4.4) ---

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
