"""At the press: sign in, an alarm appears while the run goes on, one tap answers it, and nothing is lost meanwhile."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from packages.console.tests.consoles import PASSWORD

from prooflight_console.accounts.roles import Role
from prooflight_line.journal.journal import Journal
from prooflight_line.testing.sample_runs import facts, misprint, sheet

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from packages.console.tests.browser.conftest import Visitor
    from packages.console.tests.browser.serving import Serving
    from playwright.sync_api import Page

STREAK_MM = (61.0, 0.0, 1.6, 297.0)
Written = tuple[Journal, int]


@pytest.fixture
def written(emptied: Path) -> Iterator[Written]:
    """A journal whose run goes on: 20 good sheets so far."""
    with Journal.open(str(emptied)) as journal:
        run = journal.begin_run(facts(0))
        record(journal, run, range(20))
        yield journal, run


def record(journal: Journal, run: int, numbers: range, *, bad: bool = False) -> None:
    rng = np.random.default_rng([26, numbers.start])
    for number in numbers:
        made = misprint(number, rng, kind="streak", box_mm=STREAK_MM) if bad else sheet(number, rng)
        journal.record(run, made)
    assert journal.commit()


def shown(page: Page) -> list[int]:
    """Numbers of the sheets in the strip, as it has them."""
    told: list[str] = page.locator("#strip .unseen").all_text_contents()
    return [int(one) for one in told]


def wait_for_sheet(page: Page, number: int) -> None:
    page.wait_for_selector(f"#strip li:last-child .unseen:text-is('{number}')", state="attached")


def test_the_first_link_chooses_a_password_and_signs_in(
    written: Written, emptied: Path, serve: Callable[..., Serving], visit: Callable[..., Visitor]
) -> None:
    console = serve(emptied)
    secret = console.accounts.first_link()
    visitor = visit(console)
    page = visitor.goto(f"/welcome#{secret}")
    assert secret not in page.url, "the secret stays in the bar, and in the history"
    page.fill("[name=password]", PASSWORD)
    page.fill("[name=again]", PASSWORD)
    page.click("button.main")
    page.wait_for_selector(".band.good")
    page.click("summary.who")
    page.click("[hx-post='/sign-out']")
    page.wait_for_url("**/sign-in")
    page.fill("[name=name]", "admin")
    page.fill("[name=password]", "not the password")
    visitor.expected.append("401")
    page.click("button.main")
    page.wait_for_selector("[role=alert]")
    visitor.sign_in("admin", path="/search")


def test_an_alarm_appears_is_answered_with_one_tap_and_stands_in_the_report(
    written: Written, emptied: Path, serve: Callable[..., Serving], visit: Callable[..., Visitor]
) -> None:
    (journal, run), console = written, serve(emptied)
    visitor = visit(console, has_touch=True)
    page = visitor.signed_in(console.person(Role.OPERATOR, "Jan")).goto("/")
    page.wait_for_selector(".band.good")
    record(journal, run, range(20, 24), bad=True)
    page.wait_for_selector(".band.stop")
    wait_for_sheet(page, 23)
    assert shown(page) == list(range(24))
    assert page.title().startswith("●")
    page.locator(".incident a").first.tap()
    page.wait_for_selector("#viewers[data-ready]")
    page.fill("#note", "dust on the glass")
    page.locator(".tap.false-alarm").tap()
    page.wait_for_selector(".tap.false-alarm[aria-pressed=true]")
    assert "dust on the glass" in page.inner_text(".words")
    page = visitor.goto(f"/report/{run}")
    told = page.inner_text("main")
    assert "Jan" in told
    assert "dust on the glass" in told
    figures = page.locator(".figures dd").all_text_contents()
    assert figures[2].startswith("4"), "four sheets were a false alarm"
    page = visitor.goto("/")
    page.wait_for_selector(".band.good")
    page.wait_for_selector("text=No open incident")


def test_the_keyboard_is_enough(console: Serving, visit: Callable[..., Visitor]) -> None:
    page = visit(console).signed_in("operator").goto("/")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "main"
    page.goto(console.address + "/runs/1/incidents/1")
    page.wait_for_selector("#viewers[data-ready]")
    page.keyboard.press("m")
    page.wait_for_selector(".tap.misprint[aria-pressed=true]")


def test_a_server_that_starts_again_under_an_open_page_loses_nothing(
    written: Written, emptied: Path, serve: Callable[..., Serving], visit: Callable[..., Visitor]
) -> None:
    (journal, run), console = written, serve(emptied)
    visitor = visit(console)
    page = visitor.signed_in(console.person(Role.VIEWER)).goto("/")
    record(journal, run, range(20, 25))
    wait_for_sheet(page, 24)
    page.evaluate("window.same = true")
    visitor.expected += ["ERR_CONNECTION_REFUSED", "ERR_INCOMPLETE_CHUNKED_ENCODING", "ERR_EMPTY_RESPONSE"]
    console.stop()
    page.wait_for_selector("#away:not([hidden])")
    record(journal, run, range(25, 40))
    console.start()
    wait_for_sheet(page, 39)
    assert shown(page) == list(range(40)), "none is missing, none stands there twice"
    page.wait_for_selector("#away", state="hidden")
    assert page.evaluate("window.same"), "it caught up without loading the page again"


def test_another_language_says_the_same(console: Serving, visit: Callable[..., Visitor]) -> None:
    page = visit(console).signed_in("viewer").goto("/")
    page.click("summary.who")
    page.click("[hx-post='/language/de']")
    page.wait_for_selector("html[lang=de]")
    for path, words in (("/report/1", "Fehlalarme"), ("/search", "Suchen"), ("/setup", "Kamera")):
        page.goto(console.address + path)
        assert words in page.inner_text("main")
