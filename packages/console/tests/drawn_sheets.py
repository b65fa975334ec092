"""A run whose sheets passed and were drawn: their whole scans are kept, on paper that had moved and stretched."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from packages.line.tests.journal.sample_rows import facts, good

from prooflight.files.content import content_digest
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.redeciding import evidence_to_store
from prooflight.pages.files import write_tiff
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

MARK: Final = (slice(100, 112), slice(60, 72))
"""Rows and columns of the page in the scan where paper lies bare that should be printed."""
MIDDLE: Final = (106, 66)
"""Of the mark, as it lies on the page: the paper's move is taken back within a few pixels."""


def write_drawn(folder: Path, page: Page, press: Press, *, sheets: int = 1) -> dict[str, Any]:
    """Such a run in ``journal.sqlite``; gives what a console is started with besides."""
    job, artefact = folder / "job.tif", folder / "rig.press"
    write_tiff(page, job)
    press.save(artefact)
    inspector = Inspector.of(press, "chi-square")
    seen = inspector.planned(page).expected.expected_dn
    moved = np.float32([[1.002, 0, 1.4], [0, 1.001, -2.3]])
    size = seen.shape[2], seen.shape[1]
    scan = np.rint(cv2.warpAffine(seen[0], moved, size, borderMode=cv2.BORDER_REPLICATE))[None].astype(
        np.uint16
    )
    lines, columns = press.geometry.on_page(page.width_mm, page.height_mm)
    rows, across = MARK
    scan[
        0,
        lines.start + rows.start : lines.start + rows.stop,
        columns.start + across.start : columns.start + across.stop,
    ] = int(press.sensors[0].white_dn)
    inspection = inspector.inspect(page, scan)
    kept = evidence_to_store(inspection, page, press, whole=True)
    kept = {name: array for name, array in kept.items() if not name.startswith("cut")}
    passed = replace(inspection.verdict, verdict="good", regions=(), kind=None)
    with Journal.open(str(folder / "journal.sqlite")) as journal:
        told = facts(
            job_digest=content_digest(job),
            press_digest=press.digest,
            detector="chi-square",
            settings={"sample": 0.1},
        )
        run = journal.begin_run(told)
        for sheet in range(sheets):
            record = good(sheet, job_page=0, verdict=passed, evidence=kept, asked=0.1)
            journal.record(run, record)
        journal.commit()
    return {"presses": (artefact,), "jobs": (job,)}
