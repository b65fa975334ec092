"""PDFs printed by presses at a resolution of their own, inspected against rasters drawn coarsely and finely.

Everywhere else a simulated press prints the same raster from which its prints are predicted. A real press rasterises a
PDF itself, at 600 or 1200 dpi, and rounds letters and lines to its own pixels.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.training.real_pages import FEWEST_REAL, recalibrated
from prooflight.detectors.base import StoredArrays
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.matched_filter.variation import AMOUNTS
from prooflight.detectors.optional import ScannedPage
from prooflight.errors import InputError, RequestError
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.job import for_learning
from prooflight.pages.job import edge_sd_mm
from prooflight.pages.pdf.rip import PdfJob
from prooflight.rng import stream
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.scans import MisprintRequest, scan_page
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of
from prooflight_studies.harness.operating import counted
from prooflight_studies.harness.page import write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from prooflight.inspection.inspector import Prepared
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

PRINTED_DPI: Final = (0, 600, 1200)
"""Resolutions of the prints; 0: the raster itself, drawn as finely as it was expected."""
FINER: Final = (1, 2)
WITH_MISPRINTS: Final = 1200
PAGES_A_DAY: Final = 4
QUICK: Final = 4
OTHER_PAGES: Final = ("wrong-page",)
"""Kinds that need another page; each job here has only one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One print, inspected against one raster."""

    page: str
    printed_dpi: int
    """Resolution of the print; 0: the raster itself."""
    finer: int
    """Factor by which the raster was drawn more finely."""
    misprint: str
    """Kind of the misprint; empty: a good print."""
    severity: float
    alarm: bool
    p_value: float
    said: ScannedPage
    """Values of the scan, from which a press can learn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ResolutionResults:
    """Results of the study, as the page shows them."""

    seed: int
    press: str
    raster_dpi: float
    promise: float
    pages: int
    days: int
    rows: list[dict[str, Any]]
    """Counts by printed resolution and raster."""
    learned: list[dict[str, Any]]
    """Counts by printed resolution, after recalibration.

    They are of prints expected from the finely drawn raster, judged by the press after it learned from the good prints
    of the other half of the pages.
    """
    worst: list[dict[str, Any]]
    """Pages whose good prints alarm although they were drawn finely."""


