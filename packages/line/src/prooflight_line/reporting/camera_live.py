"""State of a line camera: as lines for a terminal, and as a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from rich.text import Text

from prooflight_line.camera_set_up.seen import smoothed
from prooflight_line.ruler.slanted_edge import FREQUENCIES

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from prooflight_line.camera_set_up.seen import Focus, SensorView
    from prooflight_line.cameras.camera import Health

SATURATED_MOST: Final = 1e-4
FLAT_LEAST: Final = 0.7
COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""Hues that all common colour-vision deficiencies can distinguish (Okabe and Ito 2008)."""
_STRIP_LINES: Final = 600


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraShown:
    """State of a camera at one time."""

    camera: str
    form: str
    top_code_dn: int
    lines: NDArray[np.uint16]
    """The last lines, (sensors, lines, pixels). [DN]"""
    views: tuple[SensorView, ...]
    health: Health
    lens_mtf50: float | None = None
    """MTF50 across of the press file's lens and pixel. [cycles/pixel]"""

    def facts(self) -> dict[str, Any]:
        """Return the state for a program, as JSON values."""
        return {
            "camera": self.camera,
            "pixel_format": self.form,
            "top_code_dn": self.top_code_dn,
            "lines": self.lines.shape[1],
            "lens_mtf50_per_pixel": self.lens_mtf50,
            "health": self.health,
            "sensors": [_facts(view) for view in self.views],
        }


def _facts(view: SensorView) -> dict[str, Any]:
    focus = view.focus
    return {
        "saturated_share": view.saturated,
        "black_dn": view.black_dn,
        "at_zero_share": view.at_zero,
        "noise_dn": view.noise_dn,
        "flatness": view.flatness,
        "darkest_at": view.darkest_share,
        "profile_dn": np.round(view.mean_dn, 2),
        "focus": None
        if focus is None
        else {
            "by": focus.by,
            "mtf50_across_per_pixel": focus.across,
            "mtf50_along_per_line": focus.along,
            "places": focus.places,
            "pixel_mm": focus.pixel_mm,
        },
    }


def live_camera(shown: CameraShown) -> Text:
    """Return the state in a line for each sensor, and one for the way of its lines."""
    lines = Text(f"{shown.camera}   {shown.form}   ", style="bold").append(_way(shown.health))
    for at, view in enumerate(shown.views):
        lines.append("\n" if len(shown.views) == 1 else f"\nsensor {at + 1}: ", "bold")
        rows = [*_light_rows(view), *_focus_rows(view.focus, shown.lens_mtf50)]
        for place, (name, text, good) in enumerate(rows):
            lines.append(f"{', ' if place else ''}{name} " if name else ", ", "dim")
            lines.append(text, "" if good else "bold red")
    return lines


def _light_rows(view: SensorView) -> list[tuple[str, str, bool]]:
    light = f"least {100 * view.flatness:.0f} % of the greatest, at {100 * view.darkest_share:.0f} %"
    return [
        ("saturated", f"{100 * view.saturated:.3f} %", view.saturated <= SATURATED_MOST),
        ("black", f"{view.black_dn:.0f} DN, {100 * view.at_zero:.2f} % at code 0", view.at_zero < 0.001),
        ("noise", f"{view.noise_dn:.2f} DN from line to line", True),
        ("light", light, view.flatness >= FLAT_LEAST),
    ]


def _focus_rows(focus: Focus | None, wanted: float | None) -> list[tuple[str, str, bool]]:
    if focus is None:
        return [("focus", "no edges to measure it from: place a ruler page under the camera", True)]
    across = focus.across
    good = wanted is None or across.value >= 0.75 * wanted
    rows = [
        ("MTF50 across", f"{across.value:.3f} +- {across.standard_error:.3f} cycles/pixel", good),
        ("", f"by {focus.by}" + ("" if wanted is None else f"; the press file's lens: {wanted:.3f}"), True),
    ]
    if focus.along is not None:
        along = focus.along
        rows.insert(1, ("MTF50 along", f"{along.value:.3f} +- {along.standard_error:.3f} cycles/line", True))
    if len(focus.places) > 1:
        rows.append(("across the line", "  ".join(f"{sharp:.2f}" for _, sharp in focus.places), True))
    return rows


def _way(health: Health) -> Text:
    parts = [
        f"{health.lines_per_s:,.0f} lines/s",
        f"{health.lines_lost:,} of {health.lines + health.lines_lost:,} lost",
        f"{health.resends:,} packets sent again",
        f"{health.buffers_free} buffers free",
    ]
    if health.temperature_c is not None:
        parts.append(f"{health.temperature_c:.1f} degrees C")
    return Text("   ".join(parts), style="bold red" if health.lines_lost else "dim")


