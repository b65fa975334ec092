"""Simulated scans as files, with the truth beside them."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from prooflight.acquiring.replay import write_scan
from prooflight.atomic import whole_file
from prooflight.pages.job import opened
from prooflight.simulating.scans import page_rng, scan_page
from prooflight.simulating.worlds import worlds_digest

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from prooflight.pages.job import JobSource
    from prooflight.press import Press
    from prooflight.simulating.scans import MisprintRequest


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanToFile:
    """Print, scan and write one page; small and picklable, so that it travels to worker processes."""

    job: JobSource
    press: Press
    out: Path
    request: MisprintRequest | None
    seed: int
    job_pages: int

    def __call__(self, number: int) -> dict[str, Any]:
        """Page ``number`` of the job to ``out``; returns the truth about it."""
        press, job = self.press, opened(self.job)
        page = press.geometry.lay(job.page(number))
        scan = scan_page(
            page,
            press=press,
            request=self.request,
            others=tuple(n for n in range(1, self.job_pages + 1) if n != number),
            fetch=lambda other: press.geometry.lay(job.page(other)),
            rng=page_rng(self.seed, number),
        )
        path = self.out / f"{page.name}.tif"
        truth = {
            "page": page.name,
            "file": str(path),
            "misprint": None if scan.misprint is None else asdict(scan.misprint),
            "draws": scan.draws,
        }
        write_scan(path, scan.dn, facts={"page": page.name, "press": press.name, "unit": "DN"})
        return truth


def write_truth(path: Path, truths: Sequence[dict[str, Any]], *, world: str, seed: int, press: Press) -> None:
    """``truth.json``: what was done to every page, in which world, from which seed; atomic."""
    document = {
        "world": world,
        "worlds_sha256": worlds_digest(),
        "seed": seed,
        "press_digest": press.digest,
        "scans": list(truths),
    }
    with whole_file(path) as unfinished:
        unfinished.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
