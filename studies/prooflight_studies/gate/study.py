"""The gate measured: a long run in which everything fails, the real ``watch`` beside it, and how far the gate must be.

Four parts, kept apart in ``gate.json``: ``latency`` and ``watch`` run the real detector; ``plant`` draws its verdicts'
times from those; ``counts`` counts what is to be printed again, by another controller and in a browser.
"""

from __future__ import annotations

import os
import tempfile
import warnings
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.stats import genpareto

from prooflight import __version__
from prooflight.rng import stream
from prooflight_line.journal.journal import Journal
from prooflight_line.plant.gate.gate import exchange_s
from prooflight_line.plant.gate.log import LoggedDecisions, PlantError, log_path, rows_of
from prooflight_line.plant.gate.reconciling import read_trays, reconciled
from prooflight_studies.gate.journeys import PACE, journeys, needed
from prooflight_studies.gate.picture import draw_handshake, draw_trays
from prooflight_studies.gate.plan import DISTANCE_MM, LASTS_S, PITCH_MM, SHARES, SHEET_MM, Plan
from prooflight_studies.gate.plant import run_plant
from prooflight_studies.gate.real import COARSER, EVERY, MISPRINT, Rig, run_watch
from prooflight_studies.gate.real import DISTANCE_MM as REAL_DISTANCE_MM
from prooflight_studies.gate.stand_in import settings_of
from prooflight_studies.harness.page import stored_results, write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from prooflight_line.plant.gate.reconciling import Reconciliation
    from prooflight_line.plant.simulator.plc import TrayRow
    from prooflight_studies.gate.plant import Happened

PARTS: Final = ("latency", "watch", "plant", "counts")
SHEETS, QUICK_SHEETS = 10_000, 300
JOURNEYS, QUICK_JOURNEYS = (8, 40), (1, 40)
"""Presses of the counts, and sheets of each."""
RATE: Final = 5.0
FASTER: Final = 2.0
ROUNDS, QUICK_ROUNDS = 3, 1
"""How often each failure happens."""
REAL_RATE, QUICK_REAL_RATE = 4.0, 2.0
LATENCY_SHEETS, QUICK_LATENCY_SHEETS = 840, 60
"""3.5 minutes at 4 a second."""
WATCH_SHEETS, QUICK_WATCH_SHEETS = 240, 48
WATCH_RATE: Final = 2.0
KILL_SHARE: Final = 0.5
"""Share of the sheets at the gate when `watch` is killed."""
PUBLISHED_MS: Final = ((0.0, 120.0), (0.5, 182.0), (0.99, 275.0), (0.999, 363.0), (1.0, 487.0))
"""Share and time from last line to verdict, as measured once of chi-square, two sensors, 5 sheets a second on two
cores; the least is assumed. Used where `latency` has not been measured in full."""
RATES: Final = (1.0, 5.0, 10.0)
SAMPLES_MS: Final = 2000
"""Times kept in the results."""


def run_gate_study(
    out: Path,
    *,
    parts: Sequence[str],
    cache: Path,
    seed: int,
    quick: bool,
    sheets: int | None,
    faster: float | None,
    progress: Callable[[str], None],
) -> dict[str, Any]:
    """Measure parts; what other parts had measured stays. Writes gate.md, gate.json and pictures."""
    out.mkdir(parents=True, exist_ok=True)
    if "counts" in parts:
        needed()
    new: dict[str, Any] = {}
    if "latency" in parts:
        new["latency"] = _latency(cache, seed=seed, quick=quick, progress=progress)
    if "watch" in parts:
        new["watch"] = _watch(cache, quick=quick, progress=progress)
    if "plant" in parts:
        new["plant"], happened = _plant(
            new.get("latency") or _measured(stored_results(out / "gate.md")),
            seed=seed,
            sheets=sheets or (QUICK_SHEETS if quick else SHEETS),
            faster=faster or FASTER,
            rounds=QUICK_ROUNDS if quick else ROUNDS,
            progress=progress,
        )
        draw_trays(out / "gate-trays.png", happened.rows)
    if "counts" in parts:
        new["counts"] = _counts(seed=seed, quick=quick, progress=progress)
    # Parts may have been measured meanwhile by others.
    stored = stored_results(out / "gate.md")
    done = {part: {"seed": seed, "quick": quick} for part in parts}
    results = dict.fromkeys(PARTS) | stored | new
    results |= {"parts": stored.get("parts", {}) | done, "cores": os.cpu_count()}
    draw_handshake(out / "gate-handshake.png")
    write_page(out / "gate.md", "gate", results)
    return results


