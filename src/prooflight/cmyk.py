"""The process inks, in the order of every raster and every axis of inks."""

from __future__ import annotations

from typing import Final

INKS: Final = 4
INK_LETTERS: Final = "CMYK"
INK_NAMES: Final = ("cyan", "magenta", "yellow", "black")
NAME_OF_INK: Final = dict(zip(INK_LETTERS, INK_NAMES, strict=True))
