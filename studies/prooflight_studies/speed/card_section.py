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
RATES: Final = """
Whole inspections a second by the worker processes of a run, with two threads each:

| workers | images on the card | all on the processor |
|---:|---:|---:|
"""


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
    of = figures
    flights = ", ".join(f"{rate:,.0f} with {count}" for count, rate in of["in_flight"].items())
    rows = "".join(
        f"| {workers} | {rate:.1f} | {of['cpu_per_s'][workers]:.1f} |\n"
        for workers, rate in of["gpu_per_s"].items()
    )
    rates = RATES + rows if rows else ""
    middle, most_95, most_99, most = of["score_off"]
    differing = "".join(
        f"\n\n- {one['page']}, {one['misprint'] or 'good'}: {one['cpu']} (score {one['cpu_score']:.2f}) "
        f"on the processor, {one['gpu']} ({one['gpu_score']:.2f}) on the card"
        for one in of["differing"]
    )
    return f"""{HEADING}
`prooflight bench --device gpu --docs docs` writes this section. Card: {of["card"]}, numba-cuda {of["numba_cuda"]};
{of["host_cores"]} cores; scans of {of["camera_mpx"]:.2f} Mpx.

Of {of["prints"]:,} prints of {of["pages"]} pages of the sample job ({of["misprints"]:,} misprinted)
{len(of["differing"])} had another verdict on the card than on the processor, and {of["other_kinds"]} were misprints of
another kind. Scores differed by {middle:.3f} (median), by at most {most_95:.2f} on 95 of 100 prints, {most_99:.2f} on
99 of 100 and {most:.2f} on all; the threshold is {of["threshold"]:.2f}.{differing}

A sheet takes {of["sheet_ms"]:.2f} ms on the card, {of["upload_ms"]:.2f} ms of it to send the scan. Sheets a second
with so many on it at once: {flights}. The first inspection takes {of["compiled_s"]:.0f} s: the card's code is compiled.

An inspection takes {of["gpu_cpu_s"]:.3f} s of processor time with its images on the card, {of["cpu_cpu_s"]:.3f} s
without: registration, fringes, marks, glyphs and statistics remain on the processor.
{rates}"""
