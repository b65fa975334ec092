"""The process that takes jobs in, of the study: as ``prooflight queue fill``, but pages are measured and not drawn."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

from prooflight.errors import InputError
from prooflight.pages.job import JobSource
from prooflight_line.job_queue.arrivals import Arrivals
from prooflight_line.job_queue.examining import ANY_DPI, Examined
from prooflight_line.job_queue.filling import fill_once
from prooflight_line.job_queue.hot_folder import HotFolder
from prooflight_line.job_queue.pairing import Pairing

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
