"""Picture of a page with its zones."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon
from numpy.typing import NDArray
from PIL import Image

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zone import Kind, Zone

STYLES: Final[dict[Kind, tuple[str, str]]] = {
    "ignore": ("#6b6b6b", "////"),
    "normal": ("#0072b2", ""),
    "careful": ("#d55e00", ""),
}
"""Colour and hatching of each kind; hatching and line width distinguish them without colour."""
WIDTH_INCH: Final = 6.5
MOST_PX: Final = 1200
PALE: Final = 0.55
"""Strength of the page's own image, so that zones stand out."""
PALE_COLOUR: Final = 0.12
"""Opacity of a zone's colour."""
NAMED: Final = 24
"""Greatest number of zones that are labelled in the picture."""


def zones_picture(page: Page, zones: Sequence[Zone]) -> Image.Image:
    """Draw the page in millimetres, with its zones and their names."""
    height = WIDTH_INCH * page.height_mm / page.width_mm
    figure = Figure(figsize=(WIDTH_INCH, height + 0.9), dpi=110, layout="constrained")
    axes = figure.add_subplot()
    axes.imshow(_pale(page), extent=(0, page.width_mm, page.height_mm, 0), interpolation="antialiased")
    for zone in zones:
        colour, hatch = STYLES[zone.kind]
        line = 2.2 if zone.kind == "careful" else 1.2
        axes.add_patch(
            Polygon(
                zone.corners_mm,
                closed=True,
                facecolor=to_rgba(colour, PALE_COLOUR),
                edgecolor=colour,
                hatch=hatch,
                linewidth=line,
            )
        )
    for zone in zones[:NAMED]:
        x, y, width, _ = zone.box
        axes.text(
            x + 0.01 * page.width_mm,
            y + 0.01 * page.width_mm,
            _short(zone.name, width / page.width_mm),
            fontsize=8,
            color="black",
            va="top",
            bbox={"facecolor": "white", "edgecolor": STYLES[zone.kind][0], "pad": 1.5, "alpha": 0.9},
        )
    axes.set(xlabel="x [mm]", ylabel="y [mm]", xlim=(0, page.width_mm), ylim=(page.height_mm, 0))
    axes.set_title(f"{page.name}: zones", loc="left", fontsize=10)
    legend = [
        Patch(facecolor=to_rgba(colour, PALE_COLOUR), edgecolor=colour, hatch=hatch, label=kind)
        for kind, (colour, hatch) in STYLES.items()
        if any(zone.kind == kind for zone in zones)
    ]
    figure.legend(handles=legend, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return Image.open(file)


def _short(name: str, share: float) -> str:
    """Shorten a name to what a zone of that share of the page's width can hold."""
    most = max(int(70 * share), 6)
    return name if len(name) <= most else f"{name[: most - 1]}…"


def _pale(page: Page) -> NDArray[np.float32]:
    """Return the page as screens show CMYK without a profile, paler."""
    rows, columns = page.cmyk.shape[:2]
    scale = min(MOST_PX / max(rows, columns), 1.0)
    size = max(round(columns * scale), 1), max(round(rows * scale), 1)
    left = 1 - cv2.resize(page.cmyk, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    return np.asarray(1 - PALE * (1 - left[..., :3] * left[..., 3:]), np.float32)
