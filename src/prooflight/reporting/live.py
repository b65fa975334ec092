"""Live view of the running press in a terminal: speed, a strip of verdicts, the last alarms, drift curves.

It is drawn from reported outcomes and the status snapshot alone, without access to the inspection.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.columns import Columns
from rich.console import Group
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from prooflight.errors import plain, sentence
from prooflight.line.monitor.channels import drift_channels
from prooflight.line.pace import REMEDY
from prooflight.line.status import Phase
from prooflight.reporting import wording

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.console import RenderableType

    from prooflight.line.monitor.channels import Channel
    from prooflight.line.monitor.run import Announcement
    from prooflight.line.notices import Notice
    from prooflight.line.outcomes import Outcome
    from prooflight.line.status import Status
    from prooflight.scans.cameras.camera import Health

STRIP: Final = 240
"""Number of sheets shown."""
ALARMS: Final = 6
ANNOUNCEMENTS: Final = 4
NOTICES: Final = 4
CURVE_PAGES: Final = 240
CURVE_CELLS: Final = 30
WHAT_CELLS: Final = 56
CURVES: Final = 7
"""Number of channels shown: those that have drifted furthest relative to their tolerance."""
LEAST_SPAN: Final = 0.4
"""Least span of a curve's scale, in units of the tolerance: a curve that moves less is drawn flat."""
BARS: Final = "▁▂▃▄▅▆▇█"
VERDICTS: Final = {"good": ("■", "green"), "misprint": ("■", "bold red"), "not-inspected": ("□", "yellow")}
PHASES: Final = {Phase.INSPECTING: "green", Phase.FAULT: "bold red"}
ACTIONS: Final = {"accept": "green", "reprint": "yellow", "stop": "bold red"}


@dataclass(slots=True)
class Recent:
    """Last sheets for display; outcomes come from one thread, pictures are drawn by another."""

    channels: tuple[Channel, ...]
    strip: deque[tuple[str, bool]] = field(default_factory=lambda: deque(maxlen=STRIP))
    """Verdict of each sheet, and whether the paper path or the camera was at fault."""
    alarms: deque[Outcome] = field(default_factory=lambda: deque(maxlen=ALARMS))
    announcements: deque[Announcement] = field(default_factory=lambda: deque(maxlen=ANNOUNCEMENTS))
    notices: deque[str] = field(default_factory=lambda: deque(maxlen=NOTICES))
    """Messages that belong to no sheet."""
    curves: dict[str, deque[float]] = field(default_factory=dict)
    guard: threading.Lock = field(default_factory=threading.Lock)

    @classmethod
    def of(cls, sensors: Sequence[str]) -> Recent:
        """Create an empty record."""
        return cls(channels=drift_channels(sensors))

    def add(self, outcome: Outcome) -> None:
        """Add one sheet."""
        record = outcome.record
        with self.guard:
            self.strip.append((record.verdict.verdict, bool(record.faults)))
            if record.verdict.verdict == "misprint":
                self.alarms.append(outcome)
            self.announcements.extend(outcome.announcements)
            for name, value in outcome.evidence.values.items():
                if np.isfinite(value):
                    self.curves.setdefault(name, deque(maxlen=CURVE_PAGES)).append(float(value))

    def notice(self, notice: Notice) -> None:
        """Add a message that belongs to no sheet."""
        with self.guard:
            self.notices.append(notice.text)


