"""From a scan to what it says, and an artefact's way there and back; learning: ``commissioning/test_learn.py``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.training.learn import Pages, learn_model
from prooflight.detectors.matched_filter.analysis import analyse
from prooflight.detectors.matched_filter.design import prepare_page
from prooflight.detectors.matched_filter.fit.modes import PAGE_FEATURES
from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
from prooflight.detectors.matched_filter.model import DetectorModel, compressed
from prooflight.detectors.matched_filter.ranking import (
    ADDED_FROM,
    ADDED_SLOPE,
    ALONE_FROM,
    ALONE_SLOPE,
    every_column,
    marks_of,
    strongest_alone,
)
from prooflight.detectors.matched_filter.statistics.families import all_statistics
from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
from prooflight.detectors.matched_filter.statistics.statistic import Observed, Statistic, keys_of, values_of
from prooflight.files.schema import Misfit
from prooflight.prediction.predict import predict
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

NAMES = ["box/add-C+/8", "box/add-C-/8", "flat/void+/4", "streak/void/1/full", "ghost/C/0", "place/skew"]


def learned(count: int) -> DetectorModel:
    """From made-up statistics of three kinds of misprints, and page features of so many numbers; seed 1."""
    rng = np.random.default_rng(1)
    values = np.exp(0.3 * rng.standard_normal((400, len(NAMES)))).astype(np.float32)
    bad = np.arange(400) % 2 == 1
    kind = np.where(bad, np.array(KINDS)[np.arange(400) // 2 % 3], "")
    for place, one in enumerate(KINDS[:3]):
        values[kind == one, place] *= 8
    page_features = rng.standard_normal((400, count))
    pages = Pages(
        values=values,
        page_features=page_features,
        design=np.arange(400) // 2,
        kind=kind,
        press=np.zeros(400, np.int64),
    )
    return learn_model(pages, names=NAMES, scatter=Scatter.white(), rng=rng, trees=60)


@pytest.fixture(scope="module")
def trained() -> DetectorModel:
    return learned(3)


def test_a_mark_is_what_a_scan_says_most(press: Press, page: Page) -> None:
    expected = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    known = prepare_page(page, expected, sensors=press.sensors, geometry=press.geometry)
    cmyk = page.cmyk.copy()
    rows, columns = cmyk.shape[:2]
    spot = (slice(rows // 2, rows // 2 + 24), slice(columns // 2, columns // 2 + 24))
    cmyk[spot] = 255 - cmyk[spot]
    statistics = []
    for printed in (page, replace(page, cmyk=cmyk)):
        seen = predict(printed, sensors=press.sensors, geometry=press.geometry, threads=1)
        scan = ideal_scan(seen, press, np.random.default_rng(2))
        analysis = analyse(known, scan)
        statistics.append(
            all_statistics(
                analysis.sums, analysis.marks, analysis.fit, analysis.registration, Scatter.white()
            )
        )
    good, bad = (compressed(values_of(one)) for one in statistics)
    assert keys_of(statistics[0]) == keys_of(statistics[1])
    assert [Statistic.parse(key) for key in keys_of(statistics[0])] == [
        one.statistic for one in statistics[0]
    ]
    assert np.isfinite(good).all()
    assert (bad - good).max() > 1.0


@pytest.mark.parametrize(
    "residual_variance", [ResidualVariance(), ResidualVariance.none()], ids=["varies", "exact"]
)
def test_where_nothing_varies_a_mark_at_an_edge_is_told_from_noise(
    press: Press, page: Page, residual_variance: ResidualVariance
) -> None:
    """Three raster pixels beside the steepest edge: what a print's own scatter hides, noise alone does not.

    Seed 2: measured 3.9 without the mark and 11.2 with it; in 10^4 boxes noise passes 6 once in 10^5 prints.
    """
    expected = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    known = prepare_page(page, expected, sensors=press.sensors, geometry=press.geometry)
    black = page.cmyk[..., 3].astype(int)
    steep = np.abs(np.diff(black, axis=1))[8:-8, 8:-8]
    row, column = np.unravel_index(steep.argmax(), steep.shape)
    cmyk = page.cmyk.copy()
    cmyk[row + 8 : row + 11, column + 8 : column + 11, 3] = 128
    most = []
    for printed in (page, replace(page, cmyk=cmyk)):
        seen = predict(printed, sensors=press.sensors, geometry=press.geometry, threads=1)
        scan = ideal_scan(seen, press, np.random.default_rng(2))
        analysis = analyse(known, scan, residual_variance=residual_variance)
        statistics = all_statistics(
            analysis.sums, analysis.marks, analysis.fit, analysis.registration, Scatter.white()
        )
        most.append(max(one.value for one in statistics if one.statistic.label == "box"))
    good, bad = most
    assert good < 6
    assert (bad > 8) == residual_variance.exact


def test_what_an_exact_press_looks_at_is_found_and_not_taken_out(press: Press, page: Page) -> None:
    """A print 5 % too dark is named by the fit and stays in the residuals."""
    expected = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    known = prepare_page(page, expected, sensors=press.sensors, geometry=press.geometry)
    darker = replace(page, cmyk=(page.cmyk * 0.95).astype(np.uint8))
    scan = ideal_scan(
        predict(darker, sensors=press.sensors, geometry=press.geometry, threads=1),
        press,
        np.random.default_rng(2),
    )
    exact, varying = (
        analyse(known, scan, residual_variance=residual_variance)
        for residual_variance in (ResidualVariance.none(), ResidualVariance())
    )
    assert np.abs(exact.fit.gain[:, 0]).max() > 0.01
    push, power = (np.abs(exact.sums.tiles[part, 0].sum(dtype=float)) for part in (0, 1))
    taken = np.abs(varying.sums.tiles[0, 0].sum(dtype=float)) / varying.sums.tiles[1, 0].sum(dtype=float)
    assert push / power > 3 * taken


def test_kinds_are_told_apart(trained: DetectorModel) -> None:
    values = np.ones((3, len(NAMES)), np.float32)
    values[np.arange(3), np.arange(3)] = 9
    assert trained.kinds_of(values, np.zeros((3, 3))) == list(KINDS[:3])
    alike = replace(trained, name_forests=trained.name_forests[:1] * 3)
    assert alike.kinds_of(values, np.zeros((3, 3))) == list(KINDS[:3])  # by what tells them from good pages


def test_more_evidence_scores_higher(trained: DetectorModel) -> None:
    values = np.ones((2, len(NAMES)), np.float32)
    values[1, 0] = 9
    good, bad = trained.score(values, np.zeros((2, 3)))
    assert bad > good + 2


def test_kinds_and_scores_come_back_from_arrays_and_facts(trained: DetectorModel) -> None:
    again = DetectorModel.from_parts(trained.arrays(), trained.facts())
    rng = np.random.default_rng(3)
    values, page_features = rng.exponential(2, (50, len(NAMES))), rng.standard_normal((50, 3))
    assert np.array_equal(again.score(values, page_features), trained.score(values, page_features))
    assert again.kinds_of(values, page_features) == trained.kinds_of(values, page_features)


def test_what_misprints_taught_is_checked_whole() -> None:
    found = learned(PAGE_FEATURES)
    arrays, facts = found.arrays(), found.facts() | {"threshold": None}
    DetectorModel.check(arrays, facts)
    for name in arrays:
        with pytest.raises(Misfit, match=name):
            DetectorModel.check({one: array for one, array in arrays.items() if one != name}, facts)
    without_last = facts["kinds"][:-1]
    for change in (
        {"kinds": without_last},
        {"kinds": [*without_last, without_last[0]]},
        {"ranked": False},
        {"starts": [None, None]},  # of presses of before
        {"names": NAMES[::-1]},
        {"spread": {"edge": np.nan}},
        {"prior": {"gain": 0.0}},
        {"tail_from": 1.0},
    ):
        with pytest.raises(Misfit):
            DetectorModel.check(arrays, facts | change)


def test_families_join_sizes_and_keep_signs_apart() -> None:
    keys = "flat/void+/4", "flat/void+/8", "flat/void-/4", "swap/CM", "swap/CK"
    assert [Statistic.parse(key).cause for key in keys] == [
        "flat/void+", "flat/void+", "flat/void-", "swap", "swap",
    ]  # fmt: skip


# --- evidence of families, by hand ---


def by_hand() -> DetectorModel:
    """Two numbers in a portrait; two families: boxes of two sizes, and the white that the fit states in deviations."""
    rng = np.random.default_rng(1)
    pages = Pages(
        values=rng.exponential(size=(60, 3)).astype(np.float32),
        page_features=rng.standard_normal((60, 2)),
        design=np.arange(60),
        kind=np.zeros(60, "U1"),
        press=np.zeros(60, np.int64),
    )
    names = ["box/add-C+/4", "box/add-C+/8", "fit/white"]
    learned_ = learn_model(pages, names=names, scatter=Scatter.white(), rng=rng, ranked=False)
    return replace(
        learned_,
        centre=np.array([[1.0, 0.0], [2.0, 1.0]]),
        baseline=np.array([[0.5, 0.5, 0], [0.1, 0.2, 0], [0.0, 0.3, 0]]),
        sd=np.array([0.25, 0.5, 1.0]),
        quantiles=np.array([[0.0, 1.0, 2.0]] * 2),
        tail=np.array([[2.0, 3.0, 0.5]] * 2),
        tail_from=0.9,
    )


def test_a_statistic_is_compared_with_what_pages_of_such_content_give() -> None:
    values = np.array([[2.0, -2.0, 7.0]])
    found = by_hand().deviations(
        values, np.array([[5.0, -9.0]])
    )  # two deviations up; nine down, of which three count
    expected = [0.5 + 0.2, 0.5 + 0.4 - 0.9]
    statistics = [np.log(7), -np.log(7)]
    assert found == pytest.approx(
        np.array([[(statistics[0] - expected[0]) / 0.25, (statistics[1] - expected[1]) / 0.5, 7.0]])
    )


def test_what_this_press_does_anyway_is_taken_off_in_deviations() -> None:
    """Of what the fit states in deviations as well."""
    values, page_features = np.array([[2.0, -2.0, 7.0]]), np.array([[5.0, -9.0]])
    plain = by_hand()
    own = replace(plain, shift=np.array([1.0, -2.0, 3.0]), scale=np.array([1.0, 2.0, 4.0]))
    was = plain.deviations(values, page_features)
    assert own.deviations(values, page_features) == pytest.approx((was - [[1, -2, 3]]) / [[1, 2, 4]])


def test_a_score_is_all_misprints_odds_those_of_the_likeliest_kind_and_a_family_far_out(
    trained: DetectorModel,
) -> None:
    rng = np.random.default_rng(3)
    values, page_features = rng.exponential(2, (50, len(NAMES))), rng.standard_normal((50, 3))
    deviations = trained.deviations(values, page_features)
    evidence = trained.family_evidence(deviations)
    every = every_column(evidence, page_features, deviations)
    assert trained.forest is not None
    of_kinds = np.array([forest.score(every) for forest in trained.kind_forests])
    alone = strongest_alone(evidence, marks_of(trained.families))
    by_forests = trained.forest.score(every) + of_kinds.max(axis=0)
    by_forests += ADDED_SLOPE * np.maximum(alone - ADDED_FROM, 0)
    alone = ALONE_SLOPE * (alone - ALONE_FROM)
    asked = np.maximum(by_forests, alone)
    assert trained.score(values, page_features) == pytest.approx(asked)
    untaught = replace(trained, forest=None, kinds=(), kind_forests=(), name_forests=())
    assert untaught.score(values, page_features) == pytest.approx(
        untaught.guard(untaught.family_evidence(deviations))
    )


@pytest.mark.parametrize(
    ("deviation", "p"),
    [(-1.0, 1.0), (0.5, 1 - 0.225), (2.0, 0.1), (2 + 18 * 3, 0.1 * 10**-2), (2 + 6e12, 0.1 * 1e-24)],
)
def test_evidence_is_the_greatest_deviations_p_value(deviation: float, p: float) -> None:
    """By quantiles up to the nine tenths, then by a generalised Pareto distribution: (1 + 0.5 x / 3)^-2."""
    found = by_hand().family_evidence(np.array([[deviation, -5.0, deviation]]))
    assert found == pytest.approx(np.full((1, 2), -np.log10(p)))


def test_an_excess_is_counted_from_what_99_of_100_good_pages_show() -> None:
    """A hundredth is 0.1 (1 + 0.5 x / 3)^-2 at x = 6 (sqrt(10) - 1), beyond the two deviations of nine tenths."""
    level, features = 2 + 6 * (np.sqrt(10) - 1), np.array([5.0, -9.0])
    white = Observed(statistic=Statistic.parse("fit/white"), value=7.0)
    assert by_hand().above_good(white, features) == pytest.approx(7.0 - level)
    box = Observed(statistic=Statistic.parse("box/add-C+/4"), value=2.0)
    assert by_hand().above_good(box, features) == pytest.approx((np.log(7) - 0.7) / 0.25 - level)
    assert by_hand().above_good(replace(box, statistic=Statistic.parse("box/void+/4")), features) is None


def test_the_score_that_no_misprint_taught_counts_the_kth_family_by_its_kth_part() -> None:
    evidence = np.array([[1.0, 12.0, 3.0, 0.0, 2.0, 0.5, 0.5, 0.5, 0.5, 0.5]])
    first_eight = 12 + 3 / 2 + 2 / 3 + 1 / 4 + 0.5 * (1 / 5 + 1 / 6 + 1 / 7 + 1 / 8)
    assert by_hand().guard(evidence) == pytest.approx([first_eight])
    assert by_hand().guard(evidence[:, :2]) == pytest.approx([12.5])
