"""How fast a press's sheets are inspected on this machine: measured on a composed page and good prints of it."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from statistics import median
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.inspection.inspector import Inspector
from prooflight.pages.process import settle_process
from prooflight.pages.raster import MM_PER_INCH
from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.scans import ideal_scan
from prooflight_line.run.sheet_inspector import SheetInspector

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

SEED: Final = 1
SHEETS: Final = 9


@dataclass(frozen=True, slots=True, kw_only=True)
class Speed:
    """Times of one thread, in seconds of a processor: what else this machine does now does not count."""

    detector: str
    page_mm: tuple[float, float]
    prepare_s: float
    inspect_s: float
    """Median of ``SHEETS`` sheets."""

    def sheets_per_s(self, cores: int) -> float:
        """Return the greatest rate if all these cores inspected and nothing else."""
        return cores / self.inspect_s


def measure_speed(press: Press, *, steps: Iterable[int] = range(SHEETS)) -> Speed:
    """Prepare a page for a press and inspect good prints of it; steps: one is taken a sheet, to show progress."""
    settle_process()
    sheets = SheetInspector(inspector=Inspector(press).with_threads(1))
    page = press.geometry.lay(_page(press))
    sheets.warm_up(sheets.prepare(page))  # compiles kernels, and fills caches
    began_s = time.process_time()
    ready = sheets.prepare(page)
    prepare_s = time.process_time() - began_s
    expected = sheets.inspector.planned(page, threads=1).expected
    rng, times = stream(None, "bench-scan"), []
    for number in steps:
        scan = ideal_scan(expected, press, rng)
        began_s = time.process_time()
        sheets.inspect(ready, scan, name="print", seed=number)
        times.append(time.process_time() - began_s)
    return Speed(
        detector=sheets.inspector.detector.name,
        page_mm=(page.width_mm, page.height_mm),
        prepare_s=prepare_s,
        inspect_s=median(times),
    )


def _page(press: Press) -> Page:
    """Return a composed page, cut to the width that the press sees."""
    page = Corpus(seed=SEED, dpi=press.dpi).page(0)
    columns = int(press.geometry.field_mm / MM_PER_INCH * page.dpi)
    return replace(page, cmyk=np.ascontiguousarray(page.cmyk[:, :columns]))
