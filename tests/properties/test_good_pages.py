"""In the ideal world a page's p-value is uniform: what the detector promises rests on that."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from prooflight.detectors.paper.chi_square import ChiSquare
from prooflight.detectors.paper.detector import PaperDetector
from prooflight.inspection.inspector import Inspector
from prooflight.prediction.predict import predict
from prooflight.rng import stream
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

SCANS = 120


def test_p_values_of_good_pages_are_uniform(two_sensor_press: Press, make_page: Callable[..., Page]) -> None:
    press = two_sensor_press
    test = ChiSquare(good_pages_per_false_alarm=1e5, misprint_rate=0.01, tiles=False)
    of_pages = Inspector(press=press, detector=PaperDetector(press_context=press.press_context(), test=test))
    p_values = []
    for design in range(3):
        page = make_page(20 + design, width_mm=20.0, height_mm=20.0)
        good = predict(page, sensors=press.sensors, geometry=press.geometry)
        for copy in range(SCANS // 3):
            scan = ideal_scan(good, press, stream(design, "print", copy))
            verdict = of_pages.inspect(page, scan, seed=copy).verdict
            assert verdict.p_value is not None
            p_values.append(verdict.p_value)
    # fixed seeds; a true uniform would fail once in a thousand
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    assert 0.3 < np.mean(p_values) < 0.7
