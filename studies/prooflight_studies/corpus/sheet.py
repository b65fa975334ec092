"""Overview of designs: contact sheets, figures of every page, and the study that writes ``corpus.md``."""

from __future__ import annotations

import os
import time
from dataclasses import astuple, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from prooflight.files.atomic import whole_file
from prooflight.pages.parallel import in_order
from prooflight.simulation.corpus.corpus import BLACK_ALONE, Corpus
from prooflight_studies.harness.folder import Folder
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.picture import write_figure

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
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


# --- figures of a page: its white, its coverage by ink, and its edges ---

CAMERA_PIXEL_MM: Final = 0.1054
"""Pixel of the paper's camera: 2048 pixels over about 216 mm."""
EDGE_CONTRAST: Final = 0.20
"""Share of paper white that the 3 x 3 neighbourhood of a pixel at an edge spans at least."""
SOLIDS_L: Final = (56.0, 48.0, 89.0, 16.0)
PAPER_L: Final = 95.0
"""CIE L* of solid C, M, Y, K and of coated paper, ISO 12647-2:2013, printing condition 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageFigures:
    """Figures of a page; shares of its area unless stated otherwise."""

    white: float
    cyan: float
    """Mean coverage of cyan; the next three are of the other inks."""
    magenta: float
    yellow: float
    black: float
    total_ink: float
    """Sum of the four coverages."""
    black_alone: float
    """Share of the printed area that carries no ink but black."""
    edges: float


SIGNIFICANCE: Final = 0.05
QUARTILES: Final = (0.25, 0.5, 0.75)
NAMES: Final = {
    "white": "white",
    "cyan": "cyan",
    "magenta": "magenta",
    "yellow": "yellow",
    "black": "black",
    "total_ink": "total ink",
    "black_alone": "black alone, of what is printed",
    "edges": "edges",
}


def page_figures(page: Page) -> PageFigures:
    """Return the figures of a page at 482 dpi or any other resolution that is not coarser than the camera's."""
    cmyk = page.cmyk
    packed = cmyk.view(np.uint32)[..., 0]  # four inks at once
    inked = packed != 0
    coloured = (packed & np.array([255, 255, 255, 0], np.uint8).view(np.uint32)) != 0
    printed = int(inked.sum())
    cover = [value / 255 for value in cv2.mean(cmyk)]
    return PageFigures(
        white=1 - printed / inked.size,
        cyan=cover[0],
        magenta=cover[1],
        yellow=cover[2],
        black=cover[3],
        total_ink=sum(cover),
        black_alone=float((inked & ~coloured).sum()) / max(printed, 1),
        edges=_edge_share(page),
    )


def _edge_share(page: Page) -> float:
    light = np.ones(page.cmyk.shape[:2], np.float32)
    for ink, lightness in enumerate(SOLIDS_L):
        solid = _luminance(lightness) / _luminance(PAPER_L)
        share = np.linspace(0, 1, 256, dtype=np.float32)
        light *= (1 - share * np.float32(1 - solid))[
            page.cmyk[..., ink]
        ]  # Demichel: inks lie by chance on another
    size = (max(round(extent / CAMERA_PIXEL_MM), 1) for extent in (page.width_mm, page.height_mm))
    seen = cv2.resize(light, tuple(size), interpolation=cv2.INTER_AREA)
    around = np.ones((3, 3), np.uint8)
    return float((cv2.dilate(seen, around) - cv2.erode(seen, around) > EDGE_CONTRAST).mean())


def _luminance(lightness: float) -> float:
    """Convert L* above 8 to Y / Yn (CIE 15)."""
    return ((lightness + 16) / 116) ** 3


def table(pages: Iterable[PageFigures]) -> NDArray[np.float64]:
    """Return a table (pages, figures), the figures in the order of ``NAMES``."""
    return np.array([astuple(figures) for figures in pages])


def in_black(figures: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which pages of a table have no ink but black."""
    return np.asarray(figures[:, 1:4].sum(axis=1) == 0)


def summary(figures: NDArray[np.float64]) -> dict[str, object]:
    """Return quartiles of every figure of a table, and the share of pages in black alone."""
    quartiles = np.quantile(figures, (0.25, 0.5, 0.75), axis=0).T
    rows: dict[str, object] = {
        name: [round(float(value), 4) for value in row] for name, row in zip(NAMES, quartiles, strict=True)
    }
    return {"pages": len(figures), "in_black_alone": round(float(in_black(figures).mean()), 4), **rows}


def corpus_results(
    designs: NDArray[np.float64],
    real: NDArray[np.float64] | None,
    *,
    seed: int,
    dpi: float,
    times: Mapping[float, Sequence[float]],
    sheets: Sequence[str],
) -> dict[str, Any]:
    """Return all figures of the page. ours, theirs: tables of designs and of real pages.

    times: of drawing, by resolution [s]; sheets: file names of contact sheets.
    """
    return {
        "seed": seed,
        "dpi": dpi,
        "black_alone": BLACK_ALONE,
        "camera_pixel_mm": CAMERA_PIXEL_MM,
        "edge_contrast": EDGE_CONTRAST,
        "designs": {"pages": len(designs), "in_black": in_black(designs).sum()},
        "real": None if real is None else _comparison(designs, real),
        "shares": [
            {
                "name": name,
                "designs": np.quantile(designs[:, column], QUARTILES),
                "real": None if real is None else np.quantile(real[:, column], QUARTILES),
                "distance": None
                if real is None
                else stats.ks_2samp(designs[:, column], real[:, column]).statistic,
            }
            for column, name in enumerate(NAMES.values())
        ],
        "times": [
            {"dpi": at, "designs": len(taken), "mean_s": np.mean(taken), "slowest_s": max(taken)}
            for at, taken in times.items()
        ],
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "sheets": sheets,
    }


def _comparison(designs: NDArray[np.float64], real: NDArray[np.float64]) -> dict[str, Any]:
    """Return the figures of the real pages, and the critical value of the two-sample distance at ``SIGNIFICANCE``."""
    bound = np.sqrt(-0.5 * np.log(SIGNIFICANCE / 2) * (1 / len(designs) + 1 / len(real)))
    return {
        "pages": len(real),
        "in_black": in_black(real).sum(),
        "distance_bound": bound,
        "significance": SIGNIFICANCE,
    }
