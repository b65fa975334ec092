"""Files of all sorts are sent into a hot folder while the process that fills it is killed; writes jobs.md."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from prooflight.errors import InputError, RequestError
from prooflight.pages.job import JobSource
from prooflight.rng import stream
from prooflight_line.job_queue.arrivals import Arrivals
from prooflight_line.job_queue.examining import ANY_DPI, Examined
from prooflight_line.job_queue.filling import fill_once
from prooflight_line.job_queue.hot_folder import OWN, STAGES, HotFolder
from prooflight_line.job_queue.listing import arriving
from prooflight_line.job_queue.pairing import Pairing
from prooflight_studies.harness.page import write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np

    from prooflight_line.job_queue.hot_folder import Entry

Way = Literal["renamed", "slowly"]
"""How a file is written: under another name and renamed, or under its own with a pause in its middle."""
SHARES: Final = {
    "job": 380,
    "slow": 100,
    "copy": 120,
    "cut": 60,
    "no job": 40,
    "ticket": 60,
    "bad ticket": 40,
    "ticket alone": 20,
    "ordered twice": 20,
    "ordered again": 20,
}
"""Deliveries of each kind in a thousand files: four kinds are of two files."""
PAIRS: Final = ("ticket", "bad ticket", "ordered twice", "ordered again")
LATER: Final = ("ordered twice", "ordered again")
"""Kinds that order once more what was ordered before, and are sent when that has ended."""
WHAT: Final = {
    "job": "a PDF, renamed into place",
    "slow": "a PDF that is written slowly, with a pause in its middle",
    "copy": "the content of another job under another name",
    "cut": "a PDF that was cut off",
    "no job": "a file that is not a job",
    "ticket": "a PDF and its ticket, in either order",
    "bad ticket": "a PDF and a ticket that cannot be used",
    "ticket alone": "a ticket whose PDF does not arrive",
    "ordered twice": "a PDF that was ordered before, under another job's ID",
    "ordered again": "the same PDF and ticket once more",
}
TICKET: Final = (
    '<XJDF xmlns="http://www.CIP4.org/JDFSchema_2_0" JobID="{job}" Types="Product"><ProductList>'
    '<Product Amount="{copies}"/></ProductList><ResourceSet Name="RunList"><Resource><RunList>'
    '<FileSpec URL="{file}"/></RunList></Resource></ResourceSet></XJDF>'
)
BAD: Final = (
    TICKET.replace("JobID", "Job"),
    TICKET.replace("{copies}", "many"),
    TICKET.replace("{file}", "../{file}"),
    TICKET.replace("</XJDF>", ""),
    TICKET.replace("<XJDF", '<!DOCTYPE XJDF SYSTEM "file:///dev/zero"><XJDF'),
)
"""Tickets without a job's ID, of no number, of a file elsewhere, cut off, and with a document type."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SentFile:
    """One file."""

    name: str
    content: bytes
    way: Way = "renamed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Delivery:
    """Files that belong together, in the order in which they are sent."""

    kind: str
    files: tuple[SentFile, ...]
    origin: str
    """Group of deliveries with one content and one order, of which one must be accepted."""
    given: bool = False
    """Whether its PDF is one of the folder that was given, of which it is not known whether it can be used."""

    @property
    def job(self) -> str:
        """Name of its job's file; empty: it has none."""
        return next((file.name for file in self.files if not file.name.endswith(".xjdf")), "")


def small_pdf(number: int) -> bytes:
    """Return a PDF of one page that no other number has."""
    content = f"0 0 0 1 k 10 10 {10 + number % 50} 20 re f % {number}".encode()
    objects = (
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        b"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 100 100] /Contents 4 0 R >>",
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content),
    )
    data, places = b"%PDF-1.7\n", list[int]()
    for at, each in enumerate(objects, start=1):
        places.append(len(data))
        data += b"%d 0 obj\n%s\nendobj\n" % (at, each)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    return (
        data
        + b"xref\n0 5\n0000000000 65535 f \n%strailer\n<< /Size 5 /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n"
        % (
            table,
            len(data),
        )
    )


