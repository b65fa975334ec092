"""Maps of the least defects that would be caught on a page, next to the page itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure

from prooflight.cmyk import NAME_OF_INK
from prooflight.reporting.pictures import page_picture
from prooflight_studies.harness.picture import write_figure

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight_studies.detectability.closed_form import Reach

NOWHERE: Final = "#b3261e"
"""Colour of places where no defect of the kind would be caught."""
TICKS: Final = {"spot": (0.2, 0.5, 1, 2, 5, 10), "patch": (5, 10, 20, 50, 100)}
COLOUR_OF_INK: Final = {"C": "#0091c8", "M": "#c8006f", "Y": "#c9a800", "K": "#222222"}


def draw_reach(path: Path, page: Page, reach: Reach, press: Press) -> None:
    """Draw the page, the smallest spot, the faintest streak, and the smallest loss of density of places and inks."""
    ratio = page.height_mm / page.width_mm
    figure = Figure(figsize=(15.5, 4.1 * ratio + 2.6), dpi=100, layout="constrained")
    grid = figure.add_gridspec(2, 3, height_ratios=[4.1 * ratio, 1.7])
    axes = [figure.add_subplot(grid[0, column]) for column in range(3)]
    extent = (0.0, page.width_mm, page.height_mm, 0.0)
    axes[0].imshow(
        np.asarray(page_picture(page, press, width_px=700)), extent=extent, interpolation="antialiased"
    )
    axes[0].set_title(f"{page.name} as a person sees it")
    _map(figure, axes[1], reach.spot_mm, reach, page, "Smallest solid black spot [mm]", TICKS["spot"])
    _map(
        figure,
        axes[2],
        reach.patch_percent,
        reach,
        page,
        "Smallest loss of all inks in 16 x 16 mm [%]",
        TICKS["patch"],
    )
    for one in axes:
        one.set_xlabel("x [mm]")
    axes[0].set_ylabel("y [mm]")
    _streaks(figure.add_subplot(grid[1, :2]), reach, page)
    _inks(figure.add_subplot(grid[1, 2]), reach)
    figure.suptitle(
        "Caught in 99 of 100 prints at the promised rate of false alarms; red: not at all", fontsize=12
    )
    write_figure(figure, path)


def _map(
    figure: Figure,
    axes: Axes,
    values: NDArray[np.float64],
    reach: Reach,
    page: Page,
    title: str,
    ticks: tuple[float, ...],
) -> None:
    rows, columns = values.shape
    extent = (
        reach.left_mm,
        reach.left_mm + columns * reach.tile_mm,
        reach.top_mm + rows * reach.tile_mm,
        reach.top_mm,
    )
    shown = np.where(np.isfinite(values) & (values <= ticks[-1]), values, np.nan)
    none = np.ma.masked_where(np.isnan(values) | ~np.isnan(shown), np.ones_like(values))
    axes.set_facecolor("#e8e8e4")
    axes.imshow(none, extent=extent, cmap=ListedColormap([NOWHERE]), interpolation="nearest")
    image = axes.imshow(
        shown, extent=extent, cmap="viridis", norm=LogNorm(ticks[0], ticks[-1]), interpolation="nearest"
    )
    bar = figure.colorbar(image, ax=axes, shrink=0.75, ticks=list(ticks), format="%g")
    bar.ax.minorticks_off()
    axes.set_xlim(0, page.width_mm)
    axes.set_ylim(page.height_mm, 0)
    axes.set_title(title)


def _streaks(axes: Axes, reach: Reach, page: Page) -> None:
    x = (np.arange(reach.streak_percent.size) + 0.5) * reach.pixel_mm + reach.left_mm
    finite = np.isfinite(reach.streak_percent)
    axes.plot(x, np.where(finite, reach.streak_percent, np.nan), color="#0b3d85", linewidth=0.9)
    if finite.any():
        axes.set_ylim(0, 1.5 * float(np.percentile(reach.streak_percent[finite], 97)))
    axes.set_title("Faintest black streak, 0.5 mm wide, top to bottom [% ink]")
    axes.set_xlabel("x [mm]")
    axes.set_xlim(0, page.width_mm)
    axes.grid(visible=True, color="#e3e3df", linewidth=0.6)
    lost = np.isinf(reach.streak_percent)
    if lost.any():
        low, high = axes.get_ylim()
        axes.fill_between(x, low, high, where=lost.tolist(), color=NOWHERE, linewidth=0, alpha=0.6)
        axes.set_ylim(low, high)


def _inks(axes: Axes, reach: Reach) -> None:
    shown = [letter for letter, least in reach.inks_percent.items() if np.isfinite(least)]
    values = [reach.inks_percent[letter] for letter in shown]
    bars = axes.barh(
        [NAME_OF_INK[letter] for letter in shown], values, color=[COLOUR_OF_INK[letter] for letter in shown]
    )
    axes.bar_label(bars, fmt="%.0f %%", padding=4)
    axes.invert_yaxis()
    axes.set_xlim(0, 1.18 * max(values, default=1.0))
    axes.set_title("Smallest loss of one ink all over [%]")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if not shown:
        axes.set(xticks=[], yticks=[])
        axes.text(0.5, 0.5, "none would be caught", ha="center", va="center", transform=axes.transAxes)
