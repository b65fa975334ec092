"""Files of a chart to print: PDF, CMYK TIFF and recipe file.

The TIFF has 254 dpi, ten pixels a millimetre, so that no edge of a ``Layout`` falls inside a pixel. PDF and
TIFF paint the same boxes in the same inks.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.errors import RequestError
from prooflight.files.atomic import whole_file
from prooflight.inks.chart_layout import (
    STEPS_PER_MM,
    Box,
    Layout,
    PlacedRecipes,
    place_recipes,
    write_recipes,
)
from prooflight.inks.recipes import choose_recipes, printable_recipes
from prooflight.pages.files import page_name, write_tiff
from prooflight.pages.raster import MM_PER_INCH, POINTS_PER_INCH, Page

DPI: Final = STEPS_PER_MM * MM_PER_INCH
_POINTS_PER_MM: Final = POINTS_PER_INCH / MM_PER_INCH
_FEWEST_PATCHES: Final = 16  # solids and overprints
_BLACK: Final = (0, 0, 0, 255)
_WHITE: Final = (0, 0, 0, 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChartFiles:
    """Files that ``make_chart`` wrote."""

    pdf: Path
    tiffs: tuple[Path, ...]
    recipes: Path


def make_chart(
    folder: Path,
    patches: int,
    *,
    rng: np.random.Generator,
    layout: Layout | None = None,
    ink_limit_percent: float = 400.0,
) -> ChartFiles:
    """Write ``chart.pdf``, ``chart-p0001.tif`` ... and ``chart.txt`` with ``patches`` well-chosen recipes.

    The same seed gives the same files. RequestError: too few or too many patches, or a layout without room.
    """
    candidates = printable_recipes(ink_limit_percent)
    if not _FEWEST_PATCHES <= patches <= len(candidates):
        what = f"a chart of {patches} patches"
        raise RequestError("--patches", what, remedy=f"take {_FEWEST_PATCHES} to {len(candidates)}")
    chosen = candidates[choose_recipes(candidates, patches)]
    placed = place_recipes(chosen, layout or Layout(), rng)
    folder.mkdir(parents=True, exist_ok=True)
    files = ChartFiles(
        pdf=folder / "chart.pdf",
        tiffs=tuple(folder / f"chart-{page_name(page)}.tif" for page in range(1, placed.pages + 1)),
        recipes=folder / "chart.txt",
    )
    for page, path in enumerate(files.tiffs, start=1):
        write_tiff(Page(cmyk=raster(placed, page), dpi=DPI, name=page_name(page), number=page), path)
    write_pdf(files.pdf, placed)
    write_recipes(files.recipes, placed)
    return files


def raster(placed: PlacedRecipes, page: int, *, dpi: float = DPI) -> NDArray[np.uint8]:
    """Draw one page as CMYK, (rows, columns, 4).

    At other resolutions edges lie on the nearest raster pixel.
    """
    layout, scale = placed.layout, dpi / MM_PER_INCH
    paper = np.zeros((round(layout.height_mm * scale), round(layout.width_mm * scale), INKS), dtype=np.uint8)
    for (x, y, width, height), ink in painted(placed, page):
        left, top, right, bottom = (round(edge * scale) for edge in (x, y, x + width, y + height))
        paper[top:bottom, left:right] = ink
    return paper


def write_pdf(path: Path, placed: PlacedRecipes) -> None:
    """Write all pages as vector PDF in DeviceCMYK; the same placed recipes give the same bytes."""
    from reportlab.pdfgen.canvas import Canvas  # imported late: only this function needs it

    layout = placed.layout
    with whole_file(path) as unfinished:
        size = (layout.width_mm * _POINTS_PER_MM, layout.height_mm * _POINTS_PER_MM)
        canvas = Canvas(str(unfinished), pagesize=size, invariant=1)
        canvas.setTitle("Prooflight chart")
        for page in range(1, placed.pages + 1):
            canvas.scale(_POINTS_PER_MM, _POINTS_PER_MM)
            for (x, y, width, height), ink in painted(placed, page):
                canvas.setFillColorCMYK(*(level / 255 for level in ink))
                canvas.rect(x, layout.height_mm - y - height, width, height, stroke=0, fill=1)
            canvas.setFillColorCMYK(0, 0, 0, 1)
            canvas.setFont("Helvetica", 2.8)
            note = (
                f"Prooflight chart, page {page} of {placed.pages}; print without colour management or scaling"
            )
            canvas.drawCentredString(layout.width_mm / 2, layout.margin_mm + 1.5, note)
            canvas.showPage()
        canvas.save()


def painted(placed: PlacedRecipes, page: int) -> list[tuple[Box, tuple[int, ...]]]:
    """Return the boxes of a page with their ink levels 0..255, to be painted in this order."""
    marks = [(box, _BLACK if black else _WHITE) for box, black in placed.layout.black_and_white(page)]
    here = placed.place[:, 0] == page
    levels = np.round(placed.cmyk[here] * 255).astype(int).tolist()
    boxes = [placed.layout.patch_box(row, column) for _, row, column in placed.place[here].tolist()]
    return [*marks, *((box, tuple(ink)) for box, ink in zip(boxes, levels, strict=True))]
