"""Pictures of every screen of the console.

``python -m packages.console.tests.browser.pictures FOLDER [X.press [ZONES.json]]``.

Of made-up runs; a press artefact, where one is given, is taken for theirs. ZONES.json: of the sample job, as
``prooflight zones price --save`` left it for that press; without it the price that is shown is made up as well. Needs
Chromium and Playwright.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from packages.console.tests.browser.conftest import CHROMIUM, FLAGS
from packages.console.tests.browser.runs import write_runs
from packages.console.tests.browser.serving import Serving
from packages.console.tests.zone_prices import entry, quick
from PIL import Image
from playwright.sync_api import sync_playwright

from prooflight.pages.job import JobSource
from prooflight.pages.zones.zones_file import JobZones, ZoneEntry
from prooflight.press.artefact import Press
from prooflight.simulation.corpus.sample_job.sample_job import make_sample_job
from prooflight_console.access import COOKIE
from prooflight_console.accounts.roles import Role, Scope, Who
from prooflight_console.zones.prices import Prices
from prooflight_console.zones.pricing import PriceRequest
from prooflight_line.journal.journal import Journal
from prooflight_line.plant.gate.log import GateLog, log_path
from prooflight_line.plant.gate.registers import Code, Result

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PEOPLE: Final = {
    "Petra Sommer": Role.ADMIN,
    "Jan Kowalski": Role.OPERATOR,
    "Mei Lin": Role.ENGINEER,
    "Tom Reeve": Role.VIEWER,
}
SCREENS: Final = {
    "sign-in": ("/sign-in", "form"),
    "now": ("/", ".band"),
    "incident": ("/runs/3/incidents/4", "#viewers[data-ready]"),
    "sheet": ("/runs/3/sheets/256", "#viewers[data-ready]"),
    "alarms": ("/alarms?show=all", ".incident"),
    "alarm-statistics": ("/alarms/statistics", ".course"),
    "hand-over": ("/alarms/hand-over", "textarea"),
    "reprint": ("/runs/3/reprint", "table"),
    "runs": ("/report", "table"),
    "report": ("/report/1", ".heat"),
    "quality": ("/quality?since=2026-05-01", ".pareto"),
    "search": ("/search", "table"),
    "press": ("/press?run=2", "#charts[data-ready]"),
    "compare": ("/press?run=2&against=1", "#charts[data-ready]"),
    "setup": ("/setup", ".camera"),
    "zones": ("/setup/zones/1", "#desk[data-ready='1']"),
    "users": ("/setup/users", "table"),
    "tokens": ("/setup/tokens", "table"),
    "audit": ("/setup/audit", "table"),
}
"""Address, and what is there when it is whole."""
SIZES: Final[dict[str, dict[str, Any]]] = {
    "desktop": {"viewport": {"width": 1440, "height": 900}, "color_scheme": "light"},
    "tablet": {"viewport": {"width": 1024, "height": 768}, "color_scheme": "light", "has_touch": True},
    "phone": {"viewport": {"width": 390, "height": 844}, "color_scheme": "light", "has_touch": True},
    "dark": {"viewport": {"width": 1440, "height": 900}, "color_scheme": "dark"},
    "tablet-dark": {"viewport": {"width": 1024, "height": 768}, "color_scheme": "dark", "has_touch": True},
    "phone-dark": {"viewport": {"width": 390, "height": 844}, "color_scheme": "dark", "has_touch": True},
}
SHOWN: Final = """async () => {
  const seen = [...document.images].filter((one) => one.getBoundingClientRect().top < innerHeight);
  await Promise.all([document.fonts.ready, ...seen.map((one) => one.decode().catch(() => null))]);
}"""
"""Until fonts and pictures are there."""
WHOLE: Final = (
    "now",
    "alarms",
    "alarm-statistics",
    "report",
    "quality",
    "press",
    "compare",
    "incident",
    "zones",
)
SMALL_PX: Final = 1080
"""Width of the copies for the docs."""
COLOURS: Final = 256
EXACT: Final = 6
RARE_TOO: Final = Image.Quantize.MAXCOVERAGE
"""Colours of small areas stay what they are: they are what the picture is about."""


def main(folder: Path, press: Path | None = None, zones: Path | None = None) -> None:
    """Take them all."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as made, sync_playwright() as playwright:
        journal = Path(made) / "press-2.sqlite"
        told = {} if press is None else {"press_digest": Press.load(press).digest}
        write_runs(journal, **told)
        _gated(journal)
        going = Journal.open(str(journal))  # whoever holds it watches the press
        settings = {} if press is None else {"presses": (press,), "jobs": (_job(Path(made), zones),)}
        # Time stands still: however long the pictures take, a sheet came just now.
        serving = Serving(journal, settings=settings, prices=Prices(quick), ticking=lambda: 0.0)
        serving.start()
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=list(FLAGS))
        try:
            session = _said(serving)
            for size, options in SIZES.items():
                _taken(browser, serving, session, folder, size, options)
        finally:
            browser.close()
            serving.stop()
            going.close()