def _counts(*, seed: int, quick: bool, progress: Callable[[str], None]) -> dict[str, Any]:
    """Count sheets to print again everywhere, in runs with faults."""
    presses, sheets = QUICK_JOURNEYS if quick else JOURNEYS
    with tempfile.TemporaryDirectory() as name:
        rows = list(journeys(Path(name), seeds=range(seed, seed + presses), sheets=sheets, progress=progress))
    differs = [line for row in rows for line in row["differs"]]
    facts = {"presses": presses, "sheets": sheets, "pace": PACE, "build": __version__}
    return facts | {"rows": rows, "differs": differs}


def _measured(stored: dict[str, Any]) -> dict[str, Any] | None:
    """The times of the real detector, if they were measured in full."""
    quick = stored.get("parts", {}).get("latency", {}).get("quick", True)
    return None if quick else stored["latency"]


# --- the real detector ---


def _latency(cache: Path, *, seed: int, quick: bool, progress: Callable[[str], None]) -> dict[str, Any]:
    """Times of the real ``watch``, and how far the gate must be for them."""
    rate, sheets = (QUICK_REAL_RATE, QUICK_LATENCY_SHEETS) if quick else (REAL_RATE, LATENCY_SHEETS)
    rig = Rig(folder=cache / "gate").prepared(progress)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        watched = run_watch(
            rig,
            folder,
            rate=rate,
            sheets=sheets,
            kill_after=None,
            log=folder / "trays.jsonl",
            progress=progress,
        )
    tail = fitted(np.array(watched.written_ms), seed=seed)
    gates = []
    for a_second in RATES:
        how = {"sheets_per_s": a_second, "pitch_mm": PITCH_MM, "sheet_mm": SHEET_MM}
        row = {"rate": a_second, "speed_mm_s": a_second * PITCH_MM}
        for key, time_ms in (
            ("mm", tail.miss_ms),
            ("low_mm", tail.miss_low_ms),
            ("high_mm", tail.miss_high_ms),
        ):
            row[key] = round(distance_mm(time_ms, **how))
        gates.append(row)
    return {
        "rate": rate,
        "sheets": sheets,
        "detector": watched.detector,
        "pixels": watched.pixels,
        "coarser": COARSER,
        "tail": asdict(tail),
        "tail_share": TAIL_SHARE,
        "miss": MISS,
        "gates": gates,
        "verdict_ms": [round(ms, 1) for ms in watched.verdict_ms[:SAMPLES_MS]],
        "trays": _trays(watched.rows),
    }


def _watch(cache: Path, *, quick: bool, progress: Callable[[str], None]) -> dict[str, Any]:
    """The real ``watch``, killed in its middle and started again."""
    sheets = QUICK_WATCH_SHEETS if quick else WATCH_SHEETS
    rig = Rig(folder=cache / "gate").prepared(progress)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        watched = run_watch(
            rig,
            folder,
            rate=WATCH_RATE,
            sheets=sheets,
            kill_after=round(KILL_SHARE * sheets),
            log=folder / "trays.jsonl",
            progress=progress,
        )
        return {
            "sheets": len(watched.rows),
            "rate": WATCH_RATE,
            "runs": watched.runs,
            "detector": watched.detector,
            "distance_mm": REAL_DISTANCE_MM,
            "misprint": MISPRINT,
            "every": EVERY,
            "trays": _trays(watched.rows),
            "why_rejected": dict(Counter(row.why for row in watched.rows if row.tray == "reject")),
            "reconciled": _reconciled(folder / "runs.sqlite", folder / "trays.jsonl", len(watched.rows)),
            **_truths(watched.rows),
        }


