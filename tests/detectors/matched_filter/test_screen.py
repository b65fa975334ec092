"""The screen: the statistics that every page is analysed for, which alone decide; seeds stated."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prooflight.commissioning.training.adapting import adapted
from prooflight.commissioning.training.learn import Pages, learn_model
from prooflight.detectors.matched_filter.analysis import analyse
from prooflight.detectors.matched_filter.calibrated import score_of
from prooflight.detectors.matched_filter.design import prepare_page
from prooflight.detectors.matched_filter.exchangeability import SCORE, groups_of, summaries
from prooflight.detectors.matched_filter.model import DetectorModel
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


def drawn(designs: int, seed: int, *, wrong: bool = False) -> Pages:
    """Good pages, and of every other design a misprint where ``wrong``: of one the screen's statistics tell, of the
    other those beside it alone.
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
    rng = np.random.default_rng(2)
    pages = drawn(800, 1, wrong=True)
    return learn_model(pages, names=NAMES, scatter=Scatter.white(), rng=rng, trees=60, screened=True)


# --- the score ---


def test_the_screens_statistics_alone_decide(taught: DetectorModel) -> None:
    """Of 100 misprints of each kind it sees nearly all of one, and of the other what good pages do."""
    pages, good = drawn(400, 4, wrong=True), drawn(400, 5)
    threshold = np.quantile(taught.score(good.values, good.page_features), 0.95)
    alarms = taught.score(pages.values, pages.page_features) > threshold
    assert alarms[pages.kind == "spot"].mean() > 0.95
    assert alarms[pages.kind == "smear"].mean() < 0.2
    assert taught.forest is None
    named = taught.kinds_of(pages.values, pages.page_features)
    right = np.array(named)[pages.bad] == pages.kind[pages.bad]
    assert right.mean() > 0.9  # all statistics name what is wrong


def test_no_other_statistics_need_be_known(taught: DetectorModel) -> None:
    pages = drawn(200, 5, wrong=True)
    expected = taught.score(pages.values, pages.page_features)
    few = pages.values.copy()
    few[:, np.setdiff1d(np.arange(len(NAMES)), FIRST)] = np.nan
    np.testing.assert_array_equal(taught.score(few, pages.page_features), expected)
    few[0, FIRST[0]] = np.nan
    found = taught.score(few, pages.page_features)
    assert np.isnan(found).tolist() == [True, *[False] * 199]
    assert np.isnan(score_of(taught, few[0], pages.page_features[0], another=True))


def test_a_press_that_is_made_fit_has_its_screen_made_fit(taught: DetectorModel) -> None:
    """Three deviations further out on all statistics: 400 pages know that to 0.05, and as many alarm as before."""
    good, moved = drawn(400, 3), drawn(400, 6)
    threshold = np.quantile(taught.score(good.values, good.page_features), 0.8)
    values = (np.expm1(np.log1p(3 * moved.values) + 3) / 3).astype(np.float32)
    moved = replace(moved, values=values)
    fit = adapted(taught, moved)

    def share(one: DetectorModel) -> float:
        return float((one.score(moved.values, moved.page_features) > threshold).mean())

    assert share(taught) > 0.9
    # 2 %: standard deviation of a share of 400; four of them.
    assert share(fit) == pytest.approx(0.2, abs=0.08)
    assert share(fit.widened(3.0)) < share(fit)


# --- kept in a file ---


def test_it_comes_back_from_its_file(taught: DetectorModel) -> None:
    pages = drawn(50, 7, wrong=True)
    arrays, facts = taught.arrays(), taught.facts() | {"threshold": None}
    DetectorModel.check(arrays, facts)
    again = DetectorModel.from_parts(arrays, facts)
    np.testing.assert_array_equal(
        again.score(pages.values, pages.page_features), taught.score(pages.values, pages.page_features)
    )
    with pytest.raises(Misfit, match="no screen"):
        DetectorModel.check(arrays, facts | {"screened": False})


