"""The page ``registration.md``: how well pages are found."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.files.atomic import whole_file
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.registration.picture import draw_registration

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

MEASURES: Final = ("global", "rms", "p99", "worst", "mean")
COLUMNS: Final = (
    *("design", "real", "condition", "white", "found", "off_place"),
    *(f"{area}_{measure}" for area in ("all", "content") for measure in MEASURES),
    *("sd", "tiles", "matching", "foreign", "residual"),
)
NAMES: Final = ("good", "missing plane", "missing block", "far off", "another page")
WHITE: Final = 0.6


def _column(rows: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    return rows[:, COLUMNS.index(name)]


def _rms(values: NDArray[np.float64]) -> float:
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def summary(rows: NDArray[np.float64]) -> dict[str, float]:
    """Root mean squares over scans that were found; p99 is the median and the mean over scans."""
    kept = rows[_column(rows, "found") > 0]
    measures: dict[str, float] = {"scans": len(rows), "found": len(kept)}
    for area in ("content", "all"):
        measures |= {f"{area}_{name}": _rms(_column(kept, f"{area}_{name}")) for name in ("global", "rms")}
        measures[f"{area}_p99"] = float(np.nanmean(_column(kept, f"{area}_p99"))) if len(kept) else np.nan
    return measures


def write_register_page(
    path: Path, whole: NDArray[np.float64], crops: NDArray[np.float64], *, seed: int, facts: str
) -> dict[str, object]:
    """Write the page; returns its figures."""
    condition, white = _column(whole, "condition"), _column(whole, "white")
    good = condition == 0
    groups = {
        "good prints": whole[good],
        "of them, real pages": whole[good & (_column(whole, "real") > 0)],
        f"of them, under {WHITE:.0%} white": whole[good & (white < WHITE)],
        f"of them, {WHITE:.0%} white or more": whole[good & (white >= WHITE)],
        "a plane missing": whole[condition == 1],
        "a block missing": whole[condition == 2],
    }
    table = {name: summary(rows) for name, rows in groups.items()}
    silent = {name: _silent(crops[_column(crops, "condition") == i]) for i, name in enumerate(NAMES)}
    silent["whole pages"] = _silent(whole)
    figures: dict[str, object] = {"whole": table, "silent": silent}
    with whole_file(path) as unfinished:
        unfinished.write_text(_page(table, silent, whole, seed, facts), encoding="utf-8")
    found = _column(whole, "found") > 0
    rms = _column(whole, "content_rms")
    shown = good & found
    draw_registration(
        path.with_suffix(".png"),
        {
            name: rms[found & (condition == i)]
            for i, name in enumerate(("good prints", "a plane missing", "a block missing"))
        },
        white[shown],
        rms[shown],
        _column(whole, "real")[shown] > 0,
    )
    return figures


def _silent(rows: NDArray[np.float64]) -> dict[str, int]:
    found = _column(rows, "found") > 0
    return {
        "scans": len(rows),
        "found": int(found.sum()),
        "off place": int((_column(rows, "off_place") > 0).sum()),
        "wrong": int((found & (_column(rows, "content_mean") > 1)).sum()),
        "wrong somewhere": int((found & (_column(rows, "content_worst") > 1)).sum()),
    }


def _page(
    table: dict[str, dict[str, float]],
    silent: dict[str, dict[str, int]],
    whole: NDArray[np.float64],
    seed: int,
    facts: str,
) -> str:
    goal = table["good prints"]
    designs, real = (
        len(np.unique(rows[:, :2], axis=0)) for rows in (whole, whole[_column(whole, "real") > 0])
    )
    met = ", ".join(
        f"{name} {goal[key]:.3f} ({'met' if goal[key] <= limit else 'missed'}: {limit:g})"
        for name, key, limit in (
            ("global part", "content_global", 0.05),
            ("with the local field", "content_rms", 0.12),
            ("99th percentile", "content_p99", 0.3),
        )
    )
    lines = [
        "# Where the page lies",
        "",
        f"Written by `prooflight study registration`, seed {seed}. Press world `{worlds_digest()[:16]}`; {facts}.",
        f"{designs} designs, {real} of them real pages; {len(whole)} scans. Figures in camera pixels, rms of x and y",
        "over scans that were found; the 99th percentile (of sizes across and along) is the mean over scans.",
        "",
        f"Goals, on good prints where there is content: {met}.",
        "",
        "The truth is the sheet's drawn placement and, since content moves with the ink planes, the mean of",
        "their drawn register, weighted as their edges count (a plane that is not printed does not).",
        "*Global*: the part of the error linear over the page.",
        "*Content*: errors across, and along, over points of a 3 mm grid about which the signal's slope that way is at",
        "least 2 % of white a pixel, rms over 3 mm; not next to the sheet's edge, where one sees the sheet, not print.",
        "*Page*: over all points, blank ones too, where nothing tells and the warp is a guess from afar.",
        "",
        "| scans of | scans | found | content: global | with field | 99 % | page: global | with field | 99 % |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    keys = ("content_global", "content_rms", "content_p99", "all_global", "all_rms", "all_p99")
    for name, row in table.items():
        cells = " | ".join(f"{row[key]:.3f}" for key in keys)
        lines.append(f"| {name} | {row['scans']:.0f} | {row['found']:.0f} | {cells} |")
    lines += [
        "",
        "![Errors of scans, and of good prints by how white the page is](registration.png)",
        "",
        "## Never silently wrong",
        "",
        "Cuttings of 60 x 60 mm as pages, each in five conditions, and the whole pages above. *Wrong*: found,",
        "but off by more than a pixel on the mean over its content; *somewhere*: at any point with content.",
        "",
        "| scans of | scans | found | called off its place | wrong | somewhere |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    lines += [
        f"| {name} | " + " | ".join(str(value) for value in row.values()) + " |"
        for name, row in silent.items()
    ]
    return "\n".join([*lines, ""])
