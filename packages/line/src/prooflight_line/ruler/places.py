"""Exact position of a ruler page in a scan: pitches, skew and distortion, from the middles of bars.

The edge of a bar lies where a step between the levels on its two sides would have the area that the pixels
show. That is exact however blurred the edge is, since the light of a pixel is a mean over it: neighbouring
pixels add up to the whole. The middle between a bar's two edges then depends neither on blur nor on how fat
it is printed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.camera.fixed_pattern import Measured
from prooflight.errors import ScanError
from prooflight.inks.ruler_layout import BAR_MM, GROUP_MM, MARGIN_MM, PERIOD_MM, RulerLayout

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.inks.ruler_layout import Bar
    from prooflight_line.ruler.finding import DetectedRuler

LEAST_CONTRAST: Final = 0.05
"""Least contrast of a bar, as a share of paper's light; this sensor does not see a fainter one."""
FEWEST_BARS: Final = 6
"""Least number of bars each way."""
FEWEST_PIXELS: Final = 4.0
"""Least width of a bar in pixels: its middle must show its own level."""
_INNER: Final = 0.8
"""Share of a bar's length that is read."""
_OUTLIER: Final = 5.0
_LEAST_SPREAD_MM: Final = 30.0
"""Least spread of bars perpendicular to their normal that gives the page's rotation."""
_FIRST_MM: Final = 16.0
"""Distance beyond the markers within which bars are read first.

The result locates those that lie twice as far.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BarPlaces:
    """Middles of bars of one kind, each along its own normal."""

    x_mm: NDArray[np.float64]
    """Place (bars,) on the page."""
    y_mm: NDArray[np.float64]
    at: NDArray[np.float64]
    """Column (bars,) of upright bars, line of others. [pixels]"""
    width: NDArray[np.float64]
    """Width (bars,) from edge to edge. [pixels]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RulerScale:
    """Geometry of one sensor's pixels, measured on a ruler page."""

    to_pixel: NDArray[np.float64]
    """Affine map (2, 3) from (x, y, 1) on the page [mm] to (column, line) [pixels], whole numbers at pixel centres."""
    pixel_mm: Measured
    """Distance between neighbouring columns, in the page's own millimetres.

    The standard error is that of the marks alone.
    """
    line_mm: Measured
    skew_deg: Measured
    """Clockwise rotation of the page as seen. [degree]"""
    shear_deg: float
    """Deviation of columns and lines from a right angle: the camera stands askew to the travel. [degree]"""
    bent_across_mm: float
    """Greatest smoothed distance of a mark's place from the straight ruler: the lens distorts."""
    bent_along_mm: float
    """Greatest smoothed distance along the travel: the encoder or the paper's speed wanders."""
    residual_px: tuple[float, float]
    """Rms distance of single bars from the map. [columns, lines]"""
    bars: tuple[int, int]
    """Number of bars that were read, upright and others."""
    middle_mm: tuple[float, float]
    """Mean place of the bars on the page: upright ones' across, others' along."""
    end_mm: tuple[float, float]
    """Right and bottom of the area that may be read: see ``DetectedRuler``."""

    def at(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Return column and line of a place of the page."""
        column, line = self.to_pixel @ (x_mm, y_mm, 1.0)
        return float(column), float(line)


def ruler_scale(image: NDArray[np.floating], ruler: DetectedRuler, *, where: str) -> RulerScale:
    """Measure the exact position by all combs in one sensor's image (lines, pixels) [DN]; where: the camera, in errors.

    ScanError: too few of their bars are seen, or pixels are too coarse for them.
    """
    if max(ruler.pitch_mm) > BAR_MM / FEWEST_PIXELS:
        what = f"sees {max(ruler.pitch_mm):.2g} mm a pixel or line"
        raise ScanError(where, what, remedy=f"a ruler page is for up to {BAR_MM / FEWEST_PIXELS:g} mm")
    bars = [bar for bar in RulerLayout.largest().bars() if _on_page(bar, ruler)]
    to_pixel, beyond_mm = ruler.to_pixel, _FIRST_MM
    extent_mm = float(np.hypot(image.shape[1] * ruler.pitch_mm[0], image.shape[0] * ruler.pitch_mm[1]))
    while True:
        near = [bar for bar in bars if _beyond(bar, ruler) <= beyond_mm]
        upright = bar_places(image, to_pixel, [bar for bar in near if bar.upright])
        lying = bar_places(image, to_pixel, [bar for bar in near if not bar.upright])
        for name, some in (("upright", upright), ("lying", lying)):
            if some.at.size < FEWEST_BARS:
                what = f"sees {some.at.size} {name} bars of the ruler page"
                raise ScanError(
                    where, what, remedy="let the whole page pass, with even light and without saturation"
                )
        across, along = _planes(upright, lying, to_pixel)
        to_pixel = np.stack([across.slopes, along.slopes])
        if beyond_mm > extent_mm:
            break
        beyond_mm *= 2
    back = np.linalg.inv(to_pixel[:, :2])
    pixel_mm, line_mm = float(np.hypot(*back[:, 0])), float(np.hypot(*back[:, 1]))
    right = np.rad2deg(np.arctan2(back[1, 0], back[0, 0]))
    down = np.rad2deg(np.arctan2(-back[0, 1], back[1, 1]))
    return RulerScale(
        to_pixel=to_pixel,
        pixel_mm=Measured(value=pixel_mm, standard_error=across.errors[0] * pixel_mm**2),
        line_mm=Measured(value=line_mm, standard_error=along.errors[1] * line_mm**2),
        skew_deg=Measured(
            value=-float(right + down) / 2,
            standard_error=float(np.rad2deg(np.hypot(across.errors[1] * pixel_mm, along.errors[0] * line_mm)))
            / 2,
        ),
        shear_deg=float(right - down),
        bent_across_mm=pixel_mm * _bend(upright.x_mm, across),
        bent_along_mm=line_mm * _bend(lying.y_mm, along),
        residual_px=(across.rms, along.rms),
        bars=(upright.at.size, lying.at.size),
        middle_mm=(float(upright.x_mm.mean()), float(lying.y_mm.mean())),
        end_mm=ruler.end_mm,
    )


def _on_page(bar: Bar, ruler: DetectedRuler) -> bool:
    """Return whether a bar is of the page whose markers were detected, and not of the next one."""
    x, y, width, height = bar.box
    right, bottom = ruler.end_mm
    top = ruler.groups[0] * GROUP_MM + MARGIN_MM
    return x + width <= right + 1e-6 and top - 1e-6 <= y and y + height <= bottom + 1e-6


def _beyond(bar: Bar, ruler: DetectedRuler) -> float:
    """Return the distance of a bar outside the detected markers. [mm]"""
    x, y, width, height = bar.box
    left, top, right, bottom = ruler.box_mm
    return max(left - (x + width / 2), x + width / 2 - right, top - (y + height / 2), y + height / 2 - bottom)


def bar_places(image: NDArray[np.floating], to_pixel: NDArray[np.float64], bars: list[Bar]) -> BarPlaces:
    """Measure the middles of the bars that image (lines, pixels) shows whole and with contrast.

    to_pixel: map that gives their places to half a bar.
    """
    read = [(bar, place) for bar in bars if (place := _middle(image, to_pixel, bar)) is not None]
    middles = [(bar.box[0] + bar.box[2] / 2, bar.box[1] + bar.box[3] / 2) for bar, _ in read]
    x, y = np.array(middles).reshape(-1, 2).T
    at, width = np.array([place for _, place in read]).reshape(-1, 2).T
    return BarPlaces(x_mm=x, y_mm=y, at=at, width=width)


def _middle(
    image: NDArray[np.floating], to_pixel: NDArray[np.float64], bar: Bar
) -> tuple[float, float] | None:
    """Return the place of a bar's middle along its normal, and its width [pixels]; None: it is not seen."""
    x, y, width, height = bar.box
    column, line = to_pixel @ (x + width / 2, y + height / 2, 1.0)
    scale = np.abs(np.diag(to_pixel[:, :2]))  # pixels a millimetre, columns and lines
    seen = image if bar.upright else image.T
    centre, transverse = (column, line) if bar.upright else (line, column)
    per_mm, per_mm_transverse = scale if bar.upright else scale[::-1]
    half = _INNER * max(width, height) / 2 * per_mm_transverse
    rows = slice(round(transverse - half), round(transverse + half) + 1)
    reach = 1.25 * BAR_MM * per_mm
    first, end = round(centre - reach), round(centre + reach) + 1
    if rows.start < 0 or first < 0 or rows.stop > len(seen) or end > seen.shape[1]:
        return None
    profile = seen[rows, first:end].mean(axis=0, dtype=np.float64)
    offset = (np.arange(first, end) - centre) / per_mm  # from the bar's middle [mm]
    quarter = BAR_MM / 4
    dark = float(np.median(profile[np.abs(offset) <= quarter]))
    edges = []
    for side in (-1, 1):
        paper = profile[np.abs(offset - side * BAR_MM) <= quarter]
        if not paper.size:
            return None
        white = float(np.median(paper))
        if white - dark < LEAST_CONTRAST * abs(white):
            return None
        level = (profile - dark) / (white - dark)
        between = (offset * side >= -1e-9) & (offset * side <= BAR_MM)
        area = float(level[between].sum())
        outer = np.flatnonzero(between)[-1 if side > 0 else 0] + first
        edges.append(outer + side * (0.5 - area))
    return (edges[0] + edges[1]) / 2, edges[1] - edges[0]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Plane:
    """Fitted plane: place = slopes . (x, y, 1)."""

    slopes: NDArray[np.float64]
    errors: NDArray[np.float64]
    """Standard errors (3,); 0 for slopes that were not free."""
    residual: NDArray[np.float64]
    """Residuals (bars,). [pixels]"""
    inliers: NDArray[np.bool_]
    """Bars that are no outliers, such as under a speck or a fold."""
    rms: float


def _planes(upright: BarPlaces, lying: BarPlaces, before: NDArray[np.float64]) -> tuple[_Plane, _Plane]:
    """Fit columns by upright bars, lines by the others.

    Bars in one row or column do not give the page's rotation: it is then the other kind's, at right angles,
    or the one before.
    """
    across = _plane(upright, upright.y_mm, 1, before[0, 1])
    along = _plane(lying, lying.x_mm, 0, before[1, 0])
    ratio = along.slopes[1] / across.slopes[0]
    if across.errors[1] == 0 and along.errors[0] > 0:
        across = _plane(upright, upright.y_mm, 1, -along.slopes[0] / ratio)
    elif along.errors[0] == 0 and across.errors[1] > 0:
        along = _plane(lying, lying.x_mm, 0, -across.slopes[1] * ratio)
    return across, along


def _plane(bars: BarPlaces, transverse_mm: NDArray[np.float64], fixed: int, slope: float) -> _Plane:
    """Fit a plane by least squares.

    beside_mm: places of bars perpendicular to their normal; where those hardly vary, the slope of axis
    ``fixed`` is as given.
    """
    design = np.column_stack([bars.x_mm, bars.y_mm, np.ones(bars.at.size)])
    free = np.ones(3, bool)
    free[fixed] = np.ptp(transverse_mm) >= _LEAST_SPREAD_MM
    wanted = bars.at - (0.0 if free[fixed] else slope * design[:, fixed])
    inliers = np.ones(bars.at.size, bool)
    slopes, errors = np.zeros(3), np.zeros(3)
    slopes[fixed] = slope
    for _ in range(3):
        slopes[free] = np.linalg.lstsq(design[inliers][:, free], wanted[inliers], rcond=None)[0]
        residual = bars.at - design @ slopes
        spread = 1.4826 * float(np.median(np.abs(residual[inliers] - np.median(residual[inliers])))) + 1e-3
        inliers = np.abs(residual) < _OUTLIER * spread
    part = design[inliers][:, free]
    rms = float(np.sqrt(np.square(residual[inliers]).sum() / max(len(part) - part.shape[1], 1)))
    errors[free] = rms * np.sqrt(np.diag(np.linalg.pinv(part.T @ part)))
    return _Plane(slopes=slopes, errors=errors, residual=residual, inliers=inliers, rms=rms)


def _bend(place_mm: NDArray[np.float64], plane: _Plane) -> float:
    """Return the greatest departure of a smooth curve through residuals [pixels].

    0 where it is within two of its errors.
    """
    place_mm, residual = place_mm[plane.inliers], plane.residual[plane.inliers]
    extent = np.ptp(place_mm)
    if extent < 4 * PERIOD_MM or place_mm.size < 12:
        return 0.0
    design = np.polynomial.legendre.legvander((place_mm - place_mm.min()) / extent * 2 - 1, 3)
    solution = np.linalg.lstsq(design, residual, rcond=None)[0]
    curve = design @ solution
    left = float(np.std(residual - curve, ddof=min(4, residual.size - 1)))
    error = left * np.sqrt(np.einsum("ij,jk,ik->i", design, np.linalg.pinv(design.T @ design), design))
    worst = int(np.argmax(np.abs(curve)))
    return float(abs(curve[worst])) if abs(curve[worst]) > 2 * error[worst] else 0.0
