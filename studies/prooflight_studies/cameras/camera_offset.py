"""Estimation of the offset between two sensors from what both saw of one print, to hundredths of a line.

Sensors of other colours see the same edges with other contrasts, so each tile has a gain and an offset of its
own. The page need not be known; a page of text or pictures is suitable, a blank one is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.errors import ScanError
from prooflight.scans.alignment import SensorOffset

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Image = NDArray[np.float32]

BINS: Final = 32
"""Number of parts of a line whose means are compared first: they are as fine as letters, and tolerate an
offset across of some pixels."""
TILE: Final = 48
"""Side of a tile that is compared by itself: 5 mm of the prototype's, some words. [lines and pixels]"""
SMOOTH: Final = 1.2
"""Standard deviation of the smoothing of both images, in pixels; it leaves frequencies below half the
sampling rate, so that fractional shifts are exact."""
REACH: Final = 6
"""Half width of the interpolation kernel. [pixels]"""
STEPS: Final = 6
LEAST_TILES: Final = 6
MOST_ACROSS: Final = 24
"""Search range across, either way. [pixels]"""
FLOOR: Final = 0.006
"""Standard deviation of the estimate beyond the tiles' scatter: on prints without noise it is off by up to so
much. [lines or pixels]"""
CLEAR: Final = 0.2
"""Correlation of the two images at the best offset, below which they have nothing in common."""
EDGE: Final = 3.0
"""Rms slope of a tile either way, relative to that of noise alone, above which it is used."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraOffset:
    """Estimated offset of the second sensor, later and further right than the first, with standard deviations."""

    lines: float
    pixels: float
    lines_sd: float
    pixels_sd: float
    tiles: int
    likeness: float
    """Correlation of the two images at the estimated offset. [-]"""

    @property
    def offset(self) -> SensorOffset:
        """Offset as a press file has it."""
        return SensorOffset(lines=self.lines, pixels=self.pixels)


def camera_offset(
    first: NDArray[np.uint16], second: NDArray[np.uint16], *, where: str = "the scan"
) -> CameraOffset:
    """Estimate the offset of the second sensor's lines (n, pixels) [DN] from the first's, by the same count of lines.

    Whole lines up to n / 2 and 24 pixels are searched. Standard deviations are from the scatter of the tiles,
    so they include model errors. ScanError: the images have nothing in common. where: in errors.
    """
    seen = [np.asarray(lines, np.float32) for lines in (first, second)]
    along = _along(*seen)
    a, b = (cv2.GaussianBlur(lines, (0, 0), SMOOTH) for lines in seen)
    moved = np.array([float(along), float(_across(a, b, along))])
    whole, likeness = np.zeros(2), 0.0
    steps = np.empty((0, 2))
    weights = np.empty((0, 2))
    for _ in range(STEPS):
        steps, weights, likeness = _steps(a, b, moved)
        if len(steps) < LEAST_TILES:
            break
        whole = (weights * steps).sum(axis=0) / weights.sum(axis=0)
        moved = moved + np.clip(whole, -1, 1)
    if len(steps) < LEAST_TILES or likeness < CLEAR:
        what = f"shows the same edges to both sensors in {len(steps)} places, at a likeness of {likeness:.2f}"
        raise ScanError(where, what, remedy="let a page of text or pictures pass under both")
    spread = np.sqrt((weights**2 * (steps - whole) ** 2).sum(axis=0)) / weights.sum(axis=0)
    spread = np.hypot(spread, FLOOR)
    return CameraOffset(
        lines=float(moved[0]),
        pixels=float(moved[1]),
        lines_sd=float(spread[0]),
        pixels_sd=float(spread[1]),
        tiles=len(steps),
        likeness=likeness,
    )


def _along(first: Image, second: Image) -> int:
    """Return the whole lines by which the second sees later, at the best correlation of slopes along the travel."""
    count, pixels = first.shape
    parts = np.linspace(0, pixels, min(BINS, pixels) + 1).astype(int)[:-1]
    slopes = [
        np.diff(np.add.reduceat(lines.astype(np.float64), parts, axis=1), axis=0) for lines in (first, second)
    ]
    size = 2 * count
    a, b = (np.fft.rfft(slope - slope.mean(axis=0), size, axis=0) for slope in slopes)
    alike = np.fft.irfft((np.conj(a) * b).sum(axis=1), size)
    lags = np.concatenate([np.arange(count), np.arange(-count, 0)])
    alike[np.abs(lags) > count // 2] = -np.inf
    return int(lags[np.argmax(alike)])


def _across(first: Image, second: Image, along: int) -> int:
    """Return the whole pixels by which the second sees further right."""
    a, b = _overlapping(first, second, along)
    slopes = [np.diff(image, axis=1) for image in (a, b)]
    reach = min(MOST_ACROSS, slopes[0].shape[1] // 4)
    inner = slopes[0][:, reach:-reach]
    alike = [
        float((inner * slopes[1][:, reach + by : reach + by + inner.shape[1]]).sum())
        for by in range(-reach, reach + 1)
    ]
    return int(np.argmax(alike)) - reach


def _overlapping(first: Image, second: Image, along: int) -> tuple[Image, Image]:
    """Return the lines that both saw, the second's ``along`` later."""
    count = len(first) - abs(along)
    return first[max(-along, 0) :][:count], second[max(along, 0) :][:count]


