"""Pixels taken together show the light that they showed apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from prooflight.pages.pdf.taking_together import taken_together

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.pdf.taking_together import InkLight

GAINS = tuple(tuple((np.linspace(0, 1, 18) ** power).tolist()) for power in (1.0, 0.8, 0.7, 0.6))
"""From an ink whose dots do not gain to one of which half an ink takes two thirds of the light."""


def _together(fine: NDArray[np.uint8], n: int, light: InkLight | None) -> NDArray[np.uint8]:
    out = np.empty((fine.shape[0] // n, fine.shape[1] // n, 4), np.uint8)
    taken_together(fine, out, light)
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


@given(coarse=hnp.arrays(np.uint8, (3, 5, 4)))
def test_pixels_that_are_alike_stay_as_they_are(coarse: NDArray[np.uint8]) -> None:
    fine = np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1)
    assert np.array_equal(_together(fine, 2, GAINS), coarse)
