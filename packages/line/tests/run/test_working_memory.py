"""Memory beyond the page's own buffers: bands, not pages."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.inspection.inspector import Inspector
from prooflight.prediction.predict import predict
from prooflight.scans.placement import Placement
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

FIXED_BYTES = 6e6
A_PIXEL_BYTES = 1.4
"""64 MB for 41 megapixels, seven times A4 at 240 dpi; one temporary of a whole page in single precision takes 4."""
PREDICTION_BYTES = 8
MOVED = Placement(shift_mm=(0.3, -0.2), skew_deg=0.05)


def peak_bytes(work: Callable[[], object]) -> float:
    work()
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("times", [1, 24])
def test_no_temporary_is_as_large_as_a_page(press: Press, page: Page, times: int) -> None:
    tall = replace(page, cmyk=np.concatenate([page.cmyk] * times))
    sensors, geometry = press.sensors, press.geometry
    there = predict(tall, sensors=sensors, geometry=geometry, placement=MOVED, threads=1)
    scan = ideal_scan(there, press, np.random.default_rng(1))
    buffers, room = PREDICTION_BYTES * scan.size, FIXED_BYTES + A_PIXEL_BYTES * scan.size
    assert peak_bytes(lambda: predict(tall, sensors=sensors, geometry=geometry)) < buffers + room
    inspector = Inspector.of(press, "chi-square")
    prepared = inspector.prepare(tall)
    # The page lies off its place: it is predicted again.
    assert peak_bytes(lambda: inspector.inspect(prepared, scan, scan_name="tall")) < buffers + room
