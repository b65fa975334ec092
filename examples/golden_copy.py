"""# Judge scans with a golden copy

Where no raster says what was to be printed, a scan of a good print can stand in for it. Here a simulated press prints
a page on several days, and each print is scanned into a TIFF file, as a scanner would: grey, with its resolution. The
first is taken for good; the others are compared with it.

The picture: the golden scan and the others, with the places that differ by more than good prints do.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import tifffile
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import prooflight as pf
from prooflight.inspection.golden import GoldenInspector, golden_pages
from prooflight.simulation.corpus.corpus import Corpus

PRINTS = {"good": None, "spots": "spots-voids:0.9", "missing": "missing-content:0.3"}


def scan_to_file(path: Path, page: pf.Page, press: pf.Press, misprint: str | None, *, day: int) -> None:
    """Print a page on a day of its own in the press world, and scan it."""
    scan = pf.simulate(page, press, misprint=misprint, world="press", seed=day)
    geometry = press.geometry
    dpi = [25.4 / pitch_mm for pitch_mm in (geometry.pixel_pitch_mm, geometry.line_pitch_mm)]
    tifffile.imwrite(
        path,
        (scan.dn[0] * np.uint16(16)),  # 12 bits in 16
        photometric="minisblack",
        resolution=(dpi[0], dpi[1]),
        resolutionunit="inch",
    )


def main(out: Path) -> None:
    """Print, scan, compare, draw."""
    press = pf.build_press(pf.PressFile.prototype(), seed=1, pixels=400)
    page = replace(Corpus(seed=5, dpi=95.0).page(5), dpi=press.dpi)
    scans = out / "scans"
    scans.mkdir(parents=True, exist_ok=True)
    golden = out / "golden.tif"
    scan_to_file(golden, page, press, None, day=1)
    for day, (name, misprint) in enumerate(PRINTS.items(), start=2):
        scan_to_file(scans / f"{name}.tif", page, press, misprint, day=day)

    pairs = golden_pages(golden, scans)
    judge = GoldenInspector.of(None, pairs[0].goldens[0])
    figure = Figure(figsize=(12, 4.6), layout="constrained")
    first, *others = figure.subplots(1, 1 + len(pairs))
    first.imshow(tifffile.imread(golden), cmap="gray")
    first.set_title("golden")
    for axes, pair in zip(others, pairs, strict=True):
        verdict = judge(pair)
        verdict.show()
        axes.imshow(tifffile.imread(scans / f"{pair.name}.tif"), cmap="gray")
        axes.set_title(f"{pair.name}: {verdict.verdict}")
        pixel_mm = press.geometry.pixel_pitch_mm
        for region in verdict.regions:
            corner = region.x_mm / pixel_mm, region.y_mm / pixel_mm
            size = region.width_mm / pixel_mm, region.height_mm / pixel_mm
            axes.add_patch(Rectangle(corner, *size, fill=False, color="#d8431f", lw=1.5))
    for axes in (first, *others):
        axes.set_axis_off()
    figure.savefig(out / "golden.png", dpi=110)


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]))  # the folder for what is drawn; without one, this folder
