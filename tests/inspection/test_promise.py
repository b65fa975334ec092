"""Whether the promise stands for a run: how rarely it is suspended falsely, how soon rightly, and what that leaves."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.stats import binom

from prooflight.commissioning.training.learn import Pages, learn_model
from prooflight.detectors.false_alarm_rate import GoodScores, ReferenceScores
from prooflight.detectors.matched_filter import exchangeability
from prooflight.detectors.matched_filter.calibrated import CalibratedDetector, GoodPages
from prooflight.detectors.matched_filter.detector import MatchedFilterDetector, summary_of
from prooflight.detectors.matched_filter.exchangeability import FALSELY, ExchangeabilityTest, PressRunTest
from prooflight.detectors.matched_filter.naming import FAMILIES
from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
from prooflight.detectors.matched_filter.statistics.statistic import Statistic
from prooflight.detectors.verdict import Region, Verdict
from prooflight.inspection.guarantee import GuaranteeMonitor
from prooflight.inspection.guarantee import summary_of as summary_of_page
from prooflight.inspection.inspector import Inspector

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

OWN = 40
"""Good pages of the press."""
GROUPS = 5
NAMES = ["box/add-C+/8", "box/add-M+/8", "streak/light/2/full", "fit/white"]
GOOD = Verdict(page="p0001", verdict="good", score=0.5, threshold=1.0)


def fresh(own: np.ndarray, *, room: int = 10**6) -> ExchangeabilityTest:
    """Before a run, with a press's own pages (pages, groups)."""
    stakes = exchangeability.STAKES.size
    names = ("score", *(f"group-{k}" for k in range(1, own.shape[1])))
    zeros = np.zeros((own.shape[1], stakes))
    return ExchangeabilityTest(reference_pages=list(own), room=room, names=names, log_wealth=zeros)


def exchangeable(rng: np.random.Generator, pages: int) -> np.ndarray:
    """Rows (pages, GROUPS) in which all groups and all pages hang together: one day's level and scale, heavy tails."""
    alike = rng.standard_normal(GROUPS) + rng.standard_normal()
    each = rng.standard_t(3, (pages, 1)) + rng.standard_t(3, (pages, GROUPS))
    return alike + rng.lognormal() * np.round(each, 1)  # rounded: pages tie


@pytest.mark.parametrize("room", [10**6, 45])
def test_exchangeable_pages_gain_a_factor_of_1_over_a_in_at_most_a_of_runs(room: int) -> None:
    """300 runs of 60 pages, seed 11; room 45: of 100 pages most are forgotten. Tolerance: the binomial's 0.1 %."""
    rng = np.random.default_rng(11)
    runs, pages = 300, 60
    most = []
    for _ in range(runs):
        rows = exchangeable(rng, OWN + pages)
        test = fresh(rows[:OWN], room=room)
        for row in rows[OWN:]:
            test.add(row, rng)
        most.append(test.most)
    for share in (0.3, 0.1, 0.03, FALSELY):
        above = int((np.array(most) >= -np.log(share)).sum())
        assert above <= binom.ppf(0.999, runs, share), share
    assert max(most) > -np.log(0.3)  # the wealth moves at all


def test_pages_that_lie_elsewhere_are_seen_within_30_pages() -> None:
    """Each of 20 runs, seed 12: one group of five lies two standard deviations higher."""
    rng = np.random.default_rng(12)
    for _ in range(20):
        test = fresh(rng.standard_normal((OWN, GROUPS)))
        for _ in range(30):
            test.add(rng.standard_normal(GROUPS) + 2 * (np.arange(GROUPS) == 3), rng)
        assert test.suspended
        assert test.strangest == "group-3"


