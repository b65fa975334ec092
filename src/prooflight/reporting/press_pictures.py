"""Picture of a press artefact: colours, mean and noise, columns, footprint."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from prooflight.files.atomic import whole_file
from prooflight.kernels.prediction.lookup import NODES
from prooflight.prediction.tables import SensorModel, node_fractions
from prooflight.reporting.camera_pictures import COLOURS, DASHES
from prooflight.reporting.pictures import appearance

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from prooflight.press.artefact import Press

RAMPS: Final = {
    "cyan": ((1, 0, 0, 0), "#0093d3", "-"),
    "magenta": ((0, 1, 0, 0), "#cc006b", "-"),
    "yellow": ((0, 0, 1, 0), "#d9b400", "-"),
    "black": ((0, 0, 0, 1), "#1a1a1a", "-"),
    "grey of C = M = Y": ((1, 1, 1, 0), "#808080", "--"),
}
"""Inks that rise together, colour and dashes of the curve, by name."""
_SWATCHES: Final = 256
_COLOURS_SHOWN: Final = 1200
_PANEL_INCH: Final = (4.3, 3.5)


def draw_press(path: Path, press: Press) -> None:
    """Write one figure (PNG) of everything that prediction takes from a press."""
    count = len(press.sensors) + 5
    columns = 3 if count <= 6 else 4
    rows = -(-count // columns)
    figure = Figure(
        figsize=(_PANEL_INCH[0] * columns, _PANEL_INCH[1] * rows + 0.4),
        dpi=110,
        layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.1),
    )
    inks = press.ink_facts.get("name", "unknown")
    pitch_um = press.geometry.pixel_pitch_mm * 1000
    heading = f"{press.geometry.pixels} pixels of {pitch_um:.1f} µm on paper, inks {inks}"
    figure.suptitle(f"Press {press.name}:  {heading}   ({press.digest[:16]})", x=0.01, ha="left", fontsize=11)
    panels = [figure.add_subplot(rows, columns, place + 1) for place in range(count)]
    _swatches(panels[0], press)
    for axes, sensor in zip(panels[1:], press.sensors, strict=False):
        _ramps(axes, sensor)
    noise, gain, offset, footprint = panels[-4:]
    _noise(noise, press)
    _columns(gain, offset, press)
    draw_footprint(footprint, press)
    for axes in panels[1:]:
        axes.spines[["top", "right"]].set_visible(False)
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, format="png")


def _swatches(axes: Axes, press: Press) -> None:
    """Draw the ramps as a person sees them."""
    levels = np.arange(_SWATCHES)
    recipes = np.stack([np.outer(levels, np.array(inks)) for inks, _, _ in RAMPS.values()])
    axes.imshow(
        appearance(recipes.astype(np.uint8), press.appearance_srgb),
        aspect="auto",
        extent=(0, 100, len(RAMPS) - 0.5, -0.5),
        interpolation="nearest",
    )
    axes.set_yticks(range(len(RAMPS)), [name.removeprefix("grey of ") for name in RAMPS])
    axes.tick_params(left=False)
    axes.spines[:].set_visible(False)
    axes.set(title="Colours as a person sees them", xlabel="ink [%]")


def _ramps(axes: Axes, sensor: SensorModel) -> None:
    percent = 100 * node_fractions()
    steps = np.arange(NODES)
    for name, (inks, colour, dash) in RAMPS.items():
        mean = sensor.mean_dn[tuple(steps * part for part in inks)]
        axes.plot(percent, mean, dash, color=colour, linewidth=1.8, label=name)
    axes.set(
        title=f"Sensor {sensor.name}: expected signal",
        xlabel="ink [%]",
        ylabel="mean above dark [DN]",
        xlim=(0, 100),
        ylim=(0, None),
    )
    axes.legend(frameon=False, fontsize=8)


def _noise(axes: Axes, press: Press) -> None:
    for index, sensor in enumerate(press.sensors):
        order = np.argsort(sensor.mean_dn, axis=None)[
            np.linspace(0, NODES**4 - 1, _COLOURS_SHOWN, dtype=np.intp)
        ]
        mean, sigma = sensor.mean_dn.ravel()[order], np.sqrt(sensor.variance_dn2.ravel()[order])
        colour, dash = COLOURS[index % len(COLOURS)], DASHES[index % len(DASHES)]
        axes.plot(mean, sigma, dash, color=colour, linewidth=1.8, label=sensor.name)
        axes.plot([0], [np.sqrt(sensor.dark_variance_dn2)], "o", color=colour, markersize=4)
        axes.annotate(
            f"paper: signal / sigma = {sensor.white_dn / np.sqrt(sensor.variance_dn2[0, 0, 0, 0]):.0f}",
            (sensor.white_dn, float(np.sqrt(sensor.variance_dn2[0, 0, 0, 0]))),
            xytext=(-8, 0),
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontsize=8,
            color=colour,
        )
    axes.set(
        title="Temporal noise of all colours",
        xlabel="mean above dark [DN]",
        ylabel="sigma [DN]",
        ylim=(0, None),
    )
    axes.set_xlim(left=min(0.0, axes.get_xlim()[0]))
    axes.legend(frameon=False, fontsize=8, loc="lower right")


def _columns(gain: Axes, offset: Axes, press: Press) -> None:
    geometry = press.geometry
    place_mm = (np.arange(geometry.pixels) + 0.5) * geometry.pixel_pitch_mm
    for index, sensor in enumerate(press.sensors):
        colour = COLOURS[index % len(COLOURS)]
        gain.plot(place_mm, sensor.column_gain, color=colour, linewidth=0.6, alpha=0.8, label=sensor.name)
        offset.plot(
            place_mm, sensor.column_offset_dn, color=colour, linewidth=0.6, alpha=0.8, label=sensor.name
        )
    across = "across the web [mm]"
    gain.set(title="Gain of each column", xlabel=across, ylabel="gain, axis = 1 [-]")
    offset.set(title="Offset of each column", xlabel=across, ylabel="offset [DN]")
    for axes in (gain, offset):
        axes.set_xlim(0, geometry.field_mm)
        if len(press.sensors) > 1:
            legend = axes.legend(frameon=False, fontsize=8)
            for line in legend.get_lines():
                line.set_linewidth(2)


def draw_footprint(axes: Axes, press: Press) -> None:
    """Draw the line spread function of one pixel of each sensor, across and along."""
    several = len(press.sensors) > 1
    for index, sensor in enumerate(press.sensors):
        reach = 1000 * sensor.footprint.reach_mm
        named = f", {sensor.name}" if several else ""
        colour = COLOURS[index % len(COLOURS)]
        for cumulative, dash, way in (
            (sensor.footprint.across, "-", "across"),
            (sensor.footprint.along, "--", "along the travel"),
        ):
            edges = np.linspace(-reach, reach, cumulative.size)
            density = np.diff(cumulative) / np.diff(edges) * 1000
            middle = (edges[:-1] + edges[1:]) / 2
            axes.plot(middle, density, dash, color=colour, linewidth=1.6, label=way + named)
    pixel = 1000 * press.geometry.pixel_pitch_mm
    axes.axvspan(-pixel / 2, pixel / 2, color="#000000", alpha=0.06, linewidth=0)
    axes.set(
        title="What one pixel sees (grey: its pitch)",
        xlabel="from its centre [µm]",
        ylabel="line spread [1/mm]",
        xlim=(-2.2 * pixel, 2.2 * pixel),
    )
    axes.set_ylim(0, axes.get_ylim()[1] * (1.0 + 0.14 * several * len(press.sensors)))
    axes.legend(frameon=False, fontsize=7 if several else 8, loc="upper right", ncols=1 + several)
