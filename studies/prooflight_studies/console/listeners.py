"""Clients of the console, each noting when a sheet arrived.

They are dozens of browsers' live connections, and real browsers.
"""

from __future__ import annotations

import asyncio
import json
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from types import TracebackType

CHROMIUM: Final = Path("/usr/bin/chromium")
FLAGS: Final = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
)
COOKIE: Final = "prooflight"
PATIENCE_MS: Final = 300_000
"""Time for a page to open: fifty of them on two cores, next to other work."""
WATCH: Final = """() => {
  window.seen = [];
  const shown = new Set();
  const note = (what) => window.seen.push([what, Date.now() / 1000]);
  const painted = (what) => requestAnimationFrame(() => requestAnimationFrame(() => note(what)));
  const look = () => {
    for (const cell of document.querySelectorAll("#strip .unseen")) {
      if (!shown.has(cell.textContent)) { shown.add(cell.textContent); painted(Number(cell.textContent)); }
    }
    if (shown.has("alarm") || !document.querySelector(".band.look, .band.stop")) return;
    shown.add("alarm");
    painted("alarm");
  };
  new MutationObserver(look).observe(document.getElementById("main"), { childList: true, subtree: true });
}"""
"""Script that notes the time at which a frame with each sheet of the strip, and with an alarm, was drawn."""


class Listeners:
    """Live connections, each like that of a browser on the page Now; use it as a context."""

    def __init__(self, address: tuple[str, int], *, session: str, count: int) -> None:
        self._address, self._session, self._count = address, session, count
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="listeners", daemon=True)
        self.seen: dict[int, list[float]] = {}
        """Times at which each sheet reached the connections; Unix time. [s]"""
        self.connected = 0
        self.lost: list[str] = []
        """Reason of each connection that ended early, one line each."""
        self._tasks: list[asyncio.Task[None]] = []
        self._ending = False

    def __enter__(self) -> Listeners:
        self._thread.start()
        asyncio.run_coroutine_threadsafe(self._begin(), self._loop).result()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ending = True
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _begin(self) -> None:
        ready = [asyncio.Event() for _ in range(self._count)]
        self._tasks = [asyncio.create_task(self._listen(one)) for one in ready]
        await asyncio.wait_for(asyncio.gather(*(one.wait() for one in ready)), 60)

    async def _end(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _listen(self, ready: asyncio.Event) -> None:
        reader, writer = await asyncio.open_connection(*self._address, limit=1 << 22)
        request = f"GET /now/events HTTP/1.1\r\nHost: {self._address[0]}\r\nCookie: {COOKIE}={self._session}\r\n\r\n"
        writer.write(request.encode())
        kind = ""
        try:
            async for raw in reader:
                line = raw.decode().rstrip()
                if line.startswith("retry:"):
                    self.connected += 1
                    ready.set()
                elif line.startswith("event: "):
                    kind = line.removeprefix("event: ")
                elif line.startswith("data: ") and kind == "sheet":
                    sheet = json.loads(line.removeprefix("data: "))["sheet"]
                    self.seen.setdefault(sheet, []).append(time.time())
            if not self._ending:
                self.lost.append("the console ended it")
        except OSError as error:
            self.lost.append(str(error))
        finally:
            ready.set()
            writer.close()


class Windows:
    """The page Now in real browsers; ``seen`` afterwards.

    Use it as a context; ``is_installed`` says whether there is a browser. Without one, no page is open.
    """

    def __init__(self, address: str, session: str, *, browsers: int = 1, pages: int = 1) -> None:
        """Create windows. pages: in each browser, each in a context of its own, as of another person."""
        self._address, self._session = address, session
        self._browsers, self._each = browsers, pages
        self._started: Any = None
        self._pages: list[Any] = []
        self.seen: list[dict[int | str, float]] = []
        """For each page, Unix times at which a frame with each sheet, and the first with an alarm, were drawn. [s]"""

    @property
    def is_installed(self) -> bool:
        """Whether Chromium and Playwright are installed."""
        try:
            import playwright
        except ImportError:
            return False
        return CHROMIUM.exists() and playwright is not None

    def __enter__(self) -> Windows:
        if self.is_installed:
            from playwright.sync_api import sync_playwright

            self._started = sync_playwright().start()
            for _ in range(self._browsers):
                browser = self._started.chromium.launch(executable_path=str(CHROMIUM), args=list(FLAGS))
                self._pages += [self._opened(browser) for _ in range(self._each)]
        return self

    def _opened(self, browser: Any) -> Any:
        context = browser.new_context(reduced_motion="reduce")
        context.set_default_timeout(PATIENCE_MS)
        context.add_cookies([{"name": COOKIE, "value": self._session, "url": self._address}])
        page = context.new_page()
        page.goto(self._address)
        page.wait_for_selector(".band")
        page.evaluate(WATCH)
        return page

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._started is None:
            return
        if error is None:
            self.seen = [dict(page.evaluate("window.seen")) for page in self._pages]
        for browser in {page.context.browser for page in self._pages}:
            browser.close()
        self._started.stop()
