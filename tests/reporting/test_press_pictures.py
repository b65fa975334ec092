"""The picture of a press: drawn whole, with every sensor, from the artefact alone."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from prooflight.reporting.press_pictures import draw_press

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.artefact import Press


def picture(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        assert image.format == "PNG"
        return np.asarray(image.convert("RGB")).astype(int)


def test_the_picture_follows_the_press(press: Press, tmp_path: Path) -> None:
    draw_press(tmp_path / "a.png", press)
    draw_press(tmp_path / "b.png", press)
    sensor = press.sensors[0]
    draw_press(tmp_path / "c.png", replace(press, sensors=(replace(sensor, mean_dn=0.5 * sensor.mean_dn),)))
    first, again, other = (picture(tmp_path / name) for name in ("a.png", "b.png", "c.png"))
    np.testing.assert_array_equal(first, again)
    height, width, _ = first.shape
    changed = np.argwhere((first != other).any(axis=-1))
    # signal and noise stand in the upper row, right of the swatches; the digest heads the picture
    body = changed[changed[:, 0] > 0.07 * height]
    assert body[:, 0].max() < 0.53 * height
    assert body[:, 1].min() > 0.3 * width


def test_swatches_are_the_press_own_colours(press: Press, tmp_path: Path) -> None:
    draw_press(tmp_path / "a.png", press)
    pixels = picture(tmp_path / "a.png").reshape(-1, 3)
    for full in ((-1, 0, 0, 0), (0, -1, 0, 0), (0, 0, -1, 0), (0, 0, 0, -1), (-1, -1, -1, 0)):
        colour = press.appearance_srgb[full].astype(int)
        assert (np.abs(pixels - colour).max(axis=1) <= 1).any()


@pytest.mark.parametrize("sensors", [2, 3, 5])
def test_any_number_of_sensors_fits(press: Press, tmp_path: Path, sensors: int) -> None:
    several = tuple(replace(press.sensors[0], name=f"s{number}") for number in range(sensors))
    path = tmp_path / "folder" / "a.png"
    draw_press(path, replace(press, sensors=several))
    assert picture(path).shape[1] > 1500  # four panels wide
    assert [file.name for file in path.parent.iterdir()] == ["a.png"]
