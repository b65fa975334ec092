from __future__ import annotations

import numpy as np
import pytest
from tests.detectors.paper.windows import window_means

from prooflight.detectors.paper.bayes import window_statistics


@pytest.mark.parametrize("reading", ["signed", "absolute"])
def test_units_are_each_sensors(reading: str) -> None:
    means = np.random.default_rng(2).normal(size=(2, 12, 9)).astype(np.float32)
    unit = np.array([2.0, 0.5])
    got = window_statistics(means, reading=reading, unit=unit)  # type: ignore[arg-type]
    for sensor in range(2):
        alone = window_statistics(means[sensor] / unit[sensor], reading=reading)  # type: ignore[arg-type]
        np.testing.assert_allclose(got[sensor], alone, rtol=1e-6)


def test_a_darkening_lowers_the_signed_minimum_and_a_lightening_does_not() -> None:
    """Why the paper's three numbers are blind to ink that is missing in one place."""
    z = np.zeros((1, 64, 64), np.float32)
    z[:, 8:16, 8:16] = -3
    dark, light = (window_statistics(window_means(sign * z, side=8))[0] for sign in (1, -1))
    assert dark[1] == pytest.approx(-24)
    assert light[1] == 0
