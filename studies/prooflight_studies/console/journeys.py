"""Journeys of people through the console: clicks and seconds from a question to its answer, in a real browser.

A click is a tap, a choice from a list, or a field that is filled in. Seconds are those of the machine: no person thinks
between two clicks. A journey that a page does not have yet is not measured: it stands in ``JOURNEYS`` once its page is
there.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from prooflight.detectors.verdict import Region
from prooflight.errors import RequestError
from prooflight_console.accounts.roles import Role
from prooflight_console.running import LOOPBACK, Listening, spawned
from prooflight_console.settings import ConsoleSettings
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import RunEnd
from prooflight_studies.console.building import Buildable
from prooflight_studies.console.learning import Learnable
from prooflight_studies.console.listeners import CHROMIUM, COOKIE, FLAGS
from prooflight_studies.console.serving import free_port, nothing, session, wait_until_it_answers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from playwright.sync_api import Page

    from prooflight_line.journal.records import PageRecord, RunFacts

DAY_S: Final = 86_400.0
RUNS: Final = 20
"""Runs before the present one, one a day."""
SHEETS: Final = 400
TIMES, QUICK_TIMES = 5, 1
WIDTHS: Final = (1440, 390)
PATIENCE_MS: Final = 1_800_000
"""Learning takes only the time that nothing else on the machine wants."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Journey:
    """A question, how a person gets to its answer, and what is required of it."""

    name: str
    most_clicks: int
    most_s: float | None
    """Required bound; None: there is none. [s]"""
    walk: Callable[[Hand], None]
    """Walk from the page Now to the answer, and wait until it is shown."""