def deliveries(files: int, pdfs: Sequence[bytes], rng: np.random.Generator) -> list[Delivery]:
    """Return deliveries of about so many files, in the order in which they are sent.

    pdfs: contents of the folder that was given; each is sent once as a job, and some are among the copies.
    """
    numbers = {kind: max(round(share * files / 1000), 1) for kind, share in SHARES.items()}
    made = list[Delivery]()
    for kind, number in numbers.items():
        for at in range(number):
            job_first = kind == "ticket" and at % 2 == 1 and at >= numbers["ordered twice"]
            made.append(_delivery(kind, f"{len(made):04d}", at, made, pdfs, rng, job_first=job_first))
    now = [one for one in made if one.kind not in LATER]
    later = [one for one in made if one.kind in LATER]
    return [now[at] for at in rng.permutation(len(now))] + later


def _delivery(
    kind: str,
    name: str,
    at: int,
    before: Sequence[Delivery],
    pdfs: Sequence[bytes],
    rng: np.random.Generator,
    *,
    job_first: bool,
) -> Delivery:
    number, file = int(name), f"{name}.pdf"
    content = small_pdf(number)
    match kind:
        case "job":
            given = at < len(pdfs)
            return _alone(kind, file, pdfs[at] if given else content, origin=name, given=given)
        case "slow":
            return _alone(kind, file, content, origin=name, way="slowly")
        case "copy":
            jobs = [one for one in before if one.kind == "job"]
            same = jobs[int(rng.integers(len(jobs)))]
            return _alone(kind, file, same.files[0].content, origin=same.origin, given=same.given)
        case "cut":
            return _alone(kind, file, content[: len(content) // 2], origin=name)
        case "no job":
            return _alone(kind, f"{name}.txt", content[9:], origin=name)
        case "ticket alone":
            alone = TICKET.format(job=name, copies=1, file=file)
            return _alone(kind, f"{name}.xjdf", alone.encode(), origin=name)
    text, job, origin = TICKET, name, name
    if kind == "bad ticket":
        text = BAD[at % len(BAD)]
    elif kind in LATER:
        first = [one for one in before if one.kind == "ticket"][at]
        content = next(one.content for one in first.files if one.name == first.job)
        job, origin = (first.origin, first.origin) if kind == "ordered again" else (name, name)
    ticket = SentFile(name=f"{name}.xjdf", content=text.format(job=job, copies=1 + at, file=file).encode())
    pair = (ticket, SentFile(name=file, content=content))
    return Delivery(kind=kind, files=pair[::-1] if job_first else pair, origin=origin)


def _alone(
    kind: str, name: str, content: bytes, *, origin: str, given: bool = False, way: Way = "renamed"
) -> Delivery:
    sent = SentFile(name=name, content=content, way=way)
    return Delivery(kind=kind, files=(sent,), origin=origin, given=given)


# --- the process that fills the queue ---

SETTLE_S: Final = 0.3
"""Shorter than that of the command, so that the study takes minutes; a slow sender pauses for longer."""
WAIT_S: Final = 20.0


def measured(path: Path, _ticket: object) -> Examined:
    """Open a job, measure its pages, and read what its file says of itself."""
    try:
        with JobSource(path=path, dpi=ANY_DPI).open() as job:
            sizes, facts = job.page_sizes_mm, job.document_facts()
    except InputError as error:
        return Examined(pages=0, refused=str(error))
    return Examined(pages=len(sizes), condition="" if facts is None else facts.condition)


def main(path: Path) -> None:
    """Take jobs in until the process is killed."""
    folder = HotFolder.open(path)
    arrivals = Arrivals(folder=path, settle_s=SETTLE_S)
    pairing = Pairing(folder=folder, wait_s=WAIT_S)
    with folder.filling():
        while True:
            for _ in fill_once(folder, arrivals, measured, pairing):
                pass
            arrivals.wait()


if __name__ == "__main__":
    main(Path(sys.argv[1]))


PAUSE_S: Final = 3 * SETTLE_S
"""Pause in the middle of a file that is written slowly."""
PACE_S: Final = 0.02
"""Time between two deliveries."""
LATE_S: Final = 2.0
"""Longest time between the two files of a delivery."""
PATIENCE_S: Final = 7200.0
"""Time after which the study gives up: the process does nothing any more."""
UNFINISHED: Final = 0.1
"""Share of runs that do not end their job, which is queued again."""
PRINTED: Final = 0.3
"""Share of the deliveries that are printed meanwhile; the others stay queued."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobsPlan:
    """Numbers of files and kills."""

    seed: int
    files: int = 1000
    kills: int = 20

    @classmethod
    def quick(cls, seed: int) -> JobsPlan:
        """Return a size that is enough to see that all of it works."""
        return cls(seed=seed, files=60, kills=3)


@dataclass(frozen=True, slots=True, kw_only=True)
class KindRow:
    """Where the deliveries of one kind ended."""

    kind: str
    what: str
    deliveries: int
    queued: int
    done: int
    rejected: int
    wrong: int


@dataclass(frozen=True, slots=True, kw_only=True)
class JobsResults:
    """All figures of the page."""

    seed: int
    quick: bool
    files: int
    given: int
    """PDFs of the folder that was given."""
    kills: int
    caught: int
    """Kills that caught a job while it was checked."""
    settle_s: float
    wait_s: float
    rows: list[KindRow]
    lost: int
    """Files that were sent and lie nowhere."""
    twice: int
    """Files that lie anywhere and were not sent so often."""
    left: int
    """Files that were not taken in, or are still checked."""
    late_tickets: int
    """Tickets that came after their job, and were put to it."""
    too_late: int
    """Tickets whose job had been printed when they came, and which were rejected."""


def run_jobs_study(
    out: Path,
    *,
    plan: JobsPlan,
    pages: Path | None = None,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _step: None,
) -> JobsResults:
    """Send files, kill the process that takes them in, and account for every one; writes jobs.md and its JSON.

    pages: a folder of PDFs that are sent too; None: small PDFs alone.
    """
    of_files, *others = stream(plan.seed, "hot-folder").spawn(3)
    pdfs = [] if pages is None else [path.read_bytes() for path in sorted(pages.glob("*.pdf"))]
    pdfs = list({hashlib.sha256(pdf).digest(): pdf for pdf in pdfs}.values())[
        : plan.files * SHARES["job"] // 1000
    ]
    sent = deliveries(plan.files, pdfs, of_files)
    with tempfile.TemporaryDirectory(prefix="prooflight-jobs-") as place:
        folder = HotFolder.open(Path(place))
        kills, caught = _send_and_kill(folder, sent, plan.kills, others, progress)
        results = _accounted(folder, sent, plan, quick=quick, given=len(pdfs), kills=kills, caught=caught)
    write_page(out / "jobs.md", "jobs", results)
    return results


# --- sending, killing, printing ---


def _send_and_kill(
    folder: HotFolder,
    sent: Sequence[Delivery],
    kills: int,
    generators: Sequence[np.random.Generator],
    progress: Callable[[str], None],
) -> tuple[int, int]:
    """Send everything, and return the numbers of kills and of those that caught a job while it was checked."""
    rng, of_runs = generators
    now = [one for one in sent if one.kind not in LATER]
    later = [one for one in sent if one.kind in LATER]
    seconds = rng.uniform(0, LATE_S, len(sent))
    over = threading.Event()
    sender = threading.Thread(target=_send, args=(folder.path, now, seconds), daemon=True)
    printer = threading.Thread(
        target=_print, args=(folder, int(PRINTED * len(sent)), of_runs, over), daemon=True
    )
    sender.start()
    printer.start()
    made = caught = 0
    until = time.monotonic() + PATIENCE_S
    filler = _started(folder.path)
    marks = [round((number + 1) * len(now) / (kills + 1)) for number in range(kills)]
    while sender.is_alive() or not _drained(folder) or later:
        if time.monotonic() > until:
            raise RequestError(folder.path, "the folder is not emptied", remedy="run the study again")
        if not sender.is_alive() and later and _drained(folder):
            sender = threading.Thread(target=_send, args=(folder.path, later, seconds * 0), daemon=True)
            later = []
            sender.start()
        ended = len(folder.entries(*STAGES))
        if made < kills and ended >= marks[made]:
            time.sleep(rng.uniform(0, 0.05))
            filler.kill()
            filler.wait()
            made += 1
            caught += bool(folder.entries("checking"))
            progress(f"killed {made} of {kills} times, {ended} of {len(sent)} deliveries taken in")
            filler = _started(folder.path)
        time.sleep(0.02)
    over.set()
    printer.join()
    filler.kill()
    filler.wait()
    return made, caught


def _started(folder: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "prooflight_studies.jobs.study", str(folder)])


def _drained(folder: HotFolder) -> bool:
    return not arriving(folder) and not folder.entries("checking")


def _send(folder: Path, sent: Sequence[Delivery], seconds: np.ndarray) -> None:
    """Send deliveries one after another; the second file of one comes when its time is over."""
    late: list[tuple[float, SentFile]] = []
    for delivery, pause_s in zip(sent, seconds, strict=False):
        _write(folder, delivery.files[0])
        late += [(time.monotonic() + pause_s, file) for file in delivery.files[1:]]
        time.sleep(PACE_S)
        due = [one for one in late if one[0] <= time.monotonic()]
        late = [one for one in late if one not in due]
        for _, file in due:
            _write(folder, file)
    for due_s, file in late:
        time.sleep(max(due_s - time.monotonic(), 0))
        _write(folder, file)


def _write(folder: Path, file: SentFile) -> None:
    if file.way == "slowly":
        threading.Thread(target=_write_slowly, args=(folder / file.name, file.content), daemon=True).start()
        return
    unfinished = folder / f"{file.name}.part"
    unfinished.write_bytes(file.content)
    unfinished.rename(folder / file.name)


def _write_slowly(path: Path, content: bytes) -> None:
    with path.open("wb") as writer:
        writer.write(content[: len(content) // 2])
        writer.flush()
        time.sleep(PAUSE_S)
        writer.write(content[len(content) // 2 :])


def _print(folder: HotFolder, most: int, rng: np.random.Generator, over: threading.Event) -> None:
    """Print queued jobs, of which some runs break off, until so many are done."""
    done = 0
    while done < most and not over.is_set():
        with suppress(RequestError), folder.printing() as printing:
            time.sleep(0.01)
            printing.finished = rng.random() > UNFINISHED
            done += printing.finished
        time.sleep(0.02)


# --- where everything is ---


def _accounted(
    folder: HotFolder,
    sent: Sequence[Delivery],
    plan: JobsPlan,
    *,
    quick: bool,
    given: int,
    kills: int,
    caught: int,
) -> JobsResults:
    where: dict[str, Entry] = {}
    lie: Counter[tuple[str, bytes]] = Counter()
    for entry in folder.entries(*STAGES):
        for file in entry.path.iterdir():
            if file.name not in OWN:
                where[file.name] = entry
                lie[file.name, hashlib.sha256(file.read_bytes()).digest()] += 1
    came = Counter((file.name, hashlib.sha256(file.content).digest()) for one in sent for file in one.files)
    accepted = Counter(one.origin for one in sent if _stage(where, one) in ("queued", "done"))
    rows = []
    for kind in SHARES:
        own = [one for one in sent if one.kind == kind]
        stages = Counter(_stage(where, one) for one in own)
        wrong = sum(not right(one, _stage(where, one), accepted, where) for one in own)
        rows.append(
            KindRow(
                kind=kind,
                what=WHAT[kind],
                deliveries=len(own),
                queued=stages["queued"],
                done=stages["done"],
                rejected=stages["rejected"],
                wrong=wrong,
            )
        )
    after = [one for one in sent if one.kind == "ticket" and one.files[0].name == one.job]
    separate = sum(where.get(one.files[1].name) != where.get(one.job) for one in after)
    return JobsResults(
        seed=plan.seed,
        quick=quick,
        files=sum(len(one.files) for one in sent),
        given=given,
        kills=kills,
        caught=caught,
        settle_s=SETTLE_S,
        wait_s=WAIT_S,
        rows=rows,
        lost=sum((came - lie).values()),
        twice=sum((lie - came).values()),
        left=len(arriving(folder)) + len(folder.entries("checking", "printing", "held")),
        late_tickets=len(after) - separate,
        too_late=separate,
    )


def _stage(where: dict[str, Entry], delivery: Delivery) -> str:
    entry = where.get(delivery.job or delivery.files[0].name)
    return "" if entry is None else entry.stage


def right(delivery: Delivery, stage: str, accepted: Counter[str], where: dict[str, Entry]) -> bool:
    """Return whether a delivery ended where it must.

    accepted: deliveries that were queued or done, by their origin. where: entries by the names of files.
    """
    if stage not in ("queued", "done", "rejected"):
        return False
    match delivery.kind:
        case "job" | "slow" | "copy":
            # Of one content exactly one is accepted, whichever came first; a given PDF may be refused for what it is.
            return accepted[delivery.origin] == 1 or (delivery.given and accepted[delivery.origin] == 0)
        case "ticket":
            one_folder = where.get(delivery.files[0].name) == where.get(delivery.files[1].name)
            first_job = delivery.files[0].name == delivery.job
            return stage != "rejected" and (one_folder or first_job)
        case "ordered twice":
            return stage != "rejected" and where[delivery.files[0].name] == where[delivery.files[1].name]
        case "bad ticket" | "ordered again":
            return stage == "rejected" and where[delivery.files[0].name] == where[delivery.files[1].name]
    return stage == "rejected"
