"""Picture of a calibration: its fit and what it learned."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from prooflight.files.atomic import whole_file
from prooflight.reporting.camera_pictures import COLOURS
from prooflight.reporting.press_pictures import draw_footprint

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from prooflight.commissioning.chart.calibrate import Calibration

_PANEL_INCH: Final = (4.6, 3.9)
_MOST_MAPS: Final = 3
_SIDE_MM: Final = 8.0


def draw_calibration(path: Path, calibration: Calibration) -> None:
    """Write one figure (PNG): residuals by position, measured against fitted, noise, and a pixel's footprint."""
    scans = calibration.learned.scans
    maps = min(len(scans), _MOST_MAPS)
    figure = Figure(
        figsize=(_PANEL_INCH[0] * 3, _PANEL_INCH[1] * 2.4),
        dpi=110,
        layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.12),
    )
    patches = len(calibration.patches)
    figure.suptitle(
        f"Press {calibration.press.name}:  {patches} patches in {len(scans)} scan{'s' * (len(scans) > 1)}, "
        f"{calibration.learned.fit.model.name}",
        x=0.01,
        ha="left",
        fontsize=12,
    )
    halves = figure.add_gridspec(2, 1, height_ratios=(1.35, 1))
    upper, lower = figure.add_subfigure(halves[0]), figure.add_subfigure(halves[1])
    worst = np.array([max(patch.residual_sigma, key=abs) for patch in calibration.patches])
    limit = max(float(np.percentile(np.abs(worst), 98)), 0.1)
    shown = [upper.add_subplot(1, maps, place + 1) for place in range(maps)]
    for number, axes in enumerate(shown):
        _map(axes, calibration, number, worst, limit)
    bar = upper.colorbar(shown[-1].collections[0], ax=shown, shrink=0.8, pad=0.01)
    bar.set_label("measured - fitted, worst sensor [sigma of a pixel]")
    panels = [lower.add_subplot(1, 3, place + 1) for place in range(3)]
    _fitted(panels[0], calibration)
    _noise(panels[1], calibration)
    draw_footprint(panels[2], calibration.press)
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, format="png")


def _map(axes: Axes, calibration: Calibration, number: int, worst: NDArray[np.float64], limit: float) -> None:
    """Draw the residuals of one scan at the positions of its patches."""
    scan = calibration.learned.scans[number]
    here = calibration.learned.fit.scan == number
    used = calibration.learned.fit.used[here]
    corners = scan.patches.centre_mm
    side = _side_mm(corners)
    squares = [Rectangle((x - side / 2, y - side / 2), side, side) for x, y in corners.tolist()]
    collection = PatchCollection(squares, cmap="RdBu_r", edgecolor="none")
    collection.set_array(worst[here])
    collection.set_clim(-limit, limit)
    axes.add_collection(collection)
    aside = corners[~used]
    axes.plot(aside[:, 0], aside[:, 1], "kx", markersize=4)
    low, high = corners.min(axis=0) - side, corners.max(axis=0) + side
    axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), aspect="equal")
    axes.set_title(
        f"{scan.name}, page {scan.chart.page}" + (", x: set aside" if len(aside) else ""), fontsize=10
    )
    axes.set(xlabel="across the sheet [mm]", ylabel="down the sheet [mm]" if number == 0 else "")
    axes.spines[:].set_visible(False)


def _side_mm(corners: NDArray[np.float64]) -> float:
    """Return the side of the squares that represent patches: nine tenths of their pitch."""
    places = np.unique(np.round(corners[:, 0], 2))
    return float(0.92 * np.diff(places).min()) if places.size > 1 else _SIDE_MM


def _fitted(axes: Axes, calibration: Calibration) -> None:
    for index, sensor in enumerate(calibration.press.sensors):
        fitted = np.array([patch.fitted_dn[index] for patch in calibration.patches])
        away = np.array([patch.measured_dn[index] for patch in calibration.patches]) - fitted
        colour = COLOURS[index % len(COLOURS)]
        axes.plot(fitted, away, ".", color=colour, markersize=3, alpha=0.7)
        rms = calibration.residual_sigma[index]
        axes.plot([], [], "o", color=colour, label=f"{sensor.name}: {rms:.2f} sigma rms")
    axes.axhline(0, color="#000000", linewidth=0.8)
    axes.set(title="Measured against fitted", xlabel="fitted [DN]", ylabel="measured - fitted [DN]")
    axes.legend(frameon=False, fontsize=8)


def _noise(axes: Axes, calibration: Calibration) -> None:
    for index, sensor in enumerate(calibration.press.sensors):
        colour = COLOURS[index % len(COLOURS)]
        dn = np.concatenate([scan.patches.dn[index] for scan in calibration.learned.scans])
        seen = np.concatenate([scan.patches.pixel_variance_dn2[index] for scan in calibration.learned.scans])
        noise = calibration.learned.noise[index]
        axes.plot(dn, np.sqrt(seen), ".", color=colour, markersize=3, alpha=0.25)
        signal = np.linspace(0, dn.max(), 200)
        axes.plot(signal, np.sqrt(noise.variance_dn2(signal)), color=colour, linewidth=2, label=sensor.name)
    axes.set(
        title="Noise: line without halftone, dots as read",
        xlabel="signal [DN]",
        ylabel="sigma [DN]",
        ylim=(0, None),
    )
    axes.legend(frameon=False, fontsize=8, loc="lower right")
