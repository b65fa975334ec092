"""The exact camera, light to numbers, against what real-time prediction looks up for the same specimen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.camera.camera import with_pixels
from prooflight.camera.sensor import Noise, draw_fixed_pattern
from prooflight.commissioning.build import build_press
from prooflight.detectors.paper.chi_square import pearson
from prooflight.detectors.paper.evidence import gather, interval_shares
from prooflight.prediction.predict import Prediction, predict
from prooflight.press.press_file import PressFile
from prooflight_studies.exact.exposure import page_electrons, read_out_page

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.camera.camera import Camera
    from prooflight.camera.sensor import FixedPattern
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

SEED, PIXELS = 6, 160


@dataclass(frozen=True, kw_only=True)
class Rig:
    """One specimen: its exact camera, and the press made from it."""

    press_file: PressFile
    camera: Camera
    patterns: list[FixedPattern]
    press: Press

    def expose(self, page: Page, *, noise: Noise, seed: int = 1) -> np.ndarray:
        geometry = self.press.geometry
        electrons = page_electrons(
            self.camera,
            self.press_file.inks(),
            page,
            centres_x_mm=geometry.centres_x_mm(page.width_mm),
            centres_y_mm=geometry.centres_y_mm(geometry.lines(page.height_mm)),
            backing_reflectance=self.press_file.backing_reflectance,
        )
        rng = np.random.default_rng(seed)
        return read_out_page(self.camera, electrons, patterns=self.patterns, rng=rng, noise=noise)

    def predict(self, page: Page) -> Prediction:
        return predict(page, sensors=self.press.sensors, geometry=self.press.geometry)


@pytest.fixture(scope="module")
def rig(prototype: PressFile) -> Rig:
    text = prototype.text.replace("black_level_dn = 0 ", "black_level_dn = 64 ")
    assert text != prototype.text
    press_file = PressFile(Path("rig.toml"), text)
    camera = with_pixels(press_file.camera(), PIXELS)
    rng = np.random.default_rng(SEED)  # build_press draws its specimen first, from the same seed
    return Rig(
        press_file=press_file,
        camera=camera,
        patterns=[draw_fixed_pattern(sensor, rng) for sensor in camera.sensors],
        press=build_press(press_file, seed=SEED, pixels=PIXELS),
    )


@pytest.fixture(scope="module")
def small_page(rig: Rig, make_page: Callable[..., Page]) -> Page:
    return make_page(3, width_mm=14.0, height_mm=12.0, dpi=rig.press.dpi)


def thirds(rig: Rig, page: Page) -> dict[str, tuple[slice, slice, slice]]:
    """Text, tints and picture of the page in its scan, without the four pixels that see two of them."""
    lines, columns = rig.press.geometry.on_page(page.width_mm, page.height_mm)
    edges = np.linspace(lines.start, lines.stop, 4).round().astype(int)
    across = slice(columns.start + 4, columns.stop - 4)
    return {
        name: (slice(None), slice(top + 4, bottom - 4), across)
        for name, top, bottom in zip(("text", "tints", "picture"), edges, edges[1:], strict=False)
    }


def test_without_temporal_noise_the_camera_records_what_was_predicted(rig: Rig, small_page: Page) -> None:
    exact = rig.expose(small_page, noise=Noise.PRNU | Noise.DSNU).astype(float)
    expected = rig.predict(small_page)
    difference = exact - expected.expected_dn
    z = difference / np.sqrt(expected.variance_dn2)
    # at edges: what the lens correction leaves, and half a code of rounding
    assert np.abs(difference).max() < 0.5 + 0.002 * rig.press.sensors[0].white_dn
    # elsewhere: rounding, table error and calibration together stay below a quarter of the noise
    for name, place in thirds(rig, small_page).items():
        if name != "text":
            assert np.sqrt(np.mean(z[place] ** 2)) < 0.25
            assert abs(z[place].mean()) < 0.1


def test_with_all_noise_tints_and_pictures_deviate_by_one_sigma(rig: Rig, small_page: Page) -> None:
    measured = rig.expose(small_page, noise=Noise.ALL)
    expected = rig.predict(small_page)
    z = (measured - expected.expected_dn) / np.sqrt(expected.variance_dn2)
    for name, place in thirds(rig, small_page).items():
        if name != "text":
            # model error below a quarter of the noise adds less than 3 % to sigma
            sampling = 4 / np.sqrt(2 * z[place].size)
            assert 1 - sampling < z[place].std() < 1.03 + sampling


def test_on_bare_paper_the_two_agree_to_the_last_percent_of_the_variance(rig: Rig, small_page: Page) -> None:
    blank = replace(small_page, cmyk=np.zeros_like(small_page.cmyk))
    measured, expected = rig.expose(blank, noise=Noise.ALL), rig.predict(blank)
    lines, columns = rig.press.geometry.on_page(blank.width_mm, blank.height_mm)
    inside = (slice(None), slice(lines.start + 4, lines.stop - 4), slice(columns.start + 4, columns.stop - 4))
    z = (measured[inside] - expected.expected_dn[inside]) / np.sqrt(expected.variance_dn2[inside])
    assert z.var() == pytest.approx(1, abs=4 * np.sqrt(2 / z.size) + 0.01)
    # calibration knows each column's gain to sigma / sqrt(4096)
    column_z = z.mean(axis=(0, 1)) * np.sqrt(z.shape[1])
    assert column_z.std() == pytest.approx(1, abs=0.25)
    evidence = gather(
        measured[inside],
        expected.expected_dn[inside],
        expected.variance_dn2[inside],
        top_codes_dn=[4095],
        seed=1,
    )
    freedom = evidence.histogram.shape[-1] - 1
    assert pearson(evidence.histogram, interval_shares())[0] < freedom + 5 * np.sqrt(2 * freedom)
