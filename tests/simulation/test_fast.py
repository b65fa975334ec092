"""The press world's effects appear in a scan as they should, and as the full spectral path has them."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.pages.planes import displaced
from prooflight.pages.raster import Page
from prooflight.simulation.fast import half_normals


@pytest.mark.parametrize("planes", [(0, 0), (3, -2), (-3, 2), (100, 0), (0, -100)])
def test_composed_rows_are_displaced_planes(planes: tuple[int, int]) -> None:
    cmyk = np.random.default_rng(1).integers(0, 256, (7, 9, 4)).astype(np.uint8)
    shifts = np.array([planes, (0, 0), (1, 1), planes])
    composed = displaced(Page(cmyk=cmyk, dpi=480, name="planes", number=1), shifts).cmyk
    expected = np.zeros_like(cmyk)
    for ink, (dx, dy) in enumerate(shifts):
        for i in range(7):
            for j in range(9):
                if 0 <= i - dy < 7 and 0 <= j - dx < 9:
                    expected[i, j, ink] = cmyk[i - dy, j - dx, ink]
    np.testing.assert_array_equal(composed, expected)


# --- noise ---


def test_two_quantiles_make_a_normal_number() -> None:
    quantiles = half_normals().astype(np.float64)
    assert quantiles.var() * 2 == pytest.approx(1, abs=1e-6)
    kurtosis = (quantiles**4).mean() / quantiles.var() ** 2
    assert (3 + kurtosis) / 2 == pytest.approx(3, abs=1e-3)  # of the sum of two


# --- the full spectral path ---