class Hand:
    """The hand of a person, which counts its clicks."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.clicks = 0

    def click(self, selector: str) -> None:
        """Click the first of what a selector matches."""
        self.clicks += 1
        self.page.locator(selector).first.click()

    def choose(self, selector: str, value: str) -> None:
        """Choose from a list."""
        self.clicks += 1
        self.page.select_option(selector, value)

    def wait(self, selector: str) -> None:
        """Wait until something is shown."""
        self.page.locator(selector).first.wait_for()


def _alarm(hand: Hand) -> None:
    hand.click(".incident .body")
    hand.wait("#viewers[data-ready]")
    hand.wait("#said .taps")


def _streaks_of_a_week(hand: Hand) -> None:
    hand.click(".tabs a[href='/search']")
    hand.choose("#criteria [name=kind]", "streak")
    hand.click("#criteria [name=days][value='7']")
    hand.wait(".found .main-cell")


def _most_frequent_defect(hand: Hand) -> None:
    hand.click(".tabs a[href='/report']")
    hand.click(".subtabs a[href='/quality']")
    hand.click("#by-kind .pareto a")
    hand.wait(".found .main-cell")


def _label_all_and_undo(hand: Hand) -> None:
    _streaks_of_a_week(hand)
    hand.click("#bulk .tap.misprint")
    hand.wait("#labelled button")
    hand.click("#labelled button")
    hand.page.locator("#labelled").wait_for(state="detached")


JOURNEYS: Final = (
    Journey(name="the defect of an alarm", most_clicks=1, most_s=5.0, walk=_alarm),
    Journey(name="all streaks of the last week", most_clicks=3, most_s=None, walk=_streaks_of_a_week),
    Journey(
        name="the sheets of the most frequent defect", most_clicks=3, most_s=None, walk=_most_frequent_defect
    ),
    Journey(
        name="a label for these streaks, and its withdrawal",
        most_clicks=5,
        most_s=None,
        walk=_label_all_and_undo,
    ),
)


def _next_in_flood(hand: Hand) -> None:
    hand.click("[data-go=N]")
    hand.wait("#viewers[data-ready]")
    hand.wait("#said .taps")


def _kind_in_flood(hand: Hand) -> None:
    hand.click(".groups a")
    hand.wait(".incident .body")


FLOOD_ALARMS: Final = 1000
FLOOD: Final = (
    Journey(name="the most urgent alarm of a flood of 1,000", most_clicks=1, most_s=5.0, walk=_next_in_flood),
    Journey(name="all of its alarms of one kind", most_clicks=1, most_s=None, walk=_kind_in_flood),
)
"""Each alarm is a spot at a place of its own."""


def _learn_again(hand: Hand) -> None:
    hand.click(".tabs a[href='/press']")
    hand.click("a[href='/press/engineering']")
    hand.click("input[name=good]")
    hand.click("form:has([name=step][value=learn]) button")
    hand.wait("#work button[hx-post$='/cancel']")  # until then the page may show what an earlier walk made
    hand.wait("#work form button.main")
    hand.click("#work form button.main")
    hand.wait(".version form button")


def _build(hand: Hand) -> None:
    hand.click(".tabs a[href='/press']")
    hand.click("a[href='/press/engineering']")
    hand.click("form:has([name=step][value=build]) button")
    hand.wait("#work button[hx-post$='/cancel']")
    hand.wait("#work form button.main")
    hand.click("#work form button.main")
    hand.wait(".version form button")


LEARNING: Final = Journey(name="the press learned again", most_clicks=5, most_s=None, walk=_learn_again)
"""Learning of a press that no other journey uses: a third of A4 wide, with 24 recorded good pages."""
BUILDING: Final = Journey(name="the press built and in use", most_clicks=4, most_s=None, walk=_build)
"""Build of a press as wide as A4 with pixels of 0.8 mm, from a press file that states another lamp each time."""
LEARNED, BUILT = 2, 1
"""How often the press is learned again and built in each window: each takes minutes."""


def measure_journeys(
    record: Callable[[int, bool], PageRecord],
    facts: Callable[[int], RunFacts],
    *,
    seed: int,
    quick: bool,
    progress: Callable[[str], None],
) -> dict[str, Any]:
    """Walk every journey in a desk's and in a phone's window. RequestError: no browser is installed.

    record: returns a sheet by its number and whether it is an alarm. facts: returns those of a run of so many sheets.
    seed: of the press that is learned again, its job and its scans.
    """
    if find_spec("playwright") is None or not CHROMIUM.exists():
        remedy = "apt install chromium"
        raise RequestError("--part journeys", "Chromium or Playwright is not installed", remedy=remedy)
    times = QUICK_TIMES if quick else TIMES
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        settings = ConsoleSettings.of(folder / "runs.sqlite")
        walk = partial(_walked, progress=progress)
        runs = partial(_write, record=record)
        rows = walk(partial(runs, facts=facts), settings, JOURNEYS, role=Role.OPERATOR, times=times)
        flood = partial(_write_flood, record=record, facts=facts)
        rows += walk(
            flood, ConsoleSettings.of(folder / "flood.sqlite"), FLOOD, role=Role.OPERATOR, times=times
        )
        learnable = Learnable.create(folder / "learned", seed=seed, progress=progress)
        settings = ConsoleSettings.of(
            folder / "press.sqlite",
            presses=(learnable.press,),
            jobs=(learnable.job,),
            scans=(learnable.scans,),
        )
        of_press = partial(_of_press, facts, learnable.digest)
        rows += walk(
            partial(runs, facts=of_press),
            settings,
            (LEARNING,),
            role=Role.ENGINEER,
            times=1 if quick else LEARNED,
            before=learnable.begin_again,
        )
        progress("a press that is built")
        buildable = Buildable.create(folder / "built", seed=seed)
        settings = ConsoleSettings.of(
            folder / "build.sqlite", presses=(buildable.press,), press_file=buildable.press_file
        )
        rows += walk(
            partial(runs, facts=partial(_of_press, facts, buildable.digest)),
            settings,
            (BUILDING,),
            role=Role.ENGINEER,
            times=BUILT,
            before=buildable.begin_again,
        )
        if not (learnable.learned and buildable.is_built):
            raise RequestError(
                "--part journeys", "the press in use is the one before", remedy="check the console"
            )
    return {
        "rows": rows,
        "times": times,
        "learned": 1 if quick else LEARNED,
        "built": BUILT,
        "runs": RUNS,
        "sheets": SHEETS,
        "seed": seed,
        "quick": quick,
    }


def _of_press(facts: Callable[[int], RunFacts], digest: str, sheets: int) -> RunFacts:
    """Return the facts of a run on this press."""
    return replace(facts(sheets), press_digest=digest)


def _walked(
    write: Callable[[Journal], None],
    settings: ConsoleSettings,
    journeys: Sequence[Journey],
    *,
    role: Role,
    times: int,
    progress: Callable[[str], None],
    before: Callable[[], None] = lambda: None,
) -> list[dict[str, Any]]:
    """Walk journeys through a console of its own, and return a row for each and each window.

    write: writes its runs. before: is called before every walk.
    """
    from playwright.sync_api import sync_playwright

    rows: list[dict[str, Any]] = []
    with Journal.open(str(settings.journal)) as journal:  # stays open, so that the last run goes on
        write(journal)
        secret, port = session(settings, role=role), free_port()
        console = spawned(settings, Listening(port=port), ready=nothing)
        address = f"http://{LOOPBACK}:{port}"
        try:
            wait_until_it_answers(port)
            with sync_playwright() as started:
                browser = started.chromium.launch(executable_path=str(CHROMIUM), args=list(FLAGS))
                for journey in journeys:
                    for width in WIDTHS:
                        progress(f"{journey.name}, {width} px")
                        walks = []
                        for _ in range(times):
                            before()
                            walks.append(_walk(browser, address, secret, journey, width))
                        rows.append(
                            {
                                "journey": journey.name,
                                "width": width,
                                "clicks": max(clicks for clicks, _ in walks),
                                "most_clicks": journey.most_clicks,
                                "median_s": sorted(seconds for _, seconds in walks)[times // 2],
                                "greatest_s": max(seconds for _, seconds in walks),
                                "most_s": journey.most_s,
                            }
                        )
                browser.close()
        finally:
            console.terminate()
            console.join()
    return rows


def _walk(browser: Any, address: str, secret: str, journey: Journey, width: int) -> tuple[int, float]:
    """Walk a journey from the page Now, in a window of its own; the number of clicks, and the seconds."""
    context = browser.new_context(
        viewport={"width": width, "height": 900 if width > 800 else 780},
        reduced_motion="reduce",
        locale="en-GB",
    )
    context.set_default_timeout(PATIENCE_MS)
    context.add_cookies([{"name": COOKIE, "value": secret, "url": address}])
    page = context.new_page()
    page.goto(address)
    page.locator(".incident .body").first.wait_for()
    hand = Hand(page)
    begun_s = time.monotonic()
    journey.walk(hand)
    seconds = time.monotonic() - begun_s
    context.close()
    return hand.clicks, seconds


def _write(
    journal: Journal, *, record: Callable[[int, bool], PageRecord], facts: Callable[[int], RunFacts]
) -> None:
    """Write a run a day, each with streaks and spots, and one that goes on with a streak."""
    now_s = time.time()
    for ago in range(RUNS, -1, -1):
        run = journal.begin_run(replace(facts(SHEETS), started_s=now_s - ago * DAY_S - 2 * SHEETS / 5))
        for sheet in range(SHEETS):
            page = record(sheet, sheet % 40 == 0)
            if sheet % 100 == 50 or (not ago and sheet > SHEETS - 10):
                page = _streak(record(sheet, True))
            journal.record(run, page)
        if ago:
            journal.end_run(run, RunEnd(ended_s=now_s - ago * DAY_S, ending="finished"))
    journal.commit()


def _write_flood(
    journal: Journal, *, record: Callable[[int, bool], PageRecord], facts: Callable[[int], RunFacts]
) -> None:
    """Write a run that goes on, of which each sheet is a misprint at a place where none was before."""
    run = journal.begin_run(replace(facts(FLOOD_ALARMS), started_s=time.time() - FLOOD_ALARMS / 5))
    for sheet in range(FLOOD_ALARMS):
        page = record(sheet, True)
        (region,) = page.verdict.regions
        place = replace(region, x_mm=60.0 * (sheet % 33), y_mm=60.0 * (sheet // 33))
        journal.record(run, replace(page, verdict=replace(page.verdict, regions=(place,))))
    journal.commit()


def _streak(page: PageRecord) -> PageRecord:
    """Return the same misprint as a streak of black."""
    region = Region(
        x_mm=60.0,
        y_mm=0.0,
        width_mm=1.2,
        height_mm=297.0,
        score=9.0,
        kind="streak",
        ink="K",
        darker_percent=12.0,
    )
    return replace(page, verdict=replace(page.verdict, kind="streak", regions=(region,)))
