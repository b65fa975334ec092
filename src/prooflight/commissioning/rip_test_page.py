"""The test page of ``press rip-model``: edges at parts of pixels, hairlines and tints of every ink."""

from __future__ import annotations

from typing import Final

from prooflight.cmyk import INKS
from prooflight.pages.pdf.engine_check import pdf_of

SIDE_POINTS: Final = (420.0, 320.0)
PITCH_POINTS: Final = 24.37
"""Pitch of the squares: no multiple of a pixel of any usual resolution, so that edges lie at all parts of pixels."""
SQUARE_POINTS: Final = 11.13
STAGGER_POINTS: Final = 0.173
"""Steps by which neighbours lie further down, so that no two edges of a row are rounded alike."""
SQUARES: Final = (8, 2)
"""Squares of each ink, across and down."""
HAIRLINES_POINTS: Final = (0.0, 0.06, 0.12, 0.25, 0.5)
TINTS: Final = (0.05, 0.1, 0.25, 0.5, 0.75, 0.9)


def test_pdf() -> bytes:
    """Return the page as a PDF."""
    paints = []
    for ink in range(INKS):
        top = SIDE_POINTS[1] - 14 - 74 * ink
        paints.append(_colour(ink, 1.0))
        for row in range(SQUARES[1]):
            for column in range(SQUARES[0]):
                x = 12.31 + PITCH_POINTS * column + STAGGER_POINTS * row
                y = top - 25.43 * row - SQUARE_POINTS - STAGGER_POINTS * column
                paints.append(
                    f"{x:.3f} {y:.3f} {SQUARE_POINTS + 0.037 * column:.3f} {SQUARE_POINTS + 0.029 * column:.3f} re f"
                )
                # A triangle beside it, whose edges cut pixels at all angles.
                paints.append(
                    f"{x + 13:.3f} {y:.3f} m {x + 22:.3f} {y + 3.1:.3f} l {x + 15:.3f} {y + 11:.3f} l f"
                )
        for line, width in enumerate(HAIRLINES_POINTS):
            x, y = 222.3 + 7.77 * line, top - 36
            paints.append(f"{width:g} w {x:.3f} {y:.3f} m {x:.3f} {y + 36:.3f} l S")
            paints.append(f"{264.0:.3f} {y + 7.13 * line:.3f} m {300.0:.3f} {y + 7.13 * line:.3f} l S")
        for patch, tint in enumerate(TINTS):
            paints += [_colour(ink, tint), f"{308 + 18 * patch} {top - 36} 16 36 re f"]
    content = "\n".join(paints).encode()
    return _document(content)


def _colour(ink: int, amount: float) -> str:
    amounts = ["0"] * INKS
    amounts[ink] = f"{amount:g}"
    return f"{' '.join(amounts)} k {' '.join(amounts)} K"


def _document(content: bytes) -> bytes:
    width, height = SIDE_POINTS
    page = f"<</Type/Page/Parent 2 0 R/Contents 4 0 R/Resources<<>>/MediaBox[0 0 {width:g} {height:g}]>>"
    return pdf_of(
        [
            b"<</Type/Catalog/Pages 2 0 R>>",
            b"<</Type/Pages/Kids[3 0 R]/Count 1>>",
            page.encode(),
            b"<</Length %d>>stream\n%s\nendstream" % (len(content), content),
        ]
    )
