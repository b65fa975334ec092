"""Evidence that adds up over pages: what is promised of good runs, and how soon what creeps is said."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.detectors.cost import RunningCosts
from prooflight_line.run.monitor.cusum import CLIP, SequentialRanks, Sums, run_length, threshold_for
from prooflight_line.run.monitor.run import RECENT, Change, PageEvidence, RunMonitor, expected_costs

COSTS = RunningCosts()
COLUMNS_MM = (np.arange(40) + 0.5) * 0.5
DRIFTS = 4 + 8 + 2 + 1 + 6  # gains, registers, shifts, light of one sensor, waves of the lamp


def monitor(**changed: float) -> RunMonitor:
    return RunMonitor.begin(sensors=("mono",), columns_mm=COLUMNS_MM, costs=COSTS, **changed)


def test_run_length_is_that_of_lucas_and_crosier() -> None:
    """One-sided, allowance 0.5, threshold 4: 335 pages (Lucas and Crosier 1982, table 1: 168 of both sides)."""
    assert run_length(4.0, clip=30.0) == pytest.approx(335.4, rel=0.01)
    assert run_length(5.0, clip=30.0) == pytest.approx(930.9, rel=0.01)


def test_thresholds_have_the_run_length_that_was_asked_for() -> None:
    for pages in (370.0, 1e5, 2e8):
        assert run_length(threshold_for(pages)) == pytest.approx(pages, rel=0.03)


@pytest.mark.parametrize("law", ["normal", "heavy", "skewed"])
def test_good_runs_alarm_no_more_than_stated_whatever_their_law(law: str) -> None:
    """1500 pages x 2000 channels x 2 sides at one alarm in 1000 pages: 6000 expected, of standard deviation 80."""
    rng = np.random.default_rng(5)
    draw = {
        "normal": lambda: rng.standard_normal(2000),
        "heavy": lambda: rng.standard_t(2, 2000),
        "skewed": lambda: rng.exponential(1.0, 2000),
    }[law]
    threshold, ranks, sums, alarms = threshold_for(1000.0), SequentialRanks.of(2000), Sums.of(2000), 0
    for page in range(1500):
        sums.add(ranks.score(draw()), page)
        high = sums.total >= threshold
        alarms += int(high.sum())
        sums.total[high] = 0
    assert 0.5 * 6000 < alarms < 6000 + 3 * 80


def test_scores_are_independent_of_scale_and_of_order_within_bins() -> None:
    rng = np.random.default_rng(6)
    values = rng.standard_normal((200, 3))
    one, other = SequentialRanks.of(3), SequentialRanks.of(3)
    for row in values:
        np.testing.assert_allclose(one.score(row), other.score(4 * row + 7), atol=0.2)


def test_missing_values_count_for_nothing() -> None:
    rng = np.random.default_rng(7)
    with_gaps, without = SequentialRanks.of(1), SequentialRanks.of(1)
    for _ in range(100):
        value = rng.standard_normal(1)
        assert with_gaps.score(np.array([np.nan])) == 0
        assert with_gaps.score(value) == pytest.approx(without.score(value))


def test_three_pages_whatever_they_show_raise_no_alarm() -> None:
    """A fault of the paper path spoils a page or two: nothing beyond the pages concerned."""
    rng, run = np.random.default_rng(8), monitor()
    assert run.thresholds.min() > 3 * CLIP
    for sheet in range(300):
        spoilt = sheet in (100, 101, 102)
        columns = rng.standard_normal(40) * 1e-3 + (0.5 if spoilt else 0)
        values = {"gain-cyan": 5.0 if spoilt else rng.standard_normal() * 0.015}
        assert run.see(sheet, PageEvidence(values=values, columns=columns.astype(np.float32))) == []


@pytest.mark.parametrize("good", [0, 200])
def test_a_drift_of_a_twentieth_of_a_percent_is_said_before_its_level_leaves_tolerance(good: int) -> None:
    """Prints scatter by 1.5 % as in worlds.toml; tolerance is 7 %, left by the level after 140 pages."""
    said = []
    for seed in range(8):
        rng, run = np.random.default_rng(seed), monitor()
        session = rng.standard_normal() * 0.012
        for sheet in range(good + 140):
            gain = session + rng.standard_normal() * 0.015 + 0.0005 * max(sheet - good, 0)
            news = run.see(sheet, PageEvidence(values={"gain-magenta": gain}), pages_left=2000)
            if news:
                said.append(sheet - good)
                assert news[0].channel == "gain-magenta"
                assert news[0].pages_to_tolerance != 0
                break
    assert len(said) == 8
    assert np.median(said) < 90


def test_a_streak_is_said_once_where_it_is() -> None:
    """Half a percent of the light, a third of what single columns scatter by: no page shows it."""
    rng, run, news = np.random.default_rng(9), monitor(), []
    for sheet in range(300):
        columns = rng.standard_normal(40) * 0.004
        if sheet >= 100:
            columns[16:18] -= 0.008
        news += run.see(sheet, PageEvidence(columns=columns.astype(np.float32)), pages_left=10)
    assert [one.kind for one in news][:1] == ["streak"]
    assert all(abs(one.x_mm - 8.5) < 1 for one in news if one.x_mm is not None)
    assert news[0].level == pytest.approx(-0.008, abs=0.003)
    assert len(news) <= 2
    assert 100 < news[0].sheet < 150
    assert news[0].since == pytest.approx(100, abs=25)


def test_a_streak_that_creeps_is_said_while_it_is_faint() -> None:
    rng, run = np.random.default_rng(10), monitor()
    for sheet in range(1000):
        columns = rng.standard_normal(40) * 0.004
        columns[5] -= 0.00005 * sheet
        news = run.see(sheet, PageEvidence(columns=columns.astype(np.float32)))
        if news:
            break
    assert 2.5 <= news[0].x_mm <= 3.0
    assert abs(news[0].level) < 0.012


def test_small_certain_changes_are_not_worth_a_word() -> None:
    """2 % of the tolerance, ten times the scatter."""
    run = monitor()
    rng = np.random.default_rng(11)
    for sheet in range(400):
        gain = rng.standard_normal() * 0.0001 + 0.0014 * (sheet > 100)
        assert run.see(sheet, PageEvidence(values={"gain-black": gain})) == []


def test_false_alarms_are_shared_out_by_the_union_bound() -> None:
    run = monitor(false_alarms=2.0)
    lengths = {threshold: run_length(threshold) for threshold in set(run.thresholds.tolist())}
    rates = [2 * 100_000 / lengths[threshold] for threshold in run.thresholds.tolist()]
    assert len(run.channels) == DRIFTS + 40
    assert sum(rates) == pytest.approx(2.0, rel=0.03)
    assert sum(rates[:DRIFTS]) == pytest.approx(1.0, rel=0.03)


def test_change_is_fitted_as_a_line_only_where_it_is_sure() -> None:
    rng, pages = np.random.default_rng(12), np.arange(60)
    drift = Change.fitted(pages, 0.01 + 0.0005 * pages + rng.standard_normal(60) * 0.002)
    assert drift.slope == pytest.approx(0.0005, rel=0.2)
    assert drift.level == pytest.approx(0.04, abs=0.002)
    assert drift.pages_to(0.07) == pytest.approx(60, abs=15)
    still = Change.fitted(pages, 0.01 + np.tile([0.002, -0.002], 30))
    assert (still.slope, still.pages_to(0.07)) == (0.0, None)
    assert Change(level=-0.08, slope=0.0, scatter=0.01).pages_to(0.07) == 0


def test_drifting_away_from_the_far_side_takes_longer() -> None:
    assert Change(level=-0.05, slope=0.01, scatter=0.0).pages_to(0.07) == 12


def test_costs_count_misprints_by_their_probability() -> None:
    """A level right at the tolerance: half of all pages, printed and to come, are misprints of 0.1 cent."""
    change = Change(level=0.07, slope=0.0, scatter=0.001)
    costs = expected_costs(change, tolerance=0.07, pages_since=4, pages_left=100, costs=COSTS)
    assert costs["accept"] == pytest.approx(0.1 * (2 + 50))
    assert costs["stop"] == pytest.approx(0.01 + 0.1 * 2)
    assert costs["reprint"] == pytest.approx(0.01 + 4 * 0.01)


def test_nothing_is_recommended_where_the_run_ends_before_tolerance_is_left() -> None:
    change = Change(level=0.02, slope=0.0005, scatter=0.005)
    costs = expected_costs(change, tolerance=0.07, pages_since=40, pages_left=20, costs=COSTS)
    assert min(costs, key=lambda action: costs[action]) == "accept"
    costs = expected_costs(change, tolerance=0.07, pages_since=40, pages_left=400, costs=COSTS)
    assert min(costs, key=lambda action: costs[action]) == "stop"


def test_the_end_of_what_is_followed_is_evidence() -> None:
    news = monitor().excursion(12, "light-mono", -0.045)
    assert [(one.kind, one.level, one.pages_to_tolerance) for one in news] == [("excursion", -0.045, None)]
    assert "as far as it is followed" in news[0].text


def test_size_does_not_grow() -> None:
    run, rng = monitor(), np.random.default_rng(13)
    sizes = []
    for sheet in range(2 * RECENT):
        run.see(sheet, PageEvidence(values={"shift-x": rng.standard_normal()}))
        if sheet in (10, 2 * RECENT - 1):
            arrays = (run.recent, run.sheets, run.ranks.first, run.ranks.counts, run.sums.total)
            sizes.append(sum(array.nbytes for array in arrays))
    assert sizes[0] == sizes[1]
    assert run.sheets.size == RECENT


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e38, -1e300])
def test_a_page_whose_numbers_are_absurd_spoils_no_run(value: float) -> None:
    """Seed 9: a drift is found as it would have been, and nothing overflows."""
    found = []
    for absurd in (0.0, value):
        rng, run = np.random.default_rng(9), monitor()
        said = []
        for sheet in range(300):
            gain = rng.standard_normal() * 0.01 + max(sheet - 100, 0) * 5e-4
            here = absurd if sheet in (3, 60, 61) and absurd else gain
            columns = np.full(40, np.clip(absurd, -3e38, 3e38) if sheet == 60 else 0.0, np.float32)
            said += run.see(sheet, PageEvidence(values={"gain-cyan": here}, columns=columns))
        assert np.isfinite(run.sums.total).all()
        found.append([one.kind for one in said if one.channel == "gain-cyan"])
    assert found[1][:1] == found[0][:1] == ["drift"]
