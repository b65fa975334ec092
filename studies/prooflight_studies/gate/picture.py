"""The handshake as states and as signals, and the trays of the long run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from prooflight_line.plant.gate.handshake import HANDSHAKE, State
from prooflight_studies.harness.picture import new_figure, write_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from prooflight_line.plant.simulator.plc import TrayRow

PLACES: Final = {State.AWAY: 0.0, State.JOINING: 1.6, State.ALIGNING: 3.2, State.READY: 4.8}
COLOURS: Final = {
    State.AWAY: "#d9534f",
    State.JOINING: "#f0ad4e",
    State.ALIGNING: "#f0d44e",
    State.READY: "#5cb85c",
}
TRUTHS: Final = {"good": "#5cb85c", "misprint": "#c9302c"}
OTHER: Final = "#a64ca6"


def draw_handshake(path: Path) -> None:
    """Draw the states above, from the table that the link goes by; below, what one sheet does to the registers."""
    figure = new_figure(10.5, 7.4)
    above, below = figure.subplots(2, 1, height_ratios=[1.0, 1.25])
    _states(above)
    _signals(below)
    write_figure(figure, path)


def draw_trays(path: Path, rows: Sequence[TrayRow]) -> None:
    """Draw what lay in each tray, over the sheets of the run."""
    figure = new_figure(10.5, 4.4)
    axes = figure.subplots(2, 1, sharex=True)
    bins = np.linspace(0, len(rows), 121)
    number = np.arange(len(rows))
    for place, tray in zip(axes, ("good", "reject"), strict=True):
        base = np.zeros(120)
        for name, colour in (*TRUTHS.items(), ("other", OTHER)):
            mine = [
                row.tray == tray and (row.truth == name or (name == "other" and row.truth not in TRUTHS))
                for row in rows
            ]
            counts, _ = np.histogram(number[np.array(mine, bool)], bins)
            place.bar(
                bins[:-1], counts, width=np.diff(bins), align="edge", bottom=base, color=colour, label=name
            )
            base += counts
        inside = sum(row.tray == tray for row in rows)
        place.set_title(f"{tray} tray: {inside:,} sheets", loc="left", fontsize=10)
        place.spines[["top", "right"]].set_visible(False)
        place.set_ylabel("sheets")
    axes[-1].set_xlabel("sheet, in the order in which they reached the gate")
    axes[0].legend(loc="lower right", ncols=3, fontsize=8, title="what it is in truth", title_fontsize=8)
    write_figure(figure, path)


def _states(axes: Axes) -> None:
    axes.set_axis_off()
    axes.set_xlim(-0.4, 5.2)
    axes.set_ylim(-2.3, 1.25)
    for state, x in PLACES.items():
        box = FancyBboxPatch(
            (x - 0.3, -0.16),
            0.6,
            0.32,
            boxstyle="round,pad=0.02",
            facecolor=COLOURS[state],
            edgecolor="#333333",
        )
        axes.add_patch(box)
        axes.text(x, 0, state.value.upper(), ha="center", va="center", fontsize=11, weight="bold")
    for one in HANDSHAKE:
        since, until = PLACES[one.state], PLACES[one.then]
        middle, steps = (since + until) / 2, since - until
        if steps < 0:
            _arrow(axes, (since + 0.32, 0.04), (until - 0.32, 0.04), 0.0)
            axes.text(middle, -0.04, _folded(one.event.value, 16), ha="center", va="top", fontsize=8.5)
        elif one.then is State.AWAY:
            _arrow(axes, (since, 0.2), (until + 0.05 * steps - 0.1, 0.2), 0.2)
        else:
            far = steps > PLACES[State.JOINING]
            _arrow(axes, (since - 0.1, -0.2), (until + 0.1, -0.2), -0.55 if far else -0.72)
            low = -1.8 if far else -0.47
            axes.text(middle, low, _folded(one.event.value, 19), ha="center", va="top", fontsize=8.5)
    lost = next(one.event.value for one in HANDSHAKE if one.then is State.AWAY)
    axes.text(5.2, 0.95, lost, ha="right", va="bottom", fontsize=8.5)
    axes.set_title("The handshake", loc="left")


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], bend: float) -> None:
    axes.add_patch(
        FancyArrowPatch(
            start,
            end,
            arrowstyle="-|>",
            mutation_scale=12,
            connectionstyle=f"arc3,rad={bend}",
            color="#333333",
        )
    )


def _folded(text: str, letters: int) -> str:
    words, lines = text.split(), [""]
    for word in words:
        if lines[-1] and len(lines[-1]) + len(word) > letters:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return "\n".join(lines)


def _signals(axes: Axes) -> None:
    """Time from left to right: last line at 2, verdict at 4, register at 4.5, gate at 8."""
    axes.set_xlim(0, 10)
    rows: tuple[tuple[str, list[tuple[float, int]]], ...] = (
        ("heartbeat, plc_heartbeat", [(0.25 * at, at % 2) for at in range(40)]),
        ("sheet_at_camera", [(0, 0), (2, 1)]),
        ("status: busy", [(0, 0), (2, 1), (5.2, 0)]),
        ("result_number, tag, result, position", [(0, 0), (4.5, 1)]),
        ("result_taken (acknowledgement)", [(0, 0), (5.0, 1)]),
        ("eye at the gate", [(0, 0), (8, 1), (9.2, 0)]),
        ("gate open, if result = accept", [(0, 0), (8.1, 1), (9.4, 0)]),
    )
    for at, (name, steps) in enumerate(rows):
        base = -1.5 * at
        times = [time for time, _ in steps for _ in (0, 1)][1:]
        times.append(10)
        levels = [base + 0.8 * level for _, level in steps for _ in (0, 1)]
        axes.plot(times, levels, color="#1f4e79", linewidth=1.3)
        axes.text(-0.12, base + 0.4, name, ha="right", va="center", fontsize=8.5)
    for time, what in ((2, "last line"), (4, "verdict"), (4.5, "   register"), (8, "gate")):
        axes.axvline(time, color="#bbbbbb", linewidth=0.8, linestyle=":", zorder=0)
        place = "right" if what == "verdict" else "left"
        axes.text(time + (-0.06 if place == "right" else 0.06), 1.35, what.strip(), fontsize=8.5, ha=place)
    axes.annotate(
        "", (8, -9.6), (0.9, -9.6), arrowprops={"arrowstyle": "<->", "color": "#777777", "linewidth": 0.9}
    )
    axes.text(
        4.5,
        -9.75,
        "distance_mm, counted by the encoder",
        ha="center",
        va="top",
        fontsize=8.5,
        color="#444444",
    )
    axes.axvline(0.9, color="#bbbbbb", linewidth=0.8, linestyle=":", zorder=0)
    axes.text(0.96, 1.35, "first line", fontsize=8.5)
    axes.set_ylim(-10.7, 2.0)
    axes.set_axis_off()
    axes.set_title("One sheet (time runs to the right)", loc="left")
