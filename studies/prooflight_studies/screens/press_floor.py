"""A console as it is on a press floor: runs with incidents, people, labels, a gate, a queue, zones and versions.

All of it is made up, but for the pages: the expected pages of a job on a press, with defects drawn into them.
"""

from __future__ import annotations

import json
import threading
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import uvicorn

from prooflight.files.content import content_digest
from prooflight.pages.job import JobSource
from prooflight.pages.zones.zones_file import JobZones, ZoneEntry
from prooflight.prediction.predict import predict
from prooflight.press.artefact import Press
from prooflight.press.pages import PressJob, job_source
from prooflight_console.accounts.roles import Role, Scope, Who
from prooflight_console.app import console_app
from prooflight_console.engineering.effect import Effect
from prooflight_console.engineering.versions import Version
from prooflight_console.running import ConsoleServer, Listening
from prooflight_console.settings import ConsoleSettings
from prooflight_line.job_queue.hot_folder import HotFolder
from prooflight_line.journal.following import follow
from prooflight_line.journal.journal import Journal
from prooflight_line.plant.gate.log import GateLog, log_path
from prooflight_line.plant.gate.registers import Code, Result
from prooflight_line.testing.postgres import local_postgres, server_programs
from prooflight_line.testing.sample_runs import JOB_PAGES, NOON_S, ExpectedScan, write_runs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from prooflight_console.console import Console

RUNS: Final = 5
"""Runs, one a day; the last goes on."""
DAY_S: Final = 86_400.0
CLOCK_S: Final = NOON_S + DAY_S * (RUNS - 1) + 1200.0
"""Time of day on the floor, which stands still: however long the pictures take, a sheet came just now. [s]"""
ADMIN, OPERATOR, ENGINEER, VIEWER = "Petra Sommer", "Jan Kowalski", "Mei Lin", "Tom Reeve"
PEOPLE: Final = {ADMIN: Role.ADMIN, OPERATOR: Role.OPERATOR, ENGINEER: Role.ENGINEER, VIEWER: Role.VIEWER}
GOING: Final = RUNS
"""Run that goes on."""
PICTURED: Final = (256, 137)
"""Sheets of this run whose pages are shown beside what the camera saw."""
TRAYS_TO: Final = 250
"""Tag up to which the controller has reported trays."""
LABELS: Final = (
    (OPERATOR, 1, "misprint", ""),
    (OPERATOR, 2, "false-alarm", "the picture box was swapped on purpose"),
    (OPERATOR, 3, "false-alarm", ""),
    (ENGINEER, 3, "misprint", "the spot is on the plate"),
    (OPERATOR, 4, "misprint", "scraper replaced"),
)
"""Person, incident of the first run, label and note."""
ORDER: Final = """<XJDF xmlns="http://www.CIP4.org/JDFSchema_2_0"
    Types="Product" JobID="{job}" DescriptiveName="{name}">
  <ProductList><Product Amount="{copies}" IsRoot="true"/></ProductList>
  <ResourceSet Name="CustomerInfo"><Resource><CustomerInfo CustomerID="{customer}"/></Resource></ResourceSet>
  <ResourceSet Name="Media" Usage="Input">
    <Resource Brand="Gloss Art"><Media MediaType="Paper" Weight="135"/></Resource>
  </ResourceSet>
</XJDF>
"""
JOBS: Final = (
    ("spring-catalogue.pdf", "J-0412", "Spring catalogue", 400, "Halden Garden", "printing", ""),
    ("menu-lunch.pdf", "J-0417", "Lunch menu", 250, "Bistro Vert", "queued", ""),
    ("price-list-2026.pdf", "J-0418", "Price list", 1200, "Nordwerk", "queued", ""),
    ("labels-0420.pdf", "", "", 0, "", "held", ""),
    ("annual-report.pdf", "J-0409", "Annual report", 600, "Nordwerk", "done", ""),
    (
        "poster-a0.pdf",
        "J-0411",
        "Poster",
        40,
        "Stadttheater",
        "rejected",
        "page 1: is 841.0 x 1189.0 mm; this press sees 328.4 mm across; build a press with more pixels",
    ),
)
"""File, number, name, copies and customer of each job, its stage, and why it was rejected."""
EFFECT: Final = Effect(
    runs=3,
    sheets=1058,
    unknown=0,
    alarms_before=96,
    alarms=93,
    more=2,
    fewer=5,
    fewer_good=4,
    misprints=27,
    missed=0,
    cost_cents=310.0,
)
NOTES: Final = ((NOON_S, "new lamp"), (NOON_S + 3 * DAY_S, "blanket washed"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Floor:
    """A console that is served, with the session of its admin and the secret of its kiosk."""

    address: str
    session: str
    kiosk: str
    has_records: bool
    """Whether the records of several presses are shown, which needs PostgreSQL."""
    console: Console


@contextmanager
def press_floor(folder: Path, press_file: Path, job_file: Path) -> Iterator[Floor]:
    """Serve such a console in this process. press_file, job_file: copies of them in ``folder`` are used."""
    folder.mkdir(parents=True, exist_ok=True)
    journal = folder / "press-2.sqlite"
    press_path, job = folder / "press-2.press", folder / job_file.name
    press_path.write_bytes(press_file.read_bytes())
    job.write_bytes(job_file.read_bytes())
    _write_zones(job)
    press = Press.load(press_path)
    digests: dict[str, Any] = {"job_digest": content_digest(job), "press_digest": press.digest}
    write_runs(journal, runs=RUNS, every_s=DAY_S, expected=_expected(press, job), **digests)
    _write_gate_log(journal)
    queue = folder / "queue"
    _write_queue(queue)
    with ExitStack() as stack:
        stack.enter_context(Journal.open(str(journal)))  # an open journal is that of a press that is watched
        records = _records(stack, journal) if server_programs() is not None else None
        settings = ConsoleSettings.of(
            journal, presses=(press_path,), jobs=(job,), queue=queue, records=records
        )
        address, console = stack.enter_context(served_here(settings))
        stack.enter_context(HotFolder.open(queue).filling())
        run = console.reading.run(GOING)
        for sheet in PICTURED:  # begins to predict its page, which takes a while
            console.pictures.describe(run, console.reading.sheet(GOING, sheet))
        yield Floor(
            address=address,
            session=_write_people(console, press),
            kiosk=console.accounts.kiosks.enrol("Press 2, delivery", by=ADMIN),
            has_records=records is not None,
            console=console,
        )


@contextmanager
def served_here(settings: ConsoleSettings) -> Iterator[tuple[str, Console]]:
    """Serve a console in a thread, at a time that stands still; gives its address and its services."""
    app = console_app(settings, clock=lambda: CLOCK_S, ticking=lambda: 0.0)
    console: Console = app.state.console
    listening = Listening(port=0)
    with listening.bound() as bound:
        config = uvicorn.Config(app, log_level="error", access_log=False, timeout_graceful_shutdown=1)
        server = ConsoleServer(config, console.live)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [bound]}, daemon=True)
        thread.start()
        pause = threading.Event()
        while not server.started and thread.is_alive():
            pause.wait(0.01)
        try:
            yield listening.reached_at(bound.getsockname()[1]), console
        finally:
            console.live.close()
            server.should_exit = True
            thread.join()