def live_view(
    status: Status,
    recent: Recent,
    *,
    title: str,
    deadline_s: float | None,
    cameras: Mapping[str, Health] = MappingProxyType({}),
    sheets: str = "",
) -> RenderableType:
    """Draw the whole view, as high as it needs.

    Parameters
    ----------
    title : job, press and source
    deadline_s : time for a verdict; None if the source waits for the inspection
    cameras : health of the source's cameras, by name
    sheets : counts of sheets and sets by verdict, in words, where the job's sheets have several sides or its
        pages belong together
    """
    with recent.guard:
        parts: list[RenderableType] = [_figures(status, deadline_s), _strip(recent)]
        if sheets:
            parts.insert(1, Text(sentence(sheets), style="bold"))
        if cameras:
            parts.append(_cameras(cameras))
        if recent.announcements:
            parts.append(_announcements(recent))
        parts.append(Columns([_alarms(recent), _curves(recent)], expand=False, padding=(1, 2)))
        parts += [Text(text, style="yellow") for text in recent.notices]
    if status.promise_suspended:
        parts.append(Text(sentence(wording.suspended(status.promise_suspended)), style="bold red"))
    if status.phase is Phase.PREPARING and status.to_prepare:
        parts.insert(0, Text(f"Preparing: {preparation(status)}", style="bold"))
    if status.detail:
        parts.append(Text(sentence(status.detail), style="bold red"))
    if status.overloaded:
        text = f"Inspection cannot keep up: {status.out_of_time} sheets not inspected; {REMEDY}"
        parts.insert(0, Text(text, style="bold red"))
    style = PHASES.get(status.phase, "yellow")
    speed = f"{status.pages_per_s:.2f} pages/s"
    head = Text.assemble(
        (f" {status.phase.upper()} ", f"reverse {style}"), f"  {plain(title)}   ", (speed, "bold"), " "
    )
    return Panel(Group(*parts), title=head, title_align="left", padding=(0, 1), expand=False)


def preparation(status: Status) -> str:
    """Say how many designs are ready before the first line, and how long the others will take."""
    ready = f"{status.ahead} of {wording.count(status.to_prepare, 'design')} ready"
    left = status.to_prepare - status.ahead
    if not status.ahead or left <= 0:
        return ready
    return f"{ready}, about {math.ceil(status.elapsed_s * left / status.ahead)} s left"


def sparkline(values: Sequence[float], tolerance: float, *, cells: int = CURVE_CELLS) -> str:
    """Draw means of consecutive values as bars; the scale is theirs, but never finer than 0.4 of the tolerance.

    >>> sparkline([0.0, 0.0, 1.0, 1.0, 2.0, 2.0], 1.0, cells=3)
    '▁▅█'
    """
    parts = np.array_split(np.asarray(values, float), min(cells, len(values)))
    means = np.array([part.mean() for part in parts])
    middle = (means.min() + means.max()) / 2
    span = max(float(np.ptp(means)), LEAST_SPAN * tolerance)
    steps = np.clip((means - middle) / span + 0.5, 0, 1) * len(BARS)
    return "".join(BARS[min(int(step), len(BARS) - 1)] for step in steps)


def _figures(status: Status, deadline_s: float | None) -> RenderableType:
    table = Table.grid(padding=(0, 3))
    verdict = status.stages["verdict"]
    limit = "" if deadline_s is None else f" of {deadline_s * 1e3:.0f}"
    rows = (
        ("sheets", f"{status.pages_seen}", "good", f"{status.good}", "misprints", f"{status.misprints}"),
        (
            "not inspected", f"{status.not_inspected}",
            "late", f"{status.late}",
            "missing", f"{max(status.missing, status.absent)}",
        ),
        (
            "verdict, median", f"{verdict.median_ms:.0f} ms",
            "99.9 %", f"{verdict.p999_ms:.0f}{limit} ms",
            "inspecting", f"{status.stages['inspect'].median_ms:.0f} ms",
        ),
        (
            "waiting", f"{status.queue_depth}",
            "designs ready", f"{status.ahead}",
            "in the journal", f"{status.journalled}",
        ),
    )  # fmt: skip
    bad = {
        "misprints": status.misprints,
        "late": status.late,
        "not inspected": status.not_inspected,
        "missing": status.missing or status.absent,
    }
    for row in rows:
        cells = []
        for name, value in zip(row[::2], row[1::2], strict=True):
            style = "bold red" if bad.get(name) else "bold"
            cells += [Text(name, style="dim"), Text(value, style=style)]
        table.add_row(*cells)
    faults = ", ".join(f"{count} {kind}" for kind, count in sorted(status.faults.items()))
    return Group(table, Text(f"paper path: {faults}", style="yellow")) if faults else table


