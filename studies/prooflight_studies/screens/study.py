"""Every page of the console at three widths, light and dark: its pictures, and what axe-core says of each."""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from PIL import Image

from prooflight.cli.jobs.demonstration import SAMPLE_SIZE_MM, demo_press, sample_job
from prooflight.errors import RequestError
from prooflight.files.atomic import whole_file
from prooflight_studies.console.listeners import CHROMIUM, COOKIE, FLAGS
from prooflight_studies.harness.page import stored_results, write_page
from prooflight_studies.screens.contact_sheets import MOST_PX, as_png, contact_sheet
from prooflight_studies.screens.paper_report import report_picture
from prooflight_studies.screens.press_floor import GOING, Floor, press_floor

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, FloatRect, Page

SEED: Final = 1
"""Seed of the demonstration's press and job, which a cache may hold."""
PATIENCE_MS: Final = 600_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Screen:
    """One page of the console."""

    name: str
    title: str
    path: str
    whole: str
    """Selector that matches when the page is complete."""
    live: bool = False
    """Whether the page has a connection that never ends."""
    signed_in: bool = True
    records: bool = False
    """Whether it needs the records of several presses."""
    then: Callable[[Page], None] = lambda _page: None
    """What is done on the page before it is pictured."""


def _choose_zone(page: Page) -> None:
    """Show the page with the careful zone, and select that."""
    page.select_option("#page", "4")
    for shown in ("#desk[data-ready='4']", "#proposals[data-ready='4']"):
        page.wait_for_selector(shown, state="attached")
    page.wait_for_load_state("networkidle")
    page.click(".zone-list button >> nth=0")


