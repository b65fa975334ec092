"""The whole scan of a sheet, aligned to the grid of the expected page, in files that are read by tiles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np

from prooflight.press.artefact import Press
from prooflight_console.pictures.expected import write_levels
from prooflight_console.pictures.tiles import FLAT, REACH, UNSEEN, valley
from prooflight_line.journal.arrays import NAME, TOP
from prooflight_line.journal.cuts import signal_of, whole_scan

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight_console.pictures.expected import Pyramid

WHOLE: Final = (NAME, TOP, f"{NAME}_mm")
"""Names of the arrays of the evidence that store the whole scan."""
BLOCK: Final = 96
"""Pixels along the side of a block for matching, a centimetre at the prototype's pitch."""
BLOCKS: Final = 12
"""Largest number of blocks along each side of the page."""
FEWEST: Final = 6
"""Least number of blocks that must agree with the map; otherwise the verdict's shift is used."""
WITHIN: Final = 0.7
"""Inlier threshold of the affine map. [pixels]"""


def make_seen(
    evidence: Mapping[str, NDArray[Any]],
    press: Path | None,
    shift_mm: tuple[float, float] | None,
    expected: Pyramid,
    folder: Path,
) -> None:
    """Write the levels of a sheet's whole scan; called in a process of its own.

    The scan is aligned to the page by an affine map, which is fitted to the best matches of blocks: paper
    shifts, stretches and turns. Where no scan is stored its signal is ``UNSEEN``. Raises ValueError if the
    scan cannot be read.
    """
    read = whole_scan(evidence)
    if read is None:
        raise ValueError("the stored whole scan is damaged")
    light, box = read
    loaded = None if press is None else Press.load(press)
    width_mm = expected.width_mm
    signal = signal_of(light, (box[0], box[2]), loaded, page_width_mm=width_mm, shift_mm=shift_mm)
    page = expected.part(expected.levels - 1, 0, 0, max(expected.width, expected.height))
    scan = _aligned(signal, box, page, expected)
    write_levels(
        folder,
        lambda first, last: scan[first:last],
        width=expected.width,
        height=expected.height,
        size_mm=(expected.width_mm, expected.height_mm),
    )


def _aligned(
    signal: NDArray[np.float32],
    box: tuple[float, float, float, float],
    page: NDArray[np.float32],
    expected: Pyramid,
) -> NDArray[np.float32]:
    """Return the scan at every pixel of the page, (lines, pixels)."""
    across, down = expected.width / expected.width_mm, expected.height / expected.height_mm
    scale = box[2] * across / signal.shape[1], box[3] * down / signal.shape[0]
    where = np.array([[scale[0], 0, box[0] * across], [0, scale[1], box[1] * down]], np.float64)
    where[:, 2] += (np.array(scale) - 1) / 2  # coordinates are those of pixel centres
    size = page.shape[1], page.shape[0]
    first = cv2.warpAffine(signal, where, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    there = np.ones(signal.shape, np.uint8)
    if (finer := _fitted(first, page)) is not None:
        where = finer @ np.vstack([where, [0, 0, 1]])
        first = cv2.warpAffine(signal, where, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    covered = cv2.warpAffine(there, where, size, flags=cv2.INTER_NEAREST).astype(bool)
    return np.asarray(np.where(covered, first, UNSEEN), np.float32)


def _fitted(seen: NDArray[np.float32], page: NDArray[np.float32]) -> NDArray[np.float64] | None:
    """Return the affine map (2, 3) from the scan to the page; None if too few blocks of it match."""
    rows, columns = page.shape
    here, there = [], []
    for top in np.unique(np.linspace(REACH, rows - BLOCK - REACH, BLOCKS).astype(int)):
        for left in np.unique(np.linspace(REACH, columns - BLOCK - REACH, BLOCKS).astype(int)):
            if top < REACH or left < REACH:
                continue
            piece = seen[top : top + BLOCK, left : left + BLOCK]
            around = page[top - REACH : top + BLOCK + REACH, left - REACH : left + BLOCK + REACH]
            if min(float(piece.std()), float(around.std())) < 2 * FLAT:
                continue
            off = cv2.matchTemplate(around, np.minimum(piece, 1), cv2.TM_SQDIFF)
            row, column = divmod(int(off.argmin()), off.shape[1])
            if not (0 < row < 2 * REACH and 0 < column < 2 * REACH):
                continue
            here.append((left, top))
            there.append(
                (
                    left + column - REACH + valley(off[row], column),
                    top + row - REACH + valley(off[:, column], row),
                )
            )
    if len(here) < FEWEST:
        return None
    affine, agreed = cv2.estimateAffine2D(
        np.array(here, np.float64), np.array(there, np.float64), ransacReprojThreshold=WITHIN
    )
    return None if affine is None or int(agreed.sum()) < FEWEST else np.asarray(affine, np.float64)
