"""The page ``tables.md``: accuracy of the look-up tables, in words and tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.files.atomic import whole_file

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

GOAL_RMS_SIGMA: Final = 0.10
"""A hundredth of the noise's variance: the tables then cost nothing that a detector could notice."""
GOAL_WHITE_SIGMA: Final = 0.03
GOAL_SIGMA_PERCENT: Final = 1.0
GOAL_BUILD_S: Final = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Worst:
    """One of the colours farthest off."""

    cmyk_percent: tuple[float, float, float, float]
    error_sigma: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRow:
    """One sensor's tables on one set of colours. Errors of the mean are in sigma of the temporal noise."""

    press: str
    inks: str
    sensor: str
    colours: str
    different: int
    rms_sigma: float
    """Over different colours."""
    rms_sigma_by_pixels: float
    worst_page_rms_sigma: float
    """Of the page where it is greatest, over its different colours."""
    worst_page_rms_sigma_by_pixels: float
    max_sigma: float
    white_sigma: float
    sigma_percent: float
    """Rms error of the temporal sigma, over different colours. [%]"""
    worst: tuple[Worst, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BuiltPress:
    """What was measured, and how long it took to build."""

    press: str
    inks: str
    digest: str
    press_file_sha256: str
    chart_digest: str
    sensors: int
    build_s: float
    build_cpu_s: float
    load: float
    """Programs that wanted to run when it was built, this one included (average of a minute). [-]"""
    cores: int
    pixels: int


def write_table_page(
    path: Path, rows: Sequence[TableRow], built: Sequence[BuiltPress], sources: Mapping[str, str]
) -> None:
    """Write the page, whole or not at all. sources: what each set of colours is of."""
    sections = [
        "# Look-up tables against the exact model",
        _goals(rows, built),
        _accuracy(rows),
        "## Presses",
        _presses(built),
        "## Colours",
        _colours(sources),
        "## Where the mean errs most",
        _worst(rows),
    ]
    with whole_file(path) as unfinished:
        unfinished.write_text("\n\n".join(sections) + "\n", encoding="utf-8")


def _goals(rows: Sequence[TableRow], built: Sequence[BuiltPress]) -> str:
    worst = max(max(row.rms_sigma, row.rms_sigma_by_pixels) for row in rows)
    white = max(row.white_sigma for row in rows)
    sigma = max(row.sigma_percent for row in rows)
    longest = max(press.build_s for press in built)
    return (
        "Prediction looks colours up in tables of 33 nodes an ink (decision 3). This page compares them with the full "
        "spectral path, colour by colour, in standard deviations of the temporal noise of that colour. "
        "`prooflight study tables` wrote it.\n\n"
        "| | goal | worst row below | |\n|---|---:|---:|---|\n"
        f"| mean, rms | {GOAL_RMS_SIGMA:.2f} sigma | {worst:.3f} sigma | {_met(worst, GOAL_RMS_SIGMA)} |\n"
        f"| mean at paper white | {GOAL_WHITE_SIGMA:.2f} sigma | {white:.5f} sigma "
        f"| {_met(white, GOAL_WHITE_SIGMA)} |\n"
        f"| temporal sigma, rms | {GOAL_SIGMA_PERCENT:g} % | {sigma:.3f} % | {_met(sigma, GOAL_SIGMA_PERCENT)} |\n"
        f"| build | {GOAL_BUILD_S:g} s | {longest:.1f} s | {_met(longest, GOAL_BUILD_S)} |"
    )


def _met(value: float, goal: float) -> str:
    return "met" if value <= goal else "**missed**"


def _accuracy(rows: Sequence[TableRow]) -> str:
    lines = [
        "`by colour` counts every different colour of a page once, `by pixels` as often as it is printed; `worst page` "
        "is the greatest of any page, both ways: of few colours, one can be off by itself. `largest` "
        "is over all colours looked at.",
        "",
        "| press | inks | sensor | colours | different | mean, by colour | by pixels "
        "| worst page, by colour | by pixels | largest | white | sigma |",
        "|---|---|---|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    lines += [
        f"| {row.press} | {row.inks} | {row.sensor} | {row.colours} | {row.different:,} | {row.rms_sigma:.4f} "
        f"| {row.rms_sigma_by_pixels:.4f} | {row.worst_page_rms_sigma:.4f} "
        f"| {row.worst_page_rms_sigma_by_pixels:.4f} | {row.max_sigma:.3f} "
        f"| {row.white_sigma:.5f} | {row.sigma_percent:.4f} % |"
        for row in rows
    ]
    return "\n".join(lines)


def _presses(built: Sequence[BuiltPress]) -> str:
    lines = [
        "`build` is everything from press file to artefact, fitting and cross-validating the inks included, in seconds "
        "of a clock and of one core of the machine that wrote this page; `load` is how many programs wanted to run "
        "meanwhile, this one included, on how many cores.",
        "",
        "| press | inks | sensors x pixels | build | core | load | press file | chart | artefact |",
        "|---|---|---|---:|---:|---:|---|---|---|",
    ]
    lines += [
        f"| {press.press} | {press.inks} | {press.sensors} x {press.pixels} | {press.build_s:.1f} s "
        f"| {press.build_cpu_s:.1f} s | {press.load:.1f} on {press.cores} "
        f"| `{press.press_file_sha256[:16]}` | {_code(press.chart_digest[:16])} | `{press.digest[:16]}` |"
        for press in built
    ]
    return "\n".join(lines)


def _code(text: str) -> str:
    return f"`{text}`" if text else "none"


def _colours(sources: Mapping[str, str]) -> str:
    lines = [f"- **{name}**: {source}." for name, source in sources.items()]
    lines.append(
        "\nOf a page with more than 20,000 colours, its 5,000 most frequent ones and 15,000 of the others, drawn at "
        "random, stand for all."
    )
    return "\n".join(lines)


def _worst(rows: Sequence[TableRow]) -> str:
    lines = ["C / M / Y / K in per cent, and the error in sigma.", ""]
    lines += ["| press | sensor | colours | farthest off |", "|---|---|---|---|"]
    for row in rows:
        cells = ", ".join(
            f"{' / '.join(f'{part:g}' for part in worst.cmyk_percent)}: {worst.error_sigma:+.2f}"
            for worst in row.worst
        )
        lines.append(f"| {row.press} | {row.sensor} | {row.colours} | {cells} |")
    return "\n".join(lines)
