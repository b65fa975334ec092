"""Who may not, is told so: roles, sessions that end, changes that nobody meant; and script in a name is a name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight_console.accounts.account_store import SESSION_S
from prooflight_console.accounts.roles import Role
from prooflight_line.journal.journal import Journal
from prooflight_line.testing.sample_runs import facts, misprint

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from packages.console.tests.browser.conftest import Visitor
    from packages.console.tests.browser.serving import Serving

EVIL = "<img src=x onerror=document.title=1>"
"""As long as a name may be."""


def test_nobody_is_asked_to_sign_in_and_a_viewer_is_refused(
    console: Serving, visit: Callable[..., Visitor]
) -> None:
    visitor = visit(console)
    page = visitor.goto("/setup/users")
    assert page.url == console.address + "/sign-in?next=%2Fsetup%2Fusers"
    assert page.request.get(console.address + "/api/v1/people").status == 401
    visitor.expected.append("403")
    page.fill("[name=name]", "viewer")
    page.fill("[name=password]", "correct horse battery")
    page.click("button.main")
    page.wait_for_selector("text=Higher role required")
    assert page.request.get(console.address + "/setup/audit").status == 403
    assert page.request.get(console.address + "/api/v1/people").status == 403
    visitor.goto("/setup")
    assert page.locator(".subtabs a").all_text_contents() == ["Press and camera", "Zones", "Tokens", "Kiosks"]
    visitor.goto("/runs/1/incidents/1")
    assert page.locator(".tap").count() == 0, "a viewer has nothing to tap"


def test_a_change_without_the_sessions_token_is_refused(
    console: Serving, visit: Callable[..., Visitor]
) -> None:
    visitor = visit(console)
    page = visitor.signed_in("operator").goto("/")
    visitor.expected.append("403")
    ask = """async ([path, headers]) => (await fetch(path, {method: "POST", headers,
        body: new URLSearchParams({label: "misprint"})})).status"""
    path = "/runs/1/incidents/1/label"
    assert page.evaluate(ask, [path, {}]) == 403
    assert page.evaluate(ask, [path, {"X-CSRF-Token": "guessed"}]) == 403
    csrf = page.get_attribute("meta[name=csrf]", "content")
    assert page.evaluate(ask, [path, {"X-CSRF-Token": csrf}]) == 200


def test_an_ended_session_leads_back_to_where_one_was(
    console: Serving, visit: Callable[..., Visitor]
) -> None:
    visitor = visit(console)
    page = visitor.signed_in("operator").goto("/runs/1/incidents/1")
    page.wait_for_selector("#viewers[data-ready]")
    console.clock.now_s += SESSION_S + 1
    visitor.expected += ["401", "Tile .* failed to load"]
    page.click(".tap.misprint")
    page.wait_for_url("**/sign-in*")
    visitor.sign_in("operator", path="/search?job=catalogue")


def test_script_in_names_shows_as_text(
    emptied: Path, serve: Callable[..., Serving], visit: Callable[..., Visitor]
) -> None:
    rng = np.random.default_rng(26)
    with Journal.open(str(emptied)) as journal:
        run = journal.begin_run(facts(0, job=EVIL, press=EVIL, source=EVIL, settings={EVIL: EVIL}))
        for number in range(3):
            told = misprint(number, rng, kind=EVIL, box_mm=(10.0, 10.0, 5.0, 5.0), page=EVIL)
            journal.record(run, told)
    console = serve(emptied)
    visitor = visit(console)
    page = visitor.signed_in(console.person(Role.ADMIN, EVIL)).page
    console.accounts.new_token(EVIL, EVIL, ["read"], by=EVIL)
    page.goto(console.address + "/runs/1/incidents/1")
    page.fill("#note", EVIL)
    page.click(".tap.false-alarm")
    page.wait_for_selector(".words q")
    paths = ("/", "/runs/1/incidents/1", "/report", "/report/1", "/search", "/press", "/setup")
    for path in (*paths, "/setup/users", "/setup/tokens", "/setup/audit", "/runs/1/reprint"):
        page.goto(console.address + path)
        page.get_by_text(EVIL).first.wait_for(state="attached")
        assert page.locator("img[src=x]").count() == 0, path
        assert "Prooflight" in page.title(), path
