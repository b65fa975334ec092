"""Zones in the matched filter: ignored ones hide nothing beside them, careful ones keep the promise. Seeds fixed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy import stats

from prooflight.detectors.base import StoredArrays
from prooflight.detectors.false_alarm_rate import GoodScores, PressScores
from prooflight.detectors.matched_filter.zones import STATISTICS, ZonedJudge, baseline_of, careful_scores
from prooflight.detectors.verdict import Decision
from prooflight.errors import RequestError
from prooflight.inspection.inspector import Inspector
from prooflight.pages.zones.zones_file import JobZones, PriceEntry, ZoneEntry
from prooflight.scans.scan import Scan
from prooflight.simulation.scans import simulate

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

IGNORED = (8.0, 8.0, 12.0, 14.0)
CAREFUL = (20.0, 26.0, 10.0, 12.0)


@pytest.fixture(scope="module")
def page(make_page: Callable[..., Page], trained_press: Press) -> Page:
    return trained_press.geometry.lay(make_page(2, number=1))


@pytest.fixture(scope="module")
def scan(page: Page, trained_press: Press) -> NDArray[np.uint16]:
    return simulate(page, trained_press, world="press", seed=4).dn


def zoned(page: Page, *entries: ZoneEntry, price: PriceEntry | None = None) -> JobZones:
    zones = JobZones.create(entries, [(page.width_mm, page.height_mm)])
    return zones if price is None else zones.priced(price)


def ignore(box: Any = IGNORED) -> ZoneEntry:
    return ZoneEntry(name="stamp", kind="ignore", rectangle_mm=box)


def careful(box: Any = CAREFUL) -> ZoneEntry:
    return ZoneEntry(name="face", kind="careful", rectangle_mm=box)


def calibrated(zones: JobZones, *, spread: float = 1.0) -> JobZones:
    """As if good prints had been like that: careful areas about 0, the page below the press's threshold."""
    rng = np.random.default_rng(1)
    values = rng.normal(0, spread, (240, STATISTICS))
    mean, sd = baseline_of(values[:80])
    price = PriceEntry(
        press="x",
        zones=zones.zones_digest,
        prints=240,
        seed=1,
        page_scores=tuple(rng.normal(-8, 0.5, 240)),
        careful_scores=tuple(careful_scores(values[80:], np.stack([mean, sd])).tolist()),
        careful_mean=tuple(mean.tolist()),
        careful_sd=tuple(sd.tolist()),
    )
    return zones.priced(price)


def dark(
    scan: NDArray[np.uint16], press: Press, page: Page, box: Any, share: float = 0.6
) -> NDArray[np.uint16]:
    """The scan with a rectangle of the page so much darker."""
    x, y = press.geometry.centres_x_mm(page.width_mm), press.geometry.centres_y_mm(scan.shape[1])
    here = ((y >= box[1]) & (y < box[1] + box[3]))[:, None] & (x >= box[0]) & (x < box[0] + box[2])
    return np.where(here, scan * (1 - share), scan).astype(np.uint16)


def test_whatever_lies_in_an_ignored_zone_changes_neither_score_nor_evidence(
    trained_press: Press, page: Page, scan: NDArray[np.uint16]
) -> None:
    inspector = Inspector.of(trained_press, zones=calibrated(zoned(page, ignore())))
    inner = (
        IGNORED[0] + 1.5,
        IGNORED[1] + 1.5,
        IGNORED[2] - 3,
        IGNORED[3] - 3,
    )  # prints lie up to 1 mm aside
    spoilt = dark(scan, trained_press, page, inner)
    prepared = inspector.prepare(page)
    good, bad = (inspector.inspect(prepared, one) for one in (scan, spoilt))
    assert good.verdict.verdict == bad.verdict.verdict == "good"
    # The search for the page begins from all of the scan, and forests go in steps; the threshold is 4 away.
    assert bad.verdict.score == pytest.approx(good.verdict.score, abs=1.0)
    assert good.verdict.threshold is not None
    assert bad.verdict.score is not None
    assert bad.verdict.score < good.verdict.threshold - 3
    bare = Inspector.of(trained_press)
    assert bare.inspect(page, spoilt).verdict.verdict == "misprint"


