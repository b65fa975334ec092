"""Print in a scan that its design does not predict, which distinguishes another page from one with missing content.

Tiles are chosen where the design has edges, so they show what is missing, and a page without its black lacks
as many of them as another page does. Here the scan's own print is analysed, square by square, on the coarse
pictures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import cv2
import numpy as np

from prooflight.kernels.registration.coarse import SHRINK

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.scans.geometry import ScanGeometry

SURROUND: Final = 9
"""Side of the square whose mean is subtracted from the light to get type, rules and edges, 8 mm. [coarse
pixels]"""
DETAIL_LIMIT: Final = 0.2
"""Limit of the detail, so that a few heavy edges do not drown type. [white]"""
SQUARE: Final = 8
"""Side of the squares that are compared, 7 mm, a few words. [coarse pixels]"""
FAINT: Final = 0.02
"""Detail of a square, rms, above which it is printed; the paper's cloudiness makes 0.002. [white]"""
UNTOLD: Final = 0.4
"""Share of a square's detail (energy) that the design leaves unexplained, above which the square is
foreign."""
REACH: Final = 4
"""Search range about the page's place, 3.4 mm; a page further off is a wrong page anyway. [coarse pixels]"""
MARGIN: Final = 3
"""Margin inside the sheet's edges that is left out, since edges move with the sheet, not with the print.
[coarse pixels]"""
BARE: Final = 0.9
"""Light above which nothing is printed. [white]"""
BARE_PLACE: Final = 13
"""Side of the smallest unprinted area that counts, 11 mm, wider than spaces between words or lines. [coarse
pixels]"""
DAMPING: Final = 1e-4
"""Regularisation of the fit of a square in which the design has nothing. [white^2]"""


class Foreign(NamedTuple):
    """Share of squares whose print the design does not predict."""

    of_print: float
    """Share of the squares on which the scan has print. [-]"""
    of_page: float
    """Share of the page's squares. [-]"""
    of_width: float
    """Share of the page's width with a foreign square somewhere; it is small for a streak. [-]"""


def detail(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return what type, rules and edges add to the light around them (rows, columns) [white]."""
    return np.clip(light - cv2.blur(light, (SURROUND, SURROUND)), -DETAIL_LIMIT, DETAIL_LIMIT)


def coarse_inside(geometry: ScanGeometry, width_mm: float, height_mm: float) -> tuple[slice, slice]:
    """Return the rows and columns of a coarse picture inside a page at its place, ``MARGIN`` from its edges."""
    lines, columns = geometry.on_page(width_mm, height_mm)
    rows, across = (
        slice(-(-part.start // SHRINK) + MARGIN, max(part.stop // SHRINK - MARGIN, 0))
        for part in (lines, columns)
    )
    return rows, across


def foreign_print(
    seen: NDArray[np.float32], design: NDArray[np.float32], inside: tuple[slice, slice]
) -> Foreign:
    """Measure the print in a scan that its design does not predict.

    Each square of the design may have any strength and be shifted by up to a coarse pixel, so missing, weak
    or misregistered print is still explained. Only what the scan shows is tested, not what it lacks.

    Parameters
    ----------
    seen, design : (rows, columns) coarse pictures of scan and design [white]
    inside : rows and columns to compare
    """
    rows = min(len(seen), len(design))
    if min(design[:rows][inside].shape) < SQUARE:
        return Foreign(of_print=0.0, of_page=0.0, of_width=0.0)
    there, right, down = _aligned(seen[:rows], design[:rows], inside)
    expected = detail(_less(design[:rows], seen[:rows], right, down))[inside]
    there, expected = _without_stripes(there), _without_stripes(expected)
    near_print = cv2.dilate((np.abs(there) > FAINT).astype(np.float32), np.ones((3, 3), np.uint8))
    about = [expected, *(np.roll(expected, step, axis) for axis in (0, 1) for step in (-1, 1))]
    model = np.stack([_squares(one * near_print) for one in about], axis=1)
    shown = _squares(there * near_print)
    push = np.einsum("nkp,np->nk", model, shown)
    normal = np.einsum("nkp,nlp->nkl", model, model) + DAMPING * np.eye(len(about))
    amounts = np.linalg.solve(normal, push[..., None])[..., 0]
    untold = ((shown - np.einsum("nkp,nk->np", model, amounts)) ** 2).sum(axis=1)
    energy, least = (shown**2).sum(axis=1), SQUARE**2 * FAINT**2
    foreign = (untold > least) & (untold > UNTOLD * energy)
    return Foreign(
        of_print=int(foreign.sum()) / max(int((energy > least).sum()), 1),
        of_page=float(foreign.mean()),
        of_width=float(foreign.reshape(-1, expected.shape[1] // SQUARE).any(axis=0).mean()),
    )


def _aligned(
    seen: NDArray[np.float32], design: NDArray[np.float32], inside: tuple[slice, slice]
) -> tuple[NDArray[np.float32], int, int]:
    """Return a scan's detail inside the page at the best match, and its offset right and down. [coarse pixels]"""
    framed = np.pad(detail(seen)[inside], REACH)
    expected = np.ascontiguousarray(detail(design)[inside])
    likeness = cv2.matchTemplate(framed, expected, cv2.TM_CCORR_NORMED)
    row, column = (int(at) for at in np.unravel_index(int(np.nan_to_num(likeness).argmax()), likeness.shape))
    there = framed[row : row + expected.shape[0], column : column + expected.shape[1]]
    return there, column - REACH, row - REACH


def _less(
    design: NDArray[np.float32], seen: NDArray[np.float32], right: int, down: int
) -> NDArray[np.float32]:
    """Return the design with all content removed where the scan is bare, so that the edge of a gap is not foreign."""
    matrix = np.array([[1, 0, -right], [0, 1, -down]], np.float32)
    moved = cv2.warpAffine(seen, matrix, seen.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
    place = np.ones((BARE_PLACE, BARE_PLACE), np.uint8)
    bare = cv2.morphologyEx((moved > BARE).astype(np.uint8), cv2.MORPH_OPEN, place)
    return np.where(bare > 0, np.maximum(design, moved), design).astype(np.float32)


def _without_stripes(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Subtract row and column medians: bands and streaks are no page's print."""
    across, along = np.median(picture, axis=1, keepdims=True), np.median(picture, axis=0, keepdims=True)
    return np.asarray(picture - across - along, np.float32)


def _squares(picture: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the whole squares of a picture, (squares, pixels)."""
    rows, columns = (extent // SQUARE for extent in picture.shape)
    cut = picture[: rows * SQUARE, : columns * SQUARE].astype(np.float64)
    return cut.reshape(rows, SQUARE, columns, SQUARE).swapaxes(1, 2).reshape(rows * columns, SQUARE**2)