@pytest.mark.parametrize(
    ("array", "says"),
    [
        ("first.statistic", "every page is analysed for"),
        ("first.family", "every page is analysed for"),
        ("first.tail", "begin"),
        ("", "missing"),
    ],
)
def test_a_corrupted_screen_is_refused(taught: DetectorModel, array: str, says: str) -> None:
    arrays, facts = taught.arrays(), taught.facts() | {"threshold": None}
    if array:
        arrays[array] = arrays[array].copy()
        arrays[array].flat[0] += 1
    else:
        del arrays["screen.cut"]
    with pytest.raises(Misfit, match=says):
        DetectorModel.check(arrays, facts)


# --- what it looks at ---


def test_pages_of_a_run_are_compared_by_what_all_of_them_are_looked_at_for(taught: DetectorModel) -> None:
    pages = drawn(3, 8)
    assert groups_of(taught) == (SCORE, "box", "apart", "streak", "place", "energy")
    assert "ghost" in groups_of(replace(taught, screen=None))
    deviations = taught.deviations(pages.values, pages.page_features)
    deviations[:, 2] = np.nan
    found = summaries(taught, deviations, np.zeros(3))
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
    assert np.isfinite(taught.vector_of(few)).tolist() == [index in FIRST for index in range(len(NAMES))]
    with pytest.raises(ValueError, match="not the statistics that"):
        taught.vector_of(few[1:])


def test_families_that_say_the_same_keep_their_order_on_every_processor(taught: DetectorModel) -> None:
    """Families with the same null distribution that deviate alike; sorting in vectors exchanges these."""
    plain = np.zeros_like(taught.baseline), np.ones_like(taught.sd), np.zeros_like(taught.shift)
    model = replace(taught, baseline=plain[0], sd=plain[1], shift=plain[2], scale=plain[1])
    model = replace(
        model,
        quantiles=np.repeat(taught.quantiles[:1], len(taught.families), axis=0),
        tail=np.repeat(taught.tail[:1], len(taught.families), axis=0),
    )
    features = np.zeros(15)
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
    whole, first = analyse(known, scan), analyse(known, scan, analysed_modes=SCREEN_MODES)
    every = all_statistics(whole.sums, whole.marks, whole.fit, whole.registration, scatter)
    asked = [one for one in every if in_screen(one.statistic)]
    found = screen_statistics(first.sums, first.marks, first.fit, first.registration, scatter)
    assert keys_of(found) == keys_of(asked)
    np.testing.assert_array_equal(values_of(found), values_of(asked))
    again = first.of_every_mode()
    assert again.of_every_mode() is again
    np.testing.assert_array_equal(
        values_of(all_statistics(again.sums, again.marks, again.fit, again.registration, scatter)),
        values_of(every),
    )
    order = [one.statistic for one in every]
    for threads in (1, 2):
        shared = analyse(known, scan, analysed_modes=SCREEN_MODES, threads=threads)
        seen = screen_statistics(
            shared.sums, shared.marks, shared.fit, shared.registration, scatter, threads=threads
        )
        rest = remaining_statistics(shared.of_every_mode().sums, scatter, seen, order=order, threads=threads)
        assert keys_of(rest) == keys_of(every)
        np.testing.assert_allclose(values_of(rest), values_of(every), rtol=1e-5, atol=1e-5)
    with pytest.raises(ValueError, match="not the requested statistics"):
        remaining_statistics(again.sums, scatter, found[1:], order=order)


def test_the_shipped_ranking_decides_by_what_costs_little() -> None:
    model = shipped_ranking().model
    assert model.screen is not None
    assert len(model.screen.statistic) < len(model.statistics) / 4 + 48
    assert model.forest is None


def test_a_single_mark_on_paper_alarms_whatever_forests_say() -> None:
    """The shipped ranking, a page in the middle of good ones, and a T of 100 on bare paper."""
    model = shipped_ranking().model
    assert model.screen is not None
    features = model.centre[:1]
    x = np.column_stack([np.ones(1), np.zeros((1, features.shape[1]))])
    middle = (x @ model.baseline)[0]
    values = np.sign(middle) * np.expm1(np.abs(middle)) / 3
    quiet = model.score(values[None].astype(np.float32), features)[0]
    marked = values.copy()
    marked[[one.key for one in model.statistics].index("mark/bare-/4")] = 100.0
    found = model.score(marked[None].astype(np.float32), features)[0]
    at_one_percent = np.quantile(shipped_ranking().references.worst[-1], 0.99)
    assert quiet < 0 < at_one_percent + 3 < found
