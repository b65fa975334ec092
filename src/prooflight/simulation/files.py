"""Files of simulated scans, with the ground truth next to them."""

from __future__ import annotations

import json
from collections.abc import Container, Sequence
from dataclasses import asdict, dataclass
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import RequestError
from prooflight.files.atomic import whole_file
from prooflight.files.given import GivenFiles
from prooflight.pages.job import JobSource, opened
from prooflight.rng import stream
from prooflight.scans.recorded import write_scan
from prooflight.simulation.scans import MisprintRequest, scan_page
from prooflight.simulation.session import session_of
from prooflight.simulation.worlds import measured_digest, worlds_digest

if TYPE_CHECKING:
    from prooflight.press.artefact import Press


TRUTH_FILES: Final = GivenFiles(error=RequestError, remedy="give another folder", largest_mb=1000)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanToFile:
    """Work of printing, scanning and writing one page.

    Small and picklable, so that it can be sent to worker processes.
    """

    job: JobSource
    press: Press
    out: Path
    request: MisprintRequest | None
    seed: int
    job_pages: int
    world: str = "ideal"
    """One of ``worlds.WORLDS``."""

    def __call__(self, number: int) -> dict[str, Any]:
        """Write page ``number`` of the job to ``out``; return its ground truth."""
        job, press = opened(self.job), self.press
        page = press.geometry.lay(job.page(number))
        scan = scan_page(
            page,
            press=press,
            request=self.request,
            others=tuple(n for n in range(1, self.job_pages + 1) if n != number),
            fetch=lambda other: press.geometry.lay(job.page(other)),
            rng=stream(self.seed, "print", number),
            session=session_of(press, self.seed, self.world),
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


def stored_truths(
    path: Path, pages: Container[str], *, world: str, seed: int, press: Press
) -> list[dict[str, Any]]:
    """Return the truths in a ``truth.json`` that stay valid when ``pages`` are printed again into its folder.

    Parameters
    ----------
    path
        Path of ``truth.json``; it need not exist.
    pages
        Names of the pages that will be printed.
    world, seed, press
        Parameters of the new prints.

    Raises
    ------
    RequestError
        If scans of other pages lie there that are of another world, seed or press, or the file is of another form.
    """
    if not path.exists():
        return []
    remedy = "give another folder, or remove its content"
    try:
        document = json.loads(TRUTH_FILES.read_text(path))
        old = [dict(truth) for truth in document["scans"] if truth["page"] not in pages]
        earlier = document["world"], document["seed"], document["press_digest"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise RequestError(path, "does not state what was printed there", remedy=remedy) from error
    if old and earlier != (world, seed, press.digest):
        what = f"describes {len(old)} scans of another world, seed or press"
        raise RequestError(path, what, remedy=remedy)
    return old


def write_truth(path: Path, truths: Sequence[dict[str, Any]], *, world: str, seed: int, press: Press) -> None:
    """Write ``truth.json``: the misprint of every page, the world and the seed; atomic.

    Scans are in the order of their pages' names. In all worlds but the ideal it also holds the press's
    parameters, ``session``, and those of each print, in mm, degrees and per cent.
    """
    session = session_of(press, seed, world)
    document = {
        "world": world,
        "worlds_sha256": worlds_digest(),
        "measured_sha256": measured_digest() if world == "measured" else None,
        "seed": seed,
        "press_digest": press.digest,
        "session": None if session is None else session.plain(press),
        "scans": sorted(truths, key=itemgetter("page")),
    }
    with whole_file(path) as unfinished:
        unfinished.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
