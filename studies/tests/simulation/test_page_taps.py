"""Taps of a page in the exact exposure."""

from __future__ import annotations

import numpy as np
from tests.properties.test_sampling import as_matrix

from prooflight.pages.sampling import Footprint
from prooflight_studies.exact.exposure import page_taps


def test_page_taps_go_across_columns_and_along_rows() -> None:
    reach = 0.1
    offsets = np.linspace(-reach, reach, 401)
    footprint = Footprint(
        reach_mm=reach,
        across=np.clip(offsets / 0.1 + 0.5, 0, 1),  # a box of one raster pixel
        along=np.clip(offsets / 0.2 + 0.5, 0, 1),  # and of two
    )
    x, y = page_taps(
        footprint,
        centres_x_mm=np.array([0.35]),
        centres_y_mm=np.array([0.1, 0.2]),
        raster_pixel_mm=0.1,
        raster_shape=(3, 5, 4),
    )
    np.testing.assert_allclose(as_matrix(x, 5), [[0, 0, 0, 1, 0]], atol=1e-6)
    np.testing.assert_allclose(as_matrix(y, 3), [[0.5, 0.5, 0], [0, 0.5, 0.5]], atol=1e-6)
