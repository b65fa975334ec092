"""How fast pages are predicted and compared, as ratios to peers measured in the same run."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from prooflight.comparing.error_map import normalised_error
from prooflight.comparing.evidence import gather
from prooflight.pages.raster import Page
from prooflight.predicting.predict import predict
from prooflight.predicting.tables import NODE_STEP
from prooflight.simulating.scans import ideal_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.predicting.predict import Prediction
    from prooflight.press import Press

REPEATS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedRow:
    """One timed step."""

    name: str
    mpx_per_cpu_s: float
    """Camera megapixels a second of processor time, one core, best of the repeats."""
    ratio: float
    """Over the peer of its group: numpy or scipy doing the same."""


def bench_pages(press: Press, *, quick: bool) -> dict[str, Page]:
    """A page of bars like text and a page of noise like a photograph, at the press's resolution."""
    side_mm = 40.0 if quick else 120.0
    side = round(side_mm / (press.geometry.pixel_pitch_mm / press.supersampling))
    rng = np.random.default_rng(1)
    text = np.zeros((side, side, 4), np.uint8)
    text[..., 3] = (
        255
        * (np.repeat(np.repeat(rng.random((side // 6 + 1, side // 6 + 1)) < 0.1, 6, 0), 6, 1))[:side, :side]
    )
    photo = ndimage.zoom(
        rng.integers(0, 256, (side // 16 + 2, side // 16 + 2, 4)).astype(np.float32), (16, 16, 1), order=1
    )
    photo = np.clip(photo[:side, :side] + rng.normal(0, 4, (side, side, 4)), 0, 255).astype(np.uint8)
    return {
        name: Page(cmyk=np.ascontiguousarray(cmyk), dpi=press.dpi, name=name, number=1)
        for name, cmyk in (("text", text), ("photo", photo))
    }


def bench(press: Press, *, quick: bool = False) -> list[SpeedRow]:
    """Prediction against scipy's map_coordinates of the same table; comparison against numpy's bare error map."""
    pages = bench_pages(press, quick=quick)
    return [row for name, page in pages.items() for row in _of_page(name, page, press)]


def _of_page(name: str, page: Page, press: Press) -> list[SpeedRow]:
    def predicted() -> Prediction:
        return predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)

    prediction = predicted()
    expected, variance = prediction.expected_dn, prediction.variance_dn2
    scan = ideal_scan(prediction, press, np.random.default_rng(2))
    top_codes = [sensor.top_code_dn for sensor in press.sensors]
    table = press.sensors[0].mean_dn
    places = np.ascontiguousarray(page.cmyk.reshape(-1, 4).T / np.float32(NODE_STEP))
    groups: tuple[tuple[tuple[str, Callable[[], object]], tuple[str, Callable[[], object]]], ...] = (
        (
            (f"predict, {name}", predicted),
            (f"scipy look-up alone, {name}", lambda: ndimage.map_coordinates(table, places, order=1)),
        ),
        (
            (
                f"compare and gather, {name}",
                lambda: gather(scan, expected, variance, top_codes_dn=top_codes, seed=1, threads=1),
            ),
            (f"numpy error map alone, {name}", lambda: normalised_error(scan, expected, variance)),
        ),
    )
    rows = []
    for group in groups:
        speeds = [scan.size / 1e6 / _cpu_s(work) for _, work in group]
        rows += [
            SpeedRow(name=step, mpx_per_cpu_s=round(speed, 1), ratio=round(speed / speeds[-1], 2))
            for (step, _), speed in zip(group, speeds, strict=True)
        ]
    return rows


def _cpu_s(work: Callable[[], object]) -> float:
    work()
    times = []
    for _ in range(REPEATS):
        started = time.process_time()
        work()
        times.append(time.process_time() - started)
    return min(times)
