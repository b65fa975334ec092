"""Fit for everybody, for gloves, for phones and for slow lines: axe-core finds nothing, all is in reach."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

import pytest
from starlette.routing import Match

from prooflight_console.access import endpoint_rows
from prooflight_console.accounts.roles import Role

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from packages.console.tests.browser.conftest import Visitor
    from packages.console.tests.browser.serving import Serving
    from playwright.sync_api import Page

PAGES: Final = {
    "/sign-in": "main",
    "/welcome": "main",
    "/": ".band",
    "/runs/3/incidents/4": "#viewers[data-ready]",
    "/runs/1/sheets/5": "main",
    "/runs/1/reprint": "table",
    "/alarms?show=all": ".incident",
    "/alarms/statistics": ".course",
    "/alarms/hand-over": "textarea",
    "/report": "table",
    "/report/1": ".heat",
    "/quality?since=2026-05-01": ".pareto",
    "/search": "table",
    "/press?run=2&against=1": "#charts[data-ready]",
    "/press/engineering": "main h1",
    "/press/history": ".histories",
    "/kiosk": "main",
    "/setup": ".camera",
    "/setup/kiosks": "form",
    "/setup/zones": ".empty",
    "/setup/users": "table",
    "/setup/tokens": "form",
    "/setup/audit": "table",
    "/nowhere": ".code",
}
"""Every page, and what is there when it is whole."""
ELSEWHERE: Final = {
    "/setup/zones/1": "test_zones_drawn",
    "/sign-in/provider": "below, where nobody answers",
    "/presses": "test_presses",
    "/presses/sheets": "test_presses",
    "/queue": "test_queue_page",
}
"""Pages that need more than runs; zones beside a job are looked at in ``test_zones_page``."""
PARTS: Final = (
    *("/now/events", "/setup/camera/events", "/press/{run}/course", "/press/figures", "/setup/audit/chain"),
    *(
        "/press/engineering/thresholds",
        "/press/engineering/work",
        "/press/engineering/calibration",
        "/press/history/charts",
    ),
    *("/runs/{run}/sheets/{sheet}/again", "/runs/{run}/sheets/{sheet}/thumbnail", "/runs/{run}/reprint.csv"),
    *("/runs/{run}/report.pdf", "/search.csv", "/search.json"),
    *("/queue/control", "/queue/jobs"),
    *("/setup/zones/{job}/picture", "/sign-in/provider/return", "/static/{name:path}"),
    *("/healthz", "/metrics", "/readyz"),
)
"""What pages fetch, what leads to them, and what programs ask."""
LEAST_PX: Final = 44
"""WCAG 2.2, target size (enhanced)."""
TOO_SMALL: Final = """least => {
    const touched = "button, .button, select, summary, .tabs a, input:not([type=checkbox]):not([type=hidden])";
    return [...document.querySelectorAll(touched)]
        .filter((one) => one.offsetParent && one.getBoundingClientRect().height < least)
        .map((one) => one.outerHTML.slice(0, 120));
}"""
WIDTHS: Final = (360, 1024)
"""The narrowest phone, and a tablet, which is the narrowest screen that shows the tabs of a desk."""
CUT_OFF: Final = """() => {
    const cut = [];
    for (const link of document.querySelectorAll(".tabs a, .subtabs a, .tools > *")) {
        const box = link.getBoundingClientRect();
        if (box.width && (box.left < -0.5 || box.right > innerWidth + 0.5 || link.scrollWidth > link.clientWidth + 1))
            cut.push("navigation: " + link.textContent.trim());
    }
    for (const part of document.querySelectorAll("main *")) {
        const way = getComputedStyle(part).overflowX;
        if ((way === "auto" || way === "scroll") && part.scrollWidth > part.clientWidth + 1)
            cut.push(`scrolls sideways: ${part.className}, ${part.scrollWidth} px in ${part.clientWidth}`);
    }
    return cut;
}"""
MOST_BYTES: Final = 300_000


def fit_for_everybody(page: Page) -> None:
    """axe-core finds nothing wrong with a page, nothing on it is too small or too wide; in light and in the dark."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-core is not installed")
    for theme, width in (("light", 1440), ("dark", 1024)):
        page.set_viewport_size({"width": width, "height": 768})
        page.evaluate("theme => { document.documentElement.dataset.theme = theme; }", theme)
        found = axe.Axe().run(page)
        assert found.violations_count == 0, f"{page.url}, {theme}: {found.generate_report()}"
        assert page.evaluate(TOO_SMALL, LEAST_PX) == []
        over = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        assert over <= 0, f"{page.url} is {over} px wider than the screen"


