"""Prediction of a scan from a page's raster: expected lines and their variance."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from prooflight.cmyk import INKS
from prooflight.kernels.prediction.lines import (
    ColumnLevels,
    filter_lines,
    relight,
    to_columns,
)
from prooflight.kernels.prediction.lookup import AT_ONCE, lookup_light
from prooflight.kernels.prediction.moving import filter_moved_lines
from prooflight.pages.parallel import shared_out, threads_now
from prooflight.prediction.lens_correction import correct_light
from prooflight.prediction.printed import PrintedPage
from prooflight.prediction.quantised_table import quantised_table
from prooflight.prediction.raster_light import filtered_tables, raster_light
from prooflight.prediction.sampling_grid import sampling_grid
from prooflight.prediction.tables import shot_slope
from prooflight.scans.placement import IN_PLACE

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.pages.sampling import Footprint
    from prooflight.prediction.raster_light import RasterLight
    from prooflight.prediction.sampling_grid import SamplingGrid
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.placement import Placement

BANDS_A_WORKER = 3
"""Number of bands a worker: few, since each begins with rows that its neighbour filters too, but more than
one, since a worker may be delayed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """Expected good scan of one page."""

    expected_dn: NDArray[np.float32]
    """Expected values, unrounded, (sensors, lines, pixels). [DN]"""
    variance_dn2: NDArray[np.float32]
    """Temporal variance, the 1/12 DN^2 of rounding included, (sensors, lines, pixels). [DN^2]"""


def predict(
    page: Page | PrintedPage,
    *,
    sensors: Sequence[SensorModel],
    geometry: ScanGeometry,
    placement: Placement = IN_PLACE,
    raster: RasterLight | None = None,
    threads: int | None = None,
) -> Prediction:
    """Predict all lines of a page at ``placement``, as designed or with its planes displaced.

    The raster is looked up at its own resolution (a pixel at a letter's edge is the mean of two signals, not
    the signal of half-strength ink), then filtered and area-sampled at the camera's pixels: the raster rows that
    a line sees along, then their sums across. (A page that is only shifted is filtered across first.) The footprint
    moves with the page and is sheared by its turn, but not stretched by its stretch. Displacements are linear between
    nodes (``sampling_grid``).

    raster: light of the page's raster, for one that is predicted at several placements; None: it is looked up.
    threads: number of bands of lines that run at once; by default one a core.
    """
    design = page.page if isinstance(page, PrintedPage) else page
    shape = (len(sensors), geometry.lines(design.height_mm), geometry.pixels)
    workers = threads or os.cpu_count() or 1
    light, spread = np.empty(shape, np.float32), np.empty(shape, np.float32)
    where = sampling_grid(design, geometry, placement, along_first=not placement.is_shift)
    tables = filtered_tables(sensors)
    filtered = [(sensors[one.sensor], (spread if one.of_variance else light)[one.sensor]) for one in tables]
    if where.still:
        still = raster_and_planes(page, placement)[0]
        works = [
            _filtering_still(still, sensor.footprint, where, [one.table], [one.backing], [out])
            for one, (sensor, out) in zip(tables, filtered, strict=True)
        ]
    else:
        raster = raster or raster_light(page, sensors=sensors)
        where = replace(where, along=where.along.of_groups())
        works = [
            _filtering(raster, values, where, sensor.footprint, design.pixel_mm, out)
            for values, (sensor, out) in zip(raster.values, filtered, strict=True)
        ]
    _in_bands(workers, shape[1], works)
    for sensor, out in filtered:
        correct_light(out, sensor.correction, threads=workers)
    levels = [
        partial(to_columns, levels_of(sensor), mean=mean, variance=variance)
        for sensor, mean, variance in zip(sensors, light, spread, strict=True)
    ]
    _in_bands(workers, shape[1], levels)
    return Prediction(expected_dn=light, variance_dn2=spread)


def raster_and_planes(page: Page | PrintedPage, placement: Placement) -> tuple[Page, NDArray[np.int64]]:
    """Return a raster and its planes (4, 2) as in ``PrintedPage``.

    A page that is only shifted is composed as a whole, any other row by row.
    """
    if isinstance(page, PrintedPage):
        if not placement.is_shift:
            return page.page, page.planes
        page = page.composed()
    return page, np.zeros((INKS, 2), np.int64)


