"""Labels at the press: Enter gives none, each can be undone, and a sheet is vouched for by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from packages.console.tests.browser.conftest import Visitor
    from packages.console.tests.browser.serving import Serving

BLIND = 332
"""A sheet of which the camera lost lines, and that was not inspected."""


def test_enter_labels_nothing_and_a_label_is_undone_with_one_tap(
    console: Serving, visit: Callable[..., Visitor]
) -> None:
    page = visit(console).signed_in("operator").goto("/runs/1/incidents/1")
    page.wait_for_selector("#viewers[data-ready]")
    page.fill("#note", "4012345678901")
    page.press("#note", "Enter")
    page.focus(".tap.misprint")
    page.keyboard.press("Enter")
    page.reload()
    page.wait_for_selector("#viewers[data-ready]")
    assert page.locator(".words b").count() == 0, "a reader of bar codes ends with Enter"
    page.fill("#note", "dust")
    page.click(".tap.false-alarm")
    page.wait_for_selector(".tap.false-alarm[aria-pressed=true]")
    page.click("#said .undo")
    page.wait_for_selector(".tap.false-alarm[aria-pressed=false]")
    page.wait_for_selector("#said .undone")
    assert "undone by operator" in page.inner_text("#said")
    page.keyboard.press("f")
    page.wait_for_selector(".tap.false-alarm[aria-pressed=true]")
    assert page.locator("#said .words > li").count() == 2
    assert "What the labels changed" in page.inner_text("#said")
    page.keyboard.press("z")
    page.wait_for_selector(".tap.false-alarm[aria-pressed=false]")
    page.keyboard.press("ArrowRight")
    page.wait_for_url("**/incidents/2")
    page.keyboard.press("ArrowLeft")
    page.wait_for_url("**/incidents/1")
    page.keyboard.press("n")
    page.wait_for_url(lambda address: not address.endswith("/incidents/1"))


def test_an_alarm_is_shelved_on_its_page_and_the_shelving_ended_in_the_list(
    console: Serving, visit: Callable[..., Visitor]
) -> None:
    page = visit(console, has_touch=True).signed_in("operator").goto("/runs/1/incidents/1")
    page.locator("#shelve summary").tap()
    page.select_option("#shelve [name=minutes]", "240")
    page.fill("#shelve [name=reason]", "plate change at noon")
    page.locator("#shelve button").tap()
    page.wait_for_selector("#shelve .shelving")
    page.goto(console.address + "/alarms?run=1&show=shelved")
    assert "plate change at noon" in page.inner_text(".shelving")
    page.locator(".shelving button").tap()
    page.wait_for_selector(".empty")


def test_a_sheet_that_nobody_inspected_has_no_label_and_is_vouched_for_with_a_reason(
    console: Serving, visit: Callable[..., Visitor]
) -> None:
    page = visit(console).signed_in("operator").goto("/runs/1/reprint")
    row = page.locator(f"a[href='/runs/1/sheets/{BLIND}']")
    assert row.count() == 1
    before = page.inner_text(".total")
    row.click()
    page.wait_for_selector("#said-of-sheet")
    assert page.locator(".tap").count() == 0
    page.press("#reason", "Enter")
    page.click(".vouch button")
    page.wait_for_selector("#said-of-sheet [role=alert]")
    page.fill("#reason", "held against the proof")
    page.press("#reason", "Enter")
    assert page.locator("#said-of-sheet .words b").count() == 0
    page.click(".vouch button")
    page.wait_for_selector("#said-of-sheet .words b")
    assert "held against the proof" in page.inner_text("#said-of-sheet")
    page.goto(console.address + "/runs/1/reprint")
    assert page.locator(f"a[href='/runs/1/sheets/{BLIND}']").count() == 0
    assert page.inner_text(".total") != before
    page.goto(console.address + f"/runs/1/sheets/{BLIND}")
    page.click("#said-of-sheet .undo")
    page.wait_for_selector("#said-of-sheet .undone")
    page.goto(console.address + "/runs/1/reprint")
    assert page.inner_text(".total") == before
