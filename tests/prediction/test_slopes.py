"""Slopes read off the mean table against the exact model's own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight.kernels.prediction.lookup import NODE_STEP, NODES
from prooflight.prediction.tables import EVERY, SLOPE_NODES, mean_slopes, node_fractions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile

STEP = 1e-4


def slopes_at(slopes: NDArray[np.float32], cmyk: NDArray[np.uint8]) -> NDArray[np.float32]:
    """``mean_slopes`` at recipes (n, 4), interpolated linearly in every ink: (n, 4) [DN per whole ink]."""
    width = NODE_STEP * EVERY
    cell = cmyk.astype(np.intp) // width
    upper = (cmyk % width).astype(np.float32) / width
    strides = SLOPE_NODES ** np.arange(3, -1, -1)
    flat = slopes.reshape(-1, 4)
    first = cell @ strides
    result = np.zeros((len(cmyk), 4), np.float32)
    for corner in np.ndindex(2, 2, 2, 2):
        weight = np.prod(np.where(np.array(corner) == 1, upper, 1 - upper), axis=1, dtype=np.float32)
        result += weight[:, None] * flat[first + int(strides @ np.array(corner))]
    return result


def test_slopes_meet_the_exact_models(press: Press, prototype: PressFile) -> None:
    camera, inks = prototype.camera(), prototype.inks()
    sensor = camera.sensors[0]
    rng = np.random.default_rng(1)
    cmyk = rng.integers(0, 256, (2000, 4))
    cmyk[:1000] *= rng.random((1000, 4)) < 0.5  # as pages are: most colours lack an ink

    def exact(area: np.ndarray) -> np.ndarray:
        electrons = sensor.electrons(camera.irradiance_photons(inks.reflectance(area)))
        return electrons * sensor.dn_per_e

    want = np.stack(
        [(exact(cmyk / 255 + e) - exact(cmyk / 255 - e)) / (2 * STEP) for e in STEP * np.eye(4)], axis=-1
    )
    got = slopes_at(mean_slopes(press.sensors[0].mean_dn), cmyk.astype(np.uint8))
    error = np.sqrt(((got - want) ** 2).mean(axis=0) / (want**2).mean(axis=0))
    # half a per cent; magenta's tone curve bends hard in its last tenth, there 17 nodes give 3 %
    np.testing.assert_array_less(error, [0.005, 0.05, 0.005, 0.005])


def test_slopes_of_a_parabola_are_exact_at_every_node_and_between(press: Press) -> None:
    a = node_fractions()
    c, m, y, k = np.meshgrid(a, a, a, a, indexing="ij", sparse=True)
    table = 3000 - 900 * c + 300 * c**2 - 700 * m - 200 * m * k + 50 * y**2 + 0 * k
    assert table.shape == (NODES,) * 4
    slopes = mean_slopes(table.astype(np.float32))
    assert slopes.shape == (*(SLOPE_NODES,) * 4, 4)
    cmyk = np.random.default_rng(2).integers(0, 256, (500, 4)).astype(np.uint8)
    c, m, y, k = (cmyk / 255).T
    want = np.stack([-900 + 600 * c, -700 - 200 * k, 100 * y, -200 * m], axis=-1)
    # float32 tables of 3000 DN round to 2e-4 DN, over two steps of 8 / 255 that is 4e-3 DN
    np.testing.assert_allclose(slopes_at(slopes, cmyk), want, atol=0.02)
