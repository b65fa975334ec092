from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from prooflight.detectors.false_alarm_rate import posterior_bound
from prooflight.detectors.paper.chi_square import ChiSquare, pearson, tile_statistics
from prooflight.detectors.paper.evidence import INTERVALS, Evidence, interval_shares

FLAT_TILE = 256


def evidence(tiles: np.ndarray) -> Evidence:
    """Of (sensors, tile rows, tile columns, intervals) counts."""
    return Evidence(
        tile_histogram=tiles,
        naive_histogram=np.zeros((len(tiles), INTERVALS), np.int64),
        block_z=np.zeros((len(tiles), 2, 2), np.float32),
    )


def flat(sensors: int = 1, rows: int = 4, columns: int = 5, count: int = FLAT_TILE) -> np.ndarray:
    """As expected, to fractions of a pixel; count of them in a mean interval."""
    return np.tile(interval_shares() * INTERVALS * count, (sensors, rows, columns, 1))


MOVED_FROM_4_TO_9 = float((1 / interval_shares()[[4, 9]]).sum()) / INTERVALS
"""Pearson's statistic of one tile, times a mean interval's count, when one pixel is moved between these two."""


def off_by(moved: int, count: int = 10_000) -> Evidence:
    """One tile of which two intervals are off: Pearson's statistic is about 2 moved^2 / count."""
    tiles = flat(1, 1, 1, count)
    tiles[..., 4] += moved
    tiles[..., 9] -= moved
    return evidence(tiles)


QUARTERS = np.full(4, 0.25)
COUNTS = np.array([[12, 8, 10, 10], [25, 15, 20, 20]])


def test_pearson_in_closed_form() -> None:
    # (4 + 4) / 10 and (25 + 25) / 20
    np.testing.assert_allclose(pearson(COUNTS, QUARTERS), [0.8, 2.5])
    assert pearson(np.full(32, 7), np.full(32, 1 / 32)) == 0


def test_against_scipy() -> None:
    counts = np.random.default_rng(1).integers(50, 200, 32)
    shares = np.random.default_rng(2).dirichlet(np.full(32, 9.0))
    want = stats.chisquare(counts, shares * counts.sum()).statistic
    assert pearson(counts, shares) == pytest.approx(want, rel=1e-12)


@given(st.lists(st.integers(0, 500), min_size=4, max_size=4).filter(any), st.integers(2, 9))
def test_pearson_grows_with_the_number_of_pixels_and_ignores_the_order(counts: list[int], times: int) -> None:
    one = pearson(np.array(counts), QUARTERS)
    assert one >= 0
    assert pearson(np.array(counts) * times, QUARTERS) == pytest.approx(one * times, rel=1e-9)
    assert pearson(np.array(counts[::-1]), QUARTERS) == pytest.approx(one, rel=1e-9)


def test_a_billion_pixels_do_not_overflow() -> None:
    counts = np.zeros(32, np.int64)
    counts[3] = 10**9
    assert pearson(counts, np.full(32, 1 / 32)) == pytest.approx(31e9)  # all in one of n intervals: (n - 1) N


def test_a_tiles_statistic_adds_the_sensors_up() -> None:
    tiles = np.random.default_rng(1).integers(90, 160, (2, 3, 4, INTERVALS))
    got = tile_statistics(evidence(tiles))
    assert got.shape == (3, 4)
    expected = tiles[:, 2, 1].sum(axis=-1, keepdims=True) * interval_shares()
    want = sum(stats.chisquare(tiles[s, 2, 1], expected[s]).statistic for s in range(2))
    assert got[2, 1] == pytest.approx(want, rel=1e-12)


