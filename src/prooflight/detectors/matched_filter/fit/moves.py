"""Local displacements of a page relative to its prediction, estimated from residuals, and their removal."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.kernels.residuals.residuals import predict_again, slope_sums, take_slopes
from prooflight.pages.parallel import parts_of, shared_out
from prooflight.scans.placement import Warp

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.placement import Placement

LOCAL_PIXELS: Final = 16
LOCAL_SMOOTH: Final = 1.0
"""Standard deviation of the Gaussian that smooths local displacements. [tiles]"""
LOCAL_SD: Final = 0.15
"""Standard deviation of the displacements that registration leaves. [pixels]"""
CORRECTED_SHARE: Final = 0.7
"""Share of an estimated displacement by which the placement is corrected: an edge that is sharper than a
pixel seems to have moved by up to twice its true displacement. (chosen from 0.7 and 1, on designs of their
own)"""


def local_moves(
    left: NDArray[np.float32], weight: NDArray[np.float32], light: NDArray[np.float32], *, threads: int = 1
) -> NDArray[np.float32]:
    """Return the smooth field of small displacements that explains residuals best.

    That is how far right and down the predicted light would have to move: (2, rows, columns), at squares of
    ``LOCAL_PIXELS``. [pixels]
    """
    lines, pixels = left.shape[1:]
    side = LOCAL_PIXELS
    shape = tile_shape(lines, pixels)
    sums = np.zeros((5, *shape), np.float32)

    def add_sums(first: int, last: int) -> None:
        for index in range(len(light)):
            slope_sums(left[index], weight[index], light[index], side, first, last, sums)

    shared_out([partial(add_sums, *part) for part in parts_of(shape[0], threads)], threads=threads)
    return moves_of(sums)


def tile_shape(lines: int, pixels: int) -> tuple[int, int]:
    """Return rows and columns of the squares of ``local_moves``."""
    return max(lines // LOCAL_PIXELS, 1), max(pixels // LOCAL_PIXELS, 1)


def moves_of(sums: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return ``local_moves`` from the sums of all sensors, (5, rows, columns) as ``slope_sums`` gives them."""
    ax, ay, xx, yy, xy = (cv2.GaussianBlur(one, (0, 0), LOCAL_SMOOTH) for one in sums)
    prior_information = 1 / LOCAL_SD**2
    xx, yy = xx + prior_information, yy + prior_information
    whole = xx * yy - xy * xy
    return np.stack([(xy * ay - yy * ax) / whole, (xy * ax - xx * ay) / whole])


def take_moves(
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    light: NDArray[np.float32],
    moves: NDArray[np.float32],
    *,
    threads: int = 1,
) -> None:
    """Remove displacements by ``local_moves`` from the residuals, in place and to first order."""
    lines, pixels = left.shape[1:]
    fields = [cv2.resize(one, (pixels, lines), interpolation=cv2.INTER_LINEAR) for one in moves]
    stripes = [(index, part) for index in range(len(left)) for part in parts_of(lines, threads)]
    shared_out(
        [partial(take_slopes, left[i], weight[i], light[i], *fields, *part) for i, part in stripes],
        threads=threads,
    )


def by_prediction(
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    before_dn: NDArray[np.float32],
    after_dn: NDArray[np.float32],
    *,
    threads: int = 1,
) -> None:
    """Change residuals to another prediction (sensors, lines, pixels), in place; fitted amounts stay."""
    stripes = [(index, part) for index in range(len(left)) for part in parts_of(left.shape[1], threads)]
    shared_out(
        [partial(predict_again, left[i], weight[i], before_dn[i], after_dn[i], *part) for i, part in stripes],
        threads=threads,
    )


def corrected(
    placement: Placement, moves: NDArray[np.float32], geometry: ScanGeometry, page_width_mm: float
) -> Placement:
    """Return the placement, corrected by ``CORRECTED_SHARE`` of the ``local_moves``."""
    pitch_mm = np.array([geometry.pixel_pitch_mm, geometry.line_pitch_mm])
    middle, step_mm = (LOCAL_PIXELS - 1) / 2, LOCAL_PIXELS * float(pitch_mm.min())
    corner_mm = np.array([geometry.centres_x_mm(page_width_mm)[0], geometry.centres_y_mm(1)[0]])
    first_mm = corner_mm + middle * pitch_mm
    squares = np.array(moves.shape[:0:-1])
    count = np.ceil((squares - 1) * LOCAL_PIXELS * pitch_mm / step_mm).astype(np.int64) + 1
    x_mm, y_mm = np.meshgrid(*(step_mm * np.arange(n) for n in count))
    field = Warp(nodes_mm=np.moveaxis(moves, 0, -1), pitch_mm=LOCAL_PIXELS)
    nodes = np.stack(field.at(x_mm / pitch_mm[0], y_mm / pitch_mm[1]), axis=-1) * (CORRECTED_SHARE * pitch_mm)
    if placement.warp is not None:
        nodes += np.stack(placement.warp.at(x_mm + first_mm[0], y_mm + first_mm[1]), axis=-1)
    first_x, first_y = first_mm.tolist()
    warp = Warp(nodes_mm=nodes.astype(np.float32), pitch_mm=step_mm, first_mm=(first_x, first_y))
    return replace(placement, warp=warp)
