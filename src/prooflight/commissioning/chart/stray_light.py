"""Stray light, by diffraction or glare, over a millimetre and more on the page of a chart.

The light of a point at a distance r falls as k / r^3, as the tail of diffraction does (Airy's rings on
average); k, a length, is estimated from the paper between the patches, which is darker near dark ones.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from scipy import fft

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.commissioning.chart.finding import DetectedChart
    from prooflight.inks.chart_layout import PlacedRecipes

_FROM_MM: Final = 0.3  # nearer light belongs to the pixel's footprint
_STEP_MM: Final = 0.2
# assumed: ten times what diffraction at F/2.8 strays; more is blur, not stray light
_MOST_MM: Final = 5e-3


def strayed(
    placed: PlacedRecipes,
    chart: DetectedChart,
    here: NDArray[np.int64],
    light: NDArray[np.float64],
    shape: tuple[int, ...],
) -> NDArray[np.float32]:
    """Return the net loss of each pixel by stray light of a strength of 1 mm: own minus the others' over r^3."""
    layout, step = placed.layout, _STEP_MM
    margin = 20.0
    size = [round((extent + 2 * margin) / step) for extent in (layout.height_mm, layout.width_mm)]
    fine = 2  # squares of a tenth of a millimetre
    page = np.ones([extent * fine for extent in size], np.float32)
    levels = dict(zip(map(tuple, placed.place[here, 1:].tolist()), light.tolist(), strict=True))
    boxes = [(layout.patch_box(row, column), level) for (row, column), level in levels.items()]
    darkest = float(light.min())
    marks = [(box, darkest if black else 1.0) for box, black in layout.black_and_white(chart.page)]
    for (x, y, width, height), level in (*marks, *boxes):
        left, top, right, bottom = (
            round((edge + margin) / step * fine) for edge in (x, y, x + width, y + height)
        )
        page[top:bottom, left:right] = level
    coarse = cv2.resize(page, (size[1], size[0]), interpolation=cv2.INTER_AREA)
    # Within a square the neighbours' light is even, so its middle stands for it.
    reach = round(margin / step)
    away = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) * step
    kernel = np.where(away >= _FROM_MM, step**2 / np.maximum(away, step) ** 3, 0.0)
    total = fft.next_fast_len(size[0] + 2 * reach), fft.next_fast_len(size[1] + 2 * reach)
    product = fft.rfft2(1 - coarse, total) * fft.rfft2(kernel, total)
    others = fft.irfft2(product, total)[reach : reach + size[0], reach : reach + size[1]]
    net = (others - kernel.sum() * (1 - coarse)).astype(np.float32)
    to_grid = chart.to_chart / step
    to_grid[:, 2] += margin / step - 0.5
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(net, to_grid, (shape[1], shape[0]), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    )


def strength_of(flat: NDArray[np.float32], paper: NDArray[np.bool_], spread: NDArray[np.float32]) -> float:
    """Estimate the strength of stray light from the paper.

    It is the least-squares fit of the paper's light against ``spread``, both without the part of columns and
    lines, which is already in their gains.
    """
    seen, strayed = (_without_gains(values, paper) for values in (flat, spread))
    moment = float(np.sum(strayed**2, dtype=np.float64))
    strength = -np.sum(strayed * seen, dtype=np.float64) / moment if moment > 0 else 0.0
    return float(np.clip(strength, 0.0, _MOST_MM))


def _without_gains(values: NDArray[np.float32], paper: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return an image over the paper without the means of columns and lines; 0 elsewhere."""
    left = np.where(paper, values - values[paper].mean(), 0).astype(np.float32)
    for axis in (0, 1, 0, 1):
        mean = left.sum(axis=axis, keepdims=True) / np.maximum(paper.sum(axis=axis, keepdims=True), 1)
        left -= mean.astype(np.float32)
        left *= paper
    return left
