"""One Chromium for all these tests, and a console for each; every error that a page logs fails its test."""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest
from packages.console.tests.browser.serving import Serving
from packages.console.tests.consoles import PASSWORD

from prooflight_console.access import COOKIE
from prooflight_console.accounts.roles import Role
from prooflight_line.testing.sample_runs import write_runs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from playwright.sync_api import Browser, BrowserContext, Page

CHROMIUM: Final = Path("/usr/bin/chromium")
FLAGS: Final = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
)
PATIENCE_MS: Final = 30_000
"""For a machine that does much else; nothing waits so long where all is well."""


@dataclass
class Visitor:
    """A browser's window, and what its pages logged."""

    context: BrowserContext
    page: Page
    console: Serving
    errors: list[str] = field(default_factory=list)
    expected: list[str] = field(default_factory=list)
    """Patterns of errors that a test brings about."""

    def goto(self, path: str) -> Page:
        self.page.goto(self.console.address + path)
        return self.page

    def sign_in(self, name: str, *, path: str = "/") -> Page:
        """By the form, to the page that was wanted."""
        self.goto(path)
        self.page.fill("[name=name]", name)
        self.page.fill("[name=password]", PASSWORD)
        self.page.click("button.main")
        self.page.wait_for_url(self.console.address + path)
        return self.page

    def signed_in(self, name: str) -> Visitor:
        """As if they had, a moment ago: the form has tests of its own."""
        secret = self.console.accounts.begin(name)
        self.context.add_cookies([{"name": COOKIE, "value": secret, "url": self.console.address}])
        return self

    def faults(self) -> list[str]:
        """Errors that no test expects."""
        return [one for one in self.errors if not any(re.search(each, one) for each in self.expected)]


@pytest.fixture(scope="module")  # while Playwright runs, no other test of this process may run an event loop
def chromium() -> Iterator[Browser]:
    playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    if not CHROMIUM.exists():
        pytest.skip(f"no {CHROMIUM}: apt install chromium")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=str(CHROMIUM), args=list(FLAGS))
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def journal(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three runs; nobody writes to it any more."""
    path = tmp_path_factory.mktemp("runs") / "runs.sqlite"
    write_runs(path)
    return path


@pytest.fixture(scope="session")
def standing(journal: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A console on the three runs for tests that only look, with an admin."""
    made = Serving(journal, settings={"data": tmp_path_factory.mktemp("standing") / "console.sqlite"})
    made.start()
    made.person(Role.ADMIN)
    yield made
    made.stop()


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Serving]]:
    """Starts consoles, and ends them."""
    started: list[Serving] = []

    def start(journal: Path, prices: Any = None, **settings: Any) -> Serving:
        own = {"data": tmp_path / f"console{len(started)}.sqlite", **settings}
        made = Serving(journal, settings=own, prices=prices)
        started.append(made)
        made.start()
        return made

    yield start
    for each in started:
        each.stop()


@pytest.fixture
def console(serve: Callable[..., Serving], journal: Path, tmp_path: Path) -> Serving:
    """A console on the three runs, with somebody of each role; words lie beside a journal, so each test has a copy."""
    made = serve(shutil.copytree(journal.parent, tmp_path / "three-runs") / journal.name)
    for role in Role:
        made.person(role)
    return made


@pytest.fixture
def visit(chromium: Browser) -> Iterator[Callable[..., Visitor]]:
    """Opens windows; afterwards none may have logged an error, and none may have asked elsewhere."""
    visitors: list[Visitor] = []

    def open_window(console: Serving, **options: Any) -> Visitor:
        told = {"viewport": {"width": 1440, "height": 900}, "locale": "en-GB", "reduced_motion": "reduce"}
        context = chromium.new_context(**(told | options))
        context.set_default_timeout(PATIENCE_MS)
        visitor = Visitor(context=context, page=context.new_page(), console=console)

        def heard(message: Any) -> None:
            if message.type in ("error", "warning"):
                visitor.errors.append(message.text)

        visitor.page.on("console", heard)
        visitor.page.on("pageerror", lambda error: visitor.errors.append(str(error)))

        def asked(request: Any) -> None:
            if not request.url.startswith((console.address, "data:", "blob:")):
                visitor.errors.append(f"asked elsewhere: {request.url}")

        visitor.page.on("request", asked)
        visitors.append(visitor)
        return visitor

    yield open_window
    found = [fault for visitor in visitors for fault in visitor.faults()]
    for visitor in visitors:
        visitor.context.close()
    assert found == []


@pytest.fixture
def admin(console: Serving, visit: Callable[..., Visitor]) -> Visitor:
    return visit(console).signed_in("admin")


@pytest.fixture
def emptied(tmp_path: Path) -> Path:
    """Where a journal will be."""
    return tmp_path / "runs.sqlite"
