"""All counts of sheets to print again, by a controller of its own and by a browser, in runs in which much fails.

The inspection is the process of ``stand_in``, the controller that of ``independent_plc``, the console ``prooflight
serve`` in a browser, and the lists are those of the commands: five programs that share nothing but files and the wire.
The inspection is stopped for a moment and killed by ``kill -9``, the controller hangs, answers slowly and loses its
power, sheets are lost before the camera, taken out by hand behind it, and doubled. Then a person calls an incident a
false alarm, vouches for two sheets, and takes one of the two back.
"""

from __future__ import annotations

import csv
import io
import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, redirect_stdout
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.cli import run as command
from prooflight.errors import RequestError
from prooflight.rng import stream
from prooflight_studies.gate import stand_in
from prooflight_studies.gate.plan import DISTANCE_MM, JOB_PAGES, Plan

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from playwright.sync_api import Page, Route

JOURNAL, TRAYS = "runs.sqlite", "trays.jsonl"
RATE: Final = 5.0
PACE: Final = 0.4
"""How fast time goes, on both sides of the wire: five programs and a browser share the machine."""
READY_S: Final = 4.0
"""Time for the controller to be loaded, before the belt starts."""
WATCHDOG_S: Final = 0.5
AWAY_S: Final = 4.0
"""Time from `kill -9` to the next start."""
FAULTS: Final = {"hung": 2.5, "slow": 5.0, "power": 3.0, "stall": 1.5}
"""How long the controller hangs, answers slowly, has no power, and the inspection is stopped. [s]"""
LOST_SHARE, REMOVED_SHARE = 0.02, 0.02
"""Shares of the sheets that are never printed, and that a person takes out between camera and gate."""
MAY_BE_ACCEPTED: Final = frozenset({"good", "slip", "small-slip"})
"""Kinds of sheets of a plan that the played inspection judges good, seen whole and in their place."""


@dataclass(slots=True, kw_only=True)
class Counts:
    """One start of the inspection, and all that was counted of it."""

    run: int
    needed: int
    killed: bool
    good: int
    """Sheets of the job in the good tray, by the controller's own log."""
    lacking: int
    """Sheets that the job needs and that neither lie in the good tray nor are vouched for."""
    vouched: int
    now: int | None
    page: int
    csv: int
    report: int
    reconcile: int
    reprint_list: int
    differs: list[str] = field(default_factory=list)
    """A line for each count that is not that of the trays."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Started:
    """One start of the inspection, over."""

    seed: int
    run: int
    plan: Plan
    killed: bool
    rows: list[dict[str, Any]]
    """Rows of the controller's own log, while this inspection was there."""


def journeys(
    folder: Path, *, seeds: Sequence[int], sheets: int, progress: Callable[[str], None]
) -> Iterator[dict[str, Any]]:
    """Play a press for each seed, one after the other beside one journal and one log of trays; then count."""
    with serving(folder / JOURNAL, folder / TRAYS) as served:
        starts: list[Started] = []
        for seed in seeds:
            starts += _play(folder, seed=seed, sheets=sheets, first_run=len(starts) + 1)
            progress(f"seed {seed}: {sum(len(one.rows) for one in starts)} sheets at the gate so far")
        with visiting(served, job_pages=JOB_PAGES) as visitor:
            for one in starts:
                counts = _counted(visitor, folder, one, last=one is starts[-1])
                progress(
                    f"run {one.run}: {counts.lacking} to print again; {counts.differs or 'all are equal'}"
                )
                yield {"seed": one.seed, **asdict(counts)}