def _expected(press: Press, job: Path) -> Callable[[int], ExpectedScan]:
    source = job_source(job, press)

    @lru_cache(maxsize=JOB_PAGES)
    def scan(number: int) -> ExpectedScan:
        with PressJob(source, press) as opened:
            page = opened.page(number)
        seen = predict(page, sensors=press.sensors, geometry=press.geometry).expected_dn
        lines, columns = press.geometry.on_page(page.width_mm, page.height_mm)
        return ExpectedScan(
            dn=seen[:, lines, columns].copy(),
            pixel_mm=press.geometry.pixel_pitch_mm,
            line_mm=press.geometry.line_pitch_mm,
        )

    return scan


def _write_zones(job: Path) -> None:
    with JobSource(path=job, dpi=72).open() as opened:
        sizes = opened.page_sizes_mm
    entries = [
        ZoneEntry(name="picture", kind="careful", pages="4", rectangle_mm=(20, 60, 80, 70)),
        ZoneEntry(name="numbering", kind="ignore", pages="all", rectangle_mm=(150, 278, 50, 12)),
    ]
    JobZones.create(entries, sizes).save(job.with_name(f"{job.stem}.zones.json"))


def _write_gate_log(journal: Path) -> None:
    """Write the gate's log of the run that goes on, with a sheet that was rejected although it is good."""
    with Journal.open(str(journal), read_only=True) as opened, GateLog(log_path(journal, GOING)) as log:
        log.add("run", run=GOING, job_pages=JOB_PAGES, settings={"policy": "reject"})
        for state in ("joining", "aligning", "ready"):
            log.add("state", state=state, why="")
        for page in opened.pages(GOING):
            bad = page.verdict.verdict != "good"
            result, code = (Result.DIVERT, Code.MISPRINT) if bad else (Result.ACCEPT, Code.GOOD)
            tag = page.sheet + 1
            log.add(
                "decision", tag=tag, sheet=page.sheet, came=True, result=int(result), code=int(code),
                job_page=page.job_page, page=page.verdict.page, set=page.sheet // JOB_PAGES, why="",
                position=3100 * tag,
            )  # fmt: skip
            log.add("written", tag=tag, position=3100 * tag)
            if tag < TRAYS_TO:
                log.add("tray", tag=tag, tray="reject" if bad or tag == 31 else "good", session=1)


