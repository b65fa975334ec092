"""Scan lines across a bar code, cut into its elements (ISO/IEC 15416, 5.2 to 5.4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.kernels.scan_lines import cut_lines

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.inspection.codes.symbols import Symbol

PROFILES: Final = 10
"""Number of scan lines across a bar code (ISO/IEC 15416, 5.2.4)."""
INNER: Final = 0.1, 0.9
"""Part of a bar code's height that scan lines are taken from (the inspection band)."""
SAMPLES_A_PIXEL: Final = 4
QUIET_PIXELS: Final = 6.0
"""Width of paper on either side that a profile holds."""
LEAST_EDGES: Final = 4
"""Least number of edges, of two bars: a code with fewer is no bar code."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """Scan line across a bar code, cut into elements."""

    edges: NDArray[np.float64]
    """Edges between elements [pixel]; the first bar begins at edges[0]."""
    peaks: NDArray[np.float64]
    """Light (elements,) of elements in order: paper, bar, space, ..., bar, paper."""
    defects: NDArray[np.float64]
    """Greatest non-monotony (elements,) within each of them."""


def cut_elements(lines: NDArray[np.float64], step: float) -> tuple[Profile | None, ...]:
    """Cut scan lines (lines, samples) into elements; samples are ``step`` pixels apart. None: a line has no bars.

    Elements lie above or below the global threshold, (greatest + least) / 2; an edge lies where light first
    passes halfway between its two elements (ISO/IEC 15416, 5.3). Non-monotony is that of 5.4.5.
    """
    edges, peaks, defects = np.empty((3, *lines.shape))
    counts = np.empty(len(lines), np.int64)
    cut_lines(lines, edges, peaks, defects, counts)
    return tuple(
        Profile(
            edges=edges[line, : count - 1] * step, peaks=peaks[line, :count], defects=defects[line, :count]
        )
        if count > LEAST_EDGES
        else None
        for line, count in enumerate(counts.tolist())
    )


def profiles(light: NDArray[np.float32], symbol: Symbol) -> tuple[Profile | None, ...]:
    """Return the scan lines across a code as the camera must see it.

    A code that is not made of bars has none.
    """
    if not symbol.linear:
        return ()
    return cut_elements(scan_lines(light, symbol), 1 / SAMPLES_A_PIXEL)


def scan_lines(light: NDArray[np.float32], symbol: Symbol) -> NDArray[np.float64]:
    """Sample scan lines across a bar code, (``PROFILES``, samples), all as long as the longest.

    Each has ``SAMPLES_A_PIXEL`` samples a pixel.
    """
    top_left, top_right, bottom_right, bottom_left = np.array(symbol.corners)
    part = np.linspace(*INNER, PROFILES)[:, None]
    begin, end = top_left + part * (bottom_left - top_left), top_right + part * (bottom_right - top_right)
    length = np.hypot(*(end - begin).T)
    way = (end - begin) / np.maximum(length, 1.0)[:, None]
    at = np.arange(-QUIET_PIXELS, float(length.max()) + QUIET_PIXELS, 1 / SAMPLES_A_PIXEL)
    x, y = (begin[:, axis, None] + at * way[:, axis, None] for axis in (0, 1))
    return sampled(light, x, y)


def sampled(
    light: NDArray[np.float32], x: NDArray[np.floating], y: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Return the light at points (rows, columns) [pixel], cubic between pixels; (rows, columns)."""
    x, y = (np.ascontiguousarray(axis, np.float32) for axis in (x, y))
    values = cv2.remap(light, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return values.astype(np.float64)
