"""A warp between its nodes, against plain SciPy."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from prooflight.scans.placement import Warp


@given(rows=st.integers(1, 5), columns=st.integers(1, 5), seed=st.integers(0, 10**6))
def test_a_warp_is_bilinear_and_level_beyond_its_nodes(rows: int, columns: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    warp = Warp(
        nodes_mm=rng.normal(size=(rows, columns, 2)).astype(np.float32), pitch_mm=6.0, first_mm=(-3.0, 2.0)
    )
    x, y = rng.uniform(-20, 40, (2, 7, 9))
    places = [(y - 2.0) / 6.0, (x + 3.0) / 6.0]
    for axis, got in enumerate(warp.at(x, y)):
        nodes = warp.nodes_mm[..., axis].astype(np.float64)
        want = ndimage.map_coordinates(nodes, places, order=1, mode="nearest")
        np.testing.assert_allclose(got, want, atol=1e-9)
