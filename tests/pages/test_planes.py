"""Planes displaced by parts of a raster pixel reflect what the parts reflect."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.pages.pdf.area_averages import area_averaged
from prooflight.pages.planes import PARTS, displaced, displaced_by_parts
from prooflight.pages.raster import Page

LIGHT = tuple(
    tuple((solid * np.linspace(0, 1, 18) ** power).tolist())
    for solid, power in ((0.7, 1.0), (0.5, 0.8), (0.2, 0.7), (0.98, 0.6))
)
"""What C, M, Y and K take of white, of which tints gain more or less."""


def page_of(cmyk: np.ndarray) -> Page:
    return Page(cmyk=np.ascontiguousarray(cmyk), dpi=480.0, name="p0001", number=1)


def left_by(cmyk: np.ndarray) -> np.ndarray:
    """The light that recipes (..., 4) leave, if that of inks multiplies."""
    takes = [np.interp(np.arange(256), np.linspace(0, 255, 18), curve) for curve in LIGHT]
    return np.prod([1 - takes[ink][cmyk[..., ink]] for ink in range(4)], axis=0)


def test_whole_pixels_are_those_of_displaced() -> None:
    page = page_of(np.random.default_rng(5).integers(0, 256, (13, 17, 4)).astype(np.uint8))
    planes = np.array([[1, -2], [0, 0], [-3, 1], [2, 2]])
    by_parts = displaced_by_parts(page, PARTS * planes, LIGHT)
    np.testing.assert_array_equal(by_parts.cmyk, displaced(page, planes).cmyk)


@pytest.mark.parametrize(
    "recipes", [((0, 0, 0, 0), (255, 255, 255, 255)), ((60, 0, 60, 230), (0, 200, 255, 0))]
)
def test_pixels_reflect_the_mean_of_their_parts(recipes: tuple[tuple[int, ...], tuple[int, ...]]) -> None:
    """Shapes of two recipes. Bytes are rounded: by half of one in four inks, 0.6 % of white in all."""
    on = np.kron(np.random.default_rng(6).random((5, 6)) < 0.4, np.ones((3, 3), bool))
    cmyk = np.where(on[..., None], *(np.array(one, np.uint8) for one in recipes))
    planes = np.array([[1, 2], [-1, 3], [0, -5], [6, 0]])
    fine = page_of(np.repeat(np.repeat(cmyk, PARTS, axis=0), PARTS, axis=1))
    true = left_by(displaced(fine, planes).cmyk)
    true = true.reshape(len(on), PARTS, -1, PARTS).mean(axis=(1, 3))
    np.testing.assert_allclose(
        left_by(displaced_by_parts(page_of(cmyk), planes, LIGHT).cmyk), true, atol=0.006
    )


def test_one_plane_alone_takes_the_mean_of_its_parts() -> None:
    cmyk = np.zeros((9, 9, 4), np.uint8)
    cmyk[3:6, 3:6, 3] = 255
    planes = np.array([[0, 0], [0, 0], [0, 0], [1, -2]])
    fine = displaced(page_of(np.repeat(np.repeat(cmyk, PARTS, axis=0), PARTS, axis=1)), planes)
    out = np.empty_like(cmyk)
    area_averaged(fine.cmyk, out, LIGHT, step=float(PARTS))
    np.testing.assert_array_equal(displaced_by_parts(page_of(cmyk), planes, LIGHT).cmyk, out)
