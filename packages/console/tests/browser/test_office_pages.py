"""In the office: a report that prints, search, drift charts, users, tokens, and an audit that is whole."""

from __future__ import annotations

import re
import sqlite3
from dataclasses import replace
from typing import TYPE_CHECKING

from packages.console.tests.consoles import PASSWORD

from prooflight.inspection.inspector import Inspector
from prooflight.inspection.redeciding import evidence_to_store
from prooflight.rng import stream
from prooflight.simulation.scans import scan_page
from prooflight_console.accounts.roles import Role
from prooflight_line.journal.journal import Journal
from prooflight_line.testing.sample_runs import facts, sheet

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from packages.console.tests.browser.conftest import Visitor
    from packages.console.tests.browser.serving import Serving

    from prooflight.pages.raster import Page as JobPage
    from prooflight.press.artefact import Press


def test_a_report_prints_black_on_white_on_one_page(admin: Visitor) -> None:
    page = admin.goto("/report/1")
    page.evaluate("document.documentElement.dataset.theme = 'dark'")
    page.emulate_media(media="print")
    colour = "element => getComputedStyle(element).backgroundColor"
    assert page.eval_on_selector(".card", colour) == "rgb(255, 255, 255)"
    assert not page.is_visible(".bar")
    assert not page.is_visible("a[href$='report.pdf']")
    assert page.is_visible(".heat svg")
    printed = page.pdf(format="A4", print_background=True)
    assert printed.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b(?!s)", printed)) == 1


def test_search_finds_by_kind_and_shows_more_without_twice_the_same(admin: Visitor) -> None:
    page = admin.goto("/search")
    page.select_option("[name=kind]", "streak")
    page.fill("[name=job]", "catalogue")
    page.click("form button[type=submit]")
    page.wait_for_url("**kind=streak**")
    found = page.locator(".found tbody tr:not(.behind)")
    assert found.count() == 25, "of run 1, every second sheet from 210 to 259"
    page = admin.goto("/search?verdict=misprint")
    assert found.count() == 50
    page.click(".behind a")
    page.wait_for_selector(".found tbody tr:nth-child(61)")
    addresses = page.locator(".found .main-cell a").evaluate_all("all => all.map(one => one.href)")
    assert len(addresses) == len(set(addresses))
    page.fill("[name=job]", "no such job")
    page.click("form button[type=submit]")
    page.wait_for_selector("text=No sheet matches these criteria.")


def test_two_runs_are_drawn_side_by_side(admin: Visitor) -> None:
    page = admin.goto("/press?run=2&against=1")
    page.wait_for_selector("#charts[data-ready]")
    assert page.locator(".chart canvas").count() == 16, "eight charts of each run"
    page.wait_for_selector(".compare")
    assert page.locator(".compare tbody tr").count() == 11
    densities = page.locator(".chart [role=img]").first.get_attribute("aria-label")
    assert densities is not None
    assert re.match(r"Density, run 2: cyan [-−\d.]+ %", densities)
    page.click("#theme")
    assert page.locator(".chart canvas").count() == 16, "drawn anew in the other theme"
    page = admin.goto("/press")
    page.wait_for_selector("#charts[data-ready]")
    assert page.locator(".chart canvas").count() == 8


def test_users_are_added_and_locked_out(admin: Visitor, visit: Callable[..., Visitor]) -> None:
    console, page = admin.console, admin.goto("/setup/users")
    page.fill("[name=name]", "Ada")
    page.select_option(".ask [name=role]", "viewer")
    page.click(".ask button")
    link = page.inner_text(".secret code")
    other = visit(console)
    other.page.goto(link)
    other.page.fill("[name=password]", PASSWORD)
    other.page.fill("[name=again]", PASSWORD)
    other.page.click("button.main")
    other.page.wait_for_selector("text=Ada")
    row = page.locator("tr", has_text="Ada")
    row.locator("select").select_option("operator")
    page.wait_for_selector(".secret", state="detached")
    assert console.accounts.person("Ada").role is Role.OPERATOR
    row.get_by_text("Lock", exact=True).click()
    row.get_by_text("Unlock", exact=True).wait_for()
    assert console.accounts.person("Ada").locked
    other.goto("/search")
    assert "/sign-in" in other.page.url, "her session ended with it"
    mine = page.locator("tr", has_text="you").locator("select")
    admin.expected.append("422")
    mine.select_option("viewer")
    page.wait_for_selector("text=the last admin who can sign in must remain an admin")


