"""Overview of designs: contact sheets, figures of every page, and the study that writes ``corpus.md``."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from matplotlib.figure import Figure

from prooflight.files.atomic import whole_file
from prooflight.pages.parallel import in_order
from prooflight.simulation.corpus.corpus import Corpus
from prooflight_studies.corpus.figures import NAMES, PageFigures, corpus_results, page_figures, summary, table
from prooflight_studies.harness.folder import Folder
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.picture import write_figure

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.simulation.corpus.corpus import Designs

STUDY_DPI: Final = 482.0
"""Resolution with two raster pixels a camera pixel."""
FAST_DPI: Final = 200.0
SOLIDS_RGB: Final = np.array([(0, 158, 227), (230, 0, 126), (255, 237, 0), (29, 29, 27)], np.float32) / 255
"""Usual colours of the solids on a screen; for contact sheets alone."""
DESIGNS: Final = 200
DESIGNS_QUICK: Final = 20
TIMED: Final = 40
THUMBNAIL_PX: Final = (108, 150)
"""Width and height of a page's cell on a contact sheet."""
SHEET_COLUMNS: Final = 14
A_SHEET: Final = 100
JPEG_QUALITY: Final = 72


def thumbnail(page: Page) -> NDArray[np.uint8]:
    """Return the page on a grey cell of ``THUMBNAIL_PX``, RGB."""
    wide, tall = (extent - 6 for extent in THUMBNAIL_PX)
    scale = min(wide / page.cmyk.shape[1], tall / page.cmyk.shape[0])
    size = tuple(max(round(extent * scale), 1) for extent in page.cmyk.shape[1::-1])
    inks = cv2.resize(page.cmyk, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    shown = np.prod(1 - inks[..., None] * (1 - SOLIDS_RGB), axis=2)
    place = np.full((THUMBNAIL_PX[1], THUMBNAIL_PX[0], 3), 128, np.uint8)
    place[3 : 3 + size[1], 3 : 3 + size[0]] = np.rint(255 * shown)
    return place


def write_contact_sheet(
    path: Path, thumbnails: Sequence[NDArray[np.uint8]], columns: int = SHEET_COLUMNS
) -> None:
    """Write thumbnails in rows, as JPEG."""
    empty = np.full_like(thumbnails[0], 128)
    places = [*thumbnails, *[empty] * (-len(thumbnails) % columns)]
    rows = [np.hstack(places[first : first + columns]) for first in range(0, len(places), columns)]
    picture = np.ascontiguousarray(np.vstack(rows)[..., ::-1])
    _, encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    with whole_file(path) as unfinished:
        unfinished.write_bytes(encoded.tobytes())


def draw_distributions(path: Path, drawn: NDArray[np.float64], real: NDArray[np.float64]) -> None:
    """Draw the share of pages at or below a value, for every figure, of designs and real pages."""
    figure = Figure(figsize=(9.2, 4.4), dpi=110, layout="constrained")
    for axes, name, ours, theirs in zip(
        figure.subplots(2, 4, sharey=True).flat, NAMES.values(), drawn.T, real.T, strict=True
    ):
        axes.ecdf(theirs, color="0.6", linewidth=2.5, label="real pages")
        axes.ecdf(ours, color="#0a6ebd", linewidth=1.2, label="designs")
        axes.set_title(name.split(",")[0], fontsize=9)
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].legend(fontsize=7, frameon=False, loc="upper left")
    figure.supylabel("share of pages", fontsize=8)
    write_figure(figure, path)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DesignSummary:
    """Figures and thumbnail of one page."""

    figures: PageFigures
    thumbnail: NDArray[np.uint8]


def summary_of(designs: Designs, index: int) -> DesignSummary:
    """Draw or rip one page, measure it and reduce it to a thumbnail."""
    page = designs.page(index)
    return DesignSummary(figures=page_figures(page), thumbnail=thumbnail(page))


def run_corpus_study(
    results: Path,
    *,
    pages: Path | None = None,
    seed: int = 2,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _text: None,
) -> dict[str, object]:
    """Measure the designs of a seed and, if given, a folder of real pages; write ``corpus.md`` and its pictures.

    Returns the figures' quartiles of both and the mean times. JobError: a page of the folder cannot be used.
    """
    number = DESIGNS_QUICK if quick else DESIGNS
    real_figures = None
    if pages is not None:
        folder = Folder(path=pages, dpi=STUDY_DPI)
        progress(f"analysing the {len(folder)} pages of {pages.name}")
        real = in_order(partial(summary_of, folder), range(len(folder)))
        real_figures = table(summary.figures for summary in real)
    progress(f"drawing {number} designs")
    drawn = list(in_order(partial(summary_of, Corpus(seed=seed, dpi=STUDY_DPI)), range(number)))
    design_figures = table(summary.figures for summary in drawn)
    times = {FAST_DPI: _times_s(seed, FAST_DPI, number), STUDY_DPI: _times_s(seed, STUDY_DPI, number)}
    sheets = []
    for first in range(0, number, A_SHEET):
        sheets.append(results / f"corpus-{first // A_SHEET + 1}.jpg")
        write_contact_sheet(sheets[-1], [summary.thumbnail for summary in drawn[first : first + A_SHEET]])
    if real_figures is not None:
        draw_distributions(results / "corpus-figures.png", design_figures, real_figures)
    names = [sheet.name for sheet in sheets]
    findings = corpus_results(
        design_figures, real_figures, seed=seed, dpi=STUDY_DPI, times=times, sheets=names
    )
    write_page(results / "corpus.md", "corpus", findings)
    return {
        "seed": seed,
        "designs": summary(design_figures),
        "pages": None if real_figures is None else summary(real_figures),
        "mean_cpu_s": {f"{dpi:g} dpi": round(float(np.mean(taken)), 4) for dpi, taken in times.items()},
    }


def _times_s(seed: int, dpi: float, number: int) -> list[float]:
    """Return the processor time to draw each of up to ``TIMED`` designs, in this process."""
    times = []
    for index in range(min(number, TIMED)):
        started = time.process_time()
        Corpus(seed=seed, dpi=dpi).page(index)
        times.append(time.process_time() - started)
    return times