SCREENS: Final = (
    Screen(name="now", title="Now", path="/", whole=".film img", live=True),
    Screen(name="alarms", title="Alarms", path="/alarms?show=all", whole=".incident"),
    Screen(name="alarm-statistics", title="Alarm statistics", path="/alarms/statistics", whole=".course"),
    Screen(name="hand-over", title="Shift hand-over", path="/alarms/hand-over", whole="textarea"),
    Screen(name="queue", title="Queue", path="/queue", whole="#jobs table"),
    Screen(name="reports", title="Reports", path="/report", whole="table"),
    Screen(name="report", title="The report of a run", path="/report/1", whole=".heat"),
    Screen(name="reprint", title="Sheets to reprint", path=f"/runs/{GOING}/reprint", whole="table"),
    Screen(name="quality", title="Defects and trends", path="/quality?since=2026-05-01", whole=".pareto"),
    Screen(name="search", title="Search", path="/search?kind=streak", whole=".found .main-cell"),
    Screen(name="press", title="Press", path="/press?run=2", whole="#charts[data-ready]"),
    Screen(
        name="comparison",
        title="Two runs compared",
        path="/press?run=2&against=1",
        whole="#charts[data-ready]",
    ),
    Screen(name="engineering", title="Engineering", path="/press/engineering", whole="#thresholds tbody tr"),
    Screen(name="history", title="History of the press", path="/press/history", whole=".history svg"),
    Screen(name="presses", title="Presses", path="/presses", whole="table", records=True),
    Screen(
        name="presses-search",
        title="Sheets of all presses",
        path="/presses/sheets?kind=streak",
        whole="table",
        records=True,
    ),
    Screen(name="setup", title="Set up: the machine", path="/setup", whole=".camera"),
    Screen(name="zones", title="Zones", path="/setup/zones", whole="a[href='/setup/zones/1']"),
    Screen(
        name="zones-drawing",
        title="Zones of a job",
        path="/setup/zones/1",
        whole="#desk[data-ready='1']",
        then=_choose_zone,
    ),
    Screen(name="users", title="Users", path="/setup/users", whole="table"),
    Screen(name="tokens", title="Tokens", path="/setup/tokens", whole="table"),
    Screen(name="kiosks", title="Kiosks", path="/setup/kiosks", whole="form"),
    Screen(name="audit", title="Audit trail", path="/setup/audit", whole="table"),
    Screen(name="sign-in", title="Sign in", path="/sign-in", whole="form", signed_in=False),
    Screen(name="kiosk", title="Sign in at a kiosk", path="/kiosk", whole="main", signed_in=False),
    Screen(name="welcome", title="A new user", path="/welcome", whole="main", signed_in=False),
    Screen(
        name="incident",
        title="An incident",
        path=f"/runs/{GOING}/incidents/4",
        whole="#viewers[data-ready]:has([data-layer=difference])",
    ),
    Screen(
        name="sheet",
        title="A sheet",
        path=f"/runs/{GOING}/sheets/137",
        whole="#viewers[data-ready]:has([data-layer=difference])",
    ),
    Screen(name="problem", title="A page that is not there", path="/nowhere", whole=".code"),
)
WIDTHS: Final = {1440: 900, 1024: 768, 390: 844}
"""Width and height of a desk's, a tablet's and a phone's window. [pixels]"""
SCHEMES: Final = {"light": "en-GB", "dark": "de-DE"}
"""Colour schemes, and the language in which each is shown: two languages without twice as many pictures."""
SHOWN: Final = """async () => {
  const seen = [...document.images].filter((one) => one.getBoundingClientRect().top < 1500);
  await Promise.all([document.fonts.ready, ...seen.map((one) => one.decode().catch(() => null))]);
}"""
"""Waits for fonts and pictures."""
LEAST_PX: Final = 44
"""Least height of what is touched: WCAG 2.2, target size (enhanced). [pixels]"""
FAULTS: Final = """least => {
  const touched = "button, .button, select, summary, .tabs a, input:not([type=checkbox]):not([type=hidden])";
  const faults = [...document.querySelectorAll(touched)]
    .filter((one) => one.offsetParent && one.getBoundingClientRect().height < least)
    .map((one) => "too small: " + one.outerHTML.slice(0, 80));
  const over = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  if (over > 0) faults.push(`${over} px wider than the screen`);
  for (const part of document.querySelectorAll("main *")) {
    if (!part.checkVisibility()) continue;  // within details that are closed
    const way = getComputedStyle(part).overflowX;
    if ((way === "auto" || way === "scroll") && part.scrollWidth > part.clientWidth + 1)
      faults.push(`scrolls sideways: ${part.className}`);
  }
  return faults;
}"""
"""Returns what is too small to be touched, and what scrolls sideways."""


