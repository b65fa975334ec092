"""Pictures (PNG) like the paper's figures 3 to 6, of any press."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Rectangle
from scipy import special

from prooflight.reporting.camera_pictures import COLOURS
from prooflight.reporting.pictures import SATURATION, SCALE
from prooflight.spectra import WAVE_NM
from prooflight_studies.harness.picture import new_figure, write_figure

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from prooflight.reporting.pictures import Frame

_LEVELS: Final = 12
_SIGMAS_SHOWN: Final = 4.5
_MOST_BARS: Final = 60


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Slice:
    """One table over two inks, the others absent."""

    what: str
    x_ink: str
    y_ink: str
    percent: NDArray[np.float64]
    """Values of both axes, (n,). [%]"""
    values: NDArray[np.float32]
    """Table values, (n, n), rows y."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Repeated:
    """One colour exposed many times, and the closed form's mean and sigma before clipping. [DN]"""

    name: str
    dn: NDArray[np.uint16]
    mean_dn: float
    sigma_dn: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorMap:
    """A page, its scan with a misprint, and their difference."""

    page: NDArray[np.uint8]
    """Picture of the right page. (rows, columns, 3)"""
    page_size_mm: tuple[float, float]
    measured: NDArray[np.float32]
    """Signal, paper 1. (lines, pixels)"""
    frame: Frame
    """Area that ``measured`` covers."""
    block_z: NDArray[np.float32]
    """Normalised error of blocks, (block rows, block columns), N(0, 1) where print is good."""
    misprint: str
    region_mm: tuple[float, float, float, float]
    verdict: str
    sensor: str


def draw_curves(
    path: Path,
    *,
    light: tuple[str, NDArray[np.float64]],
    sensors: Mapping[str, NDArray[np.float64]],
) -> None:
    """Draw quantum efficiencies (36,) by sensor over the light's relative power (36,); figure 3."""
    figure, (axes,) = _figure(1, 1, (6.6, 4.2))
    name, power = light
    power_axes = axes.twinx()
    power_axes.fill_between(WAVE_NM, power / power.max(), color="#d9d9d9", alpha=0.6, linewidth=0)
    power_axes.set(ylabel=f"light {name}, relative power [-]", ylim=(0, 1.05))
    power_axes.spines[["top", "left"]].set_visible(False)
    axes.set_zorder(power_axes.get_zorder() + 1)
    axes.patch.set_visible(False)
    for (sensor, efficiency), colour in zip(sensors.items(), COLOURS * len(sensors), strict=False):
        axes.plot(WAVE_NM, efficiency, color=colour, marker=".", linewidth=1.8, label=f"sensor {sensor}")
    if len(sensors) == 2:
        axes.plot(WAVE_NM, sum(sensors.values()), "--", color="#444444", linewidth=1.2, label="both")
    axes.set(
        xlabel="wavelength [nm]",
        ylabel="quantum efficiency [electrons/photon]",
        title="Sensors and light",
        xlim=(WAVE_NM[0], WAVE_NM[-1]),
        ylim=(0, 1.25 * max(efficiency.max() for efficiency in sensors.values())),
    )
    axes.legend(frameon=False, fontsize=9, loc="upper left", ncols=3)
    write_figure(figure, path)


