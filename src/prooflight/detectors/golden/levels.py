"""Page-wide difference of a scan's levels from a golden's (lamp, paper, tone): a small, robust correction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

BLOCK_PIXELS: Final = 16
PRIOR_SD: Final = 0.03
"""Prior standard deviation of each term's coefficient: two good prints differ by 1 to 2 % of ink and lamp
(worlds.toml). [contrast]"""
BLOCK_SD: Final = 0.01
"""Standard deviation of a block's mean about the smooth difference (cloudiness of paper, halftone).
[contrast]"""
MOST: Final = 0.05
"""Limit of the correction: a page whose density is 7 % off is a misprint (worlds.toml). [contrast]"""
WAVES: Final = 4
"""Number of cosines across the page, for the lamp."""
BUSY: Final = 0.1
"""Variation within the edge tolerance at which a block has half the weight. [contrast]"""
TONES: Final = 8
"""Number of steps of lightness that have equal weight, however little of the page has them."""
LEAST_BLOCKS: Final = 30
MOST_BLOCKS: Final = 4000


def level_difference(
    golden: NDArray[np.float32], scan: NDArray[np.float32], varying: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the correction of ``golden`` (lines, pixels) [contrast].

    varying: its variation around each pixel.

    It is a robust least-squares fit (Cauchy weights) to blocks of 16 x 16 pixels: a plane, waves across the
    page, tone, and tone by place; at most 5 %.
    """
    lines, pixels = golden.shape
    rows, columns = lines // BLOCK_PIXELS, pixels // BLOCK_PIXELS
    if rows * columns < LEAST_BLOCKS:
        return np.zeros_like(golden)
    chosen = np.arange(rows * columns)[:: max(1, rows * columns // MOST_BLOCKS)]
    tone, off, busy = (_blocks(image, rows, columns)[chosen] for image in (golden, scan - golden, varying))
    across = ((chosen % columns) + 0.5) * BLOCK_PIXELS / pixels
    along = ((chosen // columns) + 0.5) * BLOCK_PIXELS / lines
    model = np.stack(_terms(across, along, tone), axis=1)
    step = np.clip((tone * TONES).astype(np.intp), 0, TONES - 1)
    base_weight = 1 / (1 + (busy / BUSY) ** 2)
    of_step = np.bincount(step, base_weight, TONES)
    base_weight *= base_weight.sum() / TONES / np.maximum(of_step, LEAST_BLOCKS)[step]
    weight = base_weight
    for _ in range(8):
        weighted = model * (weight / BLOCK_SD**2)[:, None]
        normal = weighted.T @ model + np.eye(model.shape[1]) / PRIOR_SD**2
        coefficients = np.linalg.solve(normal, weighted.T @ off)
        weight = base_weight / (1 + ((off - model @ coefficients) / BLOCK_SD) ** 2)
    x = ((np.arange(pixels, dtype=np.float32) + 0.5) / pixels)[None, :]
    y = ((np.arange(lines, dtype=np.float32) + 0.5) / lines)[:, None]
    total = np.zeros_like(golden)
    for coefficient, term in zip(coefficients, _terms(x, y, golden), strict=True):
        total += np.float32(coefficient) * term.astype(np.float32)
    return np.clip(total, -MOST, MOST)


def _blocks(image: NDArray[np.float32], rows: int, columns: int) -> NDArray[np.float64]:
    """Return means of blocks, (rows * columns,)."""
    whole = image[: rows * BLOCK_PIXELS, : columns * BLOCK_PIXELS]
    return cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA).ravel().astype(np.float64)


def _terms(
    across: NDArray[np.floating], along: NDArray[np.floating], tone: NDArray[np.floating]
) -> list[NDArray[np.floating]]:
    """Return the terms of the fit at places (0..1 of the page) and tones (0 dark, 1 light)."""
    ink = 1 - tone
    waves = [np.cos(np.pi * wave * across) for wave in range(1, WAVES + 1)]
    tones = [ink, ink**2, ink**3]
    return [np.ones_like(across), along - 0.5, *waves, *tones, ink * (across - 0.5), ink * (along - 0.5)]
