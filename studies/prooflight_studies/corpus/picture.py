"""How figures of designs and of real pages spread, as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.files.atomic import whole_file
from prooflight_studies.corpus.figures import NAMES

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray


def draw_distributions(path: Path, drawn: NDArray[np.float64], real: NDArray[np.float64]) -> None:
    """Share of pages at or below a value, for every figure, designs and real pages."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 4.4), layout="constrained")
    for axes, name, ours, theirs in zip(
        figure.subplots(2, 4, sharey=True).flat, NAMES.values(), drawn.T, real.T, strict=True
    ):
        axes.ecdf(theirs, color="0.6", linewidth=2.5, label="real pages")
        axes.ecdf(ours, color="#0a6ebd", linewidth=1.2, label="designs")
        axes.set_title(name.split(",")[0], fontsize=9)
        axes.tick_params(labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].legend(fontsize=7, frameon=False, loc="upper left")
    figure.supylabel("share of pages", fontsize=8)
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, dpi=110, format="png")
