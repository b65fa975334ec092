"""Runs and pages to be journalled, and a disk that is full; tests of the journal share them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from sqlalchemy import event

from prooflight.detectors.verdict import Verdict
from prooflight_line.journal import packs
from prooflight_line.journal.records import PageRecord, RunFacts

if TYPE_CHECKING:
    from prooflight_line.journal.journal import Journal


def facts(**changes: Any) -> RunFacts:
    told = RunFacts(
        job="job.pdf",
        job_digest="j" * 64,
        press="rig",
        press_digest="p" * 64,
        detector="matched_filter",
        source="drum:5",
        started_s=1000.0,
        sheets=100,
        settings={"seed": 3},
    )
    return replace(told, **changes)


def record(sheet: int, *, score: float = 0.5, kept: bool = True, **changes: Any) -> PageRecord:
    verdict = Verdict(page=f"p{sheet:04}", verdict="good", score=score, threshold=1.0)
    arrays = {"values": np.full(50, sheet, np.float32), "wrong_page": np.array(False)}
    told = PageRecord(
        sheet=sheet,
        job_page=sheet,
        verdict=verdict,
        late=False,
        first_line=3000 * sheet,
        time_s=0.2 * sheet,
        evidence=arrays if kept else None,
    )
    return replace(told, **changes)


def files_of(path: Path) -> list[Path]:
    """Of a journal's evidence."""
    return sorted(file for file in packs.evidence_folder(path).rglob("*") if file.is_file())


def limit(journal: Journal, pages: int) -> None:
    """As if the disk had room for so many more of the database's pages."""
    with journal._engine.begin() as connection:
        now = connection.exec_driver_sql("PRAGMA page_count").scalar_one()
    journal._engine.dispose()
    at = now + pages if pages else 1 << 30
    event.listen(journal._engine, "connect", lambda raw, _: raw.execute(f"PRAGMA max_page_count = {at}"))
