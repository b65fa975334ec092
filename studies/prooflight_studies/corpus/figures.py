"""Figures of a page: its white, its ink coverage by ink, and its edges."""

from __future__ import annotations

import os
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from scipy import stats

from prooflight.simulation.corpus.corpus import BLACK_ALONE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page

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