# --- the long run ---


def _plant(
    measured: dict[str, Any] | None,
    *,
    seed: int,
    sheets: int,
    faster: float,
    rounds: int,
    progress: Callable[[str], None],
) -> tuple[dict[str, Any], Happened]:
    shares, published_ms = np.array(PUBLISHED_MS).T
    drawn_ms = np.interp(np.linspace(0, 1, SAMPLES_MS), shares, published_ms)
    times_ms = np.array(measured["verdict_ms"]) if measured else drawn_ms
    plan = Plan.draw(sheets, rate=RATE, faster=faster, seed=seed, latencies_s=times_ms / 1e3, rounds=rounds)
    with tempfile.TemporaryDirectory() as name:
        folder, log = Path(name), Path(name) / "trays.jsonl"
        happened = run_plant(plan, folder, log=log, progress=progress)
        stored = _reconciled(folder / "runs.sqlite", log, len(happened.rows))
    settings = settings_of("PLC", 502)
    failures = Counter(name for _, name in happened.failures)
    rows = happened.rows
    facts = {
        "sheets": len(rows),
        "fed": sheets,
        "rate": RATE,
        "faster": faster,
        "seconds": round(happened.seconds),
        "distance_mm": DISTANCE_MM,
        "tolerance_mm": settings.tolerance_mm,
        "policy": settings.policy,
        "exchange_ms": round(1e3 * exchange_s(settings)),
        "measured_times": bool(measured),
        "verdict_ms": {
            "median": float(np.median(times_ms)),
            "p99": float(np.quantile(times_ms, 0.99)),
            "greatest": float(times_ms.max()),
        },
        "kinds": dict(Counter(one.kind for one in plan.sheets)),
        "shares": {str(name): share for name, share in SHARES.items()},
        "failures": {name: {"times": failures[name], "seconds": LASTS_S[name]} for name in LASTS_S},
        "starts": happened.starts,
        "trays": _trays(rows),
        "why_rejected": dict(Counter(row.why for row in rows if row.tray == "reject").most_common()),
        "reconciled": stored,
        **_truths(rows),
        **_judged(rows, stored),
    }
    return facts, happened


def _truths(rows: Sequence[TrayRow]) -> dict[str, Any]:
    good = [row for row in rows if row.tray == "good"]
    return {
        "in_good": dict(Counter(row.truth for row in good)),
        "in_reject": dict(Counter(row.truth for row in rows if row.tray == "reject")),
        "bad_in_good": sum(row.truth != "good" for row in good),
        "without_result_in_good": sum(row.tag == 0 for row in good),
    }


def _judged(rows: Sequence[TrayRow], stored: dict[str, Any]) -> dict[str, Any]:
    """Good sheets that were lost: those that the controller rejected though nothing was found wrong with them."""
    good = [row for row in rows if row.truth == "good" and row.tray == "reject"]
    return {
        "good_lost": len(good),
        "good_lost_why": dict(Counter(row.why for row in good).most_common()),
        "wrong": stored["counts"].get("wrong", 0),
    }


def _trays(rows: Sequence[TrayRow]) -> dict[str, int]:
    return {name: sum(row.tray == name for row in rows) for name in ("good", "reject")}


