"""Rows of a journal for tests: a run, a good sheet, a misprint with its evidence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from prooflight.detectors.verdict import Region, Verdict
from prooflight_line.journal.records import PageRecord, RunFacts

CUT_MM = (100.0, 50.0, 12.0, 12.0)


def facts(**changes: Any) -> RunFacts:
    told = RunFacts(
        job="catalogue",
        job_digest="",
        press="rig",
        press_digest="p" * 64,
        detector="matched_filter",
        source="drum:5",
        started_s=1000.0,
        sheets=40,
    )
    return replace(told, **changes)


def good(sheet: int, **changes: Any) -> PageRecord:
    verdict = Verdict(page=f"p{sheet + 1:04}", verdict="good", score=-1.0, threshold=1.0, milliseconds=80.0)
    nuisance = {"gain-black": 0.001 * sheet, "shift-x": 0.1, "light-black": 0.002}
    told = PageRecord(
        sheet=sheet,
        job_page=sheet,
        verdict=verdict,
        late=False,
        first_line=3000 * sheet,
        time_s=0.2 * sheet,
        nuisance=nuisance,
    )
    return replace(told, **changes)


def misprint(sheet: int, *, kind: str = "spots-voids", kept: bool = True, **changes: Any) -> PageRecord:
    region = Region(x_mm=104.0, y_mm=54.0, width_mm=3.0, height_mm=3.0, score=9.0, kind=kind)
    verdict = Verdict(
        page=f"p{sheet + 1:04}",
        verdict="misprint",
        kind=kind,
        regions=(region,),
        score=8.0,
        threshold=1.0,
        probability=0.97,
        milliseconds=110.0,
        detector="matched_filter",
    )
    cut = np.full((1, 120, 120), 3000, np.uint16)
    cut[:, 40:70, 40:70] = 400
    evidence = {"cut0": cut, "cut0_mm": np.array(CUT_MM), "wrong_page": np.array(False)}
    return good(sheet, verdict=verdict, evidence=evidence if kept else None, **changes)
