"""A sheet of the random sample: its whole scan beside the page as expected, and one tap says that it was good."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

import pytest
from packages.console.tests.browser.test_fit_for_use import fit_for_everybody
from packages.console.tests.drawn_sheets import MIDDLE, write_drawn

from prooflight.cli import run
from prooflight_console.accounts.roles import Role
from prooflight_line.journal.labels import LabelStore, run_key

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from packages.console.tests.browser.conftest import Visitor
    from packages.console.tests.browser.serving import Serving
    from playwright.sync_api import Page, Route

    from prooflight.pages.raster import Page as JobPage
    from prooflight.press.artefact import Press

SEEN: Final = """() => {
  const told = JSON.parse(document.getElementById("picture").textContent);
  const canvas = document.querySelector("figure[data-layer=scan] canvas");
  const [wide, high] = [canvas.width, canvas.height];
  const [scan, expected, difference] = ["scan", "expected", "difference"].map((layer) => {
    const copy = new OffscreenCanvas(wide, high).getContext("2d", { willReadFrequently: true });
    copy.drawImage(document.querySelector(`figure[data-layer=${layer}] canvas`), 0, 0);
    return copy.getImageData(0, 0, wide, high).data;
  });
  let [left, top, right, bottom, count, apart, bare, x, y] = [wide, high, 0, 0, 0, 0, 0, 0, 0];
  for (let at = 0; at < scan.length; at += 4) {
    if (![scan, expected, difference].every((one) => one[at + 3] === 255)) continue;
    const [column, row] = [(at / 4) % wide, Math.floor(at / 4 / wide)];
    [left, top] = [Math.min(left, column), Math.min(top, row)];
    [right, bottom] = [Math.max(right, column), Math.max(bottom, row)];
    count += 1;
    apart += Math.abs(scan[at + 1] - expected[at + 1]);
    if (difference[at + 2] - difference[at] < 60) continue;
    [bare, x, y] = [bare + 1, x + column, y + row];
  }
  if (!count || !bare) return null;
  return {
    apart: apart / count,
    column: (x / bare - left) / (right + 1 - left) * told.width,
    row: (y / bare - top) / (bottom + 1 - top) * told.height,
    shape: [(right + 1 - left) / (bottom + 1 - top), told.width / told.height],
  };
}"""
"""What the canvases show: how far scan and expected page lie apart on average, and where the scan is lighter, in pixels
of the sheet's picture; null: not yet. Copies are read: browsers warn of a canvas that is read again and again.
"""


@pytest.fixture
def sampled(
    tmp_path: Path,
    page: JobPage,
    press: Press,
    serve: Callable[..., Serving],
) -> Serving:
    """A console on a run of three sheets that passed and were drawn."""
    console = serve(tmp_path / "journal.sqlite", **write_drawn(tmp_path, page, press, sheets=3))
    console.person(Role.OPERATOR, "Jan")
    return console


def opened(page: Page) -> None:
    """The pictures come by themselves."""
    page.wait_for_selector("#viewers[data-ready]")
    assert page.locator("figcaption").all_text_contents() == ["Camera image", "Expected", "Difference"]


def test_a_drawn_sheet_opens_whole_and_is_told_by_one_tap(
    sampled: Serving, visit: Callable[..., Visitor], capsys: pytest.CaptureFixture[str]
) -> None:
    visitor = visit(sampled, has_touch=True)
    page = visitor.signed_in("Jan").goto("/report/1")
    page.locator("a[href='/runs/1/sheets/0']").first.tap()
    opened(page)
    told = json.loads(page.inner_text("#picture"))
    assert (told["layers"], told["whole"]) == (["scan", "expected", "difference"], True)
    seen: dict[str, Any] = page.wait_for_function(SEEN).json_value()
    assert seen["apart"] < 8, "the scan lies where the page does"
    assert seen["shape"][0] == pytest.approx(seen["shape"][1], rel=0.03), "all of it"
    assert (seen["row"], seen["column"]) == pytest.approx(MIDDLE, abs=8)

    page.locator(".tap.good").tap()
    page.wait_for_selector(".tap.good[aria-pressed=true]")
    (word,) = LabelStore(sampled.journal).of_run(run_key(sampled.console.reading.run(1)))
    assert (word.sheet, word.word, word.by) == (0, "good", "Jan")
    page.click("text=Next")
    page.wait_for_url("**/runs/1/sheets/1")
    opened(page)
    visitor.goto("/report/1")
    assert page.locator("a[href='/runs/1/sheets/0']").count() == 0
    assert page.locator("a[href='/runs/1/sheets/1']").count() > 0
    assert run(["run", "sampled", "1", "--all", "--json", "--journal", str(sampled.journal)]) == 0
    sheets = json.loads(capsys.readouterr().out)["sheets"]
    assert [(one["sheet"], one["label"], one["by"]) for one in sheets] == [
        (0, "good", "Jan"),
        (1, None, None),
        (2, None, None),
    ]


def test_pictures_that_come_disturb_no_note_and_are_told_where_they_do_not(
    sampled: Serving, visit: Callable[..., Visitor]
) -> None:
    visitor = visit(sampled).signed_in("Jan")
    page = visitor.page
    held: list[Route] = []
    page.route("**/sheets/0/pictures", lambda asked: held.append(asked))
    with page.expect_request("**/sheets/0/pictures"):
        visitor.goto("/runs/1/sheets/0").wait_for_selector("#coming-note")
    fit_for_everybody(page)
    page.fill("#sheet-note", "as it should be")
    held[0].fulfill(status=503)
    visitor.expected.append("503")
    page.wait_for_selector("#coming-not")
    assert not page.is_visible("#coming-note")
    with page.expect_request("**/sheets/0/pictures"):
        visitor.goto("/runs/1/sheets/0").wait_for_selector("#coming-note")
    page.fill("#sheet-note", "as it should be")
    held[1].continue_()
    opened(page)
    assert page.input_value("#sheet-note") == "as it should be"
    page.keyboard.press("Tab")
    page.keyboard.press("g")
    page.wait_for_selector(".words q:has-text('as it should be')")


def test_a_drawn_sheet_is_fit_for_everybody(sampled: Serving, visit: Callable[..., Visitor]) -> None:
    page = visit(sampled).signed_in("Jan").goto("/runs/1/sheets/2")
    opened(page)
    fit_for_everybody(page)