def _play(folder: Path, *, seed: int, sheets: int, first_run: int) -> list[Started]:
    """One press; the inspection of every third is killed and begins anew."""
    plan, belt = _planned(seed, sheets)
    plan.save(folder / "plan.json")
    trays = folder / TRAYS
    before = _rows(trays)
    began_s = belt["began_s"] = time.monotonic() + READY_S
    for one in belt["faults"]:
        one["at_s"] += began_s
    (folder / "belt.json").write_text(json.dumps(belt), encoding="utf-8")
    program = [sys.executable, "-m", "prooflight_studies.gate.independent_plc"]
    with subprocess.Popen(
        [*program, str(folder / "belt.json"), str(trays)], stdout=subprocess.PIPE, text=True
    ) as plc:
        try:
            assert plc.stdout is not None
            port = plc.stdout.readline().strip()
            where = (str(folder / "plan.json"), str(folder / JOURNAL), "127.0.0.1", port, repr(began_s))
            kill_s = None if seed % 3 else began_s + plan.ends_s * 0.55 / PACE
            _inspect(where, _stalls(belt, kill_s), began_s=began_s, kill_s=kill_s)
        finally:
            plc.kill()
    rows = _rows(trays)[len(before) :]
    if kill_s is None:
        return [Started(seed=seed, run=first_run, plan=plan, killed=False, rows=rows)]
    split_s = kill_s + AWAY_S / 2
    earlier, later = ([row for row in rows if (row["at_s"] < split_s) == first] for first in (True, False))
    return [
        Started(seed=seed, run=first_run, plan=plan, killed=True, rows=earlier),
        Started(seed=seed, run=first_run + 1, plan=plan, killed=False, rows=later),
    ]


def _inspect(
    where: tuple[str, ...], stalls: list[tuple[float, int]], *, began_s: float, kill_s: float | None
) -> None:
    """Have the inspection run, in a process that can be stopped and killed, until its plan ends."""
    context = multiprocessing.get_context("fork")
    _wait(began_s)
    going = context.Process(target=stand_in.main, args=where)
    going.start()
    kill = [] if kill_s is None else [(kill_s, int(signal.SIGKILL))]
    for at_s, what in sorted([*stalls, *kill]):
        _wait(at_s)
        assert going.pid is not None
        os.kill(going.pid, what)
        if what == signal.SIGKILL:
            going.join()
            _wait(at_s + AWAY_S)
            going = context.Process(target=stand_in.main, args=where)
            going.start()
    going.join()
    if going.exitcode:
        raise RuntimeError(f"the inspection ended with {going.exitcode}")


def _stalls(belt: dict[str, Any], kill_s: float | None) -> list[tuple[float, int]]:
    """Return when the inspection is stopped and goes on; it is not stopped while it is killed."""
    signals = []
    for one in belt["faults"]:
        ends_s = one["at_s"] + one["lasts_s"]
        if one["kind"] == "stall" and (kill_s is None or not kill_s - 2 < ends_s < kill_s + 2 * AWAY_S):
            signals += [(one["at_s"], int(signal.SIGSTOP)), (ends_s, int(signal.SIGCONT))]
    return signals


def _rows(trays: Path) -> list[dict[str, Any]]:
    if not trays.exists():
        return []
    return [json.loads(line) for line in trays.read_text(encoding="utf-8").splitlines()]


# --- what is played ---


def _planned(seed: int, sheets: int) -> tuple[Plan, dict[str, Any]]:
    """The plan of the inspection, and the belt of the controller."""
    plan = Plan.draw(
        sheets, rate=RATE, faster=PACE, seed=seed, latencies_s=np.array([0.12, 0.18, 0.3]), rounds=0
    )
    rng = stream(seed, "gate-plan").spawn(1)[0]  # independent of what the plan draws
    lost = rng.uniform(size=sheets) < LOST_SHARE
    removed = rng.uniform(size=sheets) < REMOVED_SHARE
    passed = [
        sheet for sheet, gone in zip(plan.sheets, lost, strict=True) if not gone or sheet is plan.sheets[-1]
    ]
    by_hand = {sheet.serial for sheet, taken in zip(plan.sheets, removed, strict=True) if taken}
    first_s, span_s = plan.sheets[0].front_mm / plan.speed_mm_s, sheets / RATE
    at = np.sort(rng.uniform(0.1, 0.9, len(FAULTS)))
    belt = {
        "speed_mm_s": plan.speed_mm_s * PACE,
        "watchdog_s": WATCHDOG_S / PACE,
        "distance_mm": DISTANCE_MM,
        "first_count": int(rng.integers(2**32)),
        "sheets": [
            {
                "serial": sheet.serial,
                "front_mm": sheet.front_mm,
                "slip_mm": sheet.slip_mm,
                "under": int(sheet.kind == "double"),
            }
            for sheet in passed
            if sheet.serial not in by_hand
        ],
        "faults": [
            {
                "kind": str(kind),
                "at_s": (first_s + float(share) * span_s) / PACE,
                "lasts_s": FAULTS[str(kind)] / PACE,
            }
            for kind, share in zip(rng.permutation(list(FAULTS)), at, strict=True)
        ],
    }
    return replace(plan, sheets=tuple(passed)), belt