def draw_camera(path: Path, shown: CameraShown) -> None:
    """Write the same as a picture (PNG): profile, the last lines, MTF, numbers."""
    from matplotlib.figure import Figure

    from prooflight.files.atomic import whole_file

    figure = Figure(figsize=(11, 7.4), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(1.5, 1.1, 1.4), width_ratios=(1.25, 1))
    _draw_profile(figure.add_subplot(grid[0, :]), shown)
    _draw_lines(figure.add_subplot(grid[1, :]), shown)
    _draw_mtf(figure.add_subplot(grid[2, 0]), shown)
    _draw_numbers(figure.add_subplot(grid[2, 1]), shown)
    figure.suptitle(f"{shown.camera}, {shown.form}", x=0.01, ha="left", fontweight="bold")
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, format="png", dpi=130)


def _draw_profile(axes: Axes, shown: CameraShown) -> None:
    several = len(shown.views) > 1
    for at, (view, colour) in enumerate(zip(shown.views, COLOURS * 4, strict=False)):
        name = f"sensor {at + 1}: " if several else ""
        x = np.arange(view.mean_dn.size)
        axes.plot(x, view.paper_dn, color=colour, linewidth=0.6, alpha=0.35)
        axes.plot(x, smoothed(view.paper_dn), color=colour, linewidth=1.6, label=f"{name}paper")
        axes.plot(
            x, view.mean_dn, color=colour, linewidth=0.6, linestyle=":", label=f"{name}mean of all lines"
        )
    axes.axhline(shown.top_code_dn, color="#aa0000", linewidth=0.8)
    axes.text(0.003, shown.top_code_dn, "top code", color="#aa0000", va="bottom", fontsize=8,
              transform=axes.get_yaxis_transform())  # fmt: skip
    axes.set(
        xlim=(0, shown.lines.shape[2]),
        ylim=(0, 1.12 * shown.top_code_dn),
        xlabel="pixel",
        ylabel="DN",
        title="Along the line",
    )
    axes.legend(frameon=False, loc="lower center", ncols=2 * min(len(shown.views), 3), fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_lines(axes: Axes, shown: CameraShown) -> None:
    image = shown.lines[0, -_STRIP_LINES:]
    axes.imshow(
        image, cmap="gray", vmin=0, vmax=shown.top_code_dn, aspect="auto", interpolation="antialiased"
    )
    axes.set(xlabel="pixel", ylabel="line", title=f"The last {image.shape[0]} lines")


def _draw_mtf(axes: Axes, shown: CameraShown) -> None:
    drawn = False
    for at, (view, colour) in enumerate(zip(shown.views, COLOURS * 4, strict=False)):
        focus = view.focus
        if focus is None or focus.mtf_across is None or focus.mtf_along is None:
            continue
        name = f"sensor {at + 1} " if len(shown.views) > 1 else ""
        axes.plot(FREQUENCIES, focus.mtf_across, color=colour, label=f"{name}across")
        axes.plot(FREQUENCIES, focus.mtf_along, color=colour, linestyle="--", label=f"{name}along")
        drawn = True
    axes.axhline(0.5, color="#888888", linewidth=0.8)
    axes.axvline(0.5, color="#888888", linewidth=0.8)
    axes.text(0.505, 1.0, "Nyquist", color="#666666", fontsize=8, va="top")
    if shown.lens_mtf50 is not None:
        axes.plot([shown.lens_mtf50], [0.5], "o", color="black", markersize=5, label="lens of the press file")
        drawn = True
    axes.set(xlim=(0, 1), ylim=(0, 1.05), xlabel="cycles/pixel, cycles/line", ylabel="MTF", title="Focus")
    if drawn:
        axes.legend(frameon=False, fontsize=8)
    else:
        axes.text(0.5, 0.25, "no ruler page in these lines", ha="center", color="#666666")
    axes.spines[["top", "right"]].set_visible(False)


def _draw_numbers(axes: Axes, shown: CameraShown) -> None:
    axes.axis("off")
    rows: list[tuple[str, str]] = []
    for at, view in enumerate(shown.views):
        if len(shown.views) > 1:
            rows.append((f"sensor {at + 1}", ""))
        rows += [
            ("saturated", f"{100 * view.saturated:.3f} %"),
            ("black", f"{view.black_dn:.0f} DN, {100 * view.at_zero:.2f} % at code 0"),
            ("noise", f"{view.noise_dn:.2f} DN"),
            ("light", f"least {100 * view.flatness:.0f} % of the greatest"),
            *((name, text) for name, text, _ in _focus_rows(view.focus, shown.lens_mtf50)),
        ]
    health = shown.health
    rows += [
        ("lines/s", f"{health.lines_per_s:,.0f}"),
        ("lost", f"{health.lines_lost:,} of {health.lines + health.lines_lost:,} lines"),
    ]
    if health.temperature_c is not None:
        rows.append(("temperature", f"{health.temperature_c:.1f} °C"))
    step = min(0.09, 1 / max(len(rows), 1))
    for at, (name, text) in enumerate(rows):
        axes.text(0.02, 1 - at * step, name, va="top", color="#666666", fontsize=9, transform=axes.transAxes)
        axes.text(0.30, 1 - at * step, text, va="top", fontsize=9, transform=axes.transAxes)
