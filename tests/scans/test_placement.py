"""A warp between its nodes, against plain SciPy; turns, stretches and shifts by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from prooflight.scans.placement import Placement, Warp


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


def test_a_page_is_turned_and_stretched_about_its_centre() -> None:
    """A page of 20 x 40 mm turned by a quarter lies across: its right edge is seen where its lower edge would be."""
    size = {"page_width_mm": 20.0, "page_height_mm": 40.0}
    quarter = Placement(skew_deg=90.0).seen_mm(np.array([10.0, 0.0]), np.array([30.0, 20.0]), **size)
    assert np.array(quarter) == pytest.approx(np.array([[20.0, 10.0], [20.0, 30.0]]))
    wide = Placement(stretch_percent=(25.0, -20.0)).seen_mm(np.array([20.0]), np.array([40.0]), **size)
    assert np.array(wide).ravel() == pytest.approx([10 + 10 / 1.25, 20 + 20 / 0.8])


def test_a_shift_and_a_warp_displace_what_is_seen() -> None:
    warp = Warp(nodes_mm=np.full((1, 1, 2), (0.5, -0.25), np.float32), pitch_mm=6.0)
    for placement in (Placement(shift_mm=(2.5, 0.75)), Placement(shift_mm=(2.0, 1.0), warp=warp)):
        seen = placement.seen_mm(np.array([3.0]), np.array([4.0]), page_width_mm=20.0, page_height_mm=40.0)
        assert np.array(seen).ravel() == pytest.approx([0.5, 3.25])


def test_what_displaces_every_point_alike() -> None:
    level = Warp(nodes_mm=np.zeros((1, 1, 2), np.float32), pitch_mm=6.0)
    assert Placement(shift_mm=(1.0, 2.0)).is_shift
    others = (Placement(skew_deg=0.1), Placement(stretch_percent=(0, 0.1)), Placement(warp=level))
    assert not any(one.is_shift for one in others)
