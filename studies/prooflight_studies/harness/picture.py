"""Common style of the studies' figures."""

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
    """Return an empty figure with automatic layout; pads_inch: space to the sides of and above its axes."""
    layout = ConstrainedLayoutEngine(w_pad=pads_inch[0], h_pad=pads_inch[1])
    figure = Figure(figsize=(width_inch, height_inch), dpi=dpi, layout=layout)
    FigureCanvasAgg(figure)
    return figure


def plain_axes(axes: Axes) -> None:
    """Show two spines, and a faint grid behind the data."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(visible=True, color="#eeeeee")
    axes.set_axisbelow(True)


def legend_below(figure: Figure, axes: Axes, *, columns: int, size_pt: float) -> None:
    """Add one legend of ``axes`` below all axes of a figure."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=size_pt)


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whole or not at all."""
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, format="png")
