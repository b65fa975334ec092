"""Ruler pages as the simulated press prints and a line camera sees them, and what must be found in them."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from prooflight.camera.sharpness import sharpness
from prooflight.commissioning.build import build_press
from prooflight.inks.ruler_layout import RulerLayout
from prooflight.inks.ruler_print import RASTER_DPI, ruler_raster
from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight.prediction.predict import predict
from prooflight.press.press_file import PressFile
from prooflight.scans.placement import IN_PLACE
from prooflight_line.ruler.slanted_edge import FREQUENCIES

if TYPE_CHECKING:
    from prooflight.prediction.printed import PrintedPage
    from prooflight.press.artefact import Press
    from prooflight.scans.placement import Placement

LAYOUT = RulerLayout(width_mm=130.0, height_mm=212.0)
"""Two groups and the comb of a third; the width of 1,280 pixels."""
TRUE_LINE_MM = 294.0 / 2770.0


@cache
def ruler_press_file(f_number: float = 2.8) -> PressFile:
    """The prototype with 1,280 pixels, 8 TDI stages that fit the speed to 0.7 %, and a black level."""
    text = PressFile.prototype().text
    for name, value in (
        ("tdi_stages", 8),
        ("luminance_cd_m2", 1100.0),
        ("black_level_dn", 40),
        ("pixels", 1280),
        ("f_number", f_number),
    ):
        text = re.sub(rf"^{name} = [\d.]+", f"{name} = {value}", text, flags=re.MULTILINE)
    return PressFile(Path("true.toml"), text + "\n[transport]\nspeed_mm_s = 294.0\n")


@cache
def ruler_press(f_number: float = 2.8) -> Press:
    # Less light through a smaller stop is given back: what is asked is sharpness.
    text = ruler_press_file(f_number).text.replace(
        "luminance_cd_m2 = 1100.0", f"luminance_cd_m2 = {1100.0 * (f_number / 2.8) ** 2:.1f}"
    )
    return build_press(PressFile(Path("true.toml"), text), seed=5)


@cache
def ruler_page() -> Page:
    return Page(cmyk=ruler_raster(LAYOUT), dpi=RASTER_DPI, name="ruler", number=1)


def seen(
    page: Page | PrintedPage | None = None,
    *,
    placement: Placement = IN_PLACE,
    f_number: float = 2.8,
    seed: int = 7,
) -> np.ndarray:
    """A scan with the camera's noise, (1, lines, pixels) uint16."""
    press = ruler_press(f_number)
    found = predict(
        page or ruler_page(),
        sensors=press.sensors,
        geometry=press.geometry,
        placement=placement,
        threads=1,
    )
    noise = np.random.default_rng(seed).standard_normal(found.expected_dn.shape)
    noisy = found.expected_dn + noise * np.sqrt(found.variance_dn2)
    return np.clip(np.round(noisy), 0, 4095).astype(np.uint16)


def true_mtf50(f_number: float) -> tuple[float, float]:
    """MTF50 across [cycles/pixel] and along [cycles/line] of lens, pixel, motion and TDI smear, in closed form.

    The raster's turned edges are steps of a raster pixel: seen over many of them, a box of 0.05 mm. Along an edge's
    normal, 5 degrees off, that differs by less than 1 %.
    """
    camera = ruler_press_file(f_number).camera()
    sensor = camera.sensors[0]
    step = MM_PER_INCH / RASTER_DPI
    per_mm = FREQUENCIES / (sensor.pixel_pitch_um * 1e-3)
    curves = sharpness(camera, sensor, per_mm)
    across = curves.across * np.sinc(FREQUENCIES * step / camera.pixel_pitch_mm)
    along = curves.along * np.sinc(FREQUENCIES * step / camera.pixel_pitch_mm)
    pixels_a_line = camera.line_pitch_mm / camera.pixel_pitch_mm
    return _half(across), _half(along) * pixels_a_line


def _half(curve: np.ndarray) -> float:
    at = int(np.argmax(curve < 0.5))
    share = (curve[at - 1] - 0.5) / (curve[at - 1] - curve[at])
    return float(FREQUENCIES[at - 1] + share * (FREQUENCIES[at] - FREQUENCIES[at - 1]))
