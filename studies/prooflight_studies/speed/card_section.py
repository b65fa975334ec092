"""The section of ``docs/performance.md`` on a graphics card, from the figures that ``bench --device gpu`` stored."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

from prooflight_studies.harness.page import plain

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_studies.speed.card import CardFigures

HEADING: Final = "\n## On a graphics card\n"
STORED: Final = "performance-card.json"


def write_card_section(figures: CardFigures, folder: Path) -> None:
    """Store the figures beside ``performance.md`` and put the section at its end."""
    text = json.dumps(plain(figures), indent=1, allow_nan=False)
    (folder / STORED).write_text(text + "\n", encoding="utf-8")
    add_card_section(folder)


def add_card_section(folder: Path) -> None:
    """Put the section of stored figures at the end of ``performance.md``; without any, nothing changes."""
    if not (folder / STORED).is_file():
        return
    page = folder / "performance.md"
    before = page.read_text(encoding="utf-8").split(HEADING)[0]
    figures = json.loads((folder / STORED).read_text(encoding="utf-8"))
    page.write_text(before + card_section(figures), encoding="utf-8")


def card_section(figures: dict[str, Any]) -> str:
    """Return the section's text."""
    compared = figures["compared"]
    flips = sum(one["cpu"] != one["gpu"] for one in compared)
    misprints = sum(bool(one["misprint"]) for one in compared)
    pages = len({one["page"] for one in compared})
    off = max(abs(one["cpu_score"] - one["gpu_score"]) for one in compared)
    flights = ", ".join(f"{rate:,.0f} with {count}" for count, rate in figures["in_flight"].items())
    rows = "\n".join(
        f"| {threads} | {rate:.1f} | {figures['cpu_per_s'][threads]:.1f} |"
        for threads, rate in figures["gpu_per_s"].items()
    )
    of = figures
    return f"""{HEADING}
`prooflight bench --device gpu --docs docs` writes this section. Card: {of["card"]}, numba-cuda {of["numba_cuda"]};
{of["host_cores"]} cores; scans of {of["camera_mpx"]:.2f} Mpx.

Of {len(compared)} prints of {pages} pages of the sample job ({misprints} misprinted) {flips} were judged otherwise
on the card than on the processor; scores differed by at most {off:.2f}, where {of["threshold"]:.2f} is the threshold.

A sheet takes {of["sheet_ms"]:.2f} ms on the card, {of["upload_ms"]:.2f} ms of it to send the scan. Sheets a second
with so many on it at once: {flights}.

An inspection takes {of["gpu_cpu_s"]:.3f} s of processor time with its images on the card, {of["cpu_cpu_s"]:.3f} s
without: registration, fringes, marks, glyphs and statistics remain on the processor. Whole inspections a second in one
process, whose threads wait for the interpreter:

| threads | images on the card | all on the processor |
|---:|---:|---:|
{rows}
"""
