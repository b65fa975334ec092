"""The page ``corpus.md``: what designs are like beside real pages, in words, tables and pictures."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import stats

from prooflight.files.atomic import whole_file
from prooflight.simulation.corpus.corpus import BLACK_ALONE
from prooflight_studies.corpus.figures import CAMERA_PIXEL_MM, EDGE_CONTRAST, NAMES, in_black

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

SIGNIFICANCE: Final = 0.05


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


def write_corpus_page(
    path: Path,
    ours: NDArray[np.float64],
    theirs: NDArray[np.float64] | None,
    *,
    seed: int,
    dpi: float,
    times: Mapping[float, Sequence[float]],
    sheets: Sequence[Path],
) -> None:
    """Write the page, whole or not at all, and beside it the picture of the distributions.

    ours, theirs: tables of designs and of real pages; times: of drawing, by resolution; sheets: contact sheets, there
    already.
    """
    sections = [
        "# Page designs for studies",
        _introduction(ours, theirs, seed=seed, dpi=dpi),
        "## Beside real pages",
        _figures_table(ours, theirs),
    ]
    if theirs is not None:
        draw_distributions(path.with_name("corpus-figures.png"), ours, theirs)
        sections += ["![How the figures spread](corpus-figures.png)"]
    sections += ["## What it costs", _times(times), "## To leaf through"]
    sections += [
        f"![Designs of seed {seed}, sheet {number}]({sheet.name})" for number, sheet in enumerate(sheets, 1)
    ]
    with whole_file(path) as unfinished:
        unfinished.write_text("\n\n".join(sections) + "\n", encoding="utf-8")


def _introduction(
    ours: NDArray[np.float64], theirs: NDArray[np.float64] | None, *, seed: int, dpi: float
) -> str:
    black = int(in_black(ours).sum())
    text = (
        "Studies learn and test on composed designs, any number from a seed (`studies.corpus`). This page looks at the"
        f" first {len(ours)} of seed {seed} at {dpi:g} dpi. `prooflight study corpus` wrote it.\n\n"
        f"{black} of the {len(ours)} are in one ink, black: each design is with a chance of {BLACK_ALONE:.0%}. That is"
        " a little above the share among the real pages below, because much of what digital presses print is"
        " statements, forms, books and manuals; the figure is assumed. The others are in four inks, with pictures"
        " separated with grey component replacement, of another strength in every design."
    )
    if theirs is None:
        return text
    return (
        f"{text}\n\nHow often each kind comes was tuned on designs of another seed, against these {len(theirs)} real"
        " pages: the table says that designs are like them, not that they are like pages nobody looked at. The real"
        " pages were collected for variety and are no sample of what presses print."
    )


def _figures_table(ours: NDArray[np.float64], theirs: NDArray[np.float64] | None) -> str:
    edges = (
        f"`edges` are pixels of {CAMERA_PIXEL_MM} mm in whose 3 x 3 neighbourhood the luminance spans more than"
        f" {EDGE_CONTRAST:.0%} of paper white. Each cell: lower quartile / **median** / upper quartile."
    )
    if theirs is None:
        rows = [f"| {name} | {_quartiles(row)} |" for name, row in zip(NAMES.values(), ours.T, strict=True)]
        return "\n".join([edges, "", f"| share | {len(ours)} designs |", "|---|---:|", *rows])
    lines = [edges, "", f"| share | {len(ours)} designs | {len(theirs)} real pages | KS distance |"]
    lines.append("|---|---:|---:|---:|")
    for name, row, other in zip(NAMES.values(), ours.T, theirs.T, strict=True):
        distance = stats.ks_2samp(row, other).statistic
        lines.append(f"| {name} | {_quartiles(row)} | {_quartiles(other)} | {distance:.2f} |")
    black = [f"{in_black(figures).sum()} ({in_black(figures).mean():.0%})" for figures in (ours, theirs)]
    lines.append(f"| pages in black alone | {black[0]} | {black[1]} | |")
    bound = np.sqrt(-0.5 * np.log(SIGNIFICANCE / 2) * (1 / len(ours) + 1 / len(theirs)))
    lines.append(
        "\n`KS distance` is the greatest difference between the two cumulative distributions (Kolmogorov-Smirnov); two"
        f" samples of the same kind differ by more than {bound:.2f} in {SIGNIFICANCE:.0%} of cases."
    )
    return "\n".join(lines)


def _quartiles(values: NDArray[np.float64]) -> str:
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
    return f"{low:.1%} / **{middle:.1%}** / {high:.1%}".replace("%", " %")


def _times(times: Mapping[float, Sequence[float]]) -> str:
    lines = ["| resolution | designs | mean | slowest |", "|---|---:|---:|---:|"]
    for dpi, taken in times.items():
        lines.append(f"| {dpi:g} dpi | {len(taken)} | {np.mean(taken):.3f} s | {max(taken):.2f} s |")
    load = os.getloadavg()[0]
    lines.append(
        "\nProcessor seconds of one core to draw a design on the machine that wrote this page"
        f" ({os.cpu_count()} cores, load {load:.1f})."
    )
    return "\n".join(lines)
