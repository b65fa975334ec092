"""The page Engineering in a browser: from the page of the press to a version in use, and back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from packages.console.tests.browser.test_fit_for_use import fit_for_everybody
from packages.line.tests.cli.test_feedback import SHEETS, told, watched

from prooflight.press.artefact import Press
from prooflight_console.accounts.roles import Role
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from packages.console.tests.browser.conftest import Visitor
    from packages.console.tests.browser.serving import Serving

PATIENCE_MS = 300_000
"""Only a test that fails waits so long."""


@pytest.mark.parametrize("locale", ["en-GB", "de-DE"])
def test_a_version_is_made_used_and_taken_back(
    serve: Callable[..., Serving],
    visit: Callable[..., Visitor],
    trained_press: Press,
    tmp_path: Path,
    locale: str,
) -> None:
    path, journal = tmp_path / "x.press", tmp_path / "journal.sqlite"
    trained_press.save(path)
    with Journal.open(str(journal)) as opened:
        run_id = watched(opened, trained_press)
    told(journal, run_id, range(SHEETS))
    console = serve(journal, presses=(path,))
    console.person(Role.ENGINEER)
    visitor = visit(console, locale=locale).signed_in("engineer")
    page = visitor.goto("/press")
    page.click("a[href='/press/engineering']")
    page.wait_for_selector("#thresholds tbody tr")
    fit_for_everybody(page)
    page.set_viewport_size({"width": 390, "height": 800})
    over = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    assert over <= 0
    page.locator("#thresholds input[type=range]").fill("3")
    page.wait_for_selector("#thresholds input[value='3']")
    page.click("form:has(input[value=recalibrate]) button")
    page.wait_for_selector("#work form button.main", timeout=PATIENCE_MS)
    page.wait_for_selector("#versions .version")
    assert Press.load(path).digest == trained_press.digest
    fit_for_everybody(page)
    with page.expect_navigation():
        page.click("#work form button.main")
    assert Press.load(path).digest != trained_press.digest
    page.wait_for_selector(".version")
    fit_for_everybody(page)
    with page.expect_navigation():
        page.click(".version form button")
    assert Press.load(path).digest == trained_press.digest
