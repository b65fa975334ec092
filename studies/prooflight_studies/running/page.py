"""docs/results/running.md from the figures of the running study."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


def running_page(found: Mapping[str, Any], *, cores: int) -> str:
    """The page as far as it is measured."""
    parts = [
        "# The running press\n",
        f"Written by `prooflight study running` on {cores} cores. The drum plays prints of the press world, rendered "
        "beforehand; what its own thread costs is told apart. Deadline: 500 ms from a page's last line to its "
        "verdict. Parts that are missing were not measured.\n",
    ]
    live = [row for name in ("repeated", "different", "ours") for row in found.get(name, [])]
    if live:
        parts.append(_live(live))
    if "soak" in found:
        parts.append(_soak(found["soak"]))
    if "drift" in found:
        parts.append(_drift(found["drift"]))
    if "streak" in found:
        parts.append(_streak(found["streak"]))
    if "picture" in found:
        parts.append(
            "## What the operator sees\n\n"
            f"![The live view during an alarm]({found['picture']['picture']})\n\n"
            "Misprints among good prints, a streak that creeps in, and a lamp that ages.\n"
        )
    return "\n".join(parts)


COLUMNS: Final[dict[str, Callable[[Mapping[str, Any]], object]]] = {
    "run": lambda row: row["name"],
    "sensors": lambda row: row["sensors"],
    "detector": lambda row: row["detector"],
    "designs": lambda row: row["designs"],
    "prints": lambda row: row["prints"],
    "sheets": lambda row: row["sheets"],
    "asked /s": lambda row: row["asked_pages_per_s"] or "-",
    "reached /s": lambda row: f"{row['pages_per_s']:.2f}",
    "late": lambda row: row["late"],
    "not inspected": lambda row: row["not_inspected"],
    "misprints": lambda row: row["misprints"],
    "verdict median, 99 %, 99.9 %, greatest [ms]": lambda row: ", ".join(
        f"{row['verdict_ms'][name]:.0f}" for name in ("median", "p99", "p99.9", "greatest")
    ),
    "own memory at 100, at the end [MB]": lambda row: ", ".join(
        str(row["memory_mb"][when][0] or "-") for when in ("100", "end")
    ),
    "pages of the ring, mapped [MB]": lambda row: row["memory_mb"]["end"][1],
    "CPU a page [s]": lambda row: f"{row['cpu_s_a_page']:.3f}",
    "drum CPU a page [s]": lambda row: f"{row['drum_cpu_s_a_page']:.4f}",
}


MOST_LATE: Final = 20
"""Late sheets that are named; more are a rule and no exceptions."""


def _live(rows: list[Mapping[str, Any]]) -> str:
    lines = [
        "## Real time\n",
        "A4, 2048 pixels a line. *Asked*: the drum's speed; `-`: as fast as sheets are taken, which is the highest "
        "sustained speed. *CPU*: of reading, making ready, inspecting and all else; the drum's own is apart. The "
        "rasters of the ring's pages are a file mapped beside the inspection's own memory.\n",
        f"| {' | '.join(COLUMNS)} |",
        f"|{len(COLUMNS) * '---|'}",
        *(f"| {' | '.join(str(cell(row)) for cell in COLUMNS.values())} |" for row in rows),
        "\nAt full speed the source waits, so sheets queue and their latency says nothing. All prints are good: "
        "misprints are false alarms. Chi-square allows for sensor noise alone and calls nearly every real print a "
        "misprint; their places, which it then looks for, are part of its CPU.\n",
    ]
    for row in rows:
        if row["asked_pages_per_s"] and 0 < len(row.get("late_sheets", ())) <= MOST_LATE:
            late = ", ".join(f"{sheet} ({ms} ms)" for sheet, ms in row["late_sheets"])
            lines.append(f"Late of {row['name']}, {row['detector']}: sheet {late}.\n")
    taught = [row for row in rows if row["detector"] != "chi-square"]
    if taught:
        lines.append(f"The detector `{taught[0]['detector']}` promises {taught[0]['promise']}.\n")
    return "\n".join(lines)


def _soak(row: Mapping[str, Any]) -> str:
    named = ", ".join(f"{kind} {count}" for kind, count in row["named"].items())
    alarms = row.get("alarms", {})
    lines = [
        "## A long run full of faults\n",
        "Sheets of 36 x 44 mm, on which a stretch is one to four lines and a splice hides up to all; faults of whole "
        "pages are in [soak.md](soak.md).\n",
        f"{row['sheets']} sheets in {row['seconds']:.0f} s, {row['faults']} random faults, detector {row['detector']}; "
        f"{row['expected_sheets']} sheets were shown. Named in the journal: {named}.",
        f"Sheets taken for another page: {row.get('taken_for_another_page', 'unknown')}; the longest time out of step: "
        f"{row.get('steps_lost')} sheets.",
    ]
    if alarms:
        lines.append(
            f"Alarms of prints that otherwise pass, within three sheets behind a fault: "
            f"{alarms.get('near_alarms', 0)} of {alarms.get('near_sheets', 0)}; elsewhere: "
            f"{alarms.get('elsewhere_alarms', 0)} of {alarms.get('elsewhere_sheets', 0)}. "
            f"Prints that alarm anyway: {row.get('prints_that_alarm_anyway', 0)}."
        )
    memory = row["memory_mb"]
    lines.append(f"Own memory at 100 sheets {memory['100'][0]} MB, at the end {memory['end'][0]} MB.\n")
    if row["unnamed"]:
        some = "; ".join(
            f"{one['kind']} at {one['sheet']} ({one['said'] or 'nothing'})" for one in row["unnamed"][:12]
        )
        lines.append(f"Not named: {some}.\n")
    return "\n".join(lines)


def _drift(rows: list[Mapping[str, Any]]) -> str:
    lines = [
        "## A density that drifts by 0.05 % a page\n",
        "In the press world, where single prints scatter by 1.5 % and days by 1.2 %; a print is out of tolerance when "
        "its own gain, day and scatter included, passes 7 %. Pages are counted from the drift's beginning. Stated: one "
        "false alarm in 100,000 pages over all channels. Pages are those on which the sensors can tell the ink: one "
        "sensor alone tells black from the rest, and no other ink.\n",
        "| ink | sensors | good pages before | days | announced | before the first print out of tolerance | pages "
        "announced | first out of tolerance | other announcements |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        pages, out = (
            ", ".join("-" if one is None else str(one) for one in row[name])
            for name in ("pages", "first_out")
        )
        lines.append(
            f"| {row['ink']} | {row['sensors']} | {row['good_pages']} | {row['runs']} | {row['announced']} "
            f"| {row['before_first_out']} | {pages} | {out} | {row['others']} |"
        )
    lines.append(f"\nAs it is said: *{rows[0]['example']}*\n")
    return "\n".join(lines)


def _streak(row: Mapping[str, Any]) -> str:
    ink = row["ink_percent"]
    span = f"{min(ink)} to {max(ink)} %" if ink else "-"
    return (
        "## A streak that creeps in while a lamp ages\n\n"
        f"0.02 % of black a page in a column 0.5 mm wide, while the lamp loses 0.01 % a page, which is followed. "
        f"Announced on {row['announced']} of {row['runs']} days, at {span} of ink; streaks count as misprints from "
        f"{row['gate_ink_percent']:.0f} %. Places off by {max(row['off_mm'], default=0)} mm at most.\n\n"
        f"As it is said: *{row['example']}*\n"
    )