def _cameras(cameras: Mapping[str, Health]) -> RenderableType:
    table = Table.grid(padding=(0, 2))
    for name, health in cameras.items():
        warm = "" if health.temperature_c is None else f"{health.temperature_c:.0f} °C"
        free = f"{health.buffers_free} buffers free" if health.buffers_free else ""
        table.add_row(
            Text(name, style="dim"),
            Text(f"{health.lines_per_s:,.0f} lines/s", style="bold" if health.present else "bold red"),
            Text(f"{health.lines_lost:,} lost", style="yellow" if health.lines_lost else "dim"),
            Text(f"{health.resends:,} resent", style="dim"),
            Text(warm, style="dim"),
            Text(free if health.present else "away", style="dim" if health.present else "bold red"),
        )
    return table


def _strip(recent: Recent) -> Text:
    text = Text()
    for verdict, fault in recent.strip:
        mark, style = VERDICTS[verdict]
        text.append("▲" if fault else mark, style="magenta" if fault and verdict == "good" else style)
    text.append("\n" if recent.strip else "no sheet yet\n", style="dim")
    text.append("■ good  ", style="green").append("■ misprint  ", style="bold red")
    return text.append("□ not inspected  ", style="yellow").append("▲ paper path or camera", style="magenta")


def _announcements(recent: Recent) -> RenderableType:
    table = Table.grid(padding=(0, 1))
    for one in reversed(recent.announcements):
        what = one.text.rpartition(":")[0]
        table.add_row(
            Text(f"sheet {one.sheet}", style="dim"),
            Text(one.action.upper(), style=f"reverse {ACTIONS[one.action]}"),
            Text(sentence(what)),
        )
    return Panel(table, title="The run", title_align="left", border_style="yellow", expand=False)


def _alarms(recent: Recent) -> RenderableType:
    table = Table(title="Last alarms", title_justify="left", box=None, padding=(0, 1), title_style="bold")
    table.add_column("sheet", style="dim")
    table.add_column("page")
    table.add_column("what", max_width=WHAT_CELLS, no_wrap=True, overflow="ellipsis")
    for outcome in reversed(recent.alarms):
        verdict = outcome.record.verdict
        what = verdict.reason or " ".join(filter(None, (verdict.kind or "misprint", _where(outcome))))
        table.add_row(f"{outcome.record.sheet}", verdict.page, Text(sentence(what), style="red"))
    if not recent.alarms:
        table.add_row("", "", Text("none", style="dim"))
    return table


def _where(outcome: Outcome) -> str:
    if not outcome.record.verdict.regions:
        return ""
    region = outcome.record.verdict.regions[0]
    return f"at {region.x_mm + region.width_mm / 2:.0f}, {region.y_mm + region.height_mm / 2:.0f} mm"


def _curves(recent: Recent) -> RenderableType:
    table = Table(
        title=f"Last {CURVE_PAGES} sheets", title_justify="left", box=None, padding=(0, 1), title_style="bold"
    )
    for heading in ("drift", "", "now", "tolerance"):
        table.add_column(heading, justify="right" if heading in ("now", "tolerance") else "left")
    curves = [
        (channel, recent.curves[channel.name]) for channel in recent.channels if channel.name in recent.curves
    ]
    levels = {channel.name: float(np.mean(list(values)[-16:])) for channel, values in curves}
    curves.sort(key=lambda one: -abs(levels[one[0].name]) / one[0].tolerance)
    for channel, values in curves[:CURVES]:
        level = levels[channel.name]
        share = abs(level) / channel.tolerance
        style = "red" if share > 0.7 else "yellow" if share > 0.35 else "cyan"
        table.add_row(
            channel.what,
            Text(sparkline(values, channel.tolerance), style=style),
            Text(f"{level * channel.scale:+.2f} {channel.unit}", style=style),
            Text(f"{channel.tolerance * channel.scale:.2g} {channel.unit}", style="dim"),
        )
    return table
