"""A page's raster -> the lines the camera must see, and how sure that is."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from prooflight.pages.sampling import page_taps
from prooflight.predicting.kernels import predict_lines

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.acquiring.geometry import ScanGeometry
    from prooflight.pages.raster import Page
    from prooflight.predicting.tables import SensorModel

LINES_PER_BAND = 128


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """What a good scan of one page must show."""

    expected_dn: NDArray[np.float32]
    """(sensors, lines, pixels), unrounded. [DN]"""
    variance_dn2: NDArray[np.float32]
    """(sensors, lines, pixels), temporal, the 1/12 DN^2 of rounding included. [DN^2]"""


def predict(
    page: Page,
    *,
    sensors: Sequence[SensorModel],
    geometry: ScanGeometry,
    shift_mm: tuple[float, float] = (0.0, 0.0),
    threads: int | None = None,
) -> Prediction:
    """Expected lines of a whole page.

    The raster is looked up at its own resolution (a pixel at a letter's edge is the mean of two signals, not the signal
    of half-strength ink), then filtered and area-sampled at the camera's pixels. shift_mm (x, y): where the page lies
    minus where it should. threads: bands of lines run at once, default one a core.
    """
    lines = geometry.lines(page.height_mm)
    expected = np.empty((len(sensors), lines, geometry.pixels), np.float32)
    variance = np.empty_like(expected)
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        for sensor, mean_out, variance_out in zip(sensors, expected, variance, strict=True):
            across, along = page_taps(
                sensor.footprint,
                centres_x_mm=geometry.centres_x_mm(page.width_mm, shift_mm=shift_mm[0]),
                centres_y_mm=geometry.centres_y_mm(lines, shift_mm=shift_mm[1]),
                raster_pixel_mm=page.pixel_mm,
                raster_shape=page.cmyk.shape,
            )
            of_sensor = partial(
                predict_lines,
                page.cmyk,
                sensor.interleaved(),
                across.first,
                across.weights,
                along.first,
                along.weights,
                np.float32(sensor.backing_dn),
                np.float32(sensor.backing_variance_dn2),
                sensor.column_offset_dn,
                sensor.column_gain,
                np.float32(sensor.dark_variance_dn2),
                np.float32(sensor.top_code_dn),
                expected=mean_out,
                variance=variance_out,
            )
            starts = range(0, lines, LINES_PER_BAND)
            bands = [
                pool.submit(of_sensor, line_from=start, line_to=min(start + LINES_PER_BAND, lines))
                for start in starts
            ]
            for done in bands:
                done.result()
    return Prediction(expected_dn=expected, variance_dn2=variance)
