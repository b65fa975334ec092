"""Errors of an ink model on a chart that it has not seen."""

from dataclasses import replace

import numpy as np

from prooflight.inks.chart import Chart
from prooflight_studies.ink.study import spread_check, with_noise


def test_errors_on_a_measured_chart_are_as_large_as_said(measured_chart: Chart, offset_chart: Chart) -> None:
    patches = 400
    if measured_chart is offset_chart:  # without error; a reading's is about 0.3 CIEDE2000
        noisy = with_noise(offset_chart.measured, 0.3, np.random.default_rng(5))
        measured_chart, patches = replace(offset_chart, measured=noisy), 120
    row = spread_check(measured_chart, patches, seed=0)
    assert 0.7 < row.rms < 1.3  # 0.95, 0.94
    assert 0.6 < row.within_1 < 0.85
    assert row.within_2 > 0.92
