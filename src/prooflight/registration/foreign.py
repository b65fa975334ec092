"""How much of what a scan shows its design does not foretell: what tells another page from one that lacks something.

Tiles are chosen where the design has edges, so they say what is not there, and a page without its black lacks as many
of them as another page does. Here the scan's own print is looked at, square by square, on the coarse pictures.
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
"""Detail is light minus its mean over so many coarse pixels square, 8 mm: type, rules and edges."""
DETAIL_LIMIT: Final = 0.2
"""Stronger detail counts as this, so that a few heavy edges do not drown type. [white]"""
SQUARE: Final = 8
"""Coarse pixels in a side of the squares that are compared, 7 mm: some words."""
FAINT: Final = 0.02
"""Detail of a square, rms, from which something is printed there: clouds of the paper make 0.002. [white]"""
UNTOLD: Final = 0.4
"""Share of a square's detail that the design leaves unexplained, from which on it is foreign (energy)."""
REACH: Final = 4
"""Coarse pixels that the page is looked for off its place, 3.4 mm; further off it is a wrong page anyway."""
MARGIN: Final = 3
"""Coarse pixels inside the sheet's edges that do not count: edges move with the sheet, not with the print."""
BARE: Final = 0.9
"""Light above which nothing is printed. [white]"""
BARE_PLACE: Final = 13
"""Side of a place on which nothing is printed, 11 mm: no space between words or lines. [coarse pixels]"""
DAMPING: Final = 1e-4
"""Holds the fit of a square on which the design has nothing. [white^2]"""


class Foreign(NamedTuple):
    """Squares of a scan whose print the design does not foretell."""

    of_print: float
    """As a share of those on which the scan has print. [-]"""
    of_page: float
    """As a share of the page. [-]"""
    of_width: float
    """Share of the page's width that has one somewhere: little of it for a streak. [-]"""


def detail(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """What type, rules and edges add to the light about them (rows, columns) [white]."""
    return np.clip(light - cv2.blur(light, (SURROUND, SURROUND)), -DETAIL_LIMIT, DETAIL_LIMIT)


def coarse_inside(geometry: ScanGeometry, width_mm: float, height_mm: float) -> tuple[slice, slice]:
    """Rows and columns of a coarse picture that lie inside a page in its place, ``MARGIN`` from its edges."""
    lines, columns = geometry.on_page(width_mm, height_mm)
    rows, across = (
        slice(-(-part.start // SHRINK) + MARGIN, max(part.stop // SHRINK - MARGIN, 0))
        for part in (lines, columns)
    )
    return rows, across


def foreign_print(
    seen: NDArray[np.float32], design: NDArray[np.float32], inside: tuple[slice, slice]
) -> Foreign:
    """What ``seen`` shows that ``design`` does not foretell; coarse pictures (rows, columns) [white], its ``inside``.

    Each square of the design may have any strength, and lie up to a coarse pixel aside: what is missing, weak or out
    of register is foretold all the same. Only what the scan shows is asked about, not what it lacks.
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
    """A scan's detail inside the page where it is likest, and how far that lies right and down. [coarse pixels]"""
    framed = np.pad(detail(seen)[inside], REACH)
    expected = np.ascontiguousarray(detail(design)[inside])
    likeness = cv2.matchTemplate(framed, expected, cv2.TM_CCORR_NORMED)
    row, column = (int(at) for at in np.unravel_index(int(np.nan_to_num(likeness).argmax()), likeness.shape))
    there = framed[row : row + expected.shape[0], column : column + expected.shape[1]]
    return there, column - REACH, row - REACH


def _less(
    design: NDArray[np.float32], seen: NDArray[np.float32], right: int, down: int
) -> NDArray[np.float32]:
    """The design without what is missing wherever the scan is bare, so that the edge of a gap is not foreign."""
    matrix = np.array([[1, 0, -right], [0, 1, -down]], np.float32)
    moved = cv2.warpAffine(seen, matrix, seen.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
    place = np.ones((BARE_PLACE, BARE_PLACE), np.uint8)
    bare = cv2.morphologyEx((moved > BARE).astype(np.uint8), cv2.MORPH_OPEN, place)
    return np.where(bare > 0, np.maximum(design, moved), design).astype(np.float32)


def _without_stripes(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Without what goes all across or all along: bands and streaks are no page's print."""
    across, along = np.median(picture, axis=1, keepdims=True), np.median(picture, axis=0, keepdims=True)
    return np.asarray(picture - across - along, np.float32)


def _squares(picture: NDArray[np.float32]) -> NDArray[np.float64]:
    """Whole squares of a picture, (squares, pixels)."""
    rows, columns = (extent // SQUARE for extent in picture.shape)
    cut = picture[: rows * SQUARE, : columns * SQUARE].astype(np.float64)
    return cut.reshape(rows, SQUARE, columns, SQUARE).swapaxes(1, 2).reshape(rows * columns, SQUARE**2)
