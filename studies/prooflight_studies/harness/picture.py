"""How the pictures of studies look."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from prooflight.files.atomic import whole_file

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes


def new_figure(
    width_inch: float, height_inch: float, *, dpi: float = 110, pads_inch: tuple[float, float] = (0.08, 0.06)
) -> Figure:
    """An empty figure that lays itself out; pads_inch: beside and above its axes."""
    layout = ConstrainedLayoutEngine(w_pad=pads_inch[0], h_pad=pads_inch[1])
    figure = Figure(figsize=(width_inch, height_inch), dpi=dpi, layout=layout)
    FigureCanvasAgg(figure)
    return figure


def plain_axes(axes: Axes) -> None:
    """Two spines, and a faint grid behind what is drawn."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(visible=True, color="#eeeeee")
    axes.set_axisbelow(True)


def legend_below(figure: Figure, axes: Axes, *, columns: int, size_pt: float) -> None:
    """What ``axes`` show, for all axes of a figure."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=size_pt)


def write_figure(figure: Figure, path: Path) -> None:
    """As PNG, whole or not at all."""
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, format="png")
