"""The matched filter on single pages of the press world: what it says, and why. Seeds fixed."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.training.simulated_days import PressDay
from prooflight.detectors.base import StoredArrays
from prooflight.detectors.matched_filter.calibrated import WRONG_PAGE
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.registry import detector
from prooflight.errors import RequestError, ScanError
from prooflight.inspection.inspector import Inspector
from prooflight.reporting.wording import judged
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.simulation.misprints.kinds import draw_misprint

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.detectors.verdict import Verdict
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

    MakePage = Callable[..., Page]


class Bench:
    """A press day, an inspector, and misprints to order."""

    def __init__(self, press: Press, make_page: MakePage) -> None:
        self.inspector = Inspector.of(press)
        self.make = make_page
        self.day = PressDay.of(press, self, seed=5, first=0)

    def page(self, index: int) -> Page:
        return self.make(index + 1, number=index + 1)

    def scan(
        self, page: Page, rng: np.random.Generator, placement: Placement = IN_PLACE
    ) -> NDArray[np.uint16]:
        day = self.day.day
        return day.recorded(day.seen_in_press(page, rng, placement), rng)

    def verdict(self, index: int, kind: str = "", *, seed: int = 0) -> Verdict:
        page, rng = self.page(index), np.random.default_rng([seed, index])
        printed, placement = page, IN_PLACE
        if kind:
            drawn = draw_misprint(page, kind, 0.9, others=[index + 1], fetch=self.page, rng=rng)
            printed, placement = drawn.page, drawn.placement
        scan = self.scan(printed, rng, placement)
        return self.inspector.inspect(self.inspector.prepare(page), scan, scan_name="scan").verdict


@pytest.fixture(scope="module")
def bench(trained_press: Press, make_page: MakePage) -> Bench:
    return Bench(trained_press, make_page)


def test_good_prints_mostly_pass(bench: Bench) -> None:
    verdicts = [bench.verdict(index) for index in range(5)]
    # one in ten may alarm: more than two of five in 1 % of all draws
    assert sum(verdict.verdict == "good" for verdict in verdicts) >= 3
    for verdict in verdicts:
        assert verdict.detector == "matched_filter"
        assert verdict.family
        assert set(verdict.inks) == set("CMYK")
        assert verdict.score is not None
        assert verdict.threshold is not None
        assert (verdict.score > verdict.threshold) == (verdict.verdict == "misprint")
        if verdict.verdict == "good":
            assert (verdict.kind, verdict.reason, verdict.regions) == (None, "", ())


@pytest.mark.parametrize("kind", ["missing-content", "spots-voids"])
def test_a_severe_misprint_alarms_and_says_why(bench: Bench, kind: str) -> None:
    verdict = bench.verdict(1, kind)
    page = bench.page(1)
    assert verdict.verdict == "misprint"
    assert verdict.reason
    assert verdict.kind
    assert verdict.regions
    for region in verdict.regions:
        assert 0 <= region.x_mm <= region.x_mm + region.width_mm <= page.width_mm + 0.01
        assert 0 <= region.y_mm <= region.y_mm + region.height_mm <= page.height_mm + 0.01
    read = json.loads(json.dumps(asdict(verdict), allow_nan=False))
    assert read["expected_cost"] == {
        "accept": pytest.approx(0.1 * read["probability"]),
        "stop": pytest.approx(0.01 * (1 - read["probability"])),
    }


def test_misprints_alone_are_known_before_they_are_explained(bench: Bench) -> None:
    """Good prints, a hole, and another page; a page of the test that alarms counts as a misprint."""
    page, rng = bench.page(0), np.random.default_rng(7)
    prepared, printed = bench.inspector.prepare(page), np.array([0, 0, 0, 1, 2])
    scans = [bench.scan(bench.page(40 * (what == 2)), rng) for what in printed]
    scans[3][:, 200:230, 100:130] //= 2
    misprints = []
    for scan in scans:
        known: list[Verdict] = []
        verdict = bench.inspector.inspect(prepared, scan, decided=known.append).verdict
        misprints.append(verdict.verdict == "misprint")
        expected = [("misprint", None, verdict.score, verdict.threshold)] * misprints[-1]
        assert [(one.verdict, one.kind, one.score, one.threshold) for one in known] == expected
    assert not all(misprints[:3])
    assert all(misprints[3:])


def test_a_page_off_its_place_is_wrong_whatever_the_evidence(bench: Bench) -> None:
    page = bench.page(0)
    prepared, rng = bench.inspector.prepare(page), np.random.default_rng(3)
    scan = np.roll(bench.scan(page, rng), 30, axis=1)  # 3.2 mm further down
    verdict = bench.inspector.inspect(prepared, scan, scan_name="scan").verdict
    assert (verdict.verdict, verdict.kind, verdict.score) == ("misprint", "wrong-page", WRONG_PAGE)
    assert "off its position" in verdict.reason
    assert verdict.shift_mm is not None
    assert verdict.shift_mm[1] == pytest.approx(3.2, abs=0.9)  # 0.76 mm of a good print's own


def test_a_reordered_page_and_a_turned_one_are_wrong_pages_and_said_to_be(bench: Bench) -> None:
    page, rng = bench.page(0), np.random.default_rng(6)
    prepared = bench.inspector.prepare(page)
    upside_down = replace(page, cmyk=np.ascontiguousarray(page.cmyk[::-1, ::-1]))
    another = replace(bench.page(40), cmyk=np.ascontiguousarray(bench.page(40).cmyk[::-1, ::-1]))
    for printed, words in ((upside_down, "turned by 180 degrees"), (another, "another page")):
        verdict = bench.inspector.inspect(prepared, bench.scan(printed, rng), scan_name="scan").verdict
        assert (verdict.verdict, verdict.kind, verdict.score) == ("misprint", "wrong-page", WRONG_PAGE)
        assert words in verdict.reason


def test_a_prepared_page_serves_all_its_scans(bench: Bench) -> None:
    page, rng = bench.page(2), np.random.default_rng(4)
    prepared = bench.inspector.prepare(page)
    scans = [bench.scan(page, rng) for _ in range(2)]
    first, other, again = (
        bench.inspector.inspect(prepared, scan, scan_name="scan") for scan in (*scans, scans[0])
    )
    assert replace(first.verdict, milliseconds=0) == replace(again.verdict, milliseconds=0)
    assert first.verdict.score != other.verdict.score
    whole = bench.inspector.inspect(page, scans[0])
    assert whole.verdict.score == first.verdict.score


def test_a_page_of_more_colours_than_are_followed_is_judged_more_widely_and_says_so(bench: Bench) -> None:
    """As if the press's good pages scattered so many times as widely; decided again alike from what is kept."""
    page, rng = bench.page(2), np.random.default_rng(4)
    patches = rng.integers(0, 256, (10, 8, 4)).astype(np.uint8)
    rows, columns = page.cmyk.shape[:2]
    many = np.repeat(np.repeat(patches, -(-rows // 10), axis=0), -(-columns // 8), axis=1)[:rows, :columns]
    page = replace(page, cmyk=np.ascontiguousarray(many))
    found = bench.inspector.inspect(page, bench.scan(page, rng))
    times = float(found.stored_arrays["widening"])
    assert found.verdict.widened == round(times, 2) > 1
    matched_filter = model_of(bench.day.day.press)
    assert matched_filter is not None
    assert matched_filter.model.widened(1.0) is matched_filter.model
    wide = replace(matched_filter.model, scale=times * matched_filter.model.scale)
    score = wide.score(found.stored_arrays["values"][None], found.stored_arrays["page_features"][None])[0]
    assert found.verdict.score == score
    kept = StoredArrays(dict(found.stored_arrays), "matched_filter")
    assert detector("matched_filter", bench.day.day.press).decided_again(kept).score == score
    assert f"tolerances {times:.3g} times as wide" in judged(found.verdict, (36.0, 44.0))
    before = {name: array for name, array in found.stored_arrays.items() if name != "widening"}
    plain = (
        detector("matched_filter", bench.day.day.press)
        .decided_again(StoredArrays(before, "matched_filter"))
        .score
    )
    assert (
        plain
        == matched_filter.model.score(
            found.stored_arrays["values"][None], found.stored_arrays["page_features"][None]
        )[0]
        != score
    )


def test_what_people_look_at_is_there_when_asked_for(bench: Bench) -> None:
    page, rng = bench.page(3), np.random.default_rng(5)
    scan = bench.scan(page, rng)
    scan[0, 150:200, 150:200] = 60  # a dark square 5 mm wide
    done = bench.inspector.inspect(bench.inspector.prepare(page), scan, scan_name="scan")
    assert done.expect().expected_dn.shape == done.measured_dn.shape
    lines, columns = done.area
    row, column = (175 - lines.start) // 8, (175 - columns.start) // 8
    z = done.block_z[0]
    assert z.shape == ((lines.stop - lines.start) // 8, (columns.stop - columns.start) // 8)
    assert z[row, column] < -10  # darker than it should be
    assert np.median(np.abs(z)) < 3


def test_scans_that_do_not_fit_are_refused(bench: Bench) -> None:
    prepared = bench.inspector.prepare(bench.page(0))
    with pytest.raises(ScanError, match="399 pixels"):
        bench.inspector.inspect(prepared, np.zeros((1, 600, 399), np.uint16), scan_name="scan")


def test_ours_is_chosen_where_the_press_was_taught_it(trained_press: Press, press: Press) -> None:
    assert detector(None, trained_press).name == "matched_filter"
    assert detector(None, press).name == "chi-square"
    assert "10 alarms" in Inspector.of(trained_press).guarantee
    for name in ("matched_filter", "bayes"):
        with pytest.raises(RequestError, match="was not trained for"):
            detector(name, press)


@pytest.mark.parametrize("fringes", [False, True])
def test_teaching_and_inspecting_follow_fringes_where_the_press_does(
    trained_press: Press, make_page: MakePage, fringes: bool
) -> None:
    bench = Bench(replace(trained_press, fringes=fringes), make_page)
    _, taught_with = bench.day.design(0)
    used = bench.inspector.prepare(bench.page(0)).prepared_page.prepared_page
    assert (taught_with.overlaps is not None) == (used.overlaps is not None) == fringes
    assert bench.verdict(0).verdict == "good"
