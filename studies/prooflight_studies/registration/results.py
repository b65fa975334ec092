"""Figures of the registration study's page from its rows: accuracy of the registration of pages."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.cmyk import INKS
from prooflight.prediction.predict import predict
from prooflight.simulation.prints import plane_pixels
from prooflight.simulation.worlds import worlds_digest
from prooflight_studies.harness.picture import new_figure, plain_axes, write_figure

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.registration.register import Registration
    from prooflight.scans.placement import Placement
    from prooflight.simulation.prints import Print

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


# --- true position of a print, from the values drawn to print it ---

TRUTH_NOTE: Final = (
    "the sheet's simulated placement and, since content moves with the ink planes, the single shift that is closest "
    "to their simulated register: over all pixels, in units of the noise, weighted by the change of the expected "
    "signal when a plane moves (a plane that is not printed changes nothing). It does not depend on the measured "
    "positions; the measured placement and planes, weighted as in the truth, are compared with it"
)
"""Explanation of the truth on the page of results."""


def printed_at(print_: Print, parts: NDArray[np.float64], page: Page) -> Placement:
    """Return the true position of a print of ``page``; parts (2, 4): ``plane_parts`` of what is printed."""
    return _with_planes(print_.placement, plane_pixels(print_, page) * page.pixel_mm, parts)


def reported_at(result: Registration, parts: NDArray[np.float64]) -> Placement:
    """Return the reported position of the same mix of planes: registration's placement and plane displacements."""
    return _with_planes(result.placement, result.planes_mm, parts)


def _with_planes(place: Placement, planes_mm: NDArray[np.floating], parts: NDArray[np.float64]) -> Placement:
    x, y = np.einsum("ap,pa->a", parts, planes_mm)
    return replace(place, shift_mm=(place.shift_mm[0] + float(x), place.shift_mm[1] + float(y)))


def plane_parts(printed: Page, press: Press) -> NDArray[np.float64]:
    """Return the weight of each plane in a page's apparent position, across and along (2, 4).

    The weights sum to 1, or are 0 if nothing is printed. With g_p the change of the expected signal as plane p moves,
    and g their sum, planes that are displaced by d_p are closest to the whole page displaced by sum(d_p <g_p, g>) / <g,
    g>.
    """
    start = predict(printed, sensors=press.sensors, geometry=press.geometry, threads=1)
    parts = np.zeros((2, INKS))
    for axis in range(2):
        slopes = {
            ink: predict(
                _moved(printed, ink, axis), sensors=press.sensors, geometry=press.geometry, threads=1
            ).expected_dn
            - start.expected_dn
            for ink in range(INKS)
            if printed.cmyk[..., ink].any()
        }
        if not slopes:
            continue
        weighted = sum(slopes.values()) / start.variance_dn2
        weights = {ink: float(np.vdot(slope, weighted)) for ink, slope in slopes.items()}
        parts[axis, list(weights)] = np.array(list(weights.values())) / max(sum(weights.values()), 1e-9)
    return parts


def _moved(page: Page, ink: int, axis: int) -> Page:
    """Move one plane a raster pixel to the right (axis 0) or down (1)."""
    cmyk = page.cmyk.copy()
    cmyk[..., ink] = 0
    if axis == 0:
        cmyk[:, 1:, ink] = page.cmyk[:, :-1, ink]
    else:
        cmyk[1:, :, ink] = page.cmyk[:-1, :, ink]
    return replace(page, cmyk=cmyk)
