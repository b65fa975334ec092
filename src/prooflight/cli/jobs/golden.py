"""``prooflight inspect --golden``: comparison of scans with a good scan instead of a job's raster."""

from __future__ import annotations

import time
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from prooflight.cli import show
from prooflight.errors import JobError, RequestError
from prooflight.pages.files import page_name
from prooflight.pages.job import Job, JobSource
from prooflight.press.artefact import Press

if TYPE_CHECKING:
    from prooflight.cli.jobs.inspected import Inspected


def inspect_golden(
    golden: Sequence[Path],
    scans: Path,
    *,
    job: Path | None,
    press: Path | None,
    profile: Path | None,
    zones: Path | None,
    report: Path | None,
    json: bool,
) -> Inspected[Any]:
    """Inspect, and show one verdict a scan, or a page of the job; write a report where a folder is given."""
    from prooflight.cli.jobs.inspected import inspected
    from prooflight.inspection.golden import GoldenInspector, golden_pages
    from prooflight.inspection.job import Tried, alone
    from prooflight.pages.parallel import in_order

    if zones is not None and press is not None:
        what = "goes with --golden only where scans are pictures"
        raise RequestError("--zones", what, remedy="leave --press out, or inspect by the job's raster")
    loaded = None if press is None else Press.load(press)
    troubles: dict[str, str] = {}
    lefts_mm = None if job is None else _lefts_mm(job, loaded, profile, troubles)
    sensors = None if loaded is None else len(loaded.sensors)
    pages = golden_pages(golden, scans, sensors=sensors, lefts_mm=lefts_mm, troubles=troubles)
    work = GoldenInspector.of(loaded, *dict.fromkeys(page.goldens[0] for page in pages))
    if zones is not None:
        pages = work.with_zones(pages, zones)
    names, against = [page.name for page in pages], ", ".join(one.name for one in golden)
    if report is None:
        tried = Tried(work, attrgetter("name"), alone)
        done: Inspected[Any] = inspected(
            in_order(tried, pages, killed=tried.killed),
            lambda verdict: verdict,
            names=names,
            unseen=lambda _place, verdict: verdict,
            json=json,
        )
    else:
        from prooflight.reporting.golden_report import PicturedGolden, golden_summary
        from prooflight.reporting.report import unpictured_entry, write_report

        started, pictured = time.perf_counter(), PicturedGolden(work)
        done = inspected(
            in_order(pictured, pages, killed=pictured.killed),
            attrgetter("verdict"),
            names=names,
            unseen=lambda place, verdict: unpictured_entry(place + 1, verdict),
            json=json,
        )
        pages_per_s = len(pages) / (time.perf_counter() - started)
        report.mkdir(parents=True, exist_ok=True)
        summary = golden_summary(work, scans=scans.name, golden=against, pages_per_s=pages_per_s)
        write_report(report / "report.html", done.items, summary)
    if not json:
        show.judged(done.verdicts, title=f"{scans.name} against {against}")
        if report is not None:
            show.people.print("Open", show.strong(report / "report.html"))
    return done


def _lefts_mm(job: Path, press: Press | None, profile: Path | None, troubles: dict[str, str]) -> list[float]:
    """Return the offset of each page of the job from the scan's left end; 0 without a press.

    ``troubles`` receives the names of pages that cannot be used, and why.
    """
    with JobSource(path=job, dpi=72.0 if press is None else press.dpi, profile=profile).open() as opened:
        try:
            sizes_mm = list(opened.page_sizes_mm)
        except JobError:
            sizes_mm = [_size_mm(opened, number, troubles) for number in range(1, len(opened) + 1)]
    if press is None:
        return [0.0] * len(sizes_mm)
    geometry = press.geometry
    return [geometry.left_mm(width if geometry.sees(width) else height) for width, height in sizes_mm]


def _size_mm(job: Job, number: int, troubles: dict[str, str]) -> tuple[float, float]:
    try:
        return job.page_size_mm(number)
    except JobError as error:
        troubles[page_name(number)] = str(error)
        return 0.0, 0.0
