"""Simulated scans as files, with the truth beside them."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from prooflight.files.atomic import whole_file
from prooflight.pages.job import opened
from prooflight.rng import stream
from prooflight.scans.recorded import write_scan
from prooflight.simulation.scans import scan_page
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of, worlds_digest

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from prooflight.pages.job import JobSource
    from prooflight.press.artefact import Press
    from prooflight.simulation.scans import MisprintRequest


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanToFile:
    """Print, scan and write one page; small and picklable, so that it travels to worker processes."""

    job: JobSource
    press: Press
    out: Path
    request: MisprintRequest | None
    seed: int
    job_pages: int
    world: str = "ideal"
    """One of ``worlds.WORLDS``."""

    def __call__(self, number: int) -> dict[str, Any]:
        """Page ``number`` of the job to ``out``; returns the truth about it."""
        job = opened(self.job)
        press, session = _today(_Day(digest=self.press.digest, seed=self.seed, press=self.press))
        page = press.geometry.lay(job.page(number))
        scan = scan_page(
            page,
            press=press,
            request=self.request,
            others=tuple(n for n in range(1, self.job_pages + 1) if n != number),
            fetch=lambda other: press.geometry.lay(job.page(other)),
            rng=stream(self.seed, "print", number),
            session=session if self.world == "press" else None,
        )
        path = self.out / f"{page.name}.tif"
        truth = {
            "page": page.name,
            "file": str(path),
            "misprint": None if scan.misprint is None else asdict(scan.misprint),
            "draws": scan.draws,
            "print": None if scan.print_ is None else scan.print_.plain(),
        }
        write_scan(path, scan.dn, facts={"page": page.name, "press": press.name, "unit": "DN"})
        return truth


@dataclass(frozen=True, slots=True, kw_only=True)
class _Day:
    digest: str
    seed: int
    press: Press = field(compare=False)


@lru_cache(maxsize=1)
def _today(day: _Day) -> tuple[Press, Session]:
    """The press and its session, the same two objects for every page of a run in one process: true tables are kept."""
    return day.press, Session.draw(amounts_of(day.press), day.press, stream(day.seed, "session"))


def write_truth(path: Path, truths: Sequence[dict[str, Any]], *, world: str, seed: int, press: Press) -> None:
    """``truth.json``: what was done to every page, in which world, from which seed; atomic.

    In the press world also what the press was like, ``session``, and what each print did, in mm, degrees and per cent.
    """
    session = Session.draw(amounts_of(press), press, stream(seed, "session")) if world == "press" else None
    document = {
        "world": world,
        "worlds_sha256": worlds_digest(),
        "seed": seed,
        "press_digest": press.digest,
        "session": None if session is None else session.plain(press),
        "scans": list(truths),
    }
    with whole_file(path) as unfinished:
        unfinished.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
