"""Maps of the marks that would be caught on a page, beside the page, to scale."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Patch
from numpy.typing import NDArray
from PIL import Image

from prooflight.detectors.cost import floor_text
from prooflight.detectors.optional import ShowsVisibleMarks
from prooflight.files.atomic import whole_file
from prooflight.reporting.pictures import encoded, page_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from prooflight.detectors.visible_marks import PlaceRow, VisibleMarks
    from prooflight.inspection.inspector import Inspector
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

SPOT_STEPS_MM: Final = (0.0, 0.2, 0.3, 0.4, 0.6, 0.8, 1.2, 2.0, 4.0)
HAIR_STEPS_MM: Final = (0.0, 0.03, 0.06, 0.1, 0.2, 0.4, 0.8, 1.4, 2.0)
COLOURS: Final = ("#f3f7ee", "#dcedd0", "#b4dcc0", "#83c5be", "#53a8b8", "#3486ab", "#31619a", "#33397a")
"""Colours of the steps: the larger a mark must be, the darker."""
NONE_COLOUR: Final = "#d55e00"
"""Colour of places where no mark that is tried is caught."""
_PANEL_INCH: Final = 4.6
_PAGE_PX: Final = 700
_REPORT_PX: Final = 1100


@dataclass(frozen=True, slots=True, kw_only=True)
class VisibleOnPage:
    """Marks that would be caught on one page, for a report."""

    page: str
    picture: bytes
    """Image as WebP."""
    rows: tuple[PlaceRow, ...]
    floor: str
    """Description of what is always a misprint; empty if there is no floor."""

    @classmethod
    def of(cls, inspector: Inspector, page: Page) -> Self | None:
        """Return the marks of a page as it lies in the press; None if the inspector's detector has no such map."""
        if not isinstance(inspector.detector, ShowsVisibleMarks):
            return None
        marks, press = inspector.detector.visible_marks(inspector.planned(page)), inspector.press
        file = io.BytesIO()
        visibility_figure(marks, page, press).savefig(file, format="png")
        picture = Image.open(file).convert("RGB")
        picture.thumbnail((_REPORT_PX, _REPORT_PX), Image.Resampling.LANCZOS)
        return cls(
            page=page.name,
            picture=encoded(picture, quality=88),
            rows=tuple(marks.rows()),
            floor=floor_text(press.floor_share),
        )


def draw_visibility(path: Path, marks: VisibleMarks, page: Page, press: Press) -> None:
    """Write the page and its maps as a picture (PNG)."""
    figure = visibility_figure(marks, page, press)
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, format="png")


def visibility_figure(marks: VisibleMarks, page: Page, press: Press) -> Figure:
    """Return the page as a person sees it, and the smallest spot and narrowest hair that alarm at each place."""
    width_mm, height_mm = marks.page_mm
    ratio = height_mm / width_mm
    panel = _PANEL_INCH / max(ratio, 1.0)
    figure = Figure(
        figsize=(3 * panel + 3.4, panel * ratio + 1.5),
        dpi=120,
        layout=ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.08),
    )
    figure.suptitle(
        f"What would be caught on {page.name}, {width_mm:.0f} x {height_mm:.0f} mm, press {press.name}",
        x=0.01,
        ha="left",
        fontsize=11,
    )
    shown, spot, hair = figure.subplots(1, 3)
    shown.imshow(page_picture(page, press, width_px=_PAGE_PX), extent=(0, width_mm, height_mm, 0))
    shown.set_title("the page", fontsize=10)
    _map(figure, spot, marks, marks.spot_mm, SPOT_STEPS_MM, "smallest black spot", "diameter [mm]")
    _map(figure, hair, marks, marks.hair_mm, HAIR_STEPS_MM, "narrowest hair, 6 mm long", "width [mm]")
    for axes in (shown, spot, hair):
        axes.set(xlim=(0, width_mm), ylim=(height_mm, 0), aspect="equal", xlabel="x [mm]")
        axes.tick_params(labelsize=8)
    shown.set_ylabel("y [mm]")
    figure.legend(
        handles=[
            Patch(facecolor=NONE_COLOUR, label="none of the scale is caught by small windows or the floor"),
            Patch(facecolor="white", edgecolor="#888888", hatch="////", label="not inspected"),
        ],
        loc="outside lower left",
        ncols=2,
        frameon=False,
        fontsize=9,
    )
    return figure


def _map(
    figure: Figure,
    axes: Axes,
    marks: VisibleMarks,
    sizes_mm: NDArray[np.float32],
    steps_mm: tuple[float, ...],
    title: str,
    label: str,
) -> None:
    """Draw sizes (lines, pixels) with their scale."""
    colours = ListedColormap(list(COLOURS)).with_extremes(over=NONE_COLOUR, bad=(1, 1, 1, 0))
    lines, pixels = sizes_mm.shape
    left, top = marks.left_mm, marks.top_mm
    axes.set_facecolor("white")
    axes.fill_between(
        [0, marks.page_mm[0]], 0, marks.page_mm[1], facecolor="white", edgecolor="#888888", hatch="////"
    )
    image = axes.imshow(
        np.ma.masked_invalid(np.where(np.isposinf(sizes_mm), 1e3, sizes_mm)),
        cmap=colours,
        norm=BoundaryNorm(steps_mm, len(COLOURS)),
        extent=(left, left + pixels * marks.pixel_mm, top + lines * marks.line_mm, top),
        interpolation="nearest",
        zorder=2,
    )
    axes.set_title(title, fontsize=10)
    bar = figure.colorbar(image, ax=axes, label=label, ticks=steps_mm, shrink=0.85)
    bar.ax.set_yticklabels([f"{step:g}" for step in steps_mm], fontsize=8)
