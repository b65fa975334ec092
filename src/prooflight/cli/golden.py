"""``prooflight inspect --golden``: scans against a good scan rather than a job's raster."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.cli import show
from prooflight.pages.job import JobSource
from prooflight.press import Press

if TYPE_CHECKING:
    from pathlib import Path


def inspect_golden(
    golden: Path, scans: Path, *, job: Path | None, press: Path | None, profile: Path | None, json: bool
) -> int:
    """Show one verdict a scan, or a page of the job; returns how many are misprints."""
    from prooflight.inspecting.golden import GoldenInspector, golden_pages
    from prooflight.pages.parallel import in_order

    loaded = None if press is None else Press.load(press)
    lefts_mm = None if job is None else _lefts_mm(job, loaded, profile)
    sensors = None if loaded is None else len(loaded.sensors)
    pages = golden_pages(golden, scans, sensors=sensors, lefts_mm=lefts_mm)
    work = GoldenInspector.of(loaded, pages[0].golden)
    verdicts = show.inspected(in_order(work, pages), lambda seen: seen, total=len(pages), json=json)
    if not json:
        show.judged(verdicts, title=f"{scans.name} against {golden.name}")
    return sum(verdict.verdict == "misprint" for verdict in verdicts)


def _lefts_mm(job: Path, press: Press | None, profile: Path | None) -> list[float]:
    """How far each page of the job begins from the scan's left end; 0 where no press tells."""
    with JobSource(path=job, dpi=72.0 if press is None else press.dpi, profile=profile).open() as opened:
        sizes_mm = opened.page_sizes_mm
    if press is None:
        return [0.0] * len(sizes_mm)
    geometry = press.geometry
    return [geometry.left_mm(width if geometry.sees(width) else height) for width, height in sizes_mm]