def _steps(
    first: Image, second: Image, moved: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return the further offset of the second by each tile, (tiles, 2) lines and pixels, with weights and correlation.

    One Gauss-Newton step in each tile, for two displacements, a gain and an offset.
    """
    lines, pixels = moved
    height, width = first.shape
    shifted = _shifted(second, lines, pixels)
    top, left = max(int(np.ceil(-lines)), 0) + REACH, max(int(np.ceil(-pixels)), 0) + REACH
    bottom = height - max(int(np.ceil(lines)), 0) - REACH
    right = width - max(int(np.ceil(pixels)), 0) - REACH
    down, right_of = (np.asarray(slope, np.float32) for slope in np.gradient(shifted))
    rows, columns = (bottom - top) // TILE, (right - left) // TILE
    if rows < 1 or columns < 1:
        return np.empty((0, 2)), np.empty((0, 2)), 0.0

    def tiles(image: Image) -> NDArray[np.float64]:
        part = image[top : top + rows * TILE, left : left + columns * TILE].astype(np.float64)
        part = part.reshape(rows, TILE, columns, TILE).transpose(0, 2, 1, 3)
        part = part.reshape(rows * columns, TILE * TILE)
        return np.asarray(part - part.mean(axis=1, keepdims=True))

    a, b, along, across = (tiles(image) for image in (first, shifted, down, right_of))
    rough = max(float(np.median(np.sqrt((along**2).mean(axis=1)))) / 4, 1e-3)
    power = np.stack([(along**2).mean(axis=1), (across**2).mean(axis=1)], axis=1)
    clear = (np.sqrt(power) > EDGE * min(rough, _noise(a - b))).all(axis=1)
    if not clear.any():
        return np.empty((0, 2)), np.empty((0, 2)), 0.0
    a, b, along, across = (part[clear] for part in (a, b, along, across))
    # a = gain (b + step . slope): linear in gain, and in gain times each step.
    basis = np.stack([b, along, across], axis=2)
    normal = np.einsum("tpi,tpj->tij", basis, basis) + 1e-9 * np.eye(3)
    wanted = np.einsum("tpi,tp->ti", basis, a)
    solution = np.linalg.solve(normal, wanted[..., None])[..., 0]
    gain = solution[:, 0]
    left_over = a - np.einsum("tpi,ti->tp", basis, solution)
    usable = np.abs(gain) > 1e-2
    gain = np.where(usable, gain, 1.0)
    steps = solution[:, 1:] / gain[:, None]
    variance = (left_over**2).mean(axis=1)
    inverse = np.linalg.inv(normal)
    sd2 = variance[:, None] * np.stack([inverse[:, 1, 1], inverse[:, 2, 2]], axis=1) / gain[:, None] ** 2
    usable &= np.isfinite(steps).all(axis=1) & (np.abs(steps) < 2).all(axis=1)
    steps, sd2 = steps[usable], sd2[usable]
    if not len(steps):
        return steps, steps, 0.0
    # A tile is no more accurate than a hundredth of a line, since movement within it is not modelled.
    weights = 1 / (sd2 + 1e-4)
    middle = np.median(steps, axis=0)
    scatter = 1.4826 * np.median(np.abs(steps - middle), axis=0) + 1e-3
    near = (np.abs(steps - middle) < 4 * scatter).all(axis=1)
    likeness = float(np.abs((a * b).sum()) / np.sqrt((a**2).sum() * (b**2).sum() + 1e-12))
    return steps[near], weights[near], likeness


def _shifted(image: Image, lines: float, pixels: float) -> Image:
    """Shift the image up and left; its border wraps around."""
    whole = round(lines), round(pixels)
    kernels = []
    for wanted, counted in zip((lines, pixels), whole, strict=True):
        places = np.arange(-REACH, REACH + 1) - (wanted - counted)
        kernel = np.sinc(places) * np.sinc(
            places / (REACH + 1)
        )  # Lanczos: the smoothed image has no higher frequencies
        kernels.append(kernel / kernel.sum())
    rolled = np.roll(image, (-whole[0], -whole[1]), axis=(0, 1))
    return np.asarray(cv2.sepFilter2D(rolled, cv2.CV_32F, kernels[1], kernels[0]), np.float32)


def _noise(left_over: NDArray[np.float64]) -> float:
    """Return the noise of single pixels, from the tiles with the least residual."""
    return float(np.sqrt(np.percentile((left_over**2).mean(axis=1), 10)))
