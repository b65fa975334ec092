"""Agreement of the press world's fast path with the full spectral one, in mean and in variance."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.errors import InputError, RequestError
from prooflight.pages.pdf.rip import PdfJob
from prooflight.press.press_file import PressFile
from prooflight.rng import stream
from prooflight.simulation.fast import fast_mean_variance
from prooflight.simulation.prints import Print
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of, worlds_digest
from prooflight_studies.edges.rig import Rig
from prooflight_studies.exact.scans import Specimen, exact_mean_variance
from prooflight_studies.harness.page import write_page

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page

DESIGNS: Final = 20
QUICK_DESIGNS: Final = 3
PIECE_MM: Final = (24.0, 32.0)
"""Width and height of the piece of each page that is compared, as a page of its own: the full path takes seconds."""
MARGIN_PIXELS: Final = 28
"""Pixels of backing at both sides of a piece, as next to A4 in the prototype's field."""
LEAST_INKED: Final = 0.05
"""Least share of a piece that has ink; others are drawn again, since paper alone gives no evidence."""
TRIES: Final = 200
GOAL_SIGMA: Final = 0.1
GOAL_VARIANCE: Final = 0.03


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """Comparison of fast and full path on one piece of a page, one session, one print."""

    design: str
    pixels: int
    mean_rms_sigma: float
    """Difference of means in standard deviations of a pixel's own noise."""
    mean_bias_sigma: float
    mean_max_sigma: float
    variance_rms: float
    """Relative difference of variances, root mean square. [-]"""
    variance_bias: float
    """Mean relative difference of variances. [-]"""
    over_3_percent: float
    """Share of pixels whose variances differ by more than 3 %."""
    fast_cpu_s: float
    full_cpu_s: float


def run_world_study(
    pages: Path,
    results: Path,
    *,
    seed: int = 1,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _step: None,
) -> list[Agreement]:
    """Compare both paths on pieces of the PDFs of a folder, evenly over their names; write ``worlds.md``.

    RequestError: too few of the PDFs can be used.
    """
    wanted = QUICK_DESIGNS if quick else DESIGNS
    progress("building the press")
    press_file = PressFile.prototype()
    pitch_mm = press_file.geometry(press_file.camera()).pixel_pitch_mm
    rig = Rig.build(press_file, pixels=int(PIECE_MM[0] / pitch_mm) + 2 * MARGIN_PIXELS)
    files = sorted(pages.glob("*.pdf"))
    every = [files[i] for i in np.linspace(0, len(files) - 1, min(len(files), 2 * wanted)).astype(int)]
    rows: list[Agreement] = []
    for index, pdf in enumerate(every):
        piece = piece_of(pdf, rig, stream(seed, "world-piece", index))
        if piece is None:
            continue
        progress(f"{pdf.stem} ({len(rows) + 1} of {wanted})")
        rows.append(agreement(piece, rig, stream(seed, "world-print", index)))
        if len(rows) == wanted:
            break
    if len(rows) < wanted:
        what = f"only {len(rows)} of its PDFs have enough ink"
        raise RequestError(pages, what, remedy=f"give a folder of {wanted} printed pages")
    write_page(results / "worlds.md", "worlds", world_results(rows, seed=seed))
    return rows


def piece_of(pdf: Path, rig: Rig, rng: np.random.Generator) -> Page | None:
    """Return a piece of a PDF's first page that has ink on it; None if there is none or the page cannot be used."""
    try:
        with PdfJob(pdf) as job:
            page = job.page(1, rig.press.dpi)
    except InputError:
        return None
    width, height = (round(extent / page.pixel_mm) for extent in PIECE_MM)
    rows, columns = page.cmyk.shape[:2]
    if rows < height or columns < width:
        return None
    for _ in range(TRIES):
        top, left = int(rng.integers(rows - height + 1)), int(rng.integers(columns - width + 1))
        piece = page.cmyk[top : top + height, left : left + width]
        if piece.any(axis=2).mean() >= LEAST_INKED:
            return replace(page, cmyk=np.ascontiguousarray(piece), name=pdf.stem)
    return None


def agreement(page: Page, rig: Rig, rng: np.random.Generator) -> Agreement:
    """Compare both paths of one session and one print of ``page``, drawn from ``rng``."""
    specimen = Specimen(
        press=rig.press,
        camera=rig.camera,
        inks=rig.press_file.inks(),
        backing_reflectance=rig.press_file.backing_reflectance,
    )
    session = Session.draw(amounts_of(rig.press), rig.press, rng)
    print_ = Print.draw(session, rig.press, page, rng)
    begun = time.process_time()
    fast = fast_mean_variance(page, rig.press, session, print_)
    between = time.process_time()
    full = exact_mean_variance(page, specimen, session, print_)
    done = time.process_time()
    z = (fast.expected_dn - full.expected_dn) / np.sqrt(full.variance_dn2)
    relative = fast.variance_dn2 / full.variance_dn2 - 1
    return Agreement(
        design=page.name,
        pixels=z.size,
        mean_rms_sigma=float(np.sqrt(np.mean(z**2))),
        mean_bias_sigma=float(z.mean()),
        mean_max_sigma=float(np.abs(z).max()),
        variance_rms=float(np.sqrt(np.mean(relative**2))),
        variance_bias=float(relative.mean()),
        over_3_percent=float((np.abs(relative) > GOAL_VARIANCE).mean()),
        fast_cpu_s=between - begun,
        full_cpu_s=done - between,
    )


def pooled_rms(rows: list[Agreement]) -> tuple[float, float]:
    """Return rms over the pixels of all pieces: difference of means [sigma], relative difference of variances [-]."""
    pixels = np.array([row.pixels for row in rows], np.float64)
    mean = np.array([row.mean_rms_sigma for row in rows])
    variance = np.array([row.variance_rms for row in rows])
    over = [float(np.sqrt((pixels * values**2).sum() / pixels.sum())) for values in (mean, variance)]
    return over[0], over[1]


def world_results(rows: list[Agreement], *, seed: int) -> dict[str, Any]:
    """Return all figures of the page."""
    mean, variance = pooled_rms(rows)
    return {
        "seed": seed,
        "worlds": worlds_digest(),
        "piece_mm": PIECE_MM,
        "mean_rms_sigma": mean,
        "variance_rms": variance,
        "goal_sigma": GOAL_SIGMA,
        "goal_variance": GOAL_VARIANCE,
        "pieces": rows,
    }
