"""Pixels taken together show the light that they showed apart."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from prooflight.pages.pdf.area_averages import area_averaged

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.pdf.area_averages import InkLight

GAINS = tuple(tuple((np.linspace(0, 1, 18) ** power).tolist()) for power in (1.0, 0.8, 0.7, 0.6))
"""From an ink whose dots do not gain to one of which half an ink takes two thirds of the light."""


def _together(fine: NDArray[np.uint8], n: int, light: InkLight | None) -> NDArray[np.uint8]:
    out = np.empty((fine.shape[0] // n, fine.shape[1] // n, 4), np.uint8)
    area_averaged(fine, out, light, step=float(n))
    return out


@pytest.mark.parametrize("n", [2, 3])
@given(solid=st.data())
def test_the_light_of_solid_and_paper_is_their_mean(n: int, solid: st.DataObject) -> None:
    fine = np.where(solid.draw(hnp.arrays(np.bool_, (3 * n, 2 * n, 4))), 255, 0).astype(np.uint8)
    out = _together(fine, n, GAINS).astype(np.float64)
    share = (fine / 255).reshape(3, n, 2, n, 4).mean(axis=(1, 3))
    for ink, curve in enumerate(GAINS):
        # Bytes and table steps are rounded, by half of one each.
        low, high = (
            np.interp(out[..., ink] + half, np.linspace(0, 255, len(curve)), curve) for half in (-0.5, 0.5)
        )
        assert (share[..., ink] >= low - 1 / 8192 - 1e-9).all()
        assert (share[..., ink] <= high + 1 / 8192 + 1e-9).all()


def test_half_an_ink_that_gains_is_less_than_half_a_byte() -> None:
    fine = np.zeros((2, 2, 4), np.uint8)
    fine[0] = 255
    assert _together(fine, 2, None)[0, 0].tolist() == [128, 128, 128, 128]
    halves = _together(fine, 2, GAINS)[0, 0].tolist()
    assert halves[0] == 128
    assert halves == sorted(halves, reverse=True)
    assert halves[3] < 90


def _areas(first: float, step: float, count: int, extent: int) -> NDArray[np.float64]:
    """How much of each fine pixel (extent,) each of count pixels covers, (count, extent); sums are 1."""
    begin = first + step * np.arange(count)[:, None]
    at = np.arange(extent)
    covers = np.minimum(at + 1, begin + step) - np.maximum(at, begin)
    return np.clip(covers, 0, None) / step


@pytest.mark.parametrize("step", [0.62, 1.25, 2, 2.4904, 5.3])
@pytest.mark.parametrize("light", [None, GAINS], ids=["averaged", "by light"])
def test_each_pixel_is_taken_by_its_area(step: float, light: InkLight | None) -> None:
    rng = np.random.default_rng(39)
    rows, columns, first = 7, 9, 0.37
    fine = rng.choice(
        np.array([0, 255], np.uint8), (math.ceil(first + rows * step), math.ceil(columns * step), 4)
    )
    out = np.empty((rows, columns, 4), np.uint8)
    area_averaged(fine, out, light, step=step, first=first)
    down = _areas(first, step, rows, fine.shape[0])
    across = _areas(0, step, columns, fine.shape[1])
    share = np.einsum("rh,cw,hwi->rci", down, across, fine / 255)
    for ink, curve in enumerate(light or ((0.0, 1.0),) * 4):
        needed = np.interp(share[..., ink], curve, np.linspace(0, 255, len(curve)))
        # A byte is rounded, and so is the light; where its curve is steep, half a step of it is 0.6 of a byte.
        np.testing.assert_allclose(out[..., ink], needed, atol=0.51 if light is None else 1.2)


def test_bands_are_those_of_the_whole() -> None:
    step, fine = 2.4904, np.random.default_rng(39).integers(0, 256, (30, 20, 4)).astype(np.uint8)
    whole = np.empty((12, 8, 4), np.uint8)
    area_averaged(fine, whole, GAINS, step=step)
    for top in range(0, 12, 3):
        above, out = math.floor(top * step), np.empty((3, 8, 4), np.uint8)
        band = np.ascontiguousarray(fine[above : math.ceil((top + 3) * step)])
        area_averaged(band, out, GAINS, step=step, first=top * step - above)
        assert np.abs(out.astype(int) - whole[top : top + 3]).max() <= 1


def test_a_raster_that_is_not_covered_is_refused() -> None:
    with pytest.raises(ValueError, match=r"first \+ R \* step <= H"):
        area_averaged(np.zeros((4, 4, 4), np.uint8), np.zeros((2, 2, 4), np.uint8), None, step=2.0 + 1e-2)


@given(coarse=hnp.arrays(np.uint8, (3, 5, 4)))
def test_pixels_that_are_alike_stay_as_they_are(coarse: NDArray[np.uint8]) -> None:
    fine = np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1)
    assert np.array_equal(_together(fine, 2, GAINS), coarse)
