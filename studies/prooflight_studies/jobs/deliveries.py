"""What is sent into the hot folder: files of all sorts, and where each must end."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from prooflight.errors import InputError
from prooflight.pages.job import JobSource
from prooflight_line.job_queue.arrivals import Arrivals
from prooflight_line.job_queue.examining import ANY_DPI, Examined
from prooflight_line.job_queue.filling import fill_once
from prooflight_line.job_queue.hot_folder import HotFolder
from prooflight_line.job_queue.pairing import Pairing

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

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
