"""Repeated prints of one page, right and wrong: the samples of the paper's figures 7 and 8."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.paper.bayes import CORRECT, BayesianNetwork, window_statistics
from prooflight.detectors.paper.chi_square import pearson
from prooflight.detectors.paper.evidence import gather, interval_shares
from prooflight.pages.job import open_job
from prooflight.rng import stream
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.misprints.kinds import KINDS
from prooflight_studies.harness.error_map import normalised_error, window_means
from prooflight_studies.harness.operating import Scored
from prooflight_studies.harness.paper_detectors import MISPRINT_RATE, types_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.simulation.captures import Printed

SIDE: Final = 8
"""Side of the windows, as inspection has them. [pixels]"""
BINS: Final = 8
"""Number of bins; few, since only half of the copies is available for training."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples:
    """Copies of one page in the ideal world; rows alternate between training and testing."""

    statistics: NDArray[np.float64]
    """Mean, minimum and share of the window means, (copies, sensors, 3)."""
    kinds: NDArray[np.str_]
    """Kind of misprint, "" where good. (copies,)"""
    chi_square: NDArray[np.float64]
    """Pearson's statistic, summed over sensors. (copies,)"""
    sensors: tuple[str, ...]
    pitch_mm: float

    @property
    def types(self) -> NDArray[np.str_]:
        """Type of each copy: correct, global or local. (copies,)"""
        return np.array(types_of(self.kinds, types=2))


def page_samples(
    press: Press,
    job: Path,
    number: int,
    *,
    good: int,
    of_each_kind: int,
    seed: int,
    progress: Callable[[str], None] = lambda _text: None,
) -> Samples:
    """Print good copies of a job's page, and misprints of every kind, severities drawn evenly.

    Misprints without the least effect that counts are left out. JobError, RequestError: there is no such page.
    """
    with open_job(job, dpi=press.dpi) as opened:

        def fetch(index: int) -> Page:
            return press.geometry.lay(opened.page(index))

        day = SimulatedDay.begin("ideal", press, stream(seed, "sample-session", number))
        right = day.good(fetch(number))
        others = [index for index in range(1, len(opened) + 1) if index != number]
        kinds = [""] * good + [kind for _ in range(of_each_kind) for kind in KINDS]
        measured = []
        for copy, kind in enumerate(kinds):
            if copy % len(KINDS) == 0:
                progress(f"printing page {number} again, {copy} of {len(kinds)}")
            rng = stream(seed, "sample-print", number, copy)
            printed = day.wrong(right, kind, others=others, fetch=fetch, rng=rng) if kind else right
            if printed is None:
                continue
            scan = day.recorded(printed.expected, rng)
            measured.append((kind, *_numbers(scan, right, press)))
    return Samples(
        statistics=np.array([statistics for _, statistics, _ in measured]),
        kinds=np.array([kind for kind, _, _ in measured]),
        chi_square=np.array([chi_square for _, _, chi_square in measured]),
        sensors=tuple(sensor.name for sensor in press.sensors),
        pitch_mm=press.geometry.pixel_pitch_mm,
    )


def _numbers(scan: NDArray[np.uint16], right: Printed, press: Press) -> tuple[NDArray[np.float64], float]:
    area = (slice(None), *press.geometry.on_page(right.page.width_mm, right.page.height_mm))
    measured = np.ascontiguousarray(scan[area])
    expected = np.ascontiguousarray(right.expected.expected_dn[area])
    variance = np.ascontiguousarray(right.expected.variance_dn2[area])
    top_codes = [sensor.top_code_dn for sensor in press.sensors]
    evidence = gather(measured, expected, variance, top_codes_dn=top_codes, seed=1, threads=1)
    means = window_means(normalised_error(measured, expected, variance), side=SIDE)
    return window_statistics(means), float(pearson(evidence.histogram, interval_shares()).sum())


def judged_samples(samples: Samples) -> dict[str, Scored]:
    """Return scores of the odd copies of each type by detector; the network is trained on the even ones."""
    place = np.empty(len(samples.kinds), np.int64)
    for kind in np.unique(samples.kinds):
        of_kind = samples.kinds == kind
        place[of_kind] = np.arange(of_kind.sum())
    learn = place % 2 == 0
    flat = samples.statistics.reshape(len(samples.kinds), -1)
    network = BayesianNetwork.learn(
        flat[learn], samples.types[learn].tolist(), misprint_rate=MISPRINT_RATE, bins=BINS
    )
    test = ~learn
    bad = samples.types[test] != CORRECT
    return {
        name: Scored(score=score, bad=bad, design=np.flatnonzero(test), day=np.flatnonzero(test))
        for name, score in (
            ("Bayesian network", network.log_ratio(flat[test])),
            ("chi-square", samples.chi_square[test]),
        )
    }