def _gated(journal: Path) -> None:
    """The gate of the run that goes on, ready: what passed it, and a sheet rejected without need."""
    with Journal.open(str(journal), read_only=True) as opened, GateLog(log_path(journal, 3)) as log:
        log.add("run", run=3, job_pages=24, settings={"policy": "reject"})
        for state in ("joining", "aligning", "ready"):
            log.add("state", state=state, why="")
        for page in opened.pages(3):
            bad = page.verdict.verdict != "good"
            result, code = (Result.DIVERT, Code.MISPRINT) if bad else (Result.ACCEPT, Code.GOOD)
            tag = page.sheet + 1
            log.add(
                "decision", tag=tag, sheet=page.sheet, came=True, result=int(result), code=int(code),
                job_page=page.job_page, page=page.verdict.page, set=page.sheet // 24, why="", position=3100 * tag,
            )  # fmt: skip
            log.add("written", tag=tag, position=3100 * tag)
            if tag < 250:
                log.add("tray", tag=tag, tray="reject" if bad or tag == 31 else "good", session=1)


def _job(folder: Path, priced: Path | None) -> Path:
    """The sample job with zones; priced: those, else their price is made up as the runs are."""
    job = folder / "sample-job.pdf"
    make_sample_job(job, seed=1)
    if priced is not None:
        (folder / "sample-job.zones.json").write_bytes(priced.read_bytes())
        return job
    with JobSource(path=job, dpi=72).open() as opened:
        sizes = opened.page_sizes_mm
    entries = [
        ZoneEntry(name="picture", kind="careful", pages="4", rectangle_mm=(20, 60, 80, 70)),
        ZoneEntry(name="numbering", kind="ignore", pages="all", rectangle_mm=(150, 278, 50, 12)),
    ]
    zones = JobZones.create(entries, sizes)
    asked = PriceRequest(job=job, press=job, zones=zones, prints=90, trials=24)
    zones.priced(entry(asked)).save(folder / "sample-job.zones.json")
    return job


def _said(serving: Serving) -> str:
    """People, what they said, tokens; returns a session of the admin."""
    accounts, console = serving.accounts, serving.console
    for name, role in PEOPLE.items():
        serving.person(role, name)
    known = {
        person.name: Who(id=person.id, name=person.name, role=person.role) for person in accounts.people()
    }
    first = console.reading.run(1)
    for name, incident, word, note in (
        ("Jan Kowalski", 1, "misprint", ""),
        ("Jan Kowalski", 2, "false-alarm", "picture box was swapped on purpose"),
        ("Jan Kowalski", 3, "false-alarm", ""),
        ("Mei Lin", 3, "misprint", "no: the spot is on the plate"),
        ("Jan Kowalski", 4, "misprint", "scraper replaced"),
    ):
        console.say(known[name], word, first, incident=incident, note=note)
    accounts.new_token("Mei Lin", "planning-report", [Scope.READ], by="Mei Lin")
    accounts.add("Ada Novak", Role.OPERATOR, by="Petra Sommer")
    accounts.change("Tom Reeve", by="Petra Sommer", locked=True)
    return accounts.begin("Petra Sommer")


def _taken(
    browser: Browser, serving: Serving, session: str, folder: Path, size: str, options: dict[str, Any]
) -> None:
    context = browser.new_context(locale="en-GB", reduced_motion="reduce", **options)
    for name, (path, ready) in SCREENS.items():
        if name == "zones" and not serving.settings.get("jobs"):
            continue
        if name != "sign-in":
            context.add_cookies([{"name": COOKIE, "value": session, "url": serving.address}])
        page = context.new_page()
        page.goto(serving.address + path)
        page.wait_for_selector(ready)
        page.wait_for_load_state("networkidle") if name not in ("now",) else page.wait_for_load_state()
        page.evaluate(SHOWN)
        if name == "zones":
            page.select_option("#page", "4")
            for there in ("#desk[data-ready='4']", "#proposals[data-ready='4']"):
                page.wait_for_selector(there, state="attached")
            page.wait_for_load_state("networkidle")
            page.click(".zone-list button >> nth=0")
        taken = folder / f"console-{name}-{size}.png"
        page.screenshot(path=taken, full_page=name in WHOLE)
        if name == "report" and size == "desktop":
            page.pdf(path=folder / "console-report.pdf", format="A4", print_background=True)
        page.close()
        picture = Image.open(taken).convert("RGB")
        _quantised(picture).save(taken, optimize=True)
        if size == "desktop":
            _small(picture).save(folder / f"console-{name}.png", optimize=True)
        sys.stdout.write(f"{taken.name}\n")
    context.close()


def _small(picture: Image.Image) -> Image.Image:
    """For the docs: of a long page what is on top."""
    cut = picture.crop((0, 0, picture.width, min(picture.height, picture.width)))
    height = SMALL_PX * cut.height // cut.width
    return _quantised(cut.resize((SMALL_PX, height), Image.Resampling.LANCZOS))


def _quantised(picture: Image.Image) -> Image.Image:
    """Return the picture in few colours, of which the most common are exact: grounds must not change their hue."""
    result = picture.quantize(COLOURS, RARE_TOO, dither=Image.Dither.NONE)
    palette = np.array(result.getpalette()).reshape(-1, 3)
    seen, which = np.asarray(picture).reshape(-1, 3), np.asarray(result).ravel()
    colours, counts = np.unique(seen, axis=0, return_counts=True)
    for colour in colours[np.argsort(-counts)[:EXACT]]:
        index = np.bincount(which[(seen == colour).all(axis=1)]).argmax()
        palette[index] = colour
    result.putpalette(palette.ravel().tolist())
    return result


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
