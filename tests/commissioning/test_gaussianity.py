"""Noise is Gaussian away from the converter's ends: closed form against repeated exposure, seeds fixed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import stats

from prooflight.commissioning.camera.gaussianity import clipped_share, exposed_shape, near_the_ends
from prooflight.kernels.prediction.look_up import NODES

if TYPE_CHECKING:
    from prooflight.camera.sensor import LineSensor
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile

LINES = 20_000


@pytest.fixture
def sensor(prototype: PressFile) -> LineSensor:
    return prototype.camera().sensors[0]


def test_unflagged_nodes_of_the_press_are_gaussian(press: Press, sensor: LineSensor) -> None:
    rng = np.random.default_rng(1)
    places = tuple(rng.integers(0, NODES, (4, 60)))
    signal = np.append(press.sensors[0].mean_dn[places], press.sensors[0].mean_dn.min())
    electrons = signal.astype(np.float64) / sensor.dn_per_e
    assert not np.any(near_the_ends(sensor, electrons))
    assert exposed_shape(sensor, electrons, lines=LINES, rng=rng).gaussian.all()


@pytest.mark.parametrize("signal_dn", [0.3, 4090.0])
def test_a_flagged_node_is_not_gaussian(sensor: LineSensor, signal_dn: float) -> None:
    electrons = np.array([signal_dn / sensor.dn_per_e])
    assert np.any(near_the_ends(sensor, electrons))
    assert not exposed_shape(sensor, electrons, lines=LINES, rng=np.random.default_rng(2)).gaussian.any()


def test_no_colour_escapes_the_flags(sensor: LineSensor) -> None:
    """Wherever the shape is off, the closed form had said so: signals close together over both ends."""
    signal = np.concatenate([np.arange(0.0, 8.0, 0.25), np.arange(4040.0, 4095.0, 2.0)])
    electrons = signal / sensor.dn_per_e
    black, saturation = near_the_ends(sensor, electrons)
    shape = exposed_shape(sensor, electrons, lines=LINES, rng=np.random.default_rng(3))
    assert (black | saturation | shape.gaussian).all()
    assert (black[:4].all(), saturation[-4:].all()) == (True, True)
    assert not (black & saturation).any()


def test_shape_agrees_with_scipy(sensor: LineSensor) -> None:
    electrons = np.array([50_000.0])
    shape = exposed_shape(sensor, electrons, lines=4000, rng=np.random.default_rng(4))
    # the allowance for shot noise is a Poisson's own skewness, 1 / sqrt(mean), diluted by read noise
    shot = shape.skewness_allowed - 5 * np.sqrt(6 / 4000)
    assert shot[0] == pytest.approx(stats.poisson(50_000).stats("s"), rel=0.1)
    assert abs(shape.skewness[0]) < shape.skewness_allowed[0]


def test_shares_count_the_nodes(press: Press, sensor: LineSensor) -> None:
    table = press.sensors[0].mean_dn
    (share,) = press.clipped
    assert share.black == share.saturation == 0.0  # the darkest node lies at 5 DN, sigma 0.7 DN
    brighter = clipped_share(sensor, table * np.float32(4095 / table.max()))
    assert 0 < brighter.saturation < 0.1
    dimmer = clipped_share(sensor, table * np.float32(0.3))
    assert 0 < dimmer.black < 0.1
    raised = replace(sensor, black_level_dn=64.0)
    assert clipped_share(raised, table * np.float32(0.3)).black == 0.0
