"""Inks of the sample job: process colours as the bytes that reach the press, and one spot colour.

Bytes, not per cent, are the unit here: 50 % is no whole byte, and the sample job guarantees exact raster
values.
"""

from __future__ import annotations

from typing import Any

from reportlab.lib.colors import CMYKColor, CMYKColorSep

Ink = tuple[int, int, int, int]
"""C M Y K, 0 = no ink, 255 = full ink, as in ``Page.cmyk``."""

FULL = 255
_NUDGE = 0.01
"""Amount added to a byte before it is divided by 255.

reportlab prints six decimals, and a RIP may round or truncate ``value * 255``; a hundredth of a byte makes
both arrive at the intended byte.
"""


def percent(cyan: float, magenta: float, yellow: float, black: float) -> Ink:
    """Return the bytes nearest to area coverages in per cent.

    >>> percent(0, 40, 100, 0)
    (0, 102, 255, 0)
    """
    c, m, y, k = (round(FULL * value / 100) for value in (cyan, magenta, yellow, black))
    return c, m, y, k


def colour(ink: Ink) -> Any:
    """Return the reportlab colour that a RIP turns into exactly these bytes."""
    return CMYKColor(*(_fraction(byte) for byte in ink))


def _fraction(byte: int) -> float:
    return byte / FULL if byte in (0, FULL) else (byte + _NUDGE) / FULL


SPOT_NAME = "Lantern Orange"
SPOT: Ink = (0, 155, 255, 0)
"""Process equivalent of the spot colour at full tint. Every component is a multiple of 5, so that tints in steps
of a fifth have whole bytes."""


def spot_colour(fifths: int) -> Any:
    """Return the spot colour at ``fifths`` / 5 of its full tint: a Separation with a tint transform to DeviceCMYK."""
    return CMYKColorSep(*(_fraction(byte) for byte in SPOT), spotName=SPOT_NAME, density=fifths / 5)


PAPER: Ink = (0, 0, 0, 0)
BLACK: Ink = (0, 0, 0, FULL)
RICH_BLACK = percent(60, 40, 40, 100)
NIGHT = percent(100, 76, 24, 46)
"""House blue: headings on paper, flats behind light text."""
EMBER = percent(0, 72, 86, 2)
"""Accent colour; one a page."""
STRAW = percent(2, 10, 40, 0)
SAND = percent(2, 4, 10, 0)
GREY = percent(0, 0, 0, 68)
HAIRLINE = percent(0, 0, 0, 34)