def test_pages_are_fit_for_everybody_and_for_gloves(standing: Serving, visit: Callable[..., Visitor]) -> None:
    visitor = visit(standing).signed_in("admin")
    visitor.expected.append("404")
    for path, whole in PAGES.items():
        page = visitor.goto(path)
        page.wait_for_selector(whole)
        fit_for_everybody(page)


def test_no_page_scrolls_sideways_and_no_navigation_is_cut_off(
    standing: Serving, visit: Callable[..., Visitor]
) -> None:
    """In German, whose words are the longer ones."""
    visitor = visit(standing, locale="de-DE").signed_in("admin")
    visitor.expected.append("404")
    faults = {}
    for path, whole in PAGES.items():
        page = visitor.goto(path)
        page.wait_for_selector(whole)
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 740})
            over = page.evaluate(
                "document.documentElement.scrollWidth - document.documentElement.clientWidth"
            )
            cut = [*page.evaluate(CUT_OFF), *page.evaluate(TOO_SMALL, LEAST_PX)]
            if over > 0 or cut:
                faults[path, width] = (over, cut)
    assert faults == {}


def test_no_page_is_left_out(standing: Serving) -> None:
    app = standing.app
    asked = {urlsplit(path).path for path in (*PAGES, *ELSEWHERE)} - {"/nowhere"}
    analysed_modes = {
        next(route.path for route in app.routes if route.matches(getting(path))[0] is Match.FULL)
        for path in asked
    }
    there = {path for method, path, *_ in endpoint_rows(app) if method == "GET" and "/api/" not in path}
    assert analysed_modes == there - set(PARTS)


def getting(path: str) -> dict[str, str]:
    """As the application is asked for it."""
    return {"type": "http", "method": "GET", "path": path}


@pytest.mark.parametrize("path", ["/", "/runs/3/incidents/4", "/press?run=2&against=1"])
def test_a_first_load_is_small(standing: Serving, visit: Callable[..., Visitor], path: str) -> None:
    visitor = visit(standing).signed_in("admin")
    network = visitor.context.new_cdp_session(visitor.page)
    network.send("Network.enable")
    kinds: dict[str, str] = {}
    got: dict[str, int] = {}
    network.on("Network.responseReceived", lambda told: kinds.update({told["requestId"]: told["type"]}))
    network.on(
        "Network.loadingFinished",
        lambda told: got.update({told["requestId"]: int(told["encodedDataLength"])}),
    )
    visitor.goto(path).wait_for_selector(PAGES[path])
    visitor.page.evaluate("document.fonts.ready.then(() => true)")
    total = sum(length for request, length in got.items() if kinds.get(request) != "Image")
    assert 20_000 < total < MOST_BYTES, f"{path} loads {total:,} bytes"


def test_signing_in_at_a_provider_is_fit_for_everybody(
    emptied: Path, serve: Callable[..., Serving], visit: Callable[..., Visitor], tmp_path: Path
) -> None:
    pytest.importorskip("joserfc", reason="prooflight-console[oidc] is not installed")
    from packages.console.tests.test_provider import settings_of

    visitor = visit(serve(emptied, provider=settings_of(tmp_path, "http://127.0.0.1:9")))
    page = visitor.goto("/sign-in")
    page.wait_for_selector("text=Plant login")
    fit_for_everybody(page)
    visitor.expected.append("503")
    page = visitor.goto("/sign-in/provider")
    page.wait_for_selector("[role=alert]")
    fit_for_everybody(page)


EMPTY: Final = {
    "/": ".band.no-run",
    "/report": ".empty",
    "/search": ".empty",
    "/press": ".empty",
    "/setup": "main",
}


def test_pages_before_any_run_say_so(
    emptied: Path, serve: Callable[..., Serving], visit: Callable[..., Visitor]
) -> None:
    console = serve(emptied)
    visitor = visit(console).signed_in(console.person(Role.ADMIN))
    for path, whole in EMPTY.items():
        page = visitor.goto(path)
        page.wait_for_selector(whole)
        fit_for_everybody(page)
        told = page.inner_text("main")
        assert ("No run has been recorded yet." in told) == (path != "/setup")
        assert "No open incident" not in told, "nobody has looked"
