"""The expected image of a whole page at the camera's pixels, in files that are read tile by tile.

A page is predicted in bands, so that beyond its raster little memory is needed, in a process of low priority.
Its output is one NumPy file a level, each half as large a side as the one above, which the console maps and
never reads whole.
"""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np

from prooflight.files.atomic import whole_file
from prooflight.prediction.predict import predict
from prooflight.press.artefact import Press
from prooflight.press.pages import PressJob, job_source
from prooflight.scans.placement import Placement

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.pages.layout.layout import Layout
    from prooflight.pages.raster import Page

BAND_LINES: Final = 512
MARGIN_MM: Final = 3.0
"""Margin by which a band is predicted beyond its ends: more than the extent of any footprint. [mm]"""
FULL: Final = 40_000
"""Value that stands for bare paper; ink gives less, and at most 1.6 times as much light can be stored."""
TILE: Final = 512
NICE: Final = 15
FACTS: Final = "facts.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Pyramid:
    """Resolution levels of the expected image of one page, each half as large a side as the next."""

    folder: Path
    width: int
    """Pixels of the highest level across."""
    height: int
    width_mm: float
    height_mm: float
    levels: int

    @classmethod
    def read(cls, folder: Path) -> Pyramid | None:
        """Open a pyramid; returns None if it is missing or incomplete."""
        try:
            facts = json.loads((folder / FACTS).read_text())
        except (OSError, ValueError):
            return None
        return cls(folder=folder, **facts)

    def part(self, level: int, left: int, top: int, size: int) -> NDArray[np.float32]:
        """Return the signal of at most size x size pixels of a level; bare paper is 1."""
        stored = np.load(self.folder / f"level{level:02}.npy", mmap_mode="r", allow_pickle=False)
        cut = np.asarray(stored[top : top + size, left : left + size])
        return np.asarray(cut.astype(np.float32) / FULL)


def levels_of(width: int, height: int) -> int:
    """Return the number of levels of a picture, of which the lowest fits into one tile.

    >>> levels_of(512, 500), levels_of(513, 20), levels_of(20_000, 14_000)
    (1, 2, 7)
    """
    return 1 + max(0, math.ceil(math.log2(max(width, height) / TILE)))


def size_at(extent: int, level: int, levels: int) -> int:
    """Return the number of pixels along one side of a level."""
    return max(math.ceil(extent / 2 ** (levels - 1 - level)), 1)


def yielding() -> None:
    """Initialise the process that makes pictures: low priority, one core."""
    if hasattr(os, "nice"):
        os.nice(NICE)
    cv2.setNumThreads(1)


def make(job: Path, number: int, press: Path, folder: Path, layout: Layout | None = None) -> None:
    """Predict page ``number``, from 1, and write its levels; called in a process of its own.

    Raises the errors of ``open_job`` and ``Press.load``.
    """
    loaded = Press.load(press)
    with PressJob(job_source(job, loaded, layout=layout), loaded) as opened:
        page = opened.page(number)
    geometry = loaded.geometry
    pitch = geometry.pixel_pitch_mm, geometry.line_pitch_mm
    width, height = (
        max(int(extent / each), 1)
        for extent, each in zip((page.width_mm, page.height_mm), pitch, strict=True)
    )
    write_levels(
        folder,
        lambda first, last: _band(page, loaded, first, last, width),
        width=width,
        height=height,
        size_mm=(width * pitch[0], height * pitch[1]),
    )


def write_levels(
    folder: Path,
    band: Callable[[int, int], NDArray[np.float32]],
    *,
    width: int,
    height: int,
    size_mm: tuple[float, float],
) -> Pyramid:
    """Write all levels of a picture that is computed in bands; memory is that of a few bands.

    band: first and last + 1 line -> signal (lines, width), bare paper 1.
    """
    folder.mkdir(parents=True, exist_ok=True)
    levels = levels_of(width, height)
    arrays: list[Any] = []
    for level in range(levels):
        shape = size_at(height, level, levels), size_at(width, level, levels)
        path = folder / f"level{level:02}.npy"
        arrays.append(np.lib.format.open_memmap(path, mode="w+", dtype=np.uint16, shape=shape))
    for first in range(0, height, BAND_LINES):
        last = min(first + BAND_LINES, height)
        arrays[-1][first:last] = np.rint(np.clip(band(first, last), 0, 65_535 / FULL) * FULL)
        arrays[-1].flush()
    for level in range(levels - 2, -1, -1):
        _halve(arrays[level + 1], arrays[level])
    for each in arrays:
        each.flush()
    facts: dict[str, Any] = {"width": width, "height": height, "levels": levels}
    facts |= {"width_mm": size_mm[0], "height_mm": size_mm[1]}
    with whole_file(folder / FACTS) as unfinished:
        unfinished.write_text(json.dumps(facts))
    return Pyramid(folder=folder, **facts)


def _halve(fine: NDArray[np.uint16], coarse: NDArray[np.uint16]) -> None:
    """Average 2 x 2 pixels; an odd last row or column counts twice."""
    for first in range(0, coarse.shape[0], BAND_LINES):
        rows = np.asarray(fine[2 * first : 2 * (first + BAND_LINES)])
        odd = rows.shape[0] % 2, fine.shape[1] % 2
        rows = np.pad(rows, ((0, odd[0]), (0, odd[1])), mode="edge")
        size = rows.shape[1] // 2, rows.shape[0] // 2
        coarse[first : first + size[1]] = cv2.resize(rows, size, interpolation=cv2.INTER_AREA)


def _band(page: Page, press: Press, first: int, last: int, width: int) -> NDArray[np.float32]:
    """Return the first sensor's signal at lines first to last of the page's grid, without column gains."""
    geometry, sensor = press.geometry, press.sensors[0]
    pitch_x, pitch_y = geometry.pixel_pitch_mm, geometry.line_pitch_mm
    row_mm = page.pixel_mm
    begin = max(int((first * pitch_y - MARGIN_MM) / row_mm), 0)
    end = min(math.ceil((last * pitch_y + MARGIN_MM) / row_mm), page.cmyk.shape[0])
    part = replace(page, cmyk=np.ascontiguousarray(page.cmyk[begin:end]))
    # Shift by less than a pixel, so that the lines of every band are on the page's grid.
    lines_off = (begin * row_mm - geometry.lead_in_mm) / pitch_y
    columns_off = -geometry.left_mm(page.width_mm) / pitch_x
    shift_x, shift_y = (columns_off % 1) * pitch_x, (lines_off % 1) * pitch_y
    seen = predict(
        part,
        sensors=(sensor,),
        geometry=geometry,
        placement=Placement(shift_mm=(shift_x, shift_y)),
        threads=1,
    )
    top, left = first - math.floor(lines_off), -math.floor(columns_off)
    columns = slice(left, left + width)
    signal = seen.expected_dn[0, top : top + last - first, columns]
    signal = (signal - sensor.column_offset_dn[columns]) / (sensor.column_gain[columns] * sensor.white_dn)
    return np.asarray(signal, np.float32)