def _write_queue(path: Path) -> None:
    path.mkdir()
    folder = HotFolder.open(path)
    for at, (name, number, title, copies, customer, stage, why) in enumerate(JOBS):
        (path / name).write_bytes(name.encode())
        names = [name]
        if number:
            ticket = ORDER.format(job=number, name=title, copies=copies, customer=customer)
            (path / f"{number}.xjdf").write_text(ticket, encoding="utf-8")
            names = [f"{number}.xjdf", name]
        entry = folder.take_in(*names)
        digest = content_digest(entry.file)
        if why:
            folder.reject(entry, digest, why)
            continue
        facts = {"pages": 4 + 4 * at, "condition": "FOGRA39", "notes": []}
        entry = folder.queue(entry, digest, facts)
        if stage != "queued":
            entry.path.rename(path / stage / entry.path.name)


def _records(stack: ExitStack, journal: Path) -> str:
    """Return the address of records of this press and of another one."""
    from prooflight import __version__
    from prooflight_line.records.database import upgrade
    from prooflight_line.records.shipping import Shipper

    url = stack.enter_context(local_postgres("fsync=off")).url
    upgrade(url)
    other = journal.with_name("press-1.sqlite")
    write_runs(other, runs=2, going=False)
    for name, plant, path in (("press-1", "Basel", other), ("press-2", "Bern", journal)):
        followed = follow(path, version=__version__)
        assert followed is not None
        shipper = Shipper.open(url, press=name, plant=plant, journal=followed, announce=lambda _line: None)
        while shipper.step().more:
            pass
        shipper.close()
        followed.close()
    return url


def _write_people(console: Console, press: Press) -> str:
    """Write people, what they labelled and noted, tokens and versions; returns a session of the admin."""
    accounts = console.accounts
    for name, role in PEOPLE.items():
        accounts.choose(accounts.add(name, role, by=ADMIN), "correct horse battery staple")
    people = {one.name: Who(id=one.id, name=one.name, role=one.role) for one in accounts.people()}
    first = console.reading.run(1)
    for name, incident, label, note in LABELS:
        console.say(people[name], label, first, incident=incident, note=note)
    accounts.new_token(ENGINEER, "planning-report", [Scope.READ], by=ENGINEER)
    accounts.add("Ada Novak", Role.OPERATOR, by=ADMIN)
    accounts.change(VIEWER, by=ADMIN, locked=True)
    console.hand_over(people[OPERATOR], "Magenta scraper replaced at 20:40. Watch the streak at 62 mm.")
    for at_s, text in NOTES:
        console.chart_notes.write(text, at_s=at_s, by=OPERATOR)
    _write_versions(console, press)
    return accounts.begin(ADMIN)


def _write_versions(console: Console, press: Press) -> None:
    """Write the press in use as a version, and one that labels gave, with a made-up effect."""
    versions = console.work.versions
    assert versions is not None
    versions.folder.mkdir(exist_ok=True)
    common: dict[str, Any] = {"created_s": CLOCK_S - 3600.0, "by": ENGINEER}
    in_use = Version(digest=press.digest, kind="build", facts={"effect": asdict(EFFECT)}, **common)
    later = Version(digest="5d" * 32, kind="recalibrate", facts={"effect": asdict(EFFECT)}, **common)
    for version in (in_use, later):
        path = versions.folder / f"{version.name}.json"
        path.write_text(json.dumps(asdict(version)), encoding="utf-8")
