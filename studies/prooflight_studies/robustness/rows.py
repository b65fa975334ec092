"""Rows of the robustness study: scans of right and wrong prints, measured under every wrong belief of the press."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.detectors.paper.bayes import SHARE_SIGMAS, window_unit
from prooflight.detectors.paper.chi_square import pearson
from prooflight.detectors.paper.evidence import gather, interval_shares
from prooflight.prediction.predict import Prediction
from prooflight.registration.register import register
from prooflight.rng import stream
from prooflight.scans.placement import IN_PLACE
from prooflight_studies.harness.baselines import (
    VariationModel,
    absolute_difference,
    dissimilarity,
    variation_moments,
)
from prooflight_studies.harness.error_map import normalised_error, window_means
from prooflight_studies.harness.measures import FIRST_SHARE, numbers_of
from prooflight_studies.harness.protocol import Bench, on_area, rows_of_copies
from prooflight_studies.robustness.disturbances import all_disturbances

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight.prediction.predict import Prediction
    from prooflight.press.artefact import Press
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
