"""Where each amount of the fit stands in its vector."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.detectors.base import LAMP_WAVES
from prooflight.detectors.matched_filter.fit.nuisance import FitLayout, amounts_sd
from prooflight.detectors.print_prior import PrintPrior


@pytest.mark.parametrize(("sensors", "colours"), [(1, 1), (2, 5)])
def test_parts_are_views_that_fill_the_vector_once(sensors: int, colours: int) -> None:
    layout = FitLayout(sensors=sensors, colours=colours)
    vectors = np.zeros((3, layout.size))
    parts = layout.parts(vectors)
    for part in parts:
        part += 1
    assert (vectors == 1).all()
    assert parts.shape.shape == (3, sensors, colours)
    assert (parts.gain.shape, parts.planes.shape) == ((3, 4, 3), (3, 4, 2))


def test_amounts_stand_in_the_order_of_the_vector() -> None:
    layout = FitLayout(sensors=2, colours=3)
    parts = layout.parts(np.arange(layout.size, dtype=float))
    assert np.concatenate([part.ravel() for part in parts]).tolist() == list(range(layout.size))
    assert parts.white.tolist() == [0, 1]
    assert parts.gain[0, 0] == 3 + LAMP_WAVES + 6
    assert parts.planes[3, 1] == layout.size - 1


def test_every_amount_has_its_own_prior() -> None:
    layout, prior = (
        FitLayout(sensors=2, colours=3),
        PrintPrior(white=0.02, gain=0.03, tilt=0.04, plane_mm=0.5),
    )
    sds = layout.parts(amounts_sd(prior, layout, pixel_mm=0.25))
    assert (sds.white == 0.02).all()
    assert sds.gain.tolist() == [[0.03, 0.04, 0.04]] * 4
    assert (sds.planes == 0.5).all()  # a quarter of 0.5 mm, in pixels of 0.25 mm
    assert (sds.lamp > 0).all()
    assert (np.diff(sds.lamp) < 0).all()
