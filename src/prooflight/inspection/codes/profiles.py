"""Light of a code, and scan lines across a bar code, cut into its elements (ISO/IEC 15416, 5.2 to 5.4).

A code reader takes one picture, paper light, of all the camera's lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.kernels.scan_lines import cut_lines

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.inspection.codes.symbols import Symbol
    from prooflight.prediction.tables import SensorModel

PROFILES: Final = 10
"""Number of scan lines across a bar code (ISO/IEC 15416, 5.2.4)."""
INNER: Final = 0.1, 0.9
"""Part of a bar code's height that scan lines are taken from (the inspection band)."""
SAMPLES_A_PIXEL: Final = 4
QUIET_PIXELS: Final = 6.0
"""Width of paper on either side that a profile holds."""
LEAST_EDGES: Final = 4
"""Least number of edges, of two bars: a code with fewer is no bar code."""
PAPER: Final = 220
"""Grey value of bare paper: gloss and a brighter lamp still have room above it."""

LEAST_GAIN_DN: Final = np.float32(1e-3)
"""Least gain of a column: a dead one then shows as black instead of as no number."""


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


def paper_light(
    dn: NDArray[np.generic], sensors: Sequence[SensorModel], columns: slice
) -> NDArray[np.float32]:
    """Return the mean light over the sensors of a cut of a scan (sensors, lines, columns) [DN]: (lines, columns).

    Bare paper is 1. columns: of the scan, which the cut holds. A code reader sees red light alone; the
    camera's own light is the best approximation that is available here, and the grades state this.
    """
    total = np.zeros(dn.shape[1:], np.float32)
    for lines, sensor in zip(dn, sensors, strict=True):
        gain = sensor.column_gain[columns] * np.float32(sensor.white_dn * len(sensors))
        per_dn = (1 / np.maximum(gain, LEAST_GAIN_DN)).astype(np.float32)
        total += lines * per_dn
        total -= sensor.column_offset_dn[columns] * per_dn
    return total


def grey(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return light, bare paper 1, as a picture that code readers take."""
    return cv2.convertScaleAbs(np.maximum(light, 0), alpha=PAPER)
