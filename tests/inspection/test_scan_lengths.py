"""What lies on the page is judged, whatever the scan's length; the lines beyond the page say nothing."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from dataclasses import dataclass, replace
from importlib import util
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.simulated_days import PressDay
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.paper.detector import page_evidence
from prooflight.detectors.placing import inside
from prooflight.inspection.inspector import Inspector
from prooflight.prediction.predict import predict
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.simulation.misprints.kinds import draw_misprint
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile

    MakePage = Callable[..., Page]

SCRIPT = Path(__file__).with_name("inspect_lengths.py")
SAME = 1e-4
"""Of the score: sums in single precision are added up in another order by other processors and numbers of threads;
2.6e-6 was seen. Lines of another scan (what this guards against) moved it by 2e-3 and more."""
NEAR = 2.5
"""Where lines are missing, which would have told where the page's lower edge lies: in log odds. Far from the threshold
a hundredth of a forest's votes is 1, and two forests are added; 1.8 was seen."""


def _loaded() -> Any:
    spec = util.spec_from_file_location("inspect_lengths", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


inspected = _loaded().inspected


@dataclass(frozen=True, kw_only=True)
class Designs:
    make: MakePage

    def page(self, index: int) -> Page:
        return self.make(index + 1, number=index + 1)


def press_scan(press: Press, make_page: MakePage, kind: str = "") -> tuple[Page, NDArray[np.uint16]]:
    """A page and its scan in the press world; seeds 5 and 3."""
    designs = Designs(make=make_page)
    day = PressDay.of(press, designs, seed=5, first=0).day
    page, rng = designs.page(2), np.random.default_rng(3)
    printed = page
    if kind:
        printed = draw_misprint(page, kind, 0.9, others=[1], fetch=designs.page, rng=rng).page
    return page, day.recorded(day.seen_in_press(printed, rng, IN_PLACE), rng)


def lengths_about(press: Press, page: Page, seed: int) -> tuple[int, list[int]]:
    """The nominal length, and 20 about it that hold the page: the shortest and one two longer are among them."""
    nominal = press.geometry.lines(page.height_mm)
    rows, _ = press.geometry.on_page(page.width_mm, page.height_mm)
    drawn = np.random.default_rng(seed).integers(rows.stop, nominal + 60, 18)
    return nominal, [rows.stop, nominal + 2, *drawn.tolist()]


def assert_alike(rows: list[dict[str, Any]], *, nominal: int) -> None:
    first = rows[0]
    assert first["lines"] == nominal
    for row in rows:
        assert row["verdict"] == first["verdict"], row
        if row["lines"] >= nominal:
            assert row["kind"] == first["kind"], row
            assert row["score"] == pytest.approx(first["score"], rel=SAME), row
        else:
            assert row["score"] == pytest.approx(first["score"], abs=NEAR), row


def test_a_scans_length_does_not_change_its_verdict(
    trained_press: Press, make_page: MakePage, tmp_path: Path
) -> None:
    """20 lengths, 10 in each of two fresh processes, where what memory held before is not the same."""
    page, scan = press_scan(trained_press, make_page)
    nominal, lengths = lengths_about(trained_press, page, seed=28)
    assert scan.shape[1] == nominal
    trained_press.save(tmp_path / "x.press")
    (tmp_path / "scan.pickle").write_bytes(pickle.dumps((page, scan)))
    command = [
        sys.executable,
        str(SCRIPT),
        str(tmp_path / "x.press"),
        str(tmp_path / "scan.pickle"),
        "matched_filter",
    ]
    rows = inspected(trained_press, page, scan, "matched_filter", [nominal])
    for part in (lengths[:10], lengths[10:]):
        done = subprocess.run([*command, *map(str, part)], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-500:]
        rows += [json.loads(line) for line in done.stdout.splitlines()]
    assert len(rows) == 21
    assert_alike(rows, nominal=nominal)
    for here, there in zip(
        inspected(trained_press, page, scan, "matched_filter", lengths[:2]), rows[1:3], strict=True
    ):
        assert here == there | {"score": pytest.approx(there["score"], rel=SAME)}


def test_a_misprint_is_one_at_any_length(trained_press: Press, make_page: MakePage) -> None:
    page, scan = press_scan(trained_press, make_page, "streak")
    nominal, lengths = lengths_about(trained_press, page, seed=5)
    rows = inspected(trained_press, page, scan, "matched_filter", [nominal, *lengths[:5]])
    assert rows[0]["verdict"] == "misprint"
    assert_alike(rows, nominal=nominal)


def test_lengths_do_not_change_the_papers_verdicts(press: Press, page: Page) -> None:
    """Of a page in its place, to the last bit: what it rests on lies on the page."""
    seen = predict(page, sensors=press.sensors, geometry=press.geometry)
    scan = ideal_scan(seen, press, np.random.default_rng(2))
    nominal, lengths = lengths_about(press, page, seed=4)
    rows = inspected(press, page, scan, "chi-square", [nominal, *lengths])
    assert {(row["verdict"], row["score"]) for row in rows} == {("good", rows[0]["score"])}
    evidence, of_longer = (
        page_evidence(page, np.pad(scan, ((0, 0), (0, more), (0, 0))), press.press_context())
        for more in (0, 7)
    )
    np.testing.assert_array_equal(evidence.block_z, of_longer.block_z)


def test_what_a_shorter_scan_lacks_is_not_judged(press: Press, page: Page) -> None:
    """Of a page that lies 1 mm too low, in a scan that ends where the page should."""
    placement = Placement(shift_mm=(0.0, 1.0))
    seen = predict(page, sensors=press.sensors, geometry=press.geometry, placement=placement)
    scan = ideal_scan(seen, press, np.random.default_rng(1))
    rows, _ = press.geometry.on_page(page.width_mm, page.height_mm)
    done = Inspector.of(press, "chi-square").inspect(page, scan[:, : rows.stop])
    assert done.verdict.shift_mm == pytest.approx((0.0, 1.0), abs=0.02)
    assert done.area[0].stop == rows.stop
    assert done.expect().expected_dn.shape == done.measured_dn.shape


def test_pixels_are_judged_one_by_one_or_taken_together_whatever_the_length(
    prototype: PressFile, two_sensor_press: Press, trained_press: Press, make_page: MakePage
) -> None:
    """A line of 401 pixels, which nothing divides, and two sensors with 400, of which two are taken together."""
    for other in (build_press(prototype, seed=1, pixels=401), two_sensor_press):
        press = other.with_detector("matched_filter", model_of(trained_press))
        page, scan = press_scan(press, make_page)
        nominal, lengths = lengths_about(press, page, seed=6)
        assert_alike(inspected(press, page, scan, "matched_filter", [nominal, *lengths[:4]]), nominal=nominal)


@pytest.mark.parametrize("size_mm", [(5.0, 5.0), (5.0, 30.0), (30.0, 5.0)])
def test_the_least_pages_are_judged(
    trained_press: Press, make_page: MakePage, size_mm: tuple[float, float]
) -> None:
    """A ruined one is never good; a good one may alarm the matched filter, which cannot find it."""
    rows, columns = (round(extent_mm * trained_press.dpi / 25.4) + 1 for extent_mm in size_mm)
    whole = make_page(3)
    page = replace(whole, cmyk=np.ascontiguousarray(whole.cmyk[-rows:, :columns]))
    assert trained_press.geometry.lay(page) is page
    seen = predict(page, sensors=trained_press.sensors, geometry=trained_press.geometry)
    scan = ideal_scan(seen, trained_press, np.random.default_rng(1))
    ruined = scan.copy()
    ruined[:, :, ::3] = 0
    for name in ("matched_filter", "chi-square"):
        for one, words in ((scan, {"good", "misprint"}), (ruined, {"misprint", "not-inspected"})):
            done = Inspector.of(trained_press, name).inspect(page, one)
            assert done.verdict.verdict in words
            assert done.verdict.verdict == "not-inspected" or np.isfinite(done.verdict.score or np.nan)
    beyond = Placement(shift_mm=(0.0, trained_press.geometry.lead_in_mm + page.height_mm - 0.3))
    area = inside(page, trained_press.geometry, beyond, lines=scan.shape[1])
    assert area == trained_press.geometry.on_page(page.width_mm, page.height_mm)
