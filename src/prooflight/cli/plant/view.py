"""View of the simulated controller for people at a terminal: trays, belt, and registers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rich.columns import Columns
from rich.console import Group
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from prooflight.plant.gate.registers import OurStatus, Result, apart, unpacked

if TYPE_CHECKING:
    from rich.console import RenderableType

    from prooflight.plant.simulator.plc import SimulatedPlc, TrayRow

ACROSS: Final = 24
"""Sheets side by side in the picture of a tray."""
DEEP: Final = 5
CELLS: Final = 60
"""Characters of the belt from camera to gate."""
MARKS: Final = {"good": ("■", "green"), "misprint": ("■", "bold red")}
OTHER: Final = ("▲", "magenta")
WHY: Final = 4
"""Number of reasons of the reject tray that are named."""


def plc_view(plc: SimulatedPlc, where: str) -> RenderableType:
    """Return the whole view; colours show the true state of each sheet, and trays the controller's decision."""
    rows = list(plc.rows)
    parts = [
        Columns([_tray(rows, "good"), _tray(rows, "reject")], padding=(0, 2)),
        _belt(plc),
        Columns([_registers(plc), _reasons(rows)], padding=(0, 2)),
        _legend(),
    ]
    alive = (" HEARTBEAT ", "reverse green") if plc.alive else (" NOBODY THERE ", "reverse bold red")
    head = Text.assemble(alive, f"  controller at {where} ")
    if plc.stopped:
        head.append(" STOP ", "reverse bold red")
    return Panel(Group(*parts), title=head, title_align="left", padding=(0, 1), expand=False)


def _mark(truth: str) -> tuple[str, str]:
    return MARKS.get(truth, OTHER)


def _tray(rows: list[TrayRow], name: str) -> RenderableType:
    inside = [row for row in rows if row.tray == name]
    text, shown = Text(), inside[-ACROSS * DEEP :]
    for at in range(DEEP):
        line = shown[at * ACROSS : (at + 1) * ACROSS]
        for row in line:
            text.append(*_mark(row.truth))
        text.append(" " * (ACROSS - len(line)) + ("\n" if at < DEEP - 1 else ""))
    bad = sum(row.truth != "good" for row in inside)
    style = "green" if name == "good" else "red"
    what = f"{name} tray: {len(inside):,}"
    wrong = "" if name == "reject" else f", {bad} bad"
    return Panel(text, title=what + wrong, title_align="left", border_style=style, expand=False)


def _belt(plc: SimulatedPlc) -> RenderableType:
    text = Text("camera ", style="dim")
    cells = [("·", "dim")] * CELLS
    travelled = plc.belt.travelled_mm(plc.clock())
    decided = {one.position: one for one in list(plc.stored)}
    for sheet in list(plc.belt.sheets):
        at = int((travelled - sheet.front_mm) / plc.belt.distance_mm * CELLS)
        if 0 <= at < CELLS:
            count = plc.belt.count_at(sheet.front_mm + plc.belt.distance_mm)
            near = [one for one in decided.values() if abs(apart(one.position, count)) <= one.tolerance]
            mark, style = _mark(sheet.truth)
            cells[at] = (mark if near else "□", style)
    for mark, style in cells:
        text.append(mark, style)
    return text.append(" gate", style="dim")


def _registers(plc: SimulatedPlc) -> RenderableType:
    values = unpacked(plc.registers)
    table = Table(title="Registers", title_justify="left", title_style="bold", box=None, padding=(0, 1))
    for heading in ("written by Prooflight", "", "shown by the controller", ""):
        table.add_column(heading, justify="left" if heading else "right")
    status = OurStatus(values["status"] & 63)
    flags = " ".join(
        flag.name.lower().replace("_", " ") for flag in OurStatus if flag in status and flag.name
    )
    result = values["result"]
    left = (
        ("status", flags or "-"),
        ("heartbeat", f"{values['heartbeat']}"),
        ("session", f"{values['session']}"),
        ("result_number", f"{values['result_number']}"),
        ("tag", f"{values['tag']}"),
        ("result", Result(result).name.lower() if result in list(Result) else f"{result}"),
        ("position", f"{values['position']}"),
    )
    right = (
        ("encoder", f"{plc.belt.count(plc.clock())}"),
        ("session_taken", f"{plc.session}"),
        ("result_taken", f"{plc.taken}"),
        ("in_good", f"{plc.counts['good']}"),
        ("in_reject", f"{plc.counts['reject']}"),
        ("results kept", f"{len(plc.stored)}"),
        ("press stopped", "yes" if plc.stopped else "no"),
    )
    for (name, value), (other, seen) in zip(left, right, strict=True):
        table.add_row(Text(name, style="dim"), value, Text(other, style="dim"), seen)
    return table


def _reasons(rows: list[TrayRow]) -> RenderableType:
    table = Table(
        title="Why rejected",
        title_justify="left",
        title_style="bold",
        show_header=False,
        box=None,
        padding=(0, 1),
    )
    table.add_column("", justify="right")
    table.add_column("")
    counts: dict[str, int] = {}
    for row in rows:
        if row.tray == "reject":
            counts[row.why] = counts.get(row.why, 0) + 1
    for why, count in sorted(counts.items(), key=lambda one: -one[1])[:WHY]:
        table.add_row(f"{count}", why)
    if not counts:
        table.add_row("", Text("nothing yet", style="dim"))
    return table


def _legend() -> Text:
    text = Text()
    for what, (mark, style) in (("good print", MARKS["good"]), ("misprint", MARKS["misprint"])):
        text.append(f"{mark} ", style).append(f"{what}   ", "dim")
    text.append(f"{OTHER[0]} ", OTHER[1]).append("other sheet   ", "dim")
    return text.append("□ ", "dim").append("no result yet", "dim")
