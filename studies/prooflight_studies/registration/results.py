"""Figures of the registration study's page from its rows: accuracy of the registration of pages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.harness.picture import new_figure, plain_axes, write_figure
from prooflight_studies.registration.truth import TRUTH_NOTE

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

MEASURES: Final = ("global", "rms", "p99", "worst", "mean")
COLUMNS: Final = (
    *("design", "real", "condition", "white", "found", "off_place"),
    *(f"{area}_{measure}" for area in ("all", "content") for measure in MEASURES),
    *("sd", "tiles", "matching", "foreign", "residual"),
    "content_alone",
)
NAMES: Final = ("good", "missing plane", "missing block", "far off", "another page")
WHITE: Final = 0.6
GOALS: Final = (
    ("global part", "content_global", 0.05),
    ("with the local field", "content_rms", 0.12),
    ("99th percentile", "content_p99", 0.3),
)
"""Name, key in ``summary``, and limit. [pixels]"""
PANEL_INCH: Final = (5.2, 3.9)
COLOURS: Final = ("#2b6cb0", "#c05621", "#2f855a")


def _column(rows: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    return rows[:, COLUMNS.index(name)]


def _rms(values: NDArray[np.float64]) -> float:
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def summary(rows: NDArray[np.float64]) -> dict[str, float]:
    """Return root mean squares over registered scans; p99 is the mean over scans of each scan's 99th percentile."""
    registered = rows[_column(rows, "found") > 0]
    measures: dict[str, float] = {"scans": len(rows), "found": len(registered)}
    for area in ("content", "all"):
        measures |= {
            f"{area}_{name}": _rms(_column(registered, f"{area}_{name}")) for name in ("global", "rms")
        }
        measures[f"{area}_p99"] = (
            float(np.nanmean(_column(registered, f"{area}_p99"))) if len(registered) else np.nan
        )
    return measures


def register_results(
    whole: NDArray[np.float64], crops: NDArray[np.float64], *, seed: int, facts: str
) -> dict[str, Any]:
    """Return all figures of the page, from rows of ``COLUMNS``; facts: camera and raster, in words."""
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
    designs, real = (
        len(np.unique(rows[:, :2], axis=0)) for rows in (whole, whole[_column(whole, "real") > 0])
    )
    return {
        "seed": seed,
        "worlds": worlds_digest(),
        "truth": TRUTH_NOTE,
        "facts": facts,
        "designs": designs,
        "real": real,
        "scans": len(whole),
        "goals": [
            {"name": name, "reached": table["good prints"][key], "limit": limit} for name, key, limit in GOALS
        ],
        "alone": _rms(_column(whole[good & (_column(whole, "found") > 0)], "content_alone")),
        "whole": table,
        "silent": silent | {"whole pages": _silent(whole)},
    }


def draw_errors(path: Path, whole: NDArray[np.float64]) -> None:
    """Draw the errors of whole pages, from rows of ``COLUMNS``."""
    condition, registered = _column(whole, "condition"), _column(whole, "found") > 0
    rms = _column(whole, "content_rms")
    shown = (condition == 0) & registered
    _draw_registration(
        path,
        {
            name: rms[registered & (condition == i)]
            for i, name in enumerate(("good prints", "a plane missing", "a block missing"))
        },
        _column(whole, "white")[shown],
        rms[shown],
        _column(whole, "real")[shown] > 0,
    )


def _draw_registration(
    path: Path,
    errors: Mapping[str, NDArray[np.float64]],
    white: NDArray[np.float64],
    good: NDArray[np.float64],
    real: NDArray[np.bool_],
) -> None:
    """Draw shares of scans below an error (left), and good prints' errors by the white of the page (right).

    errors (n,) by name, good (n,): rms with the local field, where there is content [pixels]; white (n,): shares; real
    (n,): whether it is a real page.
    """
    figure = new_figure(2 * PANEL_INCH[0], PANEL_INCH[1], pads_inch=(0.1, 0.1))
    left, right = figure.subplots(1, 2)
    for (name, values), colour in zip(errors.items(), COLOURS, strict=False):
        ordered = np.sort(values[np.isfinite(values)])
        shares = (np.arange(ordered.size) + 1) / max(ordered.size, 1)
        left.step(
            ordered, 100 * shares, where="post", color=colour, label=f"{name} ({ordered.size} scans found)"
        )
    left.axvline(GOALS[1][2], color="0.4", linestyle="--", linewidth=1, label="goal, rms of good prints")
    left.set(xlabel="Error of a scan, rms [pixels]", ylabel="Scans with less [%]", ylim=(0, 102))
    left.legend(loc="lower right", frameon=False)
    for kind, mask, mark, colour in (
        ("composed", ~real, "o", COLOURS[0]),
        ("real page", real, "^", COLOURS[1]),
    ):
        right.plot(100 * white[mask], good[mask], mark, color=colour, markersize=4, alpha=0.6, label=kind)
    right.axhline(GOALS[1][2], color="0.4", linestyle="--", linewidth=1)
    right.set(xlabel="White of the page [%]", ylabel="Error of a good print, rms [pixels]", ylim=(0, None))
    right.legend(loc="upper left", frameon=False)
    for axes in (left, right):
        plain_axes(axes)
    left.set_xlim(0.02, None)
    left.set_xscale("log")
    ticks = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
    left.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    left.minorticks_off()
    write_figure(figure, path)


def _silent(rows: NDArray[np.float64]) -> dict[str, int]:
    registered = _column(rows, "found") > 0
    return {
        "scans": len(rows),
        "found": int(registered.sum()),
        "off place": int((_column(rows, "off_place") > 0).sum()),
        "wrong": int((registered & (_column(rows, "content_mean") > 1)).sum()),
        "wrong somewhere": int((registered & (_column(rows, "content_worst") > 1)).sum()),
    }
