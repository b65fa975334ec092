"""Ruler page to print: a vector PDF in the press's own inks, and its raster for the simulated press."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.files.atomic import whole_file
from prooflight.inks.chart_print import DPI
from prooflight.inks.ruler_layout import MARGIN_MM, RulerLayout
from prooflight.pages.raster import MM_PER_INCH, POINTS_PER_INCH

RASTER_DPI: Final = 2 * DPI
"""Resolution of the raster, 20 pixels a millimetre: only edges of turned squares fall inside a pixel."""
_POINTS_PER_MM: Final = POINTS_PER_INCH / MM_PER_INCH


def write_ruler(path: Path, layout: RulerLayout) -> None:
    """Write the page as PDF in DeviceCMYK; the same layout gives the same bytes."""
    from reportlab.pdfgen.canvas import Canvas  # imported late: only this function needs it

    with whole_file(path) as unfinished:
        size = (layout.width_mm * _POINTS_PER_MM, layout.height_mm * _POINTS_PER_MM)
        canvas = Canvas(str(unfinished), pagesize=size, invariant=1)
        canvas.setTitle("Prooflight ruler")
        canvas.scale(_POINTS_PER_MM, _POINTS_PER_MM)
        for corners, ink in layout.painted():
            canvas.setFillColorCMYK(*(level / 255 for level in ink))
            path_ = canvas.beginPath()
            first, *rest = corners.tolist()
            path_.moveTo(first[0], layout.height_mm - first[1])
            for x, y in rest:
                path_.lineTo(x, layout.height_mm - y)
            path_.close()
            canvas.drawPath(path_, stroke=0, fill=1)
        canvas.setFillColorCMYK(0, 0, 0, 1)
        canvas.setFont("Helvetica", 2.4)
        across, along = layout.checked_mm
        canvas.drawString(
            MARGIN_MM + 2,
            layout.height_mm - 7,
            f"Prooflight ruler, this edge first. Fine lines: {across:g} mm apart",
        )
        canvas.saveState()
        canvas.translate(6.2, layout.height_mm - MARGIN_MM - 2)
        canvas.rotate(-90)
        canvas.drawString(0, 0, f"{along:g} mm between fine lines; print unscaled")
        canvas.restoreState()
        canvas.showPage()
        canvas.save()


def ruler_raster(layout: RulerLayout, *, dpi: float = RASTER_DPI) -> NDArray[np.uint8]:
    """Draw the page as CMYK, (rows, columns, 4); a raster pixel is inked where its centre is."""
    scale = dpi / MM_PER_INCH
    paper = np.zeros((round(layout.height_mm * scale), round(layout.width_mm * scale), INKS), np.uint8)
    for corners, ink in layout.painted():
        left, top = np.floor(corners.min(axis=0) * scale).astype(int)
        right, bottom = np.ceil(corners.max(axis=0) * scale).astype(int)
        x = (np.arange(left, right) + 0.5) / scale
        y = ((np.arange(top, bottom) + 0.5) / scale)[:, None]
        inside = np.ones((bottom - top, right - left), bool)
        for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            inside &= (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) >= 0
        paper[top:bottom, left:right][inside] = ink
    return paper
