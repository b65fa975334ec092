"""What a short separable footprint and its correction make of light, against the round lens itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.camera.camera import with_pixels
from prooflight.camera.lens_correction import SHORT_REACH_PIXELS, lens_correction
from prooflight.kernels.prediction.lens_correction import FAR_BLOCK, FARTHER_BLOCK, NEAR_REACH

if TYPE_CHECKING:
    from prooflight.camera.camera import Camera
    from prooflight.press.press_file import PressFile

PIXELS = 160


@pytest.fixture(scope="module")
def camera(prototype: PressFile) -> Camera:
    return with_pixels(prototype.camera(), PIXELS)


def of(camera: Camera) -> tuple[np.ndarray, ...]:
    sensor = camera.sensors[0]
    found = lens_correction(camera, sensor, camera.footprint(sensor, reach_pixels=SHORT_REACH_PIXELS))
    return found.near, found.far, found.farther


def test_even_light_stays_even(camera: Camera) -> None:
    assert sum(part.astype(np.float64).sum() for part in of(camera)) == pytest.approx(1, abs=1e-6)


def test_weights_are_symmetric_and_light_is_only_moved_a_little(camera: Camera) -> None:
    for part in of(camera):
        np.testing.assert_array_equal(part, part[::-1])
        np.testing.assert_array_equal(part, part[:, ::-1])
    near = of(camera)[0]
    assert near[NEAR_REACH, NEAR_REACH] == pytest.approx(1, abs=0.03)
    assert np.abs(near).sum() < 1.1


def test_blocks_divide_one_another() -> None:
    assert FARTHER_BLOCK % FAR_BLOCK == 0
