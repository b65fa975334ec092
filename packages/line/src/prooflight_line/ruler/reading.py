"""Complete measurement of a camera on a ruler page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from prooflight.errors import ScanError
from prooflight.inks.ruler_layout import RulerLayout
from prooflight_line.ruler.finding import find_ruler, relative_light
from prooflight_line.ruler.places import ruler_scale
from prooflight_line.ruler.planes import plane_places, sensor_place
from prooflight_line.ruler.slanted_edge import ruler_sharpness

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight_line.ruler.places import RulerScale
    from prooflight_line.ruler.planes import PlanePlace, SensorPlace
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