def predict_light(
    page: Page,
    footprint: Footprint,
    tables: Sequence[NDArray[np.float32]],
    out: Sequence[NDArray[np.float32]],
    *,
    geometry: ScanGeometry,
    sign: int = 1,
) -> None:
    """Predict the signals of bare columns, without a lens's far light, of a page at its nominal place.

    Each of ``tables`` over CMYK gives one (lines, pixels) of ``out`` [the table's units], at least 0, times
    ``sign``. Beyond the page the signal is 0.
    """
    if not tables:
        return
    where = sampling_grid(page, geometry, IN_PLACE)
    seen = _filtering_still(page, footprint, where, tables, [0.0] * len(tables), out, sign=sign)
    seen(line_from=0, line_to=len(out[0]))


def relit(
    prediction: Prediction, sensors: Sequence[SensorModel], now: Sequence[SensorModel]
) -> Prediction | None:
    """Return a prediction by ``sensors`` for other column gains; None if it has to be computed again."""
    expected = np.empty_like(prediction.expected_dn)
    variance = np.empty_like(prediction.variance_dn2)
    for index, (sensor, changed) in enumerate(zip(sensors, now, strict=True)):
        is_relit = relight(
            sensor.column_offset_dn,
            changed.column_gain / sensor.column_gain,
            np.float32(sensor.dark_variance_dn2),
            np.float32(sensor.top_code_dn),
            prediction.expected_dn[index],
            prediction.variance_dn2[index],
            expected[index],
            variance[index],
        )
        if not is_relit:
            return None
    return Prediction(expected_dn=expected, variance_dn2=variance)


def cut(prediction: Prediction, area: tuple[slice, slice]) -> Prediction:
    """Cut a prediction to some lines and columns."""
    part = (slice(None), *area)
    return Prediction(expected_dn=prediction.expected_dn[part], variance_dn2=prediction.variance_dn2[part])


def expected_light(
    cmyk: NDArray[np.uint8], sensor: SensorModel
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return mean and variance of recipes (n, 4) as prediction looks them up, (n,) each [DN, DN^2], column gain 1."""
    packed = np.zeros(-(-max(len(cmyk), 1) // AT_ONCE) * AT_ONCE, np.uint32)
    packed[: len(cmyk)] = np.ascontiguousarray(cmyk).view(np.uint32)[:, 0]
    mean, variance = np.empty((2, packed.size), np.float32)
    lookup_light(packed, quantised_table(sensor.mean_dn), np.float32(0), mean)
    slope = shot_slope(sensor)
    if slope > 0:
        variance = (sensor.backing_variance_dn2 + slope * (mean - sensor.backing_dn)).astype(np.float32)
    else:
        lookup_light(packed, quantised_table(sensor.variance_dn2), np.float32(0), variance)
    return mean[: len(cmyk)], variance[: len(cmyk)]


def levels_of(sensor: SensorModel) -> ColumnLevels:
    """Return a sensor's column parameters as kernels take them."""
    return ColumnLevels(
        column_offset=sensor.column_offset_dn,
        column_gain=sensor.column_gain,
        backing=np.float32(sensor.backing_dn),
        backing_variance=np.float32(sensor.backing_variance_dn2),
        dark_variance=np.float32(sensor.dark_variance_dn2),
        shot_slope=np.float32(shot_slope(sensor)),
        top_code=np.float32(sensor.top_code_dn),
    )


def _in_bands(workers: int, lines: int, works: Sequence[Callable[..., None]]) -> None:
    """Run ``works`` on all lines, in bands on all workers; adjacent bands filter some of the same rows."""
    workers = threads_now(workers)
    band = lines if workers == 1 else -(-lines // (BANDS_A_WORKER * workers))
    tasks = [
        partial(work, line_from=start, line_to=min(start + band, lines))
        for work in works
        for start in range(0, lines, band)
    ]
    shared_out(tasks, threads=workers)


def _filtering(
    raster: RasterLight,
    values: NDArray[np.float32],
    where: SamplingGrid,
    footprint: Footprint,
    pixel_mm: float,
    light: NDArray[np.float32],
) -> Callable[..., None]:
    """Return the filtering kernel with all arguments but the range of lines; values: of one table."""
    return partial(
        filter_moved_lines,
        values,
        raster.starts,
        raster.beyond,
        raster.columns,
        *where.passes(footprint, pixel_mm),
        where.phase_bits,
        light=light,
    )


def _filtering_still(
    page: Page,
    footprint: Footprint,
    where: SamplingGrid,
    tables: Sequence[NDArray[np.float32]],
    backings: Sequence[float],
    lights: Sequence[NDArray[np.float32]],
    *,
    sign: int = 0,
) -> Callable[..., None]:
    """Return the same for a page that is only shifted, for several tables at once."""
    return partial(
        filter_lines,
        page.packed,
        tuple(quantised_table(table) for table in tables),
        np.array(backings, np.float32),
        where.stride,
        *where.passes(footprint, page.pixel_mm),
        np.float32(sign),
        lights=tuple(lights),
    )