@pytest.mark.parametrize("good_pages", [20.0, 1000.0, 1e5, 1e9])
@pytest.mark.parametrize("sensors", [1, 2])
def test_as_in_the_paper_it_alarms_beyond_what_one_good_page_in_so_many_exceeds(
    good_pages: float, sensors: int
) -> None:
    detector = ChiSquare(good_pages_per_false_alarm=good_pages, misprint_rate=0.01, tiles=False)
    threshold = stats.chi2.isf(1 / good_pages, 15 * sensors)
    just_below = int(np.sqrt(threshold * 10_000 / MOVED_FROM_4_TO_9))
    for moved, alarm in ((just_below, False), (just_below + 1, True)):
        tiles = flat(sensors, 1, 1, 10_000)
        tiles[0, ..., 4] += moved
        tiles[0, ..., 9] -= moved
        decision = detector.decide(evidence(tiles))
        statistic = MOVED_FROM_4_TO_9 * moved**2 / 10_000
        assert decision.misprint is alarm
        assert (decision.score > decision.threshold) is alarm
        assert decision.score / decision.threshold == pytest.approx(statistic / threshold, rel=1e-9)
        assert decision.p_value == pytest.approx(stats.chi2.sf(statistic, 15 * sensors), rel=1e-9)
        assert decision.probability == posterior_bound(decision.p_value or 0.0, 0.01)


def test_in_the_papers_form_a_page_is_its_histogram_however_it_is_cut() -> None:
    detector = ChiSquare(good_pages_per_false_alarm=1000, misprint_rate=0.01, tiles=False)
    tiles = np.random.default_rng(1).integers(90, 160, (2, 3, 4, INTERVALS))
    whole = tiles.sum(axis=(1, 2), keepdims=True)
    assert detector.decide(evidence(tiles)) == detector.decide(evidence(whole))


@pytest.mark.parametrize("rows", [1, 30])
def test_page_and_tiles_share_the_allowed_false_alarms(rows: int) -> None:
    good_pages = 1000.0
    detector = ChiSquare(good_pages_per_false_alarm=good_pages, misprint_rate=0.01)
    # one tile off among flat ones: about 2 moved^2 / 256 against the quantile of 1 / (2 good_pages tiles)
    of_tile = stats.chi2.isf(1 / good_pages / 2 / (rows * 5), 15)
    just_below = int(np.sqrt(of_tile * FLAT_TILE / MOVED_FROM_4_TO_9))
    for moved, alarm in ((just_below, False), (just_below + 1, True)):
        tiles = flat(1, rows, 5)
        tiles[0, 0, 3, 4] += moved
        tiles[0, 0, 3, 9] -= moved
        assert detector.decide(evidence(tiles)).misprint is alarm


def test_what_is_nothing_in_a_tile_may_be_much_on_the_page() -> None:
    good_pages, count = 1000.0, 100
    detector = ChiSquare(good_pages_per_false_alarm=good_pages, misprint_rate=0.01)
    # all of 100 tiles off by the same: the page's statistic is 100 times a tile's
    just_below = int(np.sqrt(stats.chi2.isf(1 / good_pages / 2, 15) * FLAT_TILE / MOVED_FROM_4_TO_9 / count))
    for moved, alarm in ((just_below, False), (just_below + 1, True)):
        tiles = flat(1, 10, 10)
        tiles[..., 4] += moved
        tiles[..., 9] -= moved
        assert detector.decide(evidence(tiles)).misprint is alarm


