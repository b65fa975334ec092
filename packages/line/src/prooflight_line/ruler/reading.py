"""Complete measurement of a camera on a ruler page, with the register of its ink planes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from prooflight.cmyk import INK_LETTERS
from prooflight.commissioning.camera.fixed_pattern import Measured
from prooflight.errors import ScanError
from prooflight.inks.ruler_layout import RulerLayout
from prooflight_line.ruler.finding import find_ruler, relative_light
from prooflight_line.ruler.places import bar_places, ruler_scale
from prooflight_line.ruler.slanted_edge import mean_of, ruler_sharpness

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight_line.ruler.places import RulerScale
    from prooflight_line.ruler.slanted_edge import Sharpness

_INSIDE_MM = 2.0
"""Margin left out at the edges of uniform areas."""
_TOP_SHARE = 0.001


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorReading:
    """Measurements of one sensor on the page."""

    scale: RulerScale
    across: tuple[Sharpness, ...]
    along: tuple[Sharpness, ...]
    planes: tuple[PlanePlace, ...]
    place: SensorPlace
    """Position relative to the first sensor."""
    paper_dn: float
    """Mean signal of bare paper over its strips. [DN]"""
    solid_dn: float
    """Signal of solid black. [DN]"""


def read_ruler(lines: NDArray[np.uint16], *, top_code_dn: int, where: str) -> tuple[SensorReading, ...]:
    """Return one reading a sensor of lines (sensors, lines, pixels) [DN] that show a whole ruler page.

    ScanError: there is none, it lies the wrong way, or paper is at the top code. where: the camera, in
    errors.
    """
    ruler = find_ruler(relative_light(lines), where=where)
    readings: list[SensorReading] = []
    for at, image in enumerate(lines):
        name = where if len(lines) == 1 else f"{where}, sensor {at + 1}"
        seen = image.astype(np.float32)
        scale = ruler_scale(seen, ruler, where=name)
        paper, solid = (_strips(seen, scale, solid=black) for black in (False, True))
        if not paper.size or not solid.size:
            what = "sees no strip of paper and black of the ruler page"
            raise ScanError(name, what, remedy="let the whole page pass")
        if (share := float((paper >= top_code_dn).mean())) > _TOP_SHARE:
            what = f"sees paper at its top code, {100 * share:.3g} % of {top_code_dn} DN"
            raise ScanError(name, what, remedy="shorten the exposure, close the lens, or dim the light")
        across, along = ruler_sharpness(seen, scale)
        readings.append(
            SensorReading(
                scale=scale,
                across=across,
                along=along,
                planes=plane_places(_columns_alike(seen, scale), scale),
                place=sensor_place(readings[0].scale if readings else scale, scale),
                paper_dn=float(paper.mean()),
                solid_dn=float(solid.mean()),
            )
        )
    return tuple(readings)


def _columns_alike(image: NDArray[np.float32], scale: RulerScale) -> NDArray[np.float32]:
    """Divide lines (lines, pixels) by each column's paper: PRNU would else move a faint ink's edges."""
    total, count = np.zeros(image.shape[1]), np.zeros(image.shape[1])
    for rows, columns in _places(image, scale, solid=False):
        total[columns] += image[rows, columns].sum(axis=0)
        count[columns] += rows.stop - rows.start
    seen = count > 0
    paper = np.divide(total, count, out=np.ones_like(total), where=seen)
    usual = float(np.median(paper[seen])) if seen.any() else 1.0
    # Beyond the page there is no paper, and where no strip is nothing is known.
    share = np.where(seen & (paper > 0.5 * usual), paper / usual, 1.0)
    return np.asarray(image / share.astype(np.float32))


def _strips(image: NDArray[np.float32], scale: RulerScale, *, solid: bool) -> NDArray[np.float32]:
    """Return the pixels of all uniform areas of a kind, (n,) [DN]."""
    areas = [image[rows, columns].ravel() for rows, columns in _places(image, scale, solid=solid)]
    if not areas:
        return np.empty(0, np.float32)
    pixels = np.concatenate(areas)
    # A strip of the layout that is wider than the page ends on what lies beyond it.
    middle = float(np.median(pixels))
    return pixels[np.abs(pixels - middle) < 0.3 * max(middle, 1.0)]


def _places(image: NDArray[np.float32], scale: RulerScale, *, solid: bool) -> Iterator[tuple[slice, slice]]:
    """Yield lines and columns of each uniform area of a kind that the image shows whole along the travel."""
    for (x, y, width, height), black in RulerLayout.largest().strips():
        if black != solid or x > scale.end_mm[0] or y > scale.end_mm[1]:
            continue
        left, top = scale.at(x + _INSIDE_MM, y + _INSIDE_MM)
        right, bottom = scale.at(x + width - _INSIDE_MM, y + height - _INSIDE_MM)
        rows, columns = slice(round(top), round(bottom)), slice(max(round(left), 0), round(right))
        if rows.start >= 0 and rows.stop <= len(image) and columns.start < image.shape[1]:
            yield rows, columns


# --- register of ink planes, and offsets between sensors that see the same page ---


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