def run_screens_study(
    page: Path,
    pictures: Path,
    *,
    press: Path | None = None,
    job: Path | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> dict[str, Any]:
    """Take pictures of every page, write a contact sheet of each, and the page that shows them.

    Parameters
    ----------
    page
        Page of the results.
    pictures
        Folder of the contact sheets.
    press, job
        Press artefact and job that are shown; None for those of the demonstration.

    Raises
    ------
    RequestError
        If no browser is installed.
    """
    if find_spec("playwright") is None or not CHROMIUM.exists():
        remedy = "apt install chromium"
        raise RequestError("--part screens", "Chromium or Playwright is not installed", remedy=remedy)
    from playwright.sync_api import sync_playwright

    pictures.mkdir(parents=True, exist_ok=True)
    rows = {row["name"]: row for row in stored_results(page).get("rows", [])}
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as started:
        made = Path(folder)
        press, job = _subjects(made, press, job, progress)
        progress("writing runs")
        with press_floor(made / "floor", press, job) as floor:
            browser = started.chromium.launch(executable_path=str(CHROMIUM), args=list(FLAGS))
            windows = _windows(browser, floor)
            for screen in SCREENS:
                if screen.records and not floor.has_records:
                    continue
                progress(screen.title)
                taken, faults = _taken(windows[screen.signed_in], floor.address, screen)
                _write(pictures / f"{screen.name}.png", as_png(contact_sheet(taken)))
                rows[screen.name] = {
                    "name": screen.name,
                    "title": screen.title,
                    "path": screen.path,
                    "faults": faults,
                }
                results = _results(rows, os.path.relpath(pictures, page.parent))
                write_page(
                    page, "screens", results
                )  # after each, so that an interrupted study leaves the others
            progress("the report on paper")
            _write(pictures / "run-report.png", report_picture(browser, floor))
            browser.close()
    return results


def _results(rows: dict[str, dict[str, Any]], folder: str) -> dict[str, Any]:
    return {
        "rows": [rows[one.name] for one in SCREENS if one.name in rows],
        "folder": folder,
        "widths": list(WIDTHS),
        "least_px": LEAST_PX,
        "axe": find_spec("axe_playwright_python") is not None,
        "left_out": [one.title for one in SCREENS if one.name not in rows],
    }


def _write(path: Path, data: bytes) -> None:
    with whole_file(path) as unfinished:
        unfinished.write_bytes(data)


def _subjects(
    folder: Path, press: Path | None, job: Path | None, progress: Callable[[str], None]
) -> tuple[Path, Path]:
    """Return a press and a job, which are made if none are given."""
    if job is None:
        job = folder / "sample-job.pdf"
        progress("composing the sample job")
        sample_job(job, seed=SEED)
    if press is None:
        press = folder / "two-sensors.press"
        demo_press([SAMPLE_SIZE_MM], world="press", seed=SEED, progress=progress).save(press)
    return press, job


def _windows(browser: Browser, floor: Floor) -> dict[bool, dict[str, list[BrowserContext]]]:
    """Return windows by whether somebody is signed in, and by colour scheme, in the order of ``WIDTHS``."""
    windows: dict[bool, dict[str, list[BrowserContext]]] = {True: {}, False: {}}
    for signed_in, name, secret in ((True, COOKIE, floor.session), (False, f"{COOKIE}-kiosk", floor.kiosk)):
        for scheme, locale in SCHEMES.items():
            windows[signed_in][scheme] = []
            for width, height in WIDTHS.items():
                context = browser.new_context(
                    viewport={"width": width, "height": height},
                    color_scheme="dark" if scheme == "dark" else "light",
                    locale=locale,
                    reduced_motion="reduce",
                )
                context.set_default_timeout(PATIENCE_MS)
                context.add_cookies([{"name": name, "value": secret, "url": floor.address}])
                windows[signed_in][scheme].append(context)
    return windows


def _taken(
    windows: dict[str, list[BrowserContext]], address: str, screen: Screen
) -> tuple[list[list[Image.Image]], list[str]]:
    """Return the pictures of a page, a row a colour scheme, and what is wrong in them."""
    taken: list[list[Image.Image]] = []
    faults: list[str] = []
    for scheme, contexts in windows.items():
        taken.append([])
        for width, context in zip(WIDTHS, contexts, strict=True):
            data, wrong = _picture(context, address, screen)
            taken[-1].append(Image.open(io.BytesIO(data)))
            faults += [f"{width} px, {scheme}: {one}" for one in wrong]
    return taken, faults


def _picture(context: BrowserContext, address: str, screen: Screen) -> tuple[bytes, list[str]]:
    """Return a picture of the top of a page as PNG, and what is wrong on the whole page."""
    page = context.new_page()
    page.goto(address + screen.path)
    page.locator(screen.whole).first.wait_for()
    page.wait_for_load_state("load" if screen.live else "networkidle")
    screen.then(page)
    page.evaluate(SHOWN)
    width, height = page.evaluate("[innerWidth, document.documentElement.scrollHeight]")
    top: FloatRect = {"x": 0, "y": 0, "width": width, "height": min(height, MOST_PX)}
    picture = page.screenshot(full_page=True, clip=top)
    faults = [*page.evaluate(FAULTS, LEAST_PX), *_violations(page)]
    page.close()
    return picture, faults


def _violations(page: Page) -> list[str]:
    if find_spec("axe_playwright_python") is None:
        return []
    from axe_playwright_python.sync_playwright import Axe  # type: ignore[import-untyped]

    return [f"axe-core: {one['id']}" for one in Axe().run(page).response["violations"]]