@given(st.integers(0, 10**6), st.floats(0, 0.5), st.sampled_from([20.0, 1e3, 1e6]), st.booleans())
def test_the_p_value_tells_the_same_as_the_alarm(
    seed: int, off: float, good_pages: float, tiles: bool
) -> None:
    rng = np.random.default_rng(seed)
    share = interval_shares().copy()
    share[: INTERVALS // 2] *= 1 + off * rng.random()
    counts = rng.multinomial(4096, share / share.sum(), (1, 3, 4))
    detector = ChiSquare(good_pages_per_false_alarm=good_pages, misprint_rate=0.01, tiles=tiles)
    decision = detector.decide(evidence(counts))
    assert decision.p_value is not None
    assert 0 <= decision.p_value <= 1
    assert decision.misprint is (decision.p_value < 1 / good_pages)


@pytest.mark.parametrize("tiles", [True, False])
def test_good_pages_alarm_as_often_as_promised(tiles: bool) -> None:
    pages, good_pages = 1500, 20.0
    rng = np.random.default_rng(11)
    detector = ChiSquare(good_pages_per_false_alarm=good_pages, misprint_rate=0.01, tiles=tiles)
    share = interval_shares().copy()
    alarms = sum(
        detector.decide(evidence(rng.multinomial(4096, share, (1, 4, 5)))).misprint for _ in range(pages)
    )
    allowed = pages / good_pages
    assert alarms < allowed + 4 * np.sqrt(allowed)
    # Bonferroni gives away what page and tiles have in common, less than half of it
    assert alarms > 0.6 * allowed


def test_a_good_page_seems_no_worse_than_the_misprint_rate() -> None:
    detector = ChiSquare(good_pages_per_false_alarm=1000, misprint_rate=0.02)
    decision = detector.decide(evidence(flat()))
    assert not decision.misprint
    assert decision.probability == 0.02


# Sellke, Bayarri, Berger 2001, table 1: P(H0 | data) at least so much for even prior odds
@pytest.mark.parametrize(
    ("p_value", "null_at_least"),
    [(0.1, 0.385), (0.05, 0.289), (0.01, 0.111), (0.005, 0.067), (0.001, 0.0184)],
)
def test_posterior_bound_meets_the_published_table(p_value: float, null_at_least: float) -> None:
    assert 1 - posterior_bound(p_value, 0.5) == pytest.approx(null_at_least, abs=6e-4)


@given(
    p_values=st.tuples(st.floats(1e-300, 1), st.floats(1e-300, 1)),
    rates=st.tuples(st.floats(1e-6, 0.999), st.floats(1e-6, 0.999)),
)
def test_posterior_bound_is_a_probability_that_rises_with_the_rate_and_falls_with_p(
    p_values: tuple[float, float], rates: tuple[float, float]
) -> None:
    small, large = sorted(p_values)
    rare, common = sorted(rates)
    assert rare - 1e-12 <= posterior_bound(large, rare) <= 1
    assert posterior_bound(large, rare) <= posterior_bound(small, rare) + 1e-12
    assert posterior_bound(large, rare) <= posterior_bound(large, common) + 1e-12


@pytest.mark.parametrize("p_value", [1e-300, 1e-308, 0.0])
@pytest.mark.parametrize("rate", [0.01, 0.99])
def test_posterior_bound_reaches_1(p_value: float, rate: float) -> None:
    assert posterior_bound(p_value, rate) == pytest.approx(1.0)


@pytest.mark.parametrize("p_value", [1e-320, 5e-324])
@pytest.mark.parametrize("rate", [0.01, 0.99])
def test_posterior_bound_holds_down_to_the_smallest_p_value(p_value: float, rate: float) -> None:
    assert posterior_bound(p_value, rate) == pytest.approx(1.0)


def test_evidence_of_any_strength_gives_a_probability() -> None:
    detector = ChiSquare(good_pages_per_false_alarm=1000, misprint_rate=0.01)
    for moved in range(2000, 3200, 4):  # statistics from 800 to 2048: p from 1e-148 through 1e-309 to 0
        decision = detector.decide(off_by(moved))
        assert decision.misprint
        assert decision.probability == pytest.approx(1.0)


def test_tiles_without_pixels_are_no_good_page() -> None:
    """Nought over nought: it must not be lost among numbers."""
    empty = flat()
    empty[0, 2, 3] = 0
    with np.errstate(invalid="ignore"):
        decision = ChiSquare(good_pages_per_false_alarm=100.0, misprint_rate=0.01).decide(evidence(empty))
    assert decision.verdict_name == "not-inspected"
    unpromised = ChiSquare(good_pages_per_false_alarm=np.nan, misprint_rate=0.01)
    assert unpromised.decide(evidence(flat())).verdict_name == "not-inspected"
