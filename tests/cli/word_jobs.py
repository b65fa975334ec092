"""Small jobs of pages with lines of words, for commands that want a folder."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight.pages.files import write_tiff
from prooflight.pages.raster import Page

if TYPE_CHECKING:
    from pathlib import Path


def write_word_job(folder: Path, *, pages: int, rng: np.random.Generator, tinted: bool) -> None:
    """So many pages of 36 x 30 mm as TIFF; tinted: with a patch of one ink, so that each looks like no other."""
    folder.mkdir()
    for number in range(1, pages + 1):
        cmyk = np.zeros((590, 708, 4), np.uint8)
        for line in range(60, 530, 40):
            for word in range(60, 640, 90):
                cmyk[line : line + 20, word : word + int(rng.integers(20, 80)), 3] = 255
        if tinted:
            cmyk[100:300, 400:600, number % 3] = 40 * number
        page = Page(cmyk=cmyk, dpi=500.0, name=f"p{number:04d}", number=number)
        write_tiff(page, folder / f"{page.name}.tif")
