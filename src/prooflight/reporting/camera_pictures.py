"""Curves of a camera as pictures (PNG): sharpness, designs side by side, photon transfer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from prooflight.files.atomic import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
"""Hues that all common colour-vision deficiencies can distinguish (Okabe and Ito 2008)."""
DASHES = ("-", "--", ":", "-.")
MOST_LABELS = 12
_POINTS = 200


def draw_curves(
    path: Path,
    x: NDArray[np.float64],
    curves: Mapping[str, NDArray[np.float64]],
    *,
    x_label: str,
    y_label: str,
    title: str,
    mark: tuple[float, str] | None = None,
) -> None:
    """Write curves over common x (n,), each (n,); ``mark`` is a position on x and its name."""
    figure, (axes,) = _panels(1)
    for (label, y), colour in zip(curves.items(), COLOURS * len(curves), strict=False):
        axes.plot(x, y, color=colour, label=label, marker="." if x.size < _POINTS / 4 else "")
    if mark is not None:
        place, name = mark
        axes.axvline(place, color="#888888", linewidth=0.8)
        axes.text(
            place,
            1.0,
            f"{name} ",
            color="#666666",
            ha="right",
            va="top",
            transform=axes.get_xaxis_transform(),
        )
    axes.set(xlabel=x_label, ylabel=y_label, title=title, ylim=(0, None))
    axes.legend(frameon=False)
    _write(figure, path)


def draw_designs(
    path: Path,
    values: Sequence[int | float | str],
    panels: Mapping[str, Mapping[tuple[str, str], Sequence[float]]],
    *,
    field: str,
) -> None:
    """Write one panel for each quantity, with curves over the values of ``field``; names are evenly spaced.

    The key of a curve is what it shows, which gives its colour, and its design, which gives its dashes.
    """
    figure, axes_of = _panels(len(panels))
    numbers = [value for value in values if not isinstance(value, str)]
    named = len(numbers) < len(values)
    x = np.arange(len(values), dtype=np.float64) if named else np.array(numbers, dtype=np.float64)
    order = np.argsort(x, kind="stable")
    for axes, (quantity, curves) in zip(axes_of, panels.items(), strict=True):
        shown = list(dict.fromkeys(what for what, _ in curves))
        of = list(dict.fromkeys(which for _, which in curves))
        for (what, which), y in curves.items():
            colour, dash = COLOURS[shown.index(what)], DASHES[of.index(which) % len(DASHES)]
            label = f"{what}, {which}" if which else what
            axes.plot(x[order], np.array(y)[order], dash, color=colour, marker=".", label=label)
        axes.set(xlabel=field, title=quantity, ylim=(0, None))
        if named:
            axes.set_xticks(x, [str(value) for value in values])
        if len(curves) <= MOST_LABELS:
            axes.legend(frameon=False, fontsize=7, handlelength=3)
    _write(figure, path)


def draw_photon_transfer(
    path: Path,
    sensors: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], float, float]],
) -> None:
    """Write variance against mean with the fitted line, one panel a sensor.

    sensors: by name, means (n,) and variances (n,) of the exposures [DN, DN^2], whether each was fitted (n,),
    and the line's constant [DN^2] and gain [DN/e-].
    """
    figure, axes_of = _panels(len(sensors))
    for axes, (name, (mean, variance, used, constant, gain)) in zip(axes_of, sensors.items(), strict=True):
        x = np.linspace(0, mean.max(), _POINTS)
        axes.plot(x, constant + gain * x, color=COLOURS[0], label=f"{gain:.5g} DN/e- x mean + {constant:.3g}")
        axes.plot(mean[used], variance[used], "o", color=COLOURS[0], markersize=4, label="fitted")
        axes.plot(mean[~used], variance[~used], "x", color=COLOURS[1], markersize=4, label="not fitted")
        title = f"Photon transfer, sensor {name}"
        axes.set(xlabel="mean [DN]", ylabel="temporal variance [DN^2]", title=title)
        axes.set_ylim(0, 1.1 * max(float(variance.max()), constant + gain * float(mean[used].max())))
        axes.legend(frameon=False)
    _write(figure, path)


def _panels(count: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(6.4 if count == 1 else 4.6 * count, 4.2), dpi=110, layout="constrained")
    axes_of = [figure.add_subplot(1, count, place + 1) for place in range(count)]
    for axes in axes_of:
        axes.spines[["top", "right"]].set_visible(False)
    return figure, axes_of


def _write(figure: Figure, path: Path) -> None:
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, format="png")