def test_a_token_is_shown_once_works_and_is_revoked(admin: Visitor, visit: Callable[..., Visitor]) -> None:
    console, page = admin.console, admin.goto("/setup/tokens")
    page.fill("[name=name]", "office")
    page.click(".ask button")
    secret = page.inner_text(".secret code")
    nobody, asked = visit(console), console.address + "/api/v1/runs"
    headers = {"Authorization": f"Bearer {secret}"}
    assert nobody.page.request.get(asked, headers=headers).status == 200
    page.reload()
    assert page.locator(".secret").count() == 0
    page.get_by_text("Revoke", exact=True).click()
    page.wait_for_selector("td.time:has-text('revoked')")
    assert nobody.page.request.get(asked, headers=headers).status == 401


def test_the_audit_says_whether_it_is_whole(admin: Visitor) -> None:
    console, page = admin.console, admin.goto("/setup/audit")
    assert "signed in" in page.locator("tbody tr").first.inner_text()
    page.get_by_role("button", name="Verify").click()
    page.wait_for_selector(".outcome.good")
    head = page.inner_text("#chain code")
    page.fill("[name=noted]", head)
    page.get_by_role("button", name="Verify").click()
    page.wait_for_selector(".outcome.good")
    with sqlite3.connect(console.accounts.path) as connection:
        connection.execute("drop trigger if exists audit_stays")
        triggers = connection.execute("select name from sqlite_master where type = 'trigger'").fetchall()
        for (name,) in triggers:
            connection.execute(f'drop trigger "{name}"')
        connection.execute("update audit set who = 'somebody else' where id = 2")
    connection.close()
    page.get_by_role("button", name="Verify").click()
    page.wait_for_selector(".outcome.stop")
    assert "row 2 was changed" in page.inner_text("#chain")


def test_a_verdict_made_again_is_the_same(
    press: Press,
    page: JobPage,
    emptied: Path,
    serve: Callable[..., Serving],
    visit: Callable[..., Visitor],
) -> None:
    artefact = emptied.with_name("x.press")
    digest = press.save(artefact)
    inspector = Inspector.of(press, "chi-square")
    prepared = inspector.prepare(page)
    rng = stream(4, "print", page.number)
    scan = scan_page(page, press=press, request=None, others=(), fetch=lambda _: page, rng=rng).dn
    looked = inspector.inspect(prepared, scan, scan_name="scan")
    evidence = dict(evidence_to_store(looked, prepared.page, press))
    record = replace(sheet(0, rng), verdict=looked.verdict, evidence=evidence)
    other = replace(record, sheet=1, verdict=replace(looked.verdict, score=(looked.verdict.score or 0) + 1))
    with Journal.open(str(emptied)) as journal:
        run = journal.begin_run(facts(0, press_digest=digest, detector="chi-square"))
        journal.record(run, record)
        journal.record(run, other)
    console = serve(emptied, presses=(artefact,))
    window = visit(console).signed_in(console.person(Role.ENGINEER)).goto("/runs/1/sheets/0")
    window.click("text=Recalculate verdict")
    window.wait_for_selector(".outcome.good:has-text('The verdict is unchanged.')")
    window.goto(console.address + "/runs/1/sheets/1")
    window.click("text=Recalculate verdict")
    window.wait_for_selector(".outcome.stop")
    assert window.locator(".again .other").count() == 1, "only the score is another"
    window.goto(console.address + "/setup")
    assert digest[:16] in window.inner_text("main")
