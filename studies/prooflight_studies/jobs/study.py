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
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError
from prooflight.rng import stream
from prooflight_line.job_queue.hot_folder import OWN, STAGES, HotFolder
from prooflight_line.job_queue.listing import arriving
from prooflight_studies.harness.page import write_page
from prooflight_studies.jobs.deliveries import LATER, SETTLE_S, SHARES, WAIT_S, WHAT, Delivery, deliveries

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np

    from prooflight_line.job_queue.hot_folder import Entry
    from prooflight_studies.jobs.deliveries import SentFile

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
    return subprocess.Popen([sys.executable, "-m", "prooflight_studies.jobs.deliveries", str(folder)])


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
