"""Noise is Gaussian away from the converter's ends: closed form against repeated exposure, seeds fixed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import stats

from prooflight.camera.sensor import FixedPattern, read_out
from prooflight.commissioning.characterise import clipped_share, near_the_ends, variance_dn2
from prooflight.kernels.prediction.lookup import NODES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.camera.sensor import LineSensor
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile

LINES = 20_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shape:
    """How far repeated exposures of some colours are from a Gaussian; every array (colours,)."""

    skewness: NDArray[np.float64]
    excess_kurtosis: NDArray[np.float64]
    skewness_allowed: NDArray[np.float64]
    """Greatest size by which a Gaussian's (rounded, plus shot noise) differs from 0 in so few exposures. [-]"""
    excess_kurtosis_allowed: NDArray[np.float64]

    @property
    def gaussian(self) -> NDArray[np.bool_]:
        """Whether both stay within what is allowed."""
        within: NDArray[np.bool_] = np.abs(self.skewness) <= self.skewness_allowed
        return within & (np.abs(self.excess_kurtosis) <= self.excess_kurtosis_allowed)


STANDARD_ERRORS = 5.0


def exposed_shape(
    sensor: LineSensor, electrons: NDArray[np.float64], *, lines: int, rng: np.random.Generator
) -> Shape:
    """Skewness and excess kurtosis of ``lines`` simulated exposures of each of electrons (colours,) [e-].

    Allowed is five standard errors of a Gaussian's, sqrt(6 / n) and sqrt(24 / n) (Joanes and Gill 1998), plus what is
    there before clipping: a Poisson of mean m has third and fourth cumulant m, a code of rounding the fourth cumulant
    -1 / 120 DN^4, and of its third at most a like size where sigma is about a code (Sheppard's corrections).
    """
    count = electrons.size
    pattern = FixedPattern(gain=np.ones(count), offset_e=np.zeros(count))
    dn = read_out(sensor, np.broadcast_to(electrons, (lines, count)), pattern=pattern, rng=rng).astype(
        np.float64
    )
    away = dn - dn.mean(axis=0)
    variance = (away**2).mean(axis=0)
    moved = np.maximum(variance, 1e-12)
    want = variance_dn2(sensor, electrons)
    shot_dn = (electrons + sensor.dark_e) * sensor.dn_per_e**3
    rounding = 1 / 120
    return Shape(
        skewness=(away**3).mean(axis=0) / moved**1.5,
        excess_kurtosis=(away**4).mean(axis=0) / moved**2 - 3,
        skewness_allowed=STANDARD_ERRORS * np.sqrt(6 / lines) + (shot_dn + rounding) / want**1.5,
        excess_kurtosis_allowed=STANDARD_ERRORS * np.sqrt(24 / lines)
        + (shot_dn * sensor.dn_per_e + rounding) / want**2,
    )


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
