"""Register of ink planes on a ruler page, and offsets between sensors that see the same page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from prooflight.cmyk import INK_LETTERS
from prooflight.commissioning.camera.fixed_pattern import Measured
from prooflight.inks.ruler_layout import RulerLayout
from prooflight_line.ruler.places import bar_places
from prooflight_line.ruler.slanted_edge import mean_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight_line.ruler.places import RulerScale


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanePlace:
    """Register of an ink's plane relative to black's, on the page."""

    ink: str
    across_mm: Measured
    """Displacement to the right."""
    along_mm: Measured
    """Displacement downwards."""
    crosses: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorPlace:
    """Position of a sensor relative to the first one, in the middle of the page."""

    lines: Measured
    """Number of lines by which it sees a place of the page later: of a trilinear camera, the distance of its lines."""
    pixels: Measured
    """Number of pixels by which it sees a place of the page further right."""
    turn_deg: float
    """Rotation clockwise from the first."""
    size: float
    """Size of its pixels on the page over the first's. [-]"""


def plane_places(image: NDArray[np.floating], scale: RulerScale) -> tuple[PlanePlace, ...]:
    """Measure the planes of cyan, magenta and yellow in one sensor's image (lines, pixels); unseen ones are left out.

    They are measured by the middles of crosses' arms, relative to the places that combs give, less the offset
    of black's crosses.
    """
    right, bottom = scale.end_mm
    crosses = [
        pair
        for pair in RulerLayout.largest().crosses()
        if pair[1].box[0] <= right and pair[0].box[1] <= bottom
    ]
    off: dict[str, tuple[list[float], list[float]]] = {}
    for letter in INK_LETTERS:
        arms = [[pair[way] for pair in crosses if pair[0].ink == letter] for way in range(2)]
        upright, lying = (bar_places(image, scale.to_pixel, some) for some in arms)
        across = upright.at - _expected(scale, upright.x_mm, upright.y_mm)[0]
        along = lying.at - _expected(scale, lying.x_mm, lying.y_mm)[1]
        off[letter] = (
            (across * scale.pixel_mm.value).tolist(),
            (along * scale.line_mm.value).tolist(),
        )
    black = [mean_of(values) if len(values) > 1 else None for values in off["K"]]
    planes = []
    for letter in INK_LETTERS.replace("K", ""):
        across_mm, along_mm = off[letter]
        if min(len(across_mm), len(along_mm)) < 2 or black[0] is None or black[1] is None:
            continue
        planes.append(
            PlanePlace(
                ink=letter,
                across_mm=_less(mean_of(across_mm), black[0]),
                along_mm=_less(mean_of(along_mm), black[1]),
                crosses=min(len(across_mm), len(along_mm)),
            )
        )
    return tuple(planes)


def sensor_place(first: RulerScale, other: RulerScale) -> SensorPlace:
    """Return a sensor's position relative to the first; both saw the same ruler page in the same count of lines.

    It serves for one camera's colour lines, and for two cameras whose lines are counted together.
    """
    middle = first.middle_mm
    column, line = np.subtract(other.at(*middle), first.at(*middle))
    return SensorPlace(
        lines=Measured(value=float(line), standard_error=_middle_error(first, other, 1)),
        pixels=Measured(value=float(column), standard_error=_middle_error(first, other, 0)),
        turn_deg=other.skew_deg.value - first.skew_deg.value,
        size=other.pixel_mm.value / first.pixel_mm.value,
    )


def _middle_error(first: RulerScale, other: RulerScale, axis: int) -> float:
    """Return the standard error of a mean of all bars of both."""
    return float(np.hypot(*(one.residual_px[axis] / np.sqrt(one.bars[axis]) for one in (first, other))))


def _expected(scale: RulerScale, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(scale.to_pixel @ np.stack([x_mm, y_mm, np.ones(x_mm.size)]))


def _less(one: Measured, other: Measured) -> Measured:
    return Measured(
        value=one.value - other.value,
        standard_error=float(np.hypot(one.standard_error, other.standard_error)),
    )
