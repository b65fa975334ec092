"""Load of each page on a browser: first contentful paint, bytes without pictures, requests, axe-core's violations."""

from __future__ import annotations

import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.errors import RequestError
from prooflight_console.accounts.roles import Role
from prooflight_console.running import LOOPBACK, Listening, spawned
from prooflight_console.settings import ConsoleSettings
from prooflight_line.journal.journal import Journal
from prooflight_studies.console.listeners import CHROMIUM, COOKIE, FLAGS
from prooflight_studies.console.serving import free_port, nothing, session, wait_until_it_answers

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight_line.journal.records import PageRecord, RunFacts

PAGES: Final = {
    "/sign-in": "main",
    "/": ".band",
    "/report": "table",
    "/report/1": ".heat",
    "/search": "table",
    "/press?run=1": "#charts[data-ready]",
    "/setup": ".camera",
    "/setup/users": "table",
    "/setup/tokens": "form",
    "/setup/audit": "table",
}
"""Paths of the pages, and a selector that matches when each is complete."""
LOADS, QUICK_LOADS = 7, 1
SHEETS: Final = 400
MOST_BYTES: Final = 300_000
PAINTED: Final = """() => new Promise((done) => {
  const seen = () => performance.getEntriesByName("first-contentful-paint")[0];
  if (seen()) return done(seen().startTime);
  new PerformanceObserver(() => { if (seen()) done(seen().startTime); }).observe({ type: "paint", buffered: true });
})"""


def measure_loads(
    record: Callable[[int, bool], PageRecord],
    facts: Callable[[int], RunFacts],
    *,
    quick: bool,
    progress: Callable[[str], None],
) -> dict[str, Any]:
    """Measure every page, loaded with an empty cache each time. RequestError: no browser is installed.

    record: returns a sheet by its number and whether it is an alarm. facts: returns those of a run of so many sheets.
    """
    if find_spec("playwright") is None or not CHROMIUM.exists():
        raise RequestError(
            "--part pages", "Chromium or Playwright is not installed", remedy="apt install chromium"
        )
    from playwright.sync_api import sync_playwright

    axe = None
    if find_spec("axe_playwright_python") is not None:
        from axe_playwright_python.sync_playwright import Axe  # type: ignore[import-untyped]

        axe = Axe()
    with tempfile.TemporaryDirectory() as folder:
        settings = ConsoleSettings.of(Path(folder) / "runs.sqlite")
        with Journal.open(str(settings.journal)) as journal:
            run = journal.begin_run(facts(SHEETS))
            for sheet in range(SHEETS):
                journal.record(run, record(sheet, sheet % 40 == 0))
            journal.commit()
        secret, port = session(settings, role=Role.ADMIN), free_port()
        console = spawned(settings, Listening(port=port), ready=nothing)
        address = f"http://{LOOPBACK}:{port}"
        try:
            wait_until_it_answers(port)
            with sync_playwright() as started:
                browser = started.chromium.launch(executable_path=str(CHROMIUM), args=list(FLAGS))
                rows = []
                for path, whole in PAGES.items():
                    progress(path)
                    loads = [
                        _load(browser, address, path, whole, secret, axe if at == 0 else None)
                        for at in range(QUICK_LOADS if quick else LOADS)
                    ]
                    rows.append(
                        {
                            "path": path,
                            "paint_ms": float(np.median([one["paint_ms"] for one in loads])),
                            "bytes": max(one["bytes"] for one in loads),
                            "requests": max(one["requests"] for one in loads),
                            "violations": loads[0]["violations"],
                        }
                    )
                browser.close()
        finally:
            console.terminate()
            console.join()
    return {"rows": rows, "loads": QUICK_LOADS if quick else LOADS, "most_bytes": MOST_BYTES, "quick": quick}


def _load(browser: Any, address: str, path: str, whole: str, secret: str, axe: Any) -> dict[str, Any]:
    context = browser.new_context(viewport={"width": 1440, "height": 900}, reduced_motion="reduce")
    context.add_cookies([{"name": COOKIE, "value": secret, "url": address}])
    page = context.new_page()
    network = context.new_cdp_session(page)
    network.send("Network.enable")
    kinds: dict[str, str] = {}
    got: dict[str, int] = {}
    network.on(
        "Network.responseReceived", lambda message: kinds.update({message["requestId"]: message["type"]})
    )
    network.on(
        "Network.loadingFinished",
        lambda message: got.update({message["requestId"]: int(message["encodedDataLength"])}),
    )
    page.goto(address + path)
    page.wait_for_selector(whole)
    page.evaluate("document.fonts.ready.then(() => true)")
    figures = {
        "paint_ms": float(page.evaluate(PAINTED)),
        "bytes": sum(length for request, length in got.items() if kinds.get(request) != "Image"),
        "requests": len(kinds),
        "violations": None if axe is None else int(axe.run(page).violations_count),
    }
    context.close()
    return figures