def draw_slices(path: Path, sensor: str, slices: Sequence[Slice]) -> None:
    """Draw tables as heat maps with contours, two a row; figure 4."""
    figure, panels = _figure(-(-len(slices) // 2), 2, (5.2, 4.2))
    figure.suptitle(f"Tables of sensor {sensor}, the other two inks absent", fontsize=11)
    for axes, piece in zip(panels, slices, strict=True):
        filled = axes.contourf(piece.percent, piece.percent, piece.values, levels=48, cmap="viridis")
        lines = axes.contour(
            piece.percent, piece.percent, piece.values, levels=_LEVELS, colors="white", linewidths=0.7
        )
        axes.clabel(lines, fontsize=7, fmt="%g")
        figure.colorbar(filled, ax=axes, label=piece.what, format="%g")
        axes.set(xlabel=f"{piece.x_ink} [%]", ylabel=f"{piece.y_ink} [%]", xlim=(0, 100), ylim=(0, 100))
        axes.set_aspect("equal")
    write_figure(figure, path)


def draw_histograms(path: Path, sensor: str, colours: Sequence[Repeated]) -> None:
    """Draw digital numbers of repeated exposures against the Gaussian of the tables; figure 5."""
    figure, panels = _figure(-(-len(colours) // 3), 3, (4.0, 3.1))
    count = len(colours[0].dn)
    figure.suptitle(
        f"Sensor {sensor}: {count:,} exposures of each colour, and the tables' Gaussian", fontsize=11
    )
    for axes, colour in zip(panels, colours, strict=False):
        _histogram(axes, colour)
    for axes in panels[len(colours) :]:
        axes.set_visible(False)
    write_figure(figure, path)


def _histogram(axes: Axes, colour: Repeated) -> None:
    low, high = (colour.mean_dn + side * _SIGMAS_SHOWN * colour.sigma_dn for side in (-1, 1))
    width = max(round((high - low) / _MOST_BARS), 1)  # whole codes, equally many in every bar
    edges = np.arange(np.floor(max(low, 0)), np.ceil(high) + width + 1, width) - 0.5
    share, _ = np.histogram(colour.dn, bins=edges)
    axes.bar(
        (edges[:-1] + edges[1:]) / 2,
        share / colour.dn.size,
        width=0.92 * width,
        color="#9ecae9",
        label="exposures",
    )
    # Rounding is the bars' own, so the Gaussian is integrated over them with the sigma before it.
    before = np.sqrt(max(colour.sigma_dn**2 - 1 / 12, 1e-12))
    expected = np.diff(special.ndtr((edges - colour.mean_dn) / before))
    axes.plot(
        (edges[:-1] + edges[1:]) / 2,
        expected,
        ".-",
        color=COLOURS[1],
        linewidth=1.4,
        markersize=4,
        label="Gaussian",
    )
    away = colour.dn - colour.dn.mean()
    skewness = float((away**3).mean() / max(colour.dn.std(), 1e-9) ** 3)
    axes.text(
        0.98,
        0.97,
        f"mean {colour.dn.mean():.1f} ({colour.mean_dn:.1f})\nsigma {colour.dn.std():.2f} ({colour.sigma_dn:.2f})\n"
        f"skewness {skewness:+.3f}",
        transform=axes.transAxes,
        ha="right",
        va="top",
        fontsize=7.5,
        color="#444444",
    )
    axes.set(title=colour.name, xlabel="digital number [DN]", ylabel="share [-]", xlim=(low, high))
    axes.set_ylim(0, 1.35 * max(float(share.max()) / colour.dn.size, float(expected.max())))
    axes.legend(frameon=False, fontsize=7.5, loc="upper left")


def draw_error_map(path: Path, shown: ErrorMap) -> None:
    """Draw the page, its scan, and the normalised error, next to each other in millimetres; figure 6."""
    width_mm, height_mm = shown.page_size_mm
    figure, panels = _figure(1, 3, (4.4, 3.75 * height_mm / width_mm + 0.8))
    scale = [
        ((step + SATURATION) / (2 * SATURATION), (r / 255, g / 255, b / 255)) for step, (r, g, b) in SCALE
    ]
    colours = LinearSegmentedColormap.from_list("error", scale)
    frame = shown.frame
    seen = (frame.x_mm, frame.x_mm + frame.width_mm, frame.y_mm + frame.height_mm, frame.y_mm)
    panels[0].imshow(shown.page, extent=(0, width_mm, height_mm, 0))
    panels[0].set_title("Page as it should be")
    encoded = np.clip(shown.measured, 0, 1) ** (1 / 2.2)
    panels[1].imshow(encoded, extent=seen, cmap="gray", vmin=0, vmax=1)
    panels[1].set_title(f"Scan, sensor {shown.sensor}")
    map_ = panels[2].imshow(
        shown.block_z, extent=seen, cmap=colours, vmin=-SATURATION, vmax=SATURATION, interpolation="nearest"
    )
    panels[2].set_title(f"Error: {shown.verdict}")
    x_mm, y_mm, wide_mm, high_mm = shown.region_mm
    panels[2].add_patch(
        Rectangle(
            (x_mm, y_mm), wide_mm, high_mm, fill=False, edgecolor="#009e73", linewidth=1.4, linestyle="--"
        )
    )
    figure.colorbar(
        map_,
        ax=panels[2],
        label="mean of z over 8 x 8 pixels, times 8 [sigma]; below 0: darker",
        shrink=0.75,
        extend="both",
    )
    for axes in panels:
        axes.set(xlim=(0, width_mm), ylim=(height_mm, 0), xlabel="[mm]")
        axes.spines[["top", "right"]].set_visible(True)
    figure.suptitle(f"Misprint: {shown.misprint} (green frame)", fontsize=11)
    write_figure(figure, path)


def _figure(rows: int, columns: int, panel_inch: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    height_inch = panel_inch[1] * rows + 0.3 * (rows * columns > 1)
    figure = new_figure(panel_inch[0] * columns, height_inch, pads_inch=(0.08, 0.08))
    panels = [figure.add_subplot(rows, columns, place + 1) for place in range(rows * columns)]
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
    return figure, panels
