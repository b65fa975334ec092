"""# Predict a page and look at it

Before a page is printed, its raster says what the camera must see of it: each recipe of inks has a light, the lens
and the pixels blur it, and each column has its own gain and offset. How sure that is follows too: the noise of every
pixel.

The picture: the page as it was designed, the lines that the camera must see, how noisy each pixel will be, and a
simulated scan of a good print less its prediction, in units of that noise. Nothing of the page is left in the last
one.
"""

from __future__ import annotations

import io
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import prooflight as pf
from prooflight.simulation.corpus.corpus import Corpus


def main(out: Path) -> None:
    """Build a press, predict a composed page at a fifth of its size, compare a scan with it."""
    press = pf.build_press(pf.PressFile.prototype(), seed=1, pixels=400)
    page = replace(Corpus(seed=5, dpi=95.0).page(5), dpi=press.dpi)
    seen = pf.predict(page, press)
    sensors, lines, pixels = seen.expected_dn.shape
    pitch_mm = press.geometry.pixel_pitch_mm
    print(f"{page.width_mm:.1f} x {page.height_mm:.1f} mm at {page.dpi:.0f} dpi")
    print(f"seen as {sensors} sensor x {lines} lines x {pixels} pixels of {pitch_mm:.3f} mm")

    scan = pf.simulate(page, press, seed=1)
    noise_dn = np.sqrt(seen.variance_dn2)
    off = (scan.dn - seen.expected_dn) / noise_dn
    print(f"a good print is off by {off.std():.3f} standard deviations, {np.abs(off).max():.1f} at most")

    figure = Figure(figsize=(12, 5.4), layout="constrained")
    designed, expected, noise, difference = figure.subplots(1, 4)
    rows, columns = page.cmyk.shape[:2]
    designed.imshow(Image.open(io.BytesIO(page._repr_png_())).resize((columns, rows)))
    designed.set_title("Designed")
    for axes, image, title, unit, look in (
        (expected, seen.expected_dn[0], "Must be seen", "DN", {"cmap": "gray", "vmin": 0}),
        (noise, noise_dn[0], "Its standard deviation", "DN", {"cmap": "viridis"}),
        (difference, off[0], "A good scan less that", "sigma", {"cmap": "RdBu", "vmin": -5, "vmax": 5}),
    ):
        shown = axes.imshow(image, **look)
        figure.colorbar(shown, ax=axes, location="bottom", label=unit, shrink=0.9)
        axes.set_title(title)
    for axes in (designed, expected, noise, difference):
        axes.set_axis_off()
    figure.savefig(out / "prediction.png", dpi=110)


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]))  # the folder for what is drawn; without one, this folder
