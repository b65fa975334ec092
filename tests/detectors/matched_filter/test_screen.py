"""Two looks at a page: the first lets most good pages pass, and an alarm needs both; seeds stated."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prooflight.commissioning.training.adapting import PASSED_ON, adapted, sparing
from prooflight.commissioning.training.learn import Pages, learn_model
from prooflight.detectors.matched_filter.analysis import analyse, prepare_page
from prooflight.detectors.matched_filter.calibrated import score_of
from prooflight.detectors.matched_filter.exchangeability import SCORE, groups_of, summaries
from prooflight.detectors.matched_filter.model import DetectorModel
from prooflight.detectors.matched_filter.ranking import LEAST_CHANCE
from prooflight.detectors.matched_filter.screen import NOT_PASSED_ON, of_both
from prooflight.detectors.matched_filter.shipped import shipped_ranking
from prooflight.detectors.matched_filter.statistics.families import (
    all_statistics,
    remaining_statistics,
    screen_statistics,
)
from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
from prooflight.detectors.matched_filter.statistics.statistic import (
    SCREEN_MODES,
    Observed,
    Statistic,
    in_screen,
    keys_of,
    values_of,
)
from prooflight.files.schema import Misfit
from prooflight.prediction.predict import predict
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

NAMES = [
    "box/light+/4",
    "apart/void-/4",
    "box/add-C+/4",
    "box/add-K+/8",
    "streak/void/1/full",
    "ghost/C/0",
    "place/skew",
    "energy/page",
]
FIRST = [0, 1, 4, 6, 7]
KINDS = "spot", "smear"
LEAST_SCORE = 2 * np.log(LEAST_CHANCE / (1 + LEAST_CHANCE))


def drawn(designs: int, seed: int, *, wrong: bool = False) -> Pages:
    """Good pages, and of every other design a misprint where ``wrong``: one that both looks see, one the second
    alone.
    """
    rng = np.random.default_rng(seed)
    design = np.arange(designs)
    kind = np.where(wrong & (design % 2 == 1), np.array(KINDS)[design // 2 % 2], "")
    compressed = rng.normal(10, 1, (designs, len(NAMES)))
    compressed[kind == "spot", :4] += 4
    compressed[kind == "smear", 5] += 5
    return Pages(
        values=(np.expm1(compressed) / 3).astype(np.float32),
        page_features=rng.standard_normal((designs, 15)),
        design=design,
        kind=kind,
        press=np.zeros(designs, np.int64),
    )


@pytest.fixture(scope="module")
def taught() -> DetectorModel:
    """Every page is passed on yet."""
    rng = np.random.default_rng(2)
    pages = drawn(800, 1, wrong=True)
    return learn_model(pages, names=NAMES, scatter=Scatter.white(), rng=rng, trees=60, looks_first=True)


def passing(model: DetectorModel, share: float) -> DetectorModel:
    """The model that passes on such a share of 500 other good pages."""
    assert model.screen is not None
    good = drawn(500, 3)
    least = float(np.quantile(model.first_look(good.values, good.page_features), 1 - share))
    return replace(model, screen=replace(model.screen, least=least, least_taught=least))


# --- the score of both looks ---


@pytest.mark.parametrize("shipped", [0.3, 0.01])
def test_a_press_passes_few_of_its_own_good_pages_on_and_no_more_than_the_ranking_says(
    taught: DetectorModel, shipped: float
) -> None:
    """Of 200 own pages 10; of what others it passes on scores are the same, and of all the rest no higher."""
    model, own = passing(taught, shipped), drawn(200, 6)
    spared = sparing(model, own)
    assert spared.screen is not None
    assert model.screen is not None
    first = spared.first_look(own.values, own.page_features)
    before = (first > model.screen.least).sum()
    assert (first > spared.screen.least).sum() == min(before, round(200 * PASSED_ON))
    other = drawn(300, 7, wrong=True)
    at_first, score = (one.score(other.values, other.page_features) for one in (model, spared))
    passed = spared.first_look(other.values, other.page_features) > spared.screen.least
    np.testing.assert_array_equal(score[passed], at_first[passed])
    assert (score <= at_first).all()
    again = spared.screen.as_taught()
    assert (again.least, again.least_taught) == (model.screen.least, model.screen.least)
    everything = replace(model, screen=None)
    assert sparing(everything, own) is everything


@given(
    st.lists(st.tuples(st.floats(-9, 60), st.floats(LEAST_SCORE, 60)), min_size=1, max_size=20),
    st.floats(-9, 20),
)
def test_what_is_not_passed_on_lies_below_all_that_is_and_in_order(
    scores: list[tuple[float, float]], least: float
) -> None:
    first, second = np.array(scores).T
    found, passed = of_both(first, second, least), first > least
    np.testing.assert_array_equal(found[passed], second[passed])
    assert (found[~passed] <= NOT_PASSED_ON).all()
    assert LEAST_SCORE > NOT_PASSED_ON
    order = np.argsort(first[~passed])
    assert (np.diff(found[~passed][order]) >= 0).all()


def test_an_alarm_needs_both_looks(taught: DetectorModel) -> None:
    pages = drawn(400, 4, wrong=True)
    whole = replace(taught, screen=None).score(pages.values, pages.page_features)
    alarms, passed = {}, {}
    for share in (1.0, 0.3, 0.1):
        model = passing(taught, share)
        score = model.score(pages.values, pages.page_features)
        passed[share] = model.first_look(pages.values, pages.page_features) > model.screen.least  # type: ignore[union-attr]
        np.testing.assert_array_equal(score > 0, (whole > 0) & passed[share])
        alarms[share] = score > 0
    assert passed[0.1].sum() < passed[0.3].sum() < passed[1.0].sum()
    assert (alarms[0.1] <= alarms[0.3]).all()
    # 100 misprints of each kind: the first look is blind to the second kind, and passes on about a tenth of it.
    assert alarms[0.1][pages.kind == "spot"].mean() > 0.95
    assert alarms[0.1][pages.kind == "smear"].mean() < 0.3
    assert (whole[pages.kind == "smear"] > 0).mean() > 0.9


def test_only_what_is_passed_on_must_be_known_whole(taught: DetectorModel) -> None:
    model, pages = passing(taught, 0.2), drawn(200, 5, wrong=True)
    passed = model.first_look(pages.values, pages.page_features) > model.screen.least  # type: ignore[union-attr]
    asked = model.score(pages.values, pages.page_features)
    few = pages.values.copy()
    few[:, np.setdiff1d(np.arange(len(NAMES)), FIRST)] = np.nan
    found = model.score(few, pages.page_features)
    assert 0 < passed.sum() < len(passed)
    np.testing.assert_array_equal(found[~passed], asked[~passed])
    assert np.isnan(found[passed]).all()
    few[:, FIRST[0]] = np.nan
    assert np.isnan(model.score(few, pages.page_features)).all()
    assert np.isnan(score_of(model, few[0], pages.page_features[0], another=True))


def test_a_press_that_is_made_fit_has_its_first_look_made_fit(taught: DetectorModel) -> None:
    """Three deviations further out on all statistics: 400 pages know that to 0.05, and as many are passed on."""
    model, moved = passing(taught, 0.2), drawn(400, 6)
    values = (np.expm1(np.log1p(3 * moved.values) + 3) / 3).astype(np.float32)
    moved = replace(moved, values=values)
    fit = adapted(model, moved)

    def share(one: DetectorModel) -> float:
        assert one.screen is not None
        return float((one.first_look(moved.values, moved.page_features) > one.screen.least).mean())

    assert share(model) > 0.9
    assert share(fit) == pytest.approx(
        0.2, abs=0.08
    )  # 2 %: standard deviation of a share of 400; four of them
    assert share(fit.widened(3.0)) < share(fit)


# --- kept in a file ---


def test_it_comes_back_from_its_file(taught: DetectorModel) -> None:
    model, pages = passing(taught, 0.2), drawn(50, 7, wrong=True)
    arrays, facts = model.arrays(), model.facts() | {"threshold": None}
    DetectorModel.check(arrays, facts)
    again = DetectorModel.from_parts(arrays, facts)
    np.testing.assert_array_equal(
        again.score(pages.values, pages.page_features), model.score(pages.values, pages.page_features)
    )
    spared = sparing(model, drawn(200, 6))
    told = spared.facts() | {"threshold": None}
    kept = DetectorModel.from_parts(spared.arrays(), told).screen
    assert kept is not None
    assert spared.screen is not None
    assert (kept.least, kept.least_taught) == (spared.screen.least, spared.screen.least_taught)
    with pytest.raises(Misfit, match="no more than"):
        DetectorModel.check(spared.arrays(), told | {"taught_passed_on_above": kept.least + 1})
    older = {name: fact for name, fact in told.items() if name != "taught_passed_on_above"}
    before = DetectorModel.from_parts(spared.arrays(), older).screen
    assert before is not None
    assert before.least_taught == kept.least
    without = {name: array for name, array in arrays.items() if not name.startswith(("first.", "screen"))}
    DetectorModel.check(without, facts | {"passed_on_above": None})
    assert DetectorModel.from_parts(without, facts | {"passed_on_above": None}).screen is None


@pytest.mark.parametrize(
    ("array", "says"),
    [
        ("first.statistic", "first look"),
        ("first.family", "first look"),
        ("first.tail", "begin"),
        ("", "missing"),
    ],
)
def test_a_spoilt_first_look_is_refused(taught: DetectorModel, array: str, says: str) -> None:
    model = passing(taught, 0.2)
    arrays, facts = model.arrays(), model.facts() | {"threshold": None}
    if array:
        arrays[array] = arrays[array].copy()
        arrays[array].flat[0] += 1
    else:
        del arrays["screen.cut"]
    with pytest.raises(Misfit, match=says):
        DetectorModel.check(arrays, facts)


# --- what it looks at ---


def test_pages_of_a_run_are_compared_by_what_all_of_them_are_looked_at_for(taught: DetectorModel) -> None:
    model, pages = passing(taught, 0.2), drawn(3, 8)
    assert groups_of(taught) == (SCORE, "box", "apart", "streak", "place", "energy")
    assert "ghost" in groups_of(replace(taught, screen=None))
    deviations = model.deviations(pages.values, pages.page_features)
    deviations[:, 2] = np.nan
    found = summaries(model, deviations, np.zeros(3))
    assert found.shape == (3, 6)
    np.testing.assert_array_equal(found[:, 1], deviations[:, 0])  # box/light alone


def test_the_families_that_say_most_are_of_the_look_that_was_taken(taught: DetectorModel) -> None:
    statistics = [Observed(statistic=Statistic.parse(name), value=300.0) for name in NAMES]
    statistics[5] = replace(statistics[5], value=1e9)
    statistics[1] = replace(statistics[1], value=1e6)
    features = np.zeros(15)
    assert taught.strongest(statistics, features, most=1)[0][0] == "ghost"
    few = [statistics[index] for index in FIRST]
    found = taught.strongest(few, features, most=2)
    assert found[0] == ("apart/void-", statistics[1])
    assert {one.statistic for _, one in found} <= {one.statistic for one in few}
    assert np.isfinite(taught.laid_out(few)).tolist() == [index in FIRST for index in range(len(NAMES))]
    with pytest.raises(ValueError, match="not the statistics"):
        taught.laid_out(few[1:])


def test_families_that_say_the_same_keep_their_order_on_every_processor(taught: DetectorModel) -> None:
    """As many as reach the least p-value of all; sorting in vectors exchanges these."""
    model, features = replace(taught, tail=taught.tail * [1, 1, 0.01]), np.zeros(15)
    for few in range(1, 2 ** len(NAMES)):
        tied = [few >> at & 1 for at in range(len(NAMES))]
        statistics = [
            Observed(statistic=Statistic.parse(name), value=1e12 if one else 300.0)
            for name, one in zip(NAMES, tied, strict=True)
        ]
        found = [family for family, _ in model.strongest(statistics, features, most=sum(tied))]
        says = [Statistic.parse(name).cause for name, one in zip(NAMES, tied, strict=True) if one]
        assert found == [family for family in model.families if family in says]


@settings(deadline=None, max_examples=2)
@given(st.integers(0, 2**31))
def test_the_first_look_is_at_some_of_all_statistics_and_sees_them_alike(
    two_sensor_press: Press, page: Page, seed: int
) -> None:
    press = two_sensor_press
    expected = predict(page, sensors=press.sensors, geometry=press.geometry)
    known = prepare_page(page, expected, sensors=press.sensors, geometry=press.geometry)
    scan, scatter = ideal_scan(expected, press, np.random.default_rng(seed)), Scatter.white()
    whole, first = analyse(known, scan), analyse(known, scan, looked_at=SCREEN_MODES)
    every = all_statistics(whole.sums, whole.marks, whole.fit, whole.found, scatter)
    asked = [one for one in every if in_screen(one.statistic)]
    found = screen_statistics(first.sums, first.marks, first.fit, first.found, scatter)
    assert keys_of(found) == keys_of(asked)
    np.testing.assert_array_equal(values_of(found), values_of(asked))
    again = first.of_every_mode()
    assert again.of_every_mode() is again
    np.testing.assert_array_equal(
        values_of(all_statistics(again.sums, again.marks, again.fit, again.found, scatter)), values_of(every)
    )
    order = [one.statistic for one in every]
    for threads in (1, 2):
        shared = analyse(known, scan, looked_at=SCREEN_MODES, threads=threads)
        seen = screen_statistics(
            shared.sums, shared.marks, shared.fit, shared.found, scatter, threads=threads
        )
        rest = remaining_statistics(shared.of_every_mode().sums, scatter, seen, order=order, threads=threads)
        assert keys_of(rest) == keys_of(every)
        np.testing.assert_allclose(values_of(rest), values_of(every), rtol=1e-5, atol=1e-5)
    with pytest.raises(ValueError, match="not the statistics"):
        remaining_statistics(again.sums, scatter, found[1:], order=order)


def test_the_ranking_that_is_shipped_looks_first_at_what_costs_little() -> None:
    model = shipped_ranking().model
    assert model.screen is not None
    assert len(model.screen.statistic) < len(model.statistics) / 4
    assert model.screen.least > LEAST_SCORE