def run_resolution_study(
    press: Press,
    pages: Path,
    out: Path,
    *,
    seed: int,
    most: int | None = None,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> ResolutionResults:
    """Print the first pages of a folder's PDFs and inspect them; writes resolution.md.

    most: greatest number of pages. RequestError: the press has no detector of ours, or no PDF fits it.
    """
    inspector = for_learning(Inspector.of(press, "matched_filter"))
    wanted = QUICK if quick else most
    rows, number = list[Row](), 0
    for pdf in sorted(pages.glob("*.pdf")):
        if number == wanted:
            break
        rasters = _rasters(pdf, press)
        if rasters is None:
            continue
        number += 1
        progress(f"{pdf.stem} (page {number}" + (f" of {wanted})" if wanted else ")"))
        rows += _of_page(pdf.stem, rasters, inspector, number=number, seed=seed)
    if not rows:
        raise RequestError(pages, "holds no PDF that fits this press", remedy="give a folder of PDFs")
    results = _results(rows, press, seed=seed, pages=number)
    write_page(out / "resolution.md", "resolution", results)
    return results


def _rasters(pdf: Path, press: Press) -> dict[tuple[int, int], Page] | None:
    """Return a PDF's first page by resolution (0: the press's) and factor of drawing; None: it does not fit."""
    try:
        with PdfJob(pdf) as job:
            width_mm, _ = job.page_sizes_mm[0]
            if width_mm > press.geometry.field_mm:
                return None
            light = press.ink_light
            expected = {
                (0, finer): job.page(
                    1, press.dpi, drawn_dpi=None if finer == 1 else finer * press.dpi, light=light
                )
                for finer in FINER
            }
            drawn = {key: replace(page, edge_sd_mm=edge_sd_mm(None)) for key, page in expected.items()}
            drawn |= {(dpi, 1): job.page(1, dpi) for dpi in PRINTED_DPI if dpi}
            return {key: press.geometry.lay(page) for key, page in drawn.items()}
    except InputError:
        return None


def _of_page(
    name: str, rasters: dict[tuple[int, int], Page], inspector: Inspector, *, number: int, seed: int
) -> Iterator[Row]:
    """Yield good prints at every resolution, and a misprint at one, against each raster.

    The prints are the same for each raster.
    """
    press = inspector.press
    session = Session.draw(
        amounts_of(press), press, stream(seed, "resolution-session", number // PAGES_A_DAY)
    )
    prepared = {finer: inspector.prepare(rasters[0, finer]) for finer in FINER}
    for dpi in PRINTED_DPI:
        for finer in FINER:
            page = rasters[dpi, 1] if dpi else rasters[0, finer]
            rng = stream(seed, "resolution-print", number, dpi)
            scan = scan_page(
                page, press=press, request=None, others=(), fetch=_none, rng=rng, session=session
            )
            yield _row(name, dpi, finer, prepared[finer], inspector, scan.dn)
    kinds = [kind for kind in KINDS if kind not in OTHER_PAGES]
    request = MisprintRequest(kind=kinds[number % len(kinds)])
    page, rng = rasters[WITH_MISPRINTS, 1], stream(seed, "resolution-misprint", number)
    try:
        scan = scan_page(page, press=press, request=request, others=(), fetch=_none, rng=rng, session=session)
    except RequestError:
        return  # nothing of that kind can be seen on this page
    if scan.misprint is not None:
        severity = scan.misprint.severity
        for finer in FINER:
            yield _row(
                name,
                WITH_MISPRINTS,
                finer,
                prepared[finer],
                inspector,
                scan.dn,
                misprint=request.kind,
                severity=severity,
            )


def _none(number: int) -> Page:
    raise RequestError(
        f"page {number}", "is not printed here", remedy="ask for a kind that takes no other page"
    )


def _row(
    name: str,
    dpi: int,
    finer: int,
    prepared: Prepared,
    inspector: Inspector,
    dn: np.ndarray,
    *,
    misprint: str = "",
    severity: float = 0.0,
) -> Row:
    inspection = inspector.inspect(prepared, dn)
    verdict = inspection.verdict
    return Row(
        page=name,
        printed_dpi=dpi,
        finer=finer,
        misprint=misprint,
        severity=severity,
        alarm=verdict.verdict == "misprint",
        p_value=1.0 if verdict.p_value is None else verdict.p_value,
        said=ScannedPage(
            name=name,
            score=verdict.score or 0.0,
            evidence=inspection.stored_arrays,
            digest=name,
            variation=np.zeros((len(AMOUNTS), 2), np.float32),  # of no say in a verdict
        ),
    )


def _learned(rows: list[Row], press: Press) -> list[dict[str, Any]]:
    """Return ``ResolutionResults.learned``; empty where half of the pages are too few to learn from."""
    pages = sorted({row.page for row in rows})
    halves = set(pages[::2]), set(pages[1::2])
    if min(map(len, halves)) < FEWEST_REAL:
        return []
    table = []
    for dpi in PRINTED_DPI[1:]:
        here = [row for row in rows if row.printed_dpi == dpi and row.finer == max(FINER)]
        judged = list[tuple[Row, bool]]()
        for taught_by, others in (halves, halves[::-1]):
            good = [row.said for row in here if row.page in taught_by and not row.misprint]
            digests = {one.name: one.digest for one in good}
            detector = model_of(recalibrated(press, good, digests, false_alarm_rate=_target_rate(press)))
            for row in here:
                if row.page in others:
                    kept = row.said.evidence
                    score = detector.score_again(StoredArrays(kept, detector.name))
                    rest = (float(kept[name]) for name in ("glyphs", "floor_mm2"))
                    judged.append((row, detector.decide(score, *rest).misprint))
        good_alarms = [alarm for row, alarm in judged if not row.misprint]
        caught = [alarm for row, alarm in judged if row.misprint]
        table.append(
            {
                "printed_dpi": dpi,
                "false_alarms": counted(sum(good_alarms), len(good_alarms)),
                "misprints": len(caught),
                "caught": sum(caught),
            }
        )
    return table


def _target_rate(press: Press) -> float:
    return 0.0 if "matched_filter" not in press.detectors else model_of(press).guarantee.rate


def _results(rows: list[Row], press: Press, *, seed: int, pages: int) -> ResolutionResults:
    table = []
    for dpi in PRINTED_DPI:
        for finer in FINER:
            of = [row for row in rows if (row.printed_dpi, row.finer) == (dpi, finer)]
            good = [row for row in of if not row.misprint]
            bad = [row for row in of if row.misprint]
            table.append(
                {
                    "printed_dpi": dpi,
                    "finer": finer,
                    "good": len(good),
                    "alarms": sum(row.alarm for row in good),
                    "false_alarms": counted(sum(row.alarm for row in good), len(good)),
                    "odd": sum(row.p_value < 0.05 for row in good),
                    "misprints": len(bad),
                    "caught": sum(row.alarm for row in bad),
                }
            )
    fine = Counter(row.page for row in rows if row.alarm and not row.misprint and row.finer == max(FINER))
    return ResolutionResults(
        seed=seed,
        press=press.name,
        raster_dpi=press.dpi,
        promise=_target_rate(press),
        pages=pages,
        days=-(-pages // PAGES_A_DAY),
        rows=table,
        learned=_learned(rows, press),
        worst=[{"page": page, "alarms": count} for page, count in fine.most_common()],
    )
