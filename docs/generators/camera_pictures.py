"""Pictures of docs/how-to/line-cameras.md: a ruler page, and what `camera view` draws of it.

Run ``python -m docs.generators.camera_pictures`` in the root of the repository. The camera is the prototype's,
simulated: it sees the ruler page that ``chart make --ruler`` prints, with its noise (seed 1).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.inks.ruler_layout import RulerLayout
from prooflight.inks.ruler_print import RASTER_DPI, ruler_raster
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.press.press_file import PressFile
from prooflight.rng import stream
from prooflight_line.camera_set_up.page_steps import lens_mtf50
from prooflight_line.camera_set_up.seen import sensor_views
from prooflight_line.cameras.camera import Health
from prooflight_line.reporting.camera_live import CameraShown, draw_camera

IMAGES = Path(__file__).parents[1] / "images"
SHOWN_LINES = 2400


def main() -> None:
    """Write both."""
    raster = ruler_raster(RulerLayout())
    left = 1 - raster.astype(np.float32) / 255
    rgb = 255 * left[..., :3] * left[..., 3:]
    small = cv2.resize(rgb, None, fx=0.15, fy=0.15, interpolation=cv2.INTER_AREA)
    framed = cv2.copyMakeBorder(small, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(170, 170, 170))
    cv2.imwrite(str(IMAGES / "ruler.png"), framed[..., ::-1].astype(np.uint8))

    file = PressFile.prototype()
    press, camera = build_press(file, seed=1), file.camera()
    page = Page(cmyk=raster, dpi=RASTER_DPI, name="ruler", number=1)
    seen = predict(page, sensors=press.sensors, geometry=press.geometry)
    noise = stream(1, "print", 0).standard_normal(seen.expected_dn.shape) * np.sqrt(seen.variance_dn2)
    lines = np.clip(np.round(seen.expected_dn + noise), 0, 4095).astype(np.uint16)[:, :SHOWN_LINES]
    shown = CameraShown(
        camera="Basler-raL2048-23456789 (simulated)",
        form=f"1 x {lines.shape[2]} pixels, Mono12",
        top_code_dn=4095,
        lines=lines,
        views=sensor_views(lines, top_code_dn=4095, where="camera"),
        health=replace(
            Health(), lines=lines.shape[1], lines_per_s=2770.0, buffers_free=256, temperature_c=41.5
        ),
        lens_mtf50=lens_mtf50(camera, camera.sensors[0]),
    )
    draw_camera(IMAGES / "camera-view.png", shown)


if __name__ == "__main__":
    main()
