"""``calibration.md``: the study of calibration from charts as a page a person reads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.files.atomic import whole_file

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


GOAL_SIGMA: Final = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationRow:
    """One calibration judged on one set of colours; errors in a pixel's temporal sigma, all sensors together."""

    world: str
    patches: int
    pages: int
    prints: int
    colours: str
    own_rms: float
    """Against what these prints' inks and paper were, on average."""
    own_max: float
    session_rms: float
    """Against the session's inks on these prints' paper."""
    session_paper_rms: float
    """Against the session's inks on the paper as it should be."""
    left_out: float
    """What the calibration itself says: patches predicted from all others."""
    sigma_percent: float
    """Rms error of sigma."""


def write_calibration_page(
    path: Path, rows: Sequence[CalibrationRow], *, dpi: float, seed: int, worlds: str
) -> None:
    """Write the page."""
    lines = [
        "# Calibration from a printed chart",
        "",
        "Written by `prooflight study calibration`; do not edit.",
        "",
        f"A colour line camera of {dpi:g} dpi scans charts of `chart make`; `calibrate` sees scans and recipe",
        f"file alone. Scans: `simulating.fast`, seed {seed}, worlds `{worlds[:16]}`. Errors are of the expected",
        "signal, in a single pixel's temporal sigma, over different colours and all sensors. *Own*: against the",
        "mean of the very prints that were scanned, their inks, dot gain, paper and lamp. *Session*: against what",
        "the press prints on average that day, on these prints' paper; *and paper*: on paper as it should be.",
        "*Left out*: what it says itself, without the truth: recipes predicted from all others. Goal: 0.1 sigma rms.",
        "",
        "| world | patches | pages | prints | colours | own rms | largest | session | and paper | left out | sigma |",
        "|---|---:|---:|---:|---|---:|---:|---:|---:|---:|---:|",
    ]
    lines += [
        f"| {row.world} | {row.patches} | {row.pages} | {row.prints} | {row.colours} | {row.own_rms:.3f} "
        f"| {row.own_max:.2f} | {row.session_rms:.2f} | {row.session_paper_rms:.2f} | {row.left_out:.3f} "
        f"| {row.sigma_percent:.2f} % |"
        for row in rows
    ]
    best = min(rows, key=lambda row: (row.world != "press", row.own_rms))
    met = "met" if best.own_rms <= GOAL_SIGMA else "missed"
    lines += [
        "",
        f"Best in the {best.world} world: {best.own_rms:.3f} sigma rms with {best.patches} patches and {best.prints} "
        f"prints on {best.colours} ({met}).",
        "",
        "One print's inks are not the session's: 1.5 % of ink and 1.6 % of dot gain are several sigma, whatever",
        "the chart and the camera; more prints average them, with the root of their number.",
        "",
    ]
    with whole_file(path) as unfinished:
        unfinished.write_text("\n".join(lines), encoding="utf-8")