def test_what_is_kept_of_an_endless_run_does_not_grow() -> None:
    rng = np.random.default_rng(13)
    test = fresh(rng.standard_normal((OWN, 2)), room=OWN + 50)
    own = list(test.reference_pages)
    sizes = []
    for _ in range(400):
        test.add(rng.standard_normal(2), rng)
        sizes.append(len(test.reference_pages))
    assert sizes[:50] == list(range(OWN + 1, OWN + 51))
    assert set(sizes[50:]) == {OWN + 50}
    left = sum(any(row is one for one in own) for row in test.reference_pages)
    assert left < OWN // 2  # forgotten without regard to age: of 40 about 1 is left


@pytest.fixture(scope="module")
def matched_filter() -> CalibratedDetector:
    """Taught by random rows, seed 14; its 40 good pages are of the same kind."""
    rng = np.random.default_rng(14)

    def rows(count: int) -> tuple[np.ndarray, np.ndarray]:
        values = rng.exponential(size=(count, len(NAMES))).astype(np.float32)
        return values, rng.standard_normal((count, 3))

    values, page_features = rows(120)
    pages = Pages(
        values=values,
        page_features=page_features,
        design=np.arange(120),
        kind=np.zeros(120, "U1"),
        press=np.zeros(120, np.int64),
    )
    model = learn_model(pages, names=NAMES, scatter=Scatter.white(), rng=rng, ranked=False)
    own = GoodPages(**dict(zip(("values", "page_features"), rows(OWN), strict=True)))
    good = GoodScores(worst=np.sort(rng.exponential(size=OWN)))
    return CalibratedDetector.calibrated(
        model,
        good,
        references=ReferenceScores.alone(good),
        pages=own,
        false_alarm_rate=0.05,
        misprint_rate=0.01,
    )


def test_our_detector_suspends_its_promise_once_in_words(
    press: Press, matched_filter: CalibratedDetector
) -> None:
    """Pages that scatter as its own do not, seed 15; those with light along the travel soon, and say so."""
    detector = MatchedFilterDetector(press_context=press.press_context(), calibrated=matched_filter)
    rng = np.random.default_rng(15)
    for much, suspended in ((0.0, False), (6.0, True)):
        watch, said = GuaranteeMonitor.of(detector, seed=3), []
        for page in range(60):
            values = rng.exponential(size=len(NAMES)) + much * (np.arange(len(NAMES)) == 2)
            summary = summary_of(
                matched_filter.model, values, rng.standard_normal(3), score=rng.exponential()
            )
            said += [page] if watch.add(GOOD, summary, page) else []
            assert watch.marked(GOOD).promise_suspended == bool(said)
        assert len(said) == suspended
        assert bool(watch.suspended) == suspended
    assert said[0] < 30
    assert "(most of all: lines along the travel)" in watch.suspended
    assert "check 40 good pages and run `prooflight press learn X.press JOB SCANS --good`" in watch.suspended


def test_an_inspected_page_adds_to_its_run_unless_it_shows_another(
    trained_press: Press, page: Page, make_page: Callable[..., Page]
) -> None:
    inspector = Inspector.of(trained_press, "matched_filter")
    watch = GuaranteeMonitor.of(inspector.detector)
    assert isinstance(watch.test, PressRunTest)
    prepared = inspector.prepare(page)
    good, other = (
        inspector.inspect(prepared, np.rint(inspector.planned(shown).expected.expected_dn).astype(np.uint16))
        for shown in (page, make_page(8))
    )
    summary = summary_of_page(good)
    assert summary is not None
    assert summary.shape == (len(watch.test.test.names),)
    assert np.isfinite(summary).all()
    assert other.verdict.kind == "wrong-page"
    assert summary_of_page(other) is None
    assert summary_of_page(replace(good, verdict=Verdict.skipped("p0007", "too dark"))) is None


def test_a_press_keeps_room_beside_its_own_pages(matched_filter: CalibratedDetector) -> None:
    test = ExchangeabilityTest.of(matched_filter)
    assert (len(test.reference_pages), test.room) == (OWN, OWN + 2000)


