"""The page Queue: files are sent from it, jobs are moved on it, and everybody can use it, on a phone too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from packages.console.tests.browser.test_fit_for_use import fit_for_everybody
from packages.line.tests.job_queue.test_pairing import ORDER, Filling

from prooflight_console.accounts.roles import Role

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from packages.console.tests.browser.conftest import Visitor
    from packages.console.tests.browser.serving import Serving


@pytest.mark.parametrize("language", ["en", "de"])
def test_files_are_sent_and_jobs_moved(
    emptied: Path,
    serve: Callable[..., Serving],
    visit: Callable[..., Visitor],
    tmp_path: Path,
    language: str,
) -> None:
    filling = Filling(tmp_path / "jobs")
    console = serve(emptied, queue=filling.folder.path)
    visitor = visit(console, locale=f"{language}-CH").signed_in(console.person(Role.OPERATOR))
    page = visitor.goto("/queue")
    page.wait_for_selector("#jobs .empty")
    fit_for_everybody(page)
    files = {"order.xjdf": ORDER, "menu.pdf": "good", "other.pdf": "good too", "bad.pdf": "bad"}
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    page.set_input_files("[name=files]", [tmp_path / name for name in files])
    page.click("#send button")
    page.wait_for_selector("#jobs >> text=order.xjdf")
    filling.fill()
    page.wait_for_selector("td >> text=J-17")
    fit_for_everybody(page)
    page.set_viewport_size({"width": 390, "height": 800})
    over = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    assert over <= 0
    hold = {"en": "Hold, other.pdf", "de": "Anhalten, other.pdf"}[language]
    page.get_by_role("button", name=hold).click()
    page.wait_for_selector("td >> text=" + {"en": "held", "de": "angehalten"}[language])
    assert [entry.file.name for entry in filling.folder.entries("held")] == ["other.pdf"]
