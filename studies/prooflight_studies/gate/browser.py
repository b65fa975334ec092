"""The console as a person has it: ``prooflight serve`` in a process of its own, read and used in a browser."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Page, Route

CHROMIUM: Final = Path("/usr/bin/chromium")
FLAGS: Final = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
)
PASSWORD: Final = "a password of this study"
PATIENCE_MS: Final = 60_000
FOLLOWS_S: Final = 10.0
"""Time within which Now must show what other pages do; assumed: its thread reads the journal once a second, and a busy
machine makes it late."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """Sheets to print again of one run, as pages and files of the console show them."""

    now: int | None
    """None: Now shows another run."""
    total: int
    """Stated above the list."""
    listed: frozenset[int]
    """Places in the run, of the rows of the list."""
    csv: frozenset[int]
    report: int


class Visitor:
    """A person who is signed in, in one window."""

    def __init__(self, page: Page, address: str, *, job_pages: int) -> None:
        self.page, self._address, self._job_pages = page, address, job_pages

    def goto(self, path: str) -> Page:
        """Open a page of the console."""
        self.page.goto(self._address + path)
        return self.page

    def read(self, run: int, *, needed: int, last: bool) -> Shown:
        """Return the counts of a run that is over. last: whether it is the one that Now shows."""
        page = self.goto(f"/runs/{run}/reprint")
        total = _number(page.inner_text(".total"))
        listed = set[int]()
        for cells in page.eval_on_selector_all(
            "table tbody tr", "rows => rows.map(row => [...row.cells].map(cell => cell.innerText.trim()))"
        ):
            if cells[4]:
                listed.add(self._place(cells[4], cells[5]))
            else:  # all that were not printed, in one row
                first = re.search(r"from sheet (\d[\d,]*)", cells[1])
                assert first is not None
                listed |= set(range(_number(first[1]), needed))
        with page.expect_download() as expected:
            page.click("a.button[href$='.csv']")
        with Path(expected.value.path()).open(encoding="utf-8-sig", newline="") as file:
            rows = frozenset(self._place(row["copy"], row["pages"]) for row in csv.DictReader(file))
        report = _number(self.goto(f"/report/{run}").inner_text("dl.figures a[href$='/reprint']"))
        now = self._now(run, total) if last else None
        return Shown(now=now, total=total, listed=frozenset(listed), csv=rows, report=report)

    def _now(self, run: int, total: int) -> int:
        """Return the count that Now shows of a run; it follows the journal within ``FOLLOWS_S``."""
        shown = -1
        until_s = time.monotonic() + FOLLOWS_S
        while shown != total and time.monotonic() < until_s:
            shown = _number(self.goto("/").inner_text(f"a.row-link[href='/runs/{run}/reprint'] b"))
        return shown

    def _place(self, copy: str, page: str) -> int:
        return (int(copy) - 1) * self._job_pages + int(page) - 1

    def call_false_alarm(self, run: int, sheet: int) -> None:
        """Say by one tap that the incident of a misprint is a false alarm."""
        page = self.goto(f"/runs/{run}/sheets/{sheet}")
        page.click("#said .tap.false-alarm")
        page.wait_for_selector("#said .tap.false-alarm[aria-pressed='true']")

    def vouch(self, run: int, sheet: int) -> None:
        """Vouch for one sheet."""
        page = self.goto(f"/runs/{run}/sheets/{sheet}")
        page.fill("#said-of-sheet #reason", "looked at both sides, it is good")
        page.click("#said-of-sheet .vouch button")
        page.wait_for_selector("#said-of-sheet [hx-post*='/undo']")

    def undo(self, run: int, sheet: int) -> None:
        """Take back what was said of a sheet."""
        page = self.goto(f"/runs/{run}/sheets/{sheet}")
        page.click("#said-of-sheet [hx-post*='/undo'] >> nth=0")
        page.wait_for_selector("#said-of-sheet .vouch")


def needed() -> None:
    """Raise RequestError if there is no browser."""
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError as error:
        raise RequestError("part counts", "needs Playwright", remedy="pip install playwright") from error
    if not CHROMIUM.exists():
        raise RequestError("part counts", f"needs {CHROMIUM}", remedy="apt install chromium")


@contextmanager
def serving(journal: Path, trays: Path) -> Iterator[subprocess.Popen[str]]:
    """Serve a journal and the controller's log, which may not be there yet."""
    trays.touch()
    command = [sys.executable, "-m", "prooflight", "serve", "--journal", str(journal), "--trays", str(trays)]
    with subprocess.Popen([*command, "--port", "0"], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.terminate()


@contextmanager
def visiting(served: subprocess.Popen[str], *, job_pages: int) -> Iterator[Visitor]:
    """Sign in by the link that the console prints first."""
    from playwright.sync_api import sync_playwright

    link = _link(served)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=list(FLAGS))
        page = browser.new_page(locale="en-GB")
        page.set_default_timeout(PATIENCE_MS)
        page.route("**/*", _text_only)
        page.goto(link)
        for name in ("password", "again"):
            page.fill(f"[name={name}]", PASSWORD)
        page.click("button.main")
        address = link.split("/welcome")[0]
        page.wait_for_url(f"{address}/")
        yield Visitor(page, address, job_pages=job_pages)
        browser.close()


def _text_only(route: Route) -> None:
    """Leave out pictures and fonts, which say no numbers."""
    if route.request.resource_type in ("image", "font"):
        route.abort()
    else:
        route.continue_()


def _link(served: subprocess.Popen[str]) -> str:
    assert served.stdout is not None
    for line in served.stdout:
        if digits := re.search(r"http\S+/welcome\S*", line):
            return digits[0]
    raise RuntimeError("the console printed no link")


def _number(text: str) -> int:
    digits = re.search(r"\d[\d,]*", text)
    assert digits is not None, text
    return int(digits[0].replace(",", ""))