def test_numbers_that_are_not_finite_say_nothing(matched_filter: CalibratedDetector) -> None:
    fine, page_features = np.ones(len(NAMES)), np.zeros(3)
    assert summary_of(matched_filter.model, fine, page_features, score=0.5) is not None
    for odd in (np.nan, np.inf):
        values = np.where(np.arange(len(NAMES)) == 1, odd, fine)
        assert summary_of(matched_filter.model, values, page_features, score=0.5) is None
        assert summary_of(matched_filter.model, fine, page_features + odd, score=0.5) is None
        assert summary_of(matched_filter.model, fine, page_features, score=odd) is None


@pytest.mark.parametrize("name", ["chi-square"])
def test_another_detector_never_suspends_anything(press: Press, name: str) -> None:
    watch = GuaranteeMonitor.of(Inspector.of(press, name).detector)
    assert watch.test is None
    assert not any(watch.add(GOOD, np.full(3, 1e9), page) for page in range(50))
    assert watch.marked(GOOD) is GOOD


def test_all_that_our_detector_looks_at_has_words() -> None:
    from prooflight.detectors.matched_filter.statistics import statistic

    assert set(statistic.LABELS.values()) <= set(FAMILIES)
    assert {Statistic.parse(name).label for name in NAMES} <= set(FAMILIES)


def test_of_each_design_the_first_sheet_counts() -> None:
    class Counts:
        suspended, strangest, remedy, added = False, "", "", 0

        def add(self, _summary: np.ndarray) -> None:
            self.added += 1

    test = Counts()
    watch = GuaranteeMonitor(test=test)
    for page in [0, 1, 0, 0, 1, 2]:
        watch.add(GOOD, np.zeros(3), page)
    assert test.added == 3


class Suspends:
    """A run's test that the third page ends."""

    strangest, remedy, added = "lines along the travel", "look at 40 good pages and run `press learn`", 0

    def add(self, _summary: np.ndarray) -> None:
        self.added += 1

    @property
    def suspended(self) -> bool:
        return self.added == 3


def misprint(kind: str, x_mm: float, y_mm: float) -> Verdict:
    place = Region(x_mm=x_mm, y_mm=y_mm, width_mm=2.0, height_mm=2.0, score=9.0, kind=kind)
    return replace(GOOD, verdict="misprint", kind=kind, regions=(place,))


def suspended_by(verdicts: list[Verdict]) -> str:
    watch = GuaranteeMonitor(test=Suspends())
    for page, verdict in enumerate(verdicts):
        watch.add(verdict, np.zeros(3), page)
    return watch.suspended


@pytest.mark.parametrize(
    ("verdicts", "said"),
    [
        (
            [misprint("streak", 82.0 + at % 2, 40.0 * at) for at in range(4)],
            "many sheets show streak at x = 83 mm (4 of 4)",
        ),
        (
            [GOOD, *(misprint("spots-voids", 20.0, 30.0 + at) for at in range(3))],
            "many sheets show spots-voids around x = 21 mm, y = 31 mm (3 of 4)",
        ),
        (
            [misprint("spots-voids", 20.0 * at, 30.0) for at in range(4)],
            "many sheets show spots-voids at several places (4 of 4)",
        ),
        ([misprint("density", 20.0 * at, 30.0) for at in range(4)], "many sheets show density (4 of 4)"),
    ],
)
def test_alarms_of_a_common_cause_are_no_pages_to_learn_from(verdicts: list[Verdict], said: str) -> None:
    assert suspended_by(verdicts).startswith(f"{said}: ")
    assert "learn" not in suspended_by(verdicts)


@pytest.mark.parametrize(
    "verdicts",
    [
        [GOOD] * 4,
        [*[GOOD] * 40, *[misprint("streak", 82.0, 10.0)] * 3],  # no more than a few
        [misprint("unknown", 82.0, 10.0)] * 4,
        [replace(misprint("streak", 82.0, 10.0), verdict="not-inspected")] * 4,
    ],
)
def test_where_alarms_have_nothing_in_common_good_pages_are_to_be_learned(verdicts: list[Verdict]) -> None:
    assert "look at 40 good pages and run `press learn`" in suspended_by(verdicts)
