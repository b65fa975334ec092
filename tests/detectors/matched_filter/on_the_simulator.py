"""Analyse a tiny scan on CUDA's simulator, where bodies run as Python; started by ``test_card_images``.

Prints the greatest difference from the processor's kernels, in shares of each image's root mean square.
"""

from __future__ import annotations

import sys

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.detectors.matched_filter.analysis import HostImages, analyse_registered
from prooflight.detectors.matched_filter.card.images import engine_on
from prooflight.detectors.matched_filter.design import prepare_page
from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
from prooflight.detectors.matched_filter.statistics.statistic import SCREEN_MODES
from prooflight.kernels.gpu.body import SIMULATED
from prooflight.kernels.gpu.runners import Card, Pool
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.press.press_file import PressFile
from prooflight.registration.register import Registration
from prooflight.scans.placement import Placement
from prooflight.simulation.scans import ideal_scan

PIXELS = 64
MOVED = Placement(shift_mm=(0.1, 0.1), skew_deg=0.1)


def main() -> None:
    assert SIMULATED
    press = build_press(PressFile.prototype(), seed=1, pixels=PIXELS)
    rng = np.random.default_rng(4)
    cmyk = np.repeat(np.repeat(rng.integers(0, 256, (12, 12, 4), dtype=np.uint8), 8, 0), 8, 1)
    page = Page(cmyk=cmyk, dpi=press.dpi, name="tiny", number=1)
    sensors, geometry = press.sensors, press.geometry
    expected = predict(page, sensors=sensors, geometry=geometry)
    known = prepare_page(page, expected, sensors=sensors, geometry=geometry)
    there = predict(page, sensors=sensors, geometry=geometry, placement=MOVED)
    scan, none = ideal_scan(there, press, rng), np.zeros((4, 2))
    found = Registration(placement=MOVED, located=True, planes_mm=none, plane_parts=none.T)
    host, card = (
        analyse_registered(
            known,
            scan,
            found,
            residual_variance=ResidualVariance(),
            analysed_modes=SCREEN_MODES,
            engine=engine,
        ).sums
        for engine in (HostImages, engine_on(Pool(Card)))
    )
    pairs = [
        (one[mode], other[mode])
        for one, other in zip(card.tiles, host.tiles, strict=True)
        for mode in range(3)
    ]
    pairs += [(card.columns, host.columns), (card.flat_columns, host.flat_columns), (card.cover, host.cover)]
    off = [
        np.abs(one - other).max() / max(float(np.sqrt(np.square(other).mean())), 1e-9) for one, other in pairs
    ]
    sys.stdout.write(str(max(off)))


if __name__ == "__main__":
    main()
