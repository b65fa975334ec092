"""Our detector with its promise: which good pages decide, and what an artefact keeps of it."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.training.learn import Pages, learn_model
from prooflight.detectors.matched_filter.calibrated import (
    ENOUGH_REAL,
    WRONG_PAGE,
    CalibratedDetector,
    score_of,
)
from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.model import DetectorModel

NAMES = ["box/add-C+/8", "fit/white"]


@pytest.fixture(scope="module")
def model() -> DetectorModel:
    rng = np.random.default_rng(1)
    pages = Pages(
        values=rng.exponential(size=(60, 2)).astype(np.float32),
        page_features=rng.standard_normal((60, 3)),
        design=np.arange(60),
        kind=np.zeros(60, "U1"),
    )
    return learn_model(pages, names=NAMES, scatter=Scatter.white(), rng=rng, ranked=False)


def calibrated(
    model: DetectorModel, *, real: np.ndarray | None = None, rate: float = 0.02
) -> CalibratedDetector:
    simulated = np.random.default_rng(2).exponential(size=150)
    return CalibratedDetector.calibrated(
        model, simulated=simulated, real=real, false_alarm_rate=rate, misprint_rate=0.01
    )


def test_simulated_pages_promise_until_there_are_real_ones(model: DetectorModel) -> None:
    first = calibrated(model)
    assert (first.promise.simulated, first.promise.real, first.promise.conformal) == (150, 0, True)
    real = np.random.default_rng(3).exponential(2.0, ENOUGH_REAL)  # this press scatters twice as much
    later = calibrated(model, real=real)
    assert (later.promise.simulated, later.promise.real, later.promise.conformal) == (0, ENOUGH_REAL, True)
    assert later.threshold == np.sort(real)[98]  # ceil(101 x 0.98) = 99th smallest
    assert later.threshold > first.threshold


def test_a_few_real_pages_raise_the_threshold_and_promise_nothing_by_themselves(
    model: DetectorModel,
) -> None:
    first = calibrated(model)
    rng = np.random.default_rng(4)
    worse, better = (calibrated(model, real=rng.exponential(scale, 30)) for scale in (3.0, 0.3))
    assert worse.threshold > 1.5 * first.threshold
    assert not worse.promise.conformal
    assert (worse.promise.simulated, worse.promise.real) == (150, 30)
    # real pages that score less lower nothing but by their number
    assert better.threshold >= 0.9 * first.threshold


def test_a_decision_alarms_above_the_threshold_alone(model: DetectorModel) -> None:
    ours = calibrated(model)
    low, high = ours.decide(ours.threshold), ours.decide(ours.threshold + 1)
    assert not low.misprint
    assert high.misprint
    assert high.p_value is not None
    assert low.p_value is not None
    assert high.p_value < low.p_value <= ours.promise.rate
    assert high.probability > low.probability >= 0.01


def test_what_cannot_be_promised_is_refused_down_to_what_can(model: DetectorModel) -> None:
    ours = calibrated(model, rate=1e-6)
    assert ours.promise.rate == pytest.approx(1 / 1510)
    assert not ours.promise.conformal
    assert "refused" in str(ours.promise)


def test_it_comes_back_from_its_arrays_and_facts(model: DetectorModel) -> None:
    for real in (None, np.arange(30.0)):
        ours = calibrated(model, real=real, rate=1e-4)
        facts = json.loads(json.dumps(ours.facts(), allow_nan=False))
        again = CalibratedDetector.from_parts(ours.arrays(), facts)
        assert again.threshold == ours.threshold
        assert again.promise == ours.promise
        assert again.decide(2.0) == ours.decide(2.0)
    assert replace(ours, misprint_rate=0.5).decide(2.0).probability > ours.decide(2.0).probability


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_statistic_that_is_not_finite_is_no_good_page(model: DetectorModel, value: float) -> None:
    detector, page_features = calibrated(model), np.zeros(3)
    for another in (False, True):
        fine = score_of(model, np.ones(2), page_features, another=another)
        assert detector.decide(fine).word == ("misprint" if another else "good")
        for values, page in ((np.array([1, value]), page_features), (np.ones(2), np.array([0, value, 0]))):
            score = score_of(model, values, page, another=another)
            assert detector.decide(score).word == "not-inspected"


def test_what_the_press_learned_wrong_is_not_lost_among_families(model: DetectorModel) -> None:
    tail = model.tail.copy()
    tail[0, 1] = np.nan
    score = replace(model, tail=tail).score(np.full((1, 2), 50.0), np.zeros((1, 3)))
    assert np.isnan(score).all()


GRID = np.linspace(0, 1, 101)


def mixed(model: DetectorModel, *, real: np.ndarray, rate: float) -> CalibratedDetector:
    return CalibratedDetector.calibrated(
        model, simulated=GRID, real=real, false_alarm_rate=rate, misprint_rate=0.01
    )


def test_simulated_pages_scatter_as_a_few_real_ones_do(model: DetectorModel) -> None:
    """Real pages of the same law, stretched three times from 5 on: the upper fifth lies where theirs does."""
    ours = mixed(model, real=5 + 3 * GRID[::5], rate=4 / 123)
    assert (ours.promise.real, ours.promise.simulated, ours.promise.conformal) == (21, 101, False)
    assert ours.threshold == pytest.approx(5 + 3 * 0.98)  # the fourth of 122; two stand at the top
    begin, of_real = 0.8, 5 + 3 * 0.8
    lower = GRID + of_real - begin  # those below it are raised as it is, and not stretched
    at = 6.995
    count = (lower >= at).sum() + (5 + 3 * GRID[::5] >= at).sum()
    assert ours.decide(at).p_value == pytest.approx((1 + count) / 123)


def test_simulated_pages_are_never_lowered_by_real_ones(model: DetectorModel) -> None:
    ours = mixed(model, real=0.3 * GRID[::5], rate=4 / 123)
    assert ours.threshold == pytest.approx(0.97)  # the fourth of them, as before


def test_real_pages_decide_alone_from_where_their_number_allows(model: DetectorModel) -> None:
    real = np.arange(30.0)
    for rate, alone in ((1 / 31, True), (0.99 / 31, False)):
        ours = mixed(model, real=real, rate=rate)
        assert (ours.promise.simulated == 0) == ours.promise.conformal == alone
    assert mixed(model, real=real, rate=1 / 31).threshold == 29
    many = np.arange(float(ENOUGH_REAL))
    for real, alone in ((many, True), (many[1:], False)):
        ours = mixed(model, real=real, rate=1e-3)
        assert (ours.promise.simulated == 0) == alone
        assert not ours.promise.conformal


def test_a_scan_of_another_page_scores_what_no_good_page_does(model: DetectorModel) -> None:
    values, page_features = np.ones(2), np.zeros(3)
    plain = score_of(model, values, page_features, another=False)
    assert plain < WRONG_PAGE
    assert score_of(model, values, page_features, another=True) == WRONG_PAGE
    low = replace(model, tail=model.tail * [1, 1e-9, 1])
    far = score_of(low, 50 * values, page_features, another=False)
    assert score_of(low, 50 * values, page_features, another=True) == max(far, WRONG_PAGE)