def _reconciled(journal: Path, trays: Path, at_gate: int) -> dict[str, Any]:
    """All runs of a journal beside the controller's log."""
    counts, lost, ms, runs = Counter[str](), Counter[str](), list[float](), 0
    log_alone = misprints = not_inspected = 0
    rows = read_trays(trays)
    with Journal.open(str(journal), read_only=True) as opened:
        for run in opened.runs():
            path = log_path(journal, run.id)
            stored = LoggedDecisions.read(path)
            one: Reconciliation = reconciled(opened.pages(run.id), stored, rows)
            counts, lost, runs = counts + one.counts, lost + one.lost_by, runs + 1
            ms += [row["ms"] for row in rows_of(path) if row["kind"] == "written"]
            log_alone += sum(not sheet.in_journal and sheet.sheet is not None for sheet in one.sheets)
            in_good = [sheet for sheet in one.sheets if sheet.tray == "good"]
            misprints += sum(sheet.verdict == "misprint" for sheet in in_good)
            not_inspected += sum(sheet.decision != "accept" for sheet in in_good)
    accounted = sum(counts[name] for name in ("accepted", "diverted", "lost", "unseen", "wrong"))
    if not ms:
        raise PlantError(journal, "no result was written", remedy="check the gate's log")
    median, p99, p999 = np.quantile(ms, [0.5, 0.99, 0.999])
    return {
        "runs": runs,
        "counts": dict(counts),
        "lost_by": dict(lost.most_common()),
        "at_gate": at_gate,
        "accounted": accounted,
        "open": counts["not-at-gate"],
        "in_the_gate_s_log_alone": log_alone,
        "misprints_in_good": misprints,
        "not_inspected_in_good": not_inspected,
        "written": len(ms),
        "written_ms": {"median": float(median), "p99": float(p99), "p999": float(p999)},
    }


# --- the tail of the times: how far the gate must be ---
#
# Times above a high quantile are modelled by a generalised Pareto distribution (J. Pickands, "Statistical inference
# using extreme order statistics", Annals of Statistics 3, 1975), fitted by maximum likelihood. What is asked, one miss
# in a million, lies far beyond what was measured: the figure is a model's, and its interval is of the fit alone.

TAIL_SHARE: Final = 0.1
"""assumed: the largest tenth is the tail."""
MISS: Final = 1e-6
RESAMPLES: Final = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Tail:
    """The tail of times, and what it comes to at one miss in a million."""

    count: int
    median_ms: float
    p99_ms: float
    p999_ms: float
    greatest_ms: float
    threshold_ms: float
    shape: float
    """0: exponential; above: heavier; below: it ends."""
    scale_ms: float
    miss_ms: float
    """Time that one in a million exceeds."""
    miss_low_ms: float
    miss_high_ms: float
    """95 % of resampled times."""


def fitted(times_ms: NDArray[np.float64], *, seed: int) -> Tail:
    """Fit the tail of times (n,). ValueError: they are too few."""
    if times_ms.size < 50:
        raise ValueError(f"{times_ms.size} times are too few for a tail")
    rng = stream(seed, "gate-bootstrap")
    threshold, shape, scale, miss = _fit(times_ms)
    drawn = [_fit(rng.choice(times_ms, times_ms.size))[3] for _ in range(RESAMPLES)]
    low, high = np.quantile(drawn, [0.025, 0.975])
    median, p99, p999 = np.quantile(times_ms, [0.5, 0.99, 0.999])
    return Tail(
        count=int(times_ms.size),
        median_ms=float(median),
        p99_ms=float(p99),
        p999_ms=float(p999),
        greatest_ms=float(times_ms.max()),
        threshold_ms=threshold,
        shape=shape,
        scale_ms=scale,
        miss_ms=miss,
        miss_low_ms=float(low),
        miss_high_ms=float(high),
    )


def distance_mm(time_ms: float, *, sheets_per_s: float, pitch_mm: float, sheet_mm: float) -> float:
    """Return the distance from camera to gate.

    The sheet has passed the camera when time begins; its leading edge then moves on.
    """
    return sheet_mm + sheets_per_s * pitch_mm * time_ms / 1e3


def _fit(times_ms: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Threshold, shape, scale, and the time that one in a million exceeds. [ms]"""
    threshold = float(np.quantile(times_ms, 1 - TAIL_SHARE))
    over = times_ms[times_ms > threshold] - threshold
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of the search's way through impossible shapes
        shape, _, scale = genpareto.fit(over, floc=0.0)
    miss = threshold + float(genpareto.ppf(1 - MISS / TAIL_SHARE, shape, 0.0, scale))
    return threshold, float(shape), float(scale), max(miss, float(times_ms.max()))
