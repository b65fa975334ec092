"""Search and charts by hand: sorting, many labels at once and back, saved searches, and from a bar to its sheets."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from packages.console.tests.browser.conftest import Visitor

FOUND = ".found tbody tr:not(.behind)"


def test_sheets_are_sorted_labelled_taken_back_and_saved(admin: Visitor) -> None:
    page = admin.goto("/search?verdict=misprint&kind=spots-voids")
    assert page.inner_text(".hits .total") == "9 sheets"
    page.click("th a:has-text('Size')")
    page.wait_for_url("**sort=-size**")
    assert page.get_attribute("th:has-text('Size')", "aria-sort") == "descending"
    sizes = [float(text.split()[0]) for text in page.locator(f"{FOUND} td:nth-child(4)").all_inner_texts()]
    assert sizes == sorted(sizes, reverse=True)
    page.check(f"{FOUND} >> nth=1 >> [name=pick]")
    page.fill("#bulk-note", "lint")
    page.click("#bulk .false-alarm")
    page.wait_for_selector("#labelled:has-text('1 sheet labelled.')")
    assert page.locator(f"{FOUND}:has-text('False alarm')").count() == 1
    page.click("#bulk .misprint")
    page.wait_for_selector("#labelled:has-text('9 sheets labelled.')")
    page.click("#labelled button")
    page.wait_for_selector("#labelled", state="detached")
    assert page.locator(f"{FOUND} td:last-child:has-text('Misprint')").count() == 0
    page.fill("#save-name", "spots")
    page.click(".save button")
    page.click(".saved a:has-text('spots')")
    page.wait_for_url("**kind=spots-voids**")
    assert page.locator(FOUND).count() == 9
    page.click(".saved button")
    page.wait_for_selector(".saved", state="detached")


def test_a_bar_leads_to_its_sheets_and_runs_get_a_common_report(admin: Visitor) -> None:
    page = admin.goto("/report")
    for run in (1, 2):
        page.check(f"[name=run][value='{run}']")
    page.click("text=Common report of the chosen runs")
    page.wait_for_selector("text=Of 2 runs:")
    stated = page.inner_text("#by-kind li:has-text('Streak') b")
    page.click("#by-kind a:has-text('Streak')")
    page.wait_for_selector(".found")
    assert page.inner_text(".hits .total") == f"{stated} sheets"