def test_beside_an_ignored_zone_as_much_is_caught(
    trained_press: Press, page: Page, scan: NDArray[np.uint16]
) -> None:
    beside = (IGNORED[0] + IGNORED[2] + 1.2, IGNORED[1] + 2, 3.0, 3.0)
    spoilt = dark(scan, trained_press, page, beside)
    inspector = Inspector.of(trained_press, zones=calibrated(zoned(page, ignore())))
    found = inspector.inspect(page, spoilt).verdict
    assert found.verdict == "misprint"
    assert any(
        region.x_mm <= beside[0] + 2 and region.x_mm + region.width_mm >= beside[0]
        for region in found.regions
    )


def test_a_careful_zone_alarms_by_itself_and_is_named(
    trained_press: Press, page: Page, scan: NDArray[np.uint16]
) -> None:
    """Its statistics are compared with what this page's good prints give, which here is stated."""
    bare = Inspector.of(trained_press, zones=zoned(page, careful()))
    values = bare.inspect(page, scan).stored_arrays["careful"]
    zones = calibrated(zoned(page, careful()))
    assert zones.document.price is not None
    price = zones.document.price.model_copy(update={"careful_mean": tuple(map(float, values))})
    inspector = Inspector.of(trained_press, zones=zones.priced(price))
    assert inspector.inspect(page, scan).verdict.verdict == "good"
    spot = (CAREFUL[0] + 4, CAREFUL[1] + 5, 2.0, 2.0)
    found = inspector.inspect(page, dark(scan, trained_press, page, spot))
    assert found.verdict.verdict == "misprint"
    assert found.verdict.reason.endswith("in the careful zone 'face'")
    (region, *_) = found.verdict.regions
    assert abs(region.x_mm + region.width_mm / 2 - spot[0] - 1) < 3
    assert abs(region.y_mm + region.height_mm / 2 - spot[1] - 1) < 3
    again = inspector.detector.decided_again(StoredArrays(found.stored_arrays, "matched_filter"))
    assert (again.misprint, again.score, again.threshold) == (
        True,
        pytest.approx(found.verdict.score),
        pytest.approx(found.verdict.threshold),
    )


def test_without_zones_on_a_page_nothing_is_other(
    trained_press: Press, page: Page, scan: NDArray[np.uint16]
) -> None:
    elsewhere = JobZones.create(
        [ZoneEntry(name="stamp", kind="ignore", pages="2", rectangle_mm=IGNORED)],
        [(page.width_mm, page.height_mm)] * 2,
    )
    one, other = (
        Inspector.of(trained_press, zones=zones).inspect(page, scan)
        for zones in (None, calibrated(elsewhere))
    )
    assert one.stored_arrays.keys() == other.stored_arrays.keys()
    assert replace(one.verdict, milliseconds=0) == replace(other.verdict, milliseconds=0)


def test_another_detector_refuses_zones(trained_press: Press, page: Page) -> None:
    with pytest.raises(RequestError, match="does not support zones"):
        Inspector.of(trained_press, "chi-square", zones=calibrated(zoned(page, ignore())))


def test_a_price_of_other_areas_is_refused(trained_press: Press, page: Page) -> None:
    zones = calibrated(zoned(page, careful()))
    assert zones.document.price is not None
    short = zones.document.price.model_copy(update={"careful_mean": (0.0,), "careful_sd": (1.0,)})
    with pytest.raises(RequestError, match="price them again"):
        Inspector.of(trained_press, zones=zones.priced(short)).prepare(page)


def judge(rng: np.random.Generator, *, good: int, share: float) -> ZonedJudge:
    """Whose good scores are the normal numbers that fresh ones are too."""
    return ZonedJudge(
        page_good=np.sort(rng.normal(size=good)),
        careful_good=np.sort(rng.normal(size=good)),
        baseline=np.array([[0.0], [1.0]]),
        share=share,
    )


def press_of(rate: float, rng: np.random.Generator) -> Any:
    """As much of a calibrated detector as a judge asks for."""
    own = GoodScores(worst=np.sort(rng.normal(size=2000)))
    return SimpleNamespace(
        ranking_rate=rate,
        trained_threshold=-4.0,
        scores=PressScores(reference=own, own=own),
        decision=lambda score, threshold, p_value: Decision(
            misprint=score > threshold, score=score, threshold=threshold, p_value=p_value, probability=None
        ),
    )


