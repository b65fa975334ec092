"""Light of a page's raster, looked up once for all placements at which the page is predicted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Self

import cv2
import numpy as np

from prooflight.cmyk import INKS
from prooflight.kernels.memory import unset
from prooflight.kernels.prediction.grouped import find_changes, lookup_groups
from prooflight.kernels.prediction.moving import BEYOND
from prooflight.kernels.prediction.summing import GROUP
from prooflight.prediction.printed import PrintedPage
from prooflight.prediction.quantised_table import quantised_table
from prooflight.prediction.tables import shot_slope

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.pages.sampling import Footprint
    from prooflight.prediction.tables import SensorModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlatGroups:
    """Groups of a raster's columns around which one recipe is printed, so that displaced planes do not show."""

    flat: NDArray[np.bool_]
    """(rows, whole groups)."""
    reach: int
    """Distance from a group's pixels up to which all have its recipe. [raster pixels]"""

    @classmethod
    def of(cls, page: Page, reach: int) -> Self:
        """Return those of a page; reach: at least 1."""
        rows, columns = page.cmyk.shape[:2]
        changes = np.empty((rows + 1, columns // GROUP), np.bool_)
        find_changes(page.packed, reach, changes)
        near = cv2.dilate(changes.view(np.uint8), np.ones((2 * reach + 1, 1), np.uint8))[:rows]
        return cls(flat=near == 0, reach=reach)

    def of_planes(self, planes: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return the groups at which planes (4, 2) that are so displaced do not show."""
        return self.flat if np.abs(planes).max() <= self.reach else np.zeros_like(self.flat)


class FilteredTable(NamedTuple):
    """Table of a sensor that prediction looks up and filters."""

    sensor: int
    of_variance: bool
    table: NDArray[np.float32]
    backing: float


def filtered_tables(sensors: Sequence[SensorModel]) -> list[FilteredTable]:
    """Return the means of all sensors, and the variances that do not follow from them."""
    tables = []
    for index, sensor in enumerate(sensors):
        tables.append(FilteredTable(index, False, sensor.mean_dn, sensor.backing_dn))
        if shot_slope(sensor) == 0:
            tables.append(FilteredTable(index, True, sensor.variance_dn2, sensor.backing_variance_dn2))
    return tables


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RasterLight:
    """Light of a raster above the backing's, in groups of columns."""

    columns: int
    beyond: int
    """Number of rows before and after the page's in ``starts``."""
    starts: NDArray[np.int32]
    """Place in ``values`` at which each group begins, (rows, groups)."""
    values: NDArray[np.float32]
    """Light of each of ``filtered_tables``, (tables, any). [the table's units]"""


def raster_light(
    page: Page | PrintedPage,
    *,
    sensors: Sequence[SensorModel],
    flat: FlatGroups | None = None,
) -> RasterLight:
    """Look up the light of a page's raster, as designed or with its planes displaced.

    flat: of the page as designed; None: every group is looked up that differs from the one above.
    """
    if isinstance(page, PrintedPage):
        raster, planes = page.page, page.planes
    else:
        raster, planes = page, np.zeros((INKS, 2), np.int64)
    rows, columns = raster.cmyk.shape[:2]
    groups, whole = -(-columns // GROUP), columns // GROUP
    beyond = max(_rows_beyond(sensor.footprint, raster.pixel_mm) for sensor in sensors)
    tables = filtered_tables(sensors)
    starts = unset((rows + 2 * beyond, groups)).view(np.int32)
    starts[:beyond] = starts[beyond + rows :] = 0
    values = unset((len(tables), GROUP * (1 + rows * groups)))
    values[:, :GROUP] = 0
    # One thread alone: at borders between bands, rounding would depend on the number of threads.
    lookup_groups(
        raster.packed,
        np.zeros((rows, whole), np.bool_) if flat is None else flat.of_planes(planes),
        planes,
        tuple(quantised_table(one.table) for one in tables),
        np.array([one.backing for one in tables], np.float32),
        starts[beyond : beyond + rows],
        values,
    )
    return RasterLight(columns=columns, beyond=beyond, starts=starts, values=values)


def _rows_beyond(footprint: Footprint, pixel_mm: float) -> int:
    """Return the number of rows beyond a page that a line with this footprint may see."""
    return math.ceil((footprint.along.size - 1) / footprint.steps_in(pixel_mm)) + 2 + BEYOND
