"""The page ``soak.md``: what an hour with faults came to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.files.atomic import whole_file
from prooflight.simulation.drum import AMOUNTS
from prooflight.simulation.worlds import worlds_digest

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

UNITS: Final = {
    "slip": "mm",
    "stretch": "%",
    "lost-lines": "lines",
    "extra-lines": "lines",
    "splice": "mm",
}
MOST_NOTES: Final = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class SoakFigures:
    """What came of the soak."""

    kinds: dict[str, dict[str, int]]
    """Of each kind: drawn, named, in_step."""
    sheets: int
    seen: int
    """Sheets that came out; as many as passed, or some were lost or made up."""
    false_faults: int
    """Faults said of sheets that no fault concerned."""
    wrong_pages: int
    """Such sheets taken for another page or none."""
    unlike: int
    """Such sheets cut out otherwise than in a run without faults."""
    missing_said: int
    """Pages said to be missing."""
    missing_true: int
    """Of them, pages that did not come."""
    missing_in_truth: int
    paging_ms_per_page: float
    """CPU time."""
    notes: tuple[str, ...]
    """What went wrong, one line each."""


def write_soak_page(
    path: Path, found: SoakFigures, size: Mapping[str, int], *, seed: int, every: int, apart: int
) -> None:
    """Write the page."""
    pages = size["designs"] + size["templates"] * size["forms"]
    total = {name: sum(row[name] for row in found.kinds.values()) for name in ("drawn", "named", "in_step")}
    lines = [
        "# A run with faults",
        "",
        f"{found.sheets} sheets of a job of {pages} pages, each different: {size['designs']} composed designs of all "
        f"sizes, then {size['templates']} forms filled in {size['forms']} times each with three words of their own. "
        "Printed in the press world (one session, every print its own), the prototype's camera, "
        f"`worlds.toml` {worlds_digest()[:12]}, seed {seed}; played over and over by the simulated drum as fast as "
        f"possible. About every {every}th sheet, at least {apart} apart, a fault of a kind drawn evenly. "
        "What was said is read back from the journal. No threshold was chosen on these pages.",
        "",
        f"**{total['named']} of {total['drawn']} faults are named; after {total['in_step']} of them the run is in "
        "step again within 2 sheets** (the 2 from the fault's first sheet on; the 3 behind them all right).",
        "",
        "| fault | amounts | drawn | named | in step within 2 sheets |",
        "|---|---|---|---|---|",
    ]
    for kind, row in found.kinds.items():
        low, high = AMOUNTS.get(kind, (0.0, 0.0))
        amounts = f"{low:g} to {high:g} {UNITS[kind]}" if kind in UNITS else ""
        lines.append(f"| {kind} | {amounts} | {row['drawn']} | {row['named']} | {row['in_step']} |")
    quiet = found.sheets - total["drawn"]
    lines += [
        "",
        "Lines are lost and doubled in the camera's count or, as often, unknown to it.",
        "",
        "| of the sheets | |",
        "|---|---|",
        f"| passed the camera | {found.sheets} |",
        f"| came out of paging | {found.seen} |",
        f"| not concerned by a fault, and yet said to have one | {found.false_faults} |",
        f"| not concerned, and taken for another page or none | {found.wrong_pages} |",
        f"| not concerned, and cut out otherwise than in a run without faults | {found.unlike} |",
        f"| pages that did not come: said, rightly, in truth | {found.missing_said}, {found.missing_true}, "
        f"{found.missing_in_truth} |",
        "",
        f"About {quiet} sheets were not concerned. Cut out alike means: the sheet's lines in the scan are the same to "
        "the last bit, so that its verdict is the same whatever the detector; a fault can so cause no false alarm "
        "beyond the sheets that it concerns.",
        "",
        f"Paging took {found.paging_ms_per_page:.1f} ms of one core a page, everything from the lines to the scan "
        "that is handed over and its place in the job.",
    ]
    if found.notes:
        shown = found.notes[:MOST_NOTES]
        lines += ["", f"What went wrong ({len(shown)} of {len(found.notes)}):", ""]
        lines += [f"- {note}" for note in shown]
    with whole_file(path) as unfinished:
        unfinished.write_text("\n".join(lines) + "\n", encoding="utf-8")