@pytest.mark.parametrize("together", [1.0, 0.0, -1.0])
def test_the_promise_holds_however_page_and_careful_areas_hang_together(together: float) -> None:
    """300 calibrations of 10 fresh pages each; alarms are binomial at the most: beyond 99.9 % of that fails."""
    rate, alarms, pages = 0.05, 0, 0
    rng = np.random.default_rng(int(10 + together))
    for _ in range(300):
        one, matched_filter = judge(rng, good=400, share=0.2), press_of(rate, rng)
        for _ in range(10):
            score = rng.normal()
            other = together * score + np.sqrt(1 - together**2) * rng.normal()
            decision = one.decide(matched_filter, score, np.array([other]))
            alarms, pages = alarms + decision.misprint, pages + 1
            assert decision.misprint == (decision.score > decision.threshold)
            assert decision.p_value is not None
            assert 0 < decision.p_value <= 1
    assert alarms <= stats.binom.ppf(0.999, pages, rate)
    assert alarms >= 0.3 * rate * pages  # nor is it kept by never alarming


def test_too_few_prints_cannot_speak_of_rare_alarms() -> None:
    rng = np.random.default_rng(2)
    with pytest.raises(RequestError, match="--prints"):
        judge(rng, good=8, share=0.2).decide(press_of(0.001, rng), 0.0, np.array([0.0]))


def test_a_page_without_careful_areas_uses_all_of_the_promise() -> None:
    rng = np.random.default_rng(3)
    one = replace(judge(rng, good=200, share=0.2), careful_good=np.zeros(0), baseline=np.zeros((2, 0)))
    assert one.rates(0.01) == (0.01, 0.0)
    assert judge(rng, good=600, share=0.2).rates(0.01) == (pytest.approx(0.008), pytest.approx(0.002))


@pytest.mark.parametrize("prints", [12, 60, 90, 140])
def test_few_good_prints_in_heaps_hide_nothing(prints: int) -> None:
    """Good prints at -12 and at -1, as those that taught the ranking lie: what lies above all of them alarms."""
    rng = np.random.default_rng(6)

    def heaps(count: int) -> NDArray[np.float64]:
        return np.sort(np.where(np.arange(count) % 10 < 8, -12.0, -1.0) + rng.normal(0, 0.3, count))

    matched_filter, zoned = press_of(0.01, rng), heaps(prints)
    matched_filter.scores, matched_filter.trained_threshold = (
        PressScores(reference=GoodScores(worst=heaps(1000)), own=GoodScores(worst=heaps(60))),
        0.5,
    )
    one = ZonedJudge(page_good=zoned, careful_good=np.zeros(0), baseline=np.zeros((2, 0)), share=0.2)
    assert one.decide(matched_filter, 2.0, np.zeros(0)).misprint
    assert not one.decide(matched_filter, float(zoned[-1]), np.zeros(0)).misprint


@pytest.mark.parametrize(("prints", "least", "most"), [(90, 0.05, 0.075), (600, 0.03, 0.057)])
def test_pages_that_reach_further_into_the_tail_with_zones_have_a_higher_threshold(
    prints: int, least: float, most: float
) -> None:
    """200 presses whose good pages with zones lie above every score three times as often as those that taught the
    ranking. Of 90 prints that ratio is drawn to 1, so that 5 % are 6.4 % (by ``PressScores.ratio``); 600 count it. The
    scatter of 4,000 fresh ones is 0.34 %.
    """
    rng = np.random.default_rng(7)
    matched_filter, realised, before = press_of(0.05, rng), [], []

    def good(count: int) -> NDArray[np.float64]:
        return np.sort(stats.norm.isf(rng.random(count) / 3))

    for _ in range(200):
        one = ZonedJudge(
            page_good=good(prints), careful_good=np.zeros(0), baseline=np.zeros((2, 0)), share=0.2
        )
        fresh = good(20)
        realised += [one.decide(matched_filter, score, np.zeros(0)).misprint for score in fresh]
        before += [score > matched_filter.scores.threshold(0.05)[0] for score in fresh]
    assert np.mean(before) > 0.12
    assert least < np.mean(realised) < most


@pytest.mark.parametrize("strange", [np.nan, np.inf])
def test_numbers_that_are_not_finite_decide_nothing_good(strange: float) -> None:
    rng = np.random.default_rng(4)
    one, matched_filter = judge(rng, good=200, share=0.2), press_of(0.05, rng)
    for score, value in ((strange, 0.0), (0.0, strange)):
        assert one.decide(matched_filter, score, np.array([value])).verdict_name in (
            "not-inspected",
            "misprint",
        )


def test_a_scan_is_unchanged_by_being_looked_at(
    trained_press: Press, page: Page, scan: NDArray[np.uint16]
) -> None:
    before = scan.copy()
    Inspector.of(trained_press, zones=calibrated(zoned(page, ignore(), careful()))).inspect(
        page, Scan(dn=scan, name="s")
    )
    assert np.array_equal(before, scan)
