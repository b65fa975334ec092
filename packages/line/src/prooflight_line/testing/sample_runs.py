"""Runs of a press floor for tests, studies and pictures: drift, streaks, spots, lost lines, late sheets.

The journal's own writer records them. They are made up from a seed: no press prints, and nothing is detected. Where the
expected pages of a job are given, the stored sections of scans are cut from them, with a defect drawn in.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.cmyk import INK_NAMES
from prooflight.detectors.verdict import Region, Verdict
from prooflight.rng import stream
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, RunEnd, RunFacts

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

NOON_S: Final = 1_780_000_000.0
"""When the first run began: 28 May 2026. [s]"""
EVERY_S: Final = 5400.0
JOBS: Final = ("spring-catalogue.pdf", "annual-report.pdf", "labels-0417.pdf", "spring-catalogue.pdf")
TIMES: Final = {"median_ms": 141.2, "p99_ms": 262.9, "p999_ms": 402.5, "greatest_ms": 431.0, "count": 600}
DARKER_PERCENT: Final = {"streak": 14.0, "spots-voids": 83.0, "missing-content": -61.0}
SEED: Final = 26
JOB_PAGES: Final = 24
CUT_PIXELS: Final = 140
MOST_CUT_PIXELS: Final = 256
MARGIN_MM: Final = 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExpectedScan:
    """Scan of a page as it is expected: the page alone, without what lies around it."""

    dn: NDArray[np.float32]
    """(sensors, lines, pixels) [DN]."""
    pixel_mm: float
    line_mm: float


def facts(number: int, **changes: Any) -> RunFacts:
    """Return the facts of run ``number``, from 0."""
    usual = RunFacts(
        job=JOBS[number % len(JOBS)],
        job_digest="",
        press="press-2",
        press_digest=hashlib.sha256(b"press-2").hexdigest(),
        detector="matched_filter",
        source="genicam:linea-4k",
        started_s=NOON_S + EVERY_S * number,
        sheets=600,
        settings={"deadline_s": 0.5, "inspectors": 2, "source_clock": True, "room": 6, "stall_s": 10.0},
    )
    return replace(usual, **changes)


def sheet(number: int, rng: np.random.Generator, *, drifts: float = 1.0) -> PageRecord:
    """Return a good sheet. drifts: how much faster than usual its press drifts."""
    slow = drifts * number / 600
    nuisance = {}
    for at, ink in enumerate(INK_NAMES):
        nuisance[f"gain-{ink}"] = float(0.02 * np.sin(number / 90 + at) + 0.028 * slow + rng.normal(0, 0.006))
        nuisance[f"register-{ink}-x"] = float(0.05 * np.cos(number / 140 + at) + rng.normal(0, 0.012))
        nuisance[f"register-{ink}-y"] = float(0.07 * slow + 0.03 * at - 0.05 + rng.normal(0, 0.015))
    nuisance |= {"shift-x": float(0.4 * slow + rng.normal(0, 0.08)), "shift-y": float(rng.normal(0, 0.1))}
    nuisance |= {f"light-{name}": float(-0.018 * slow + rng.normal(0, 0.002)) for name in ("first", "second")}
    nuisance |= {f"lamp-{wave}": float(rng.normal(0, 0.004) / wave) for wave in range(1, 7)}
    verdict = Verdict(
        page=f"p{number % JOB_PAGES + 1:04}",
        verdict="good",
        score=float(rng.normal(-1.5, 0.6)),
        threshold=2.0,
        probability=0.001,
        milliseconds=float(np.exp(rng.normal(np.log(120), 0.2))),
        detector="matched_filter",
    )
    return PageRecord(
        sheet=number,
        job_page=number,
        verdict=verdict,
        late=False,
        first_line=3100 * number,
        time_s=0.2 * number,
        nuisance=nuisance,
    )


def misprint(
    number: int,
    rng: np.random.Generator,
    *,
    kind: str,
    box_mm: tuple[float, float, float, float],
    accepted: bool = False,
    page: str | None = None,
    expected: Callable[[int], ExpectedScan] | None = None,
) -> PageRecord:
    """Return a misprint with a stored section of its scan. expected: scan of page N of the job, from 1."""
    good = sheet(number, rng)
    region = Region.rounded(
        box_mm,
        score=float(rng.normal(12, 1)),
        kind=kind,
        ink="M" if kind == "streak" else "",
        darker_percent=DARKER_PERCENT.get(kind),
        above_good_sd=float(rng.normal(8, 0.5)),
    )
    verdict = replace(
        good.verdict,
        verdict="misprint",
        stopping_costs_more=accepted,
        kind=kind,
        regions=(region,),
        score=float(rng.normal(7, 1)),
        probability=0.98,
        page=page or good.verdict.page,
    )
    if expected is None:
        cut, box = _synthetic_cut(kind, box_mm, rng)
    else:
        cut, box = _cut(expected(number % JOB_PAGES + 1), region, rng)
    evidence = {"cut0": cut, "cut0_mm": np.array(box), "wrong_page": np.array(False)}
    return replace(good, verdict=verdict, evidence=evidence)


def _synthetic_cut(
    kind: str, box_mm: tuple[float, float, float, float], rng: np.random.Generator
) -> tuple[NDArray[np.uint16], tuple[float, float, float, float]]:
    """Return paper with some lines of text and a defect, and its rectangle on the page. [DN, mm]"""
    cut = np.full((2, CUT_PIXELS, CUT_PIXELS), 3000.0)
    for top in range(8, CUT_PIXELS, 16):
        cut[:, top : top + 5, :] -= 2200 * np.repeat(rng.random(CUT_PIXELS // 4) < 0.45, 4)
    if kind == "streak":
        cut[:, :, 66:71] -= 700
    else:
        rows, columns = np.ogrid[:CUT_PIXELS, :CUT_PIXELS]
        cut[:, np.hypot(rows - 70, columns - 70) < 14] = 500
    cut += rng.normal(0, 30, cut.shape)
    x, y, width, height = box_mm
    box = (x + width / 2 - 7.4, y + min(height, 20) / 2 - 7.4, 14.8, 14.8)
    return np.clip(cut, 0, 4095).astype(np.uint16), box


def _cut(
    scan: ExpectedScan, defect: Region, rng: np.random.Generator
) -> tuple[NDArray[np.uint16], tuple[float, float, float, float]]:
    """Return the section of an expected scan around a defect, with that and noise, and its rectangle. [DN, mm]"""
    pitch = np.array([scan.line_mm, scan.pixel_mm])
    corner, size = np.array([defect.y_mm, defect.x_mm]), np.array([defect.height_mm, defect.width_mm])
    half = np.minimum((size / 2 + MARGIN_MM) / pitch, MOST_CUT_PIXELS / 2)
    half = np.maximum(half, CUT_PIXELS / 2)
    middle = (corner + size / 2) / pitch
    extent = np.array(scan.dn.shape[1:])
    first = np.clip(np.rint(middle - half), 0, extent - 1).astype(int)
    last = np.clip(np.rint(middle + half), first + 1, extent).astype(int)
    cut = scan.dn[:, first[0] : last[0], first[1] : last[1]].astype(np.float64)
    begin, end = ((np.rint(at / pitch) - first).astype(int).clip(0) for at in (corner, corner + size))
    spoiled = cut[:, begin[0] : end[0], begin[1] : end[1]]
    paper = np.quantile(scan.dn, 0.999, axis=(1, 2))[:, None, None]
    if defect.kind == "missing-content":
        spoiled[:] = paper
    else:
        rows, columns = np.ogrid[-1 : 1 : spoiled.shape[1] * 1j, -1 : 1 : spoiled.shape[2] * 1j]
        round_shape = np.hypot(rows, columns) < 1
        spoiled *= 0.86 if defect.kind == "streak" else np.where(round_shape, 0.2, 1.0)
    cut += rng.normal(0, 0.004, cut.shape) * paper
    (y, x), (height, width) = first * pitch, (last - first) * pitch
    return np.clip(np.rint(cut), 0, 4095).astype(np.uint16), (x, y, width, height)


def troubled(
    number: int,
    rng: np.random.Generator,
    seed: int,
    expected: Callable[[int], ExpectedScan] | None = None,
) -> PageRecord:
    """Return a sheet of a run that has its share of everything."""
    if 210 <= number < 260 and number % 2 == seed % 2:
        x = 61.0 + rng.normal(0, 0.4)
        return misprint(number, rng, kind="streak", box_mm=(x, 0.0, 1.6, 297.0), expected=expected)
    if number % 97 == 40:
        place = rng.normal([140.0, 210.0], 7.0)
        return misprint(
            number,
            rng,
            kind="spots-voids",
            box_mm=(*place, *rng.uniform(3, 9, 2)),
            accepted=True,
            expected=expected,
        )
    if number % 151 == 90:
        return misprint(
            number, rng, kind="missing-content", box_mm=(18.0, 24.0, 74.0, 31.0), expected=expected
        )
    good = sheet(number, rng, drifts=1 + seed % 3)
    if number in (330, 331, 332):
        first, lost = 3100 * number + 1400, 3 * number - 900
        detail = f"lines {first} to {first + lost - 1} were lost: parts of block {number} did not arrive"
        reason = f"lines lost: {detail}: {lost / 3000:.0%} of the sheet was not seen"
        verdict = Verdict(page=good.verdict.page, verdict="not-inspected", reason=reason)
        return replace(good, verdict=verdict, faults=("lost-lines",), nuisance={})
    if number in (470, 471):
        return replace(good, late=True, verdict=replace(good.verdict, milliseconds=640.0))
    return good


def write_runs(
    path: Path,
    *,
    runs: int = 3,
    sheets: int = 400,
    every_s: float = EVERY_S,
    going: bool = True,
    expected: Callable[[int], ExpectedScan] | None = None,
    **changes: Any,
) -> None:
    """Write some runs.

    Parameters
    ----------
    every_s
        Time from the beginning of a run to that of the next. [s]
    going
        Whether the last run has no end, and a streak goes on in it.
    expected
        Scan of page N of the job, from 1, of which the sections of the last run are cut; None: they are made up.
    changes
        Facts of each run.
    """
    with Journal.open(str(path)) as journal:
        for number in range(runs):
            rng = stream(SEED, "sample-run", number)
            started_s = NOON_S + every_s * number
            begun = facts(number, sheets=sheets, **{"started_s": started_s, **changes})
            run = journal.begin_run(begun)
            last = going and number == runs - 1
            for at in range(258 if last else sheets):
                journal.record(run, troubled(at, rng, number, expected if last else None))
            journal.commit()
            if not last:
                counts = {"elapsed_s": sheets / 5 + number, "stages": {"verdict": TIMES}}
                ended_s = begun.started_s + sheets / 5
                journal.end_run(run, RunEnd(ended_s=ended_s, ending="finished", counts=counts))
