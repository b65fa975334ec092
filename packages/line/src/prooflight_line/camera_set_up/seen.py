"""Live measurements of a line camera: profile across the line, saturation, black level, light, noise, focus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.errors import ScanError
from prooflight_line.ruler.finding import find_ruler, relative_light
from prooflight_line.ruler.places import ruler_scale
from prooflight_line.ruler.slanted_edge import ruler_sharpness
from prooflight_line.ruler.still_edges import still_sharpness

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.commissioning.camera.fixed_pattern import Measured
    from prooflight_line.ruler.finding import DetectedRuler

BRIGHT_PERCENT: Final = 90.0
"""Percentile of a column's numbers that is taken for paper where print passes: most of most pages is bare."""
SMOOTH_SHARE: Final = 1 / 32
"""Share of the line over which the light is smoothed: lamps and lenses vary slowly."""
HALF_MEAN: Final = 0.4592
"""Mean of the lesser half of |difference| of two Gaussians of deviation 1: 4 sqrt(2) (phi(0) - phi(0.6745))."""
STILL: Final = 2.0
"""Greatest variation of a column over alike lines, in units of its noise from line to line."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorView:
    """Measurements of one sensor's lines."""

    mean_dn: NDArray[np.float64]
    """Mean (pixels,). [DN]"""
    paper_dn: NDArray[np.float64]
    """``BRIGHT_PERCENT``-th percentile (pixels,) of each column. [DN]"""
    saturated: float
    """Share of numbers at the top code. [-]"""
    black_dn: float
    """Darkest hundredth of all numbers: of a covered lens or black print. [DN]"""
    at_zero: float
    """Share of numbers at code 0, where black is clipped. [-]"""
    noise_dn: float
    """Noise from line to line, where nothing changes; median over columns. [DN]"""
    flatness: float
    """Least light over the greatest along the line, smoothed, from the paper's percentile, less black. [-]"""
    darkest_share: float
    """Position along the line where it is least, 0 to 1."""
    focus: Focus | None
    """Sharpness; None: these lines do not show it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Focus:
    """Sharpness of the image."""

    by: str
    """Source of the measurement: a ruler page, or still edges."""
    across: Measured
    """MTF50 across. [cycles/pixel]"""
    along: Measured | None
    """MTF50 along; None: still edges do not give it. [cycles/line]"""
    places: tuple[tuple[float, float], ...] = ()
    """Position along the line, 0 to 1, and MTF50 across there."""
    pixel_mm: float | None = None
    """Width of a pixel on the page; None: no ruler gives it."""
    mtf_across: NDArray[np.float64] | None = None
    """MTF at ``slanted_edge.FREQUENCIES``."""
    mtf_along: NDArray[np.float64] | None = None


def sensor_views(lines: NDArray[np.uint16], *, top_code_dn: int, where: str) -> tuple[SensorView, ...]:
    """Return one view a sensor of lines (sensors, lines, pixels) [DN].

    where: the camera, in errors that are not shown.
    """
    focus = focus_of(lines, where=where)
    return tuple(
        _view(image, top_code_dn=top_code_dn, focus=one) for image, one in zip(lines, focus, strict=True)
    )


def _view(image: NDArray[np.uint16], *, top_code_dn: int, focus: Focus | None) -> SensorView:
    black = float(np.percentile(image[:, ::3], 1))
    paper = np.percentile(image, BRIGHT_PERCENT, axis=0)
    light = smoothed(paper) - black
    middle = light[light.size // 50 : light.size - light.size // 50]
    least = int(np.argmin(middle))
    return SensorView(
        mean_dn=image.mean(axis=0, dtype=np.float64),
        paper_dn=paper,
        saturated=float((image >= top_code_dn).mean()),
        black_dn=black,
        at_zero=float((image == 0).mean()),
        noise_dn=line_noise(image),
        flatness=float(max(middle[least], 0.0) / max(middle.max(), 1e-9)),
        darkest_share=(least + light.size // 50) / light.size,
        focus=focus,
    )


def smoothed(profile: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return a running median over ``SMOOTH_SHARE`` of the line, (pixels,), without dust and single pixels."""
    half = max(round(profile.size * SMOOTH_SHARE / 2), 1)
    padded = np.pad(profile.astype(np.float64), half, mode="reflect")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1))


def line_noise(image: NDArray[np.uint16]) -> float:
    """Return the standard deviation from line to line where nothing changes.

    It is the median of neighbours' differences, over columns.
    """
    if len(image) < 2:
        return 0.0
    step = np.abs(image[1::4].astype(np.int32) - image[:-1:4])
    # Half of all differences of two Gaussians of deviation s lie within 0.954 s; whole codes fill half a code more.
    return float(np.median(np.mean(np.sort(step, axis=0)[: max(len(step) // 2, 1)], axis=0)) / HALF_MEAN)


def focus_of(lines: NDArray[np.uint16], *, where: str) -> tuple[Focus | None, ...]:
    """Measure focus by a ruler page where one is seen, by edges where all lines are alike.

    Return one result a sensor.
    """
    try:
        ruler = find_ruler(relative_light(lines), where=where)
    except ScanError:
        return tuple(_still(image) for image in lines)
    return tuple(_by_ruler(image.astype(np.float32), ruler, where=where) for image in lines)


def _by_ruler(image: NDArray[np.float32], ruler: DetectedRuler, *, where: str) -> Focus | None:
    try:
        scale = ruler_scale(image, ruler, where=where)
    except ScanError:
        return None
    across, along = ruler_sharpness(image, scale)
    if not across or not along:
        return None
    y = scale.middle_mm[1]
    return Focus(
        by="ruler page",
        across=_mean([one.mtf50 for one in across]),
        along=_mean([one.mtf50 for one in along]),
        places=tuple((scale.at(one.x_mm, y)[0] / image.shape[1], one.mtf50.value) for one in across),
        pixel_mm=scale.pixel_mm.value,
        mtf_across=np.mean([one.mtf for one in across], axis=0),
        mtf_along=np.mean([one.mtf for one in along], axis=0),
    )


def _mean(places: list[Measured]) -> Measured:
    """Return the mean of places, each counted alike: focus may differ between them."""
    error = float(np.sqrt(np.sum([one.standard_error**2 for one in places])) / len(places))
    return type(places[0])(value=float(np.mean([one.value for one in places])), standard_error=error)


def _still(image: NDArray[np.uint16]) -> Focus | None:
    if len(image) < 8:
        return None
    spread = np.median(image.astype(np.float32).std(axis=0))
    if spread > STILL * max(line_noise(image), 0.5):
        return None
    across = still_sharpness(image.mean(axis=0, dtype=np.float64))
    return None if across is None else Focus(by="still edges", across=across, along=None)
