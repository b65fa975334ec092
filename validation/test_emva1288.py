"""Against the reference implementation of EMVA 1288 (package emva1288), on the same simulated images."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.camera.sensor import draw_fixed_pattern, read_out
from prooflight.commissioning.camera.exposures import statistics
from prooflight.commissioning.camera.photon_transfer import PhotonTransfer, photon_transfer

if TYPE_CHECKING:
    from prooflight.camera.sensor import LineSensor
    from prooflight.press.press_file import PressFile

LINES = 300
LEVELS_E = (300.0, 1e3, 3e3, 1e4, 2e4, 4e4, 6e4, 8e4, 1e5, 1.2e5, 1.4e5, 1.7e5, 2.2e5)
SPATIAL_IMAGES = 8
EXPOSURE_NS = 34.66e6  # 96 stages at 2770 lines/s; any number serves


@pytest.fixture(scope="module")
def emva() -> Any:
    """The reference implementation, given back the alias that numpy 2 dropped and that it still calls."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np, "asfarray", lambda values: np.asarray(values, dtype=np.float64), raising=False)
        results = pytest.importorskip("emva1288.process.results", reason="needs emva1288 (a referee)")
        data = pytest.importorskip("emva1288.process.data")
        routines = pytest.importorskip("emva1288.process.routines")

        def analyse(temporal: dict[float, list[np.ndarray]], bright: list[np.ndarray]) -> Any:
            """Two images a level for temporal noise, eight dark and eight bright ones for the fixed pattern."""
            lines, pixels = bright[0].shape
            sums = {level: routines.get_int_imgs(images[:2]) for level, images in temporal.items()}
            points = {
                level: {"sum": image["sum"].sum(), "pvar": image["pvar"].sum(), "dmean": image["dmean"]}
                for level, image in sums.items()
            }
            spatial = {0.0: routines.get_int_imgs(temporal[0.0]), 1e5: routines.get_int_imgs(bright)}
            images = {
                "width": pixels,
                "height": lines,
                "temporal": {EXPOSURE_NS: points},
                "spatial": {EXPOSURE_NS: spatial},
            }
            reduced = data.Data1288(images, loglevel=logging.ERROR)
            return results.Results1288(reduced.data, loglevel=logging.ERROR)

        yield analyse


@pytest.fixture(scope="module")
def both(emva: Any, prototype: PressFile) -> tuple[LineSensor, Any, PhotonTransfer]:
    """The prototype's sensor, 1024 columns, black level 40, evenly lit: EMVA's analysis and ours."""
    sensor = replace(prototype.camera().sensors[0], pixels=1024, black_level_dn=40.0)
    rng = np.random.default_rng(1)
    pattern = draw_fixed_pattern(sensor, rng)

    def images(level_e: float, count: int) -> list[np.ndarray]:
        light = np.full((LINES, sensor.pixels), level_e)
        return [read_out(sensor, light, pattern=pattern, rng=rng) for _ in range(count)]

    temporal = {level: images(level, 2) for level in LEVELS_E}
    temporal[0.0] = images(0.0, SPATIAL_IMAGES)
    bright = images(1e5, SPATIAL_IMAGES)
    dark = [statistics(image, name="dark") for image in temporal[0.0]]
    flat = [statistics(image, name=f"{e:g}") for e, both in temporal.items() if e for image in both]
    flat += [statistics(image, name="bright") for image in bright]
    return sensor, emva(temporal, bright), photon_transfer(dark, flat, top_code_dn=sensor.top_code_dn)


# 307,200 pixels: each of EMVA's variances has a standard error of sqrt(2 / 307,200) = 0.26 %; its unweighted line
# through nine of them gives K to 0.15 %, and K carries over to everything in electrons. Four times that is 0.6 %.


def test_system_gain(both: tuple[LineSensor, Any, PhotonTransfer]) -> None:
    sensor, emva, ours = both
    assert ours.gain.value == pytest.approx(emva.K, rel=0.006)
    assert sensor.dn_per_e == pytest.approx(emva.K, rel=0.006)


def test_temporal_dark_noise(both: tuple[LineSensor, Any, PhotonTransfer]) -> None:
    # EMVA's sigma_d holds the dark signal's shot noise, as ours does at the level of no light.
    sensor, emva, ours = both
    assert ours.read_noise_e(ours.no_light_dn.value).value == pytest.approx(emva.sigma_d, rel=0.01)
    assert emva.sigma_d == pytest.approx((sensor.read_noise_e**2 + sensor.dark_e) ** 0.5, rel=0.01)


def test_dsnu(both: tuple[LineSensor, Any, PhotonTransfer]) -> None:
    _, emva, ours = both
    assert ours.dsnu_dn.value / ours.gain.value == pytest.approx(emva.DSNU1288, rel=0.008)
    assert ours.dsnu_dn.value == pytest.approx(emva.DSNU1288_DN(), rel=0.002)


def test_prnu(both: tuple[LineSensor, Any, PhotonTransfer]) -> None:
    # Ours is high-passed, which keeps 91 % of 1024 columns' freedom: sqrt((1 / 0.91 - 1) / (2 x 1024)) = 0.7 %,
    # times three.
    _, emva, ours = both
    assert ours.prnu_percent.value == pytest.approx(emva.PRNU1288, rel=0.021)


def test_saturation(both: tuple[LineSensor, Any, PhotonTransfer]) -> None:
    _, emva, ours = both
    levels = emva.temporal["u_y"]
    assert ours.saturation_dn == pytest.approx(levels[emva.index_u_ysat], abs=1.0)
