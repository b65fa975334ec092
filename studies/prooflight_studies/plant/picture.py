"""The confusion of causes, and one press with and without corrections."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight_studies.harness.picture import new_figure, plain_axes, write_figure
from prooflight_studies.plant.loop import loop_run

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Mapping, Sequence
    from pathlib import Path


def draw_causes(path: Path, confusion: Mapping[str, Counter[str]], causes: Sequence[str], seed: int) -> None:
    """Draw how often each cause was answered, and the deviation of one run from sheet to sheet."""
    answers = [*causes, *sorted({name for row in confusion.values() for name in row} - set(causes))]
    counts = np.array([[confusion[cause][name] for name in answers] for cause in confusion])
    figure = new_figure(11, 4.6)
    left, right = figure.subplots(1, 2)
    left.imshow(counts, cmap="Blues", aspect="auto")
    for (row, column), number in np.ndenumerate(counts):
        if number:
            colour = "white" if number > counts.max() / 2 else "black"
            left.text(column, row, str(number), ha="center", va="center", fontsize=8, color=colour)
    left.set_xticks(range(len(answers)), answers, rotation=45, ha="right", fontsize=8)
    left.set_yticks(range(len(confusion)), list(confusion), fontsize=8)
    left.set(xlabel="named", ylabel="true")
    for label, damping, colour in (
        ("as it drifts", None, "#999999"),
        ("corrected as offered", 0.5, "#1f77b4"),
    ):
        deviation = loop_run(seed, 0, damping=damping).deviation[0]
        right.plot(deviation, color=colour, label=label, linewidth=1)
    right.axhspan(-1, 1, color="#5cb85c", alpha=0.15, linewidth=0)
    right.set(xlabel="sheet", ylabel="density of black, in tolerances")
    right.legend(fontsize=8, frameon=False)
    plain_axes(right)
    write_figure(figure, path)
