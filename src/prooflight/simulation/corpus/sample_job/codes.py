"""Bar codes drawn module by module on the 0.1 mm grid, in black ink alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reportlab.graphics.barcode import code128, qrencoder
from reportlab.lib.units import mm

from prooflight.simulation.corpus.sample_job import inks
from prooflight.simulation.corpus.sample_job.sheet import HEIGHT_MM

if TYPE_CHECKING:
    from prooflight.simulation.corpus.sample_job.sheet import Sheet

QR_VERSION = 2  # 25 modules a side, up to 26 bytes at error correction level M (ISO/IEC 18004, table 7)
QR_MODULES = 4 * QR_VERSION + 17


def linear(
    sheet: Sheet, x: float, y: float, words: str, *, module_mm: float = 0.3, height_mm: float = 12.0
) -> None:
    """Code 128 (ISO/IEC 15417) with its first bar at x and its top edge at y."""
    code = code128.Code128(
        words,
        barWidth=module_mm * mm,
        barHeight=height_mm * mm,
        quiet=0,
        humanReadable=0,
        barFillColor=inks.colour(inks.BLACK),
    )
    code.drawOn(sheet.canvas, x * mm, (HEIGHT_MM - y - height_mm) * mm)


def square(sheet: Sheet, x: float, y: float, words: str, *, module_mm: float = 1.1) -> float:
    """QR code (ISO/IEC 18004) with its corner at (x, y), without quiet zone; returns its side. [mm]"""
    code = qrencoder.QRCode(QR_VERSION, qrencoder.QRErrorCorrectLevel.M)
    code.addData(words)
    code.make()
    for row in range(QR_MODULES):
        step = 0
        while step < QR_MODULES:
            run = 0
            while step + run < QR_MODULES and code.isDark(row, step + run):
                run += 1
            if run:
                sheet.rect(x + step * module_mm, y + row * module_mm, run * module_mm, module_mm, inks.BLACK)
            step += max(run, 1)
    return QR_MODULES * module_mm
