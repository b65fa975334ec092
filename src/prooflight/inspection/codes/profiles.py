"""Scan lines across a bar code, cut into its elements (ISO/IEC 15416, 5.2 to 5.4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.inspection.codes.symbols import Symbol

PROFILES: Final = 10
"""Scan lines across a bar code (ISO/IEC 15416, 5.2.4)."""
INNER: Final = 0.1, 0.9
"""Of its height, in which they lie (the inspection band)."""
SAMPLES_A_PIXEL: Final = 4
QUIET_PIXELS: Final = 6.0
"""Of paper on either side that a profile holds."""
LEAST_EDGES: Final = 4
"""Two bars: what has fewer is no bar code."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """One scan line across a bar code, cut into elements."""

    edges: NDArray[np.float64]
    """Where elements begin and end [pixel]; the first bar begins at edges[0]."""
    peaks: NDArray[np.float64]
    """Light of elements in order: paper, bar, space, ..., bar, paper (elements,)."""
    defects: NDArray[np.float64]
    """Greatest non-monotony within each of them (elements,)."""


def profile(light: NDArray[np.float64], step: float) -> Profile | None:
    """Elements of one scan line (samples,), ``step`` pixels apart; None: it has no bars.

    Elements are what lies above or below the global threshold, (greatest + least) / 2; an edge lies where light passes
    halfway between its two elements (ISO/IEC 15416, 5.3).
    """
    high, low = float(light.max()), float(light.min())
    dark = light < (high + low) / 2
    changes = np.flatnonzero(np.diff(dark)) + 1
    if dark[0] or dark[-1] or changes.size < LEAST_EDGES:
        return None
    starts = np.concatenate([[0], changes])
    element = np.repeat(np.arange(starts.size), np.diff(np.append(starts, light.size)))
    lit = np.where(element % 2, -light, light)  # an element's own extreme is its greatest
    peaks = np.maximum.reduceat(lit, starts)
    samples = np.arange(light.size)
    middles = np.minimum.reduceat(np.where(lit == peaks[element], samples, light.size), starts)
    peaks = np.where(np.arange(starts.size) % 2, -peaks, peaks)
    edges = _passed(light, middles, (peaks[:-1] + peaks[1:]) / 2) * step
    defects = np.maximum.reduceat(_non_monotony(lit, element), starts)
    return Profile(edges=edges, peaks=peaks, defects=defects)


def _passed(
    light: NDArray[np.float64], middles: NDArray[np.intp], halves: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Where light first passes each of ``halves`` (n,) between its neighbours of ``middles`` (n + 1,). [sample]"""
    between = np.repeat(np.arange(halves.size), np.diff(middles))
    samples = np.arange(middles[0], middles[-1])
    falls = np.where(between % 2, -1.0, 1.0)
    beyond = (light[samples] - halves[between]) * falls < 0
    last = middles[-1]
    first = np.minimum.reduceat(np.where(beyond, samples, last), middles[:-1] - middles[0])
    first = np.where(first == last, middles[1:], first)
    before, after = light[first - 1], light[first]
    return first - 1 + (halves - before) / (after - before)


def _non_monotony(lit: NDArray[np.float64], element: NDArray[np.intp]) -> NDArray[np.float64]:
    """How far light goes back within its element between greater light on both sides, by sample (5.4.5)."""
    apart = (
        float(np.ptp(lit)) + 1.0
    ) * element  # so that what was greatest in one element counts in no other
    from_left = np.maximum.accumulate(lit + apart) - apart
    from_right = (np.maximum.accumulate((lit - apart)[::-1]) + apart[::-1])[::-1]
    return np.minimum(from_left, from_right) - lit


def profiles(light: NDArray[np.float32], symbol: Symbol) -> tuple[Profile | None, ...]:
    """Scan lines across a code as the camera must see it; none of a code that is not made of bars."""
    if not symbol.linear:
        return ()
    return tuple(profile(samples, 1 / SAMPLES_A_PIXEL) for samples in scan_lines(light, symbol))


def scan_lines(light: NDArray[np.float32], symbol: Symbol) -> list[NDArray[np.float64]]:
    """``PROFILES`` scan lines across a bar code, ``SAMPLES_A_PIXEL`` each."""
    top_left, top_right, bottom_right, bottom_left = (np.array(corner) for corner in symbol.corners)
    lines = []
    for part in np.linspace(*INNER, PROFILES):
        begin = top_left + part * (bottom_left - top_left)
        end = top_right + part * (bottom_right - top_right)
        length = float(np.hypot(*(end - begin)))
        way = (end - begin) / max(length, 1.0)
        at = np.arange(-QUIET_PIXELS, length + QUIET_PIXELS, 1 / SAMPLES_A_PIXEL)
        points = begin + at[:, None] * way
        lines.append(sampled(light, points))
    return lines


def sampled(light: NDArray[np.float32], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Light at points (n, 2), x and y [pixel], cubic between pixels."""
    x, y = (points[:, axis].astype(np.float32)[None] for axis in (0, 1))
    found = cv2.remap(light, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return found[0].astype(np.float64)
