"""The picture ``registration.png``: how far prints lie from where they are said to lie."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight_studies.harness.picture import new_figure, plain_axes, write_figure

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

PANEL_INCH: Final = (5.2, 3.9)
COLOURS: Final = ("#2b6cb0", "#c05621", "#2f855a")
GOAL_PIXELS: Final = 0.12


def draw_registration(
    path: Path,
    errors: Mapping[str, NDArray[np.float64]],
    white: NDArray[np.float64],
    good: NDArray[np.float64],
    real: NDArray[np.bool_],
) -> None:
    """Left: shares of scans (n,) of each name below an error; right: good prints' errors by how white the page is.

    errors, good: rms with the local field, where there is content [pixels]; white (n,): shares; real (n,): real pages.
    """
    figure = new_figure(2 * PANEL_INCH[0], PANEL_INCH[1], pads_inch=(0.1, 0.1))
    left, right = figure.subplots(1, 2)
    for (name, values), colour in zip(errors.items(), COLOURS, strict=False):
        ordered = np.sort(values[np.isfinite(values)])
        shares = (np.arange(ordered.size) + 1) / max(ordered.size, 1)
        left.step(
            ordered, 100 * shares, where="post", color=colour, label=f"{name} ({ordered.size} scans found)"
        )
    left.axvline(GOAL_PIXELS, color="0.4", linestyle="--", linewidth=1, label="goal, rms of good prints")
    left.set(xlabel="Error of a scan, rms [pixels]", ylabel="Scans with less [%]", ylim=(0, 102))
    left.legend(loc="lower right", frameon=False)
    for kind, mask, mark, colour in (
        ("composed", ~real, "o", COLOURS[0]),
        ("real page", real, "^", COLOURS[1]),
    ):
        right.plot(100 * white[mask], good[mask], mark, color=colour, markersize=4, alpha=0.6, label=kind)
    right.axhline(GOAL_PIXELS, color="0.4", linestyle="--", linewidth=1)
    right.set(xlabel="White of the page [%]", ylabel="Error of a good print, rms [pixels]", ylim=(0, None))
    right.legend(loc="upper left", frameon=False)
    for axes in (left, right):
        plain_axes(axes)
    left.set_xlim(0.02, None)
    left.set_xscale("log")
    ticks = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
    left.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    left.minorticks_off()
    write_figure(figure, path)