def _wait(until_s: float) -> None:
    time.sleep(max(until_s - time.monotonic(), 0.0))


# --- what is counted ---


def _counted(visitor: Visitor, folder: Path, one: Started, *, last: bool) -> Counts:
    journal, trays, plan, run = folder / JOURNAL, folder / TRAYS, one.plan, one.run
    kinds = {sheet.serial: sheet.kind for sheet in plan.sheets}
    accepted = [row["serial"] for row in one.rows if row["tray"] == "good"]
    good = {serial // 2 for serial in accepted if kinds.get(serial) in MAY_BE_ACCEPTED}
    wrong = [serial for serial in accepted if kinds.get(serial, "double") not in MAY_BE_ACCEPTED]
    needed = plan.sheets[-1].serial // 2 + 1
    lacking = set(range(needed)) - good
    differs = [f"sheet {serial} ({kinds.get(serial)}) lies in the good tray" for serial in wrong]
    if not any(row["session"] for row in one.rows):
        differs.append(f"run {run}: the machine was too slow, and the controller received no message")
        return Counts(
            run=run, needed=needed, killed=one.killed, good=0, lacking=needed, vouched=0, now=None,
            page=-1, csv=-1, report=-1, reconcile=-1, reprint_list=-1, differs=differs,
        )  # fmt: skip
    listed = _command("reprint-list", run, journal, trays)["reprints"]
    for row in [row for row in listed if row["verdict"] == "misprint" and row["sheet"] is not None][:1]:
        visitor.call_false_alarm(run, row["sheet"])
    vouchable = [(row["sheet"], row["run_sheet"]) for row in listed if row["sheet"] is not None][:2]
    for sheet, _ in vouchable:
        visitor.vouch(run, sheet)
    for sheet, _ in vouchable[1:]:
        visitor.undo(run, sheet)
    lacking -= {place for _, place in vouchable[:1]}
    shown = visitor.read(run, needed=needed, last=last)
    after = _command("reprint-list", run, journal, trays)
    reconciled = _command("reconcile", run, journal, trays)
    for name, places in (
        ("the console's list", shown.listed),
        ("its CSV", shown.csv),
        ("reprint-list", {row["run_sheet"] for row in after["reprints"]}),
    ):
        if odd := sorted(lacking ^ set(places)):
            differs.append(f"{name} and the trays differ for the sheets {odd[:10]} of run {run}")
    counts = Counts(
        run=run,
        needed=needed,
        killed=one.killed,
        good=len(good),
        lacking=len(lacking),
        vouched=len(vouchable[:1]),
        now=shown.now,
        page=shown.total,
        csv=len(shown.csv),
        report=shown.report,
        reconcile=reconciled["to_print_again"],
        reprint_list=after["count"],
    )
    numbers = (shown.now, shown.total, shown.report, counts.reconcile, counts.reprint_list)
    if {number for number in numbers if number is not None} != {len(lacking)}:
        differs.append(f"run {run}: counts are {numbers}, and {len(lacking)} sheets are not delivered")
    if reconciled["counts"].get("accepted", 0) != len(good) or reconciled["counts"].get("wrong", 0):
        differs.append(
            f"run {run}: reconcile says {reconciled['counts']}, {len(good)} good sheets are in the tray"
        )
    return replace(counts, differs=differs)


def _command(name: str, run: int, journal: Path, trays: Path) -> dict[str, Any]:
    printed = io.StringIO()
    with redirect_stdout(printed):
        command(["run", name, str(run), "--journal", str(journal), "--trays", str(trays), "--json"])
    answer: dict[str, Any] = json.loads(printed.getvalue())
    return answer


# --- the console in a browser ---

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
