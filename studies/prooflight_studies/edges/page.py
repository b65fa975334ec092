"""What the edge study found, and its page."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from prooflight.commissioning.build import SUPERSAMPLING
from prooflight.files.atomic import whole_file

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight_studies.edges.rig import Band

GOAL_SIGMA = 0.5
_LOG_BINS = np.linspace(-4.0, 4.0, 1601)  # of |z|: half a per cent a bin is finer than any figure shown


@dataclass(slots=True, kw_only=True)
class ErrorSum:
    """Errors of one way to predict, gathered over pages."""

    name: str
    edge_pixels: int = 0
    pixels: int = 0
    _edge_squares: float = 0.0
    _squares: float = 0.0
    _histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(_LOG_BINS.size - 1, np.int64))
    _normal: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2, 2)))
    _right: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    rip_cpu_s: list[float] = field(default_factory=list)
    predict_cpu_s: list[float] = field(default_factory=list)

    def add(self, predicted_dn: NDArray[np.floating], true: Band) -> None:
        """Take in the lines of a band, (lines, pixels) [DN]."""
        edges, sigma_dn = true.edges, true.sigma_dn
        z = (predicted_dn - true.mean_dn) / sigma_dn
        at_edges = z[edges]
        self.edge_pixels += at_edges.size
        self.pixels += z.size
        self._edge_squares += float((at_edges**2).sum())
        self._squares += float((z**2).sum())
        magnitude = np.log10(np.abs(at_edges).clip(1.01e-4, 0.99e4))
        self._histogram += np.histogram(magnitude, _LOG_BINS)[0]
        along, across = np.gradient(true.mean_dn, axis=0), np.gradient(true.mean_dn, axis=1)
        slope = np.stack([across[edges], along[edges]]) / sigma_dn[edges]
        self._normal += slope @ slope.T
        self._right += slope @ at_edges

    def row(self) -> ErrorRow:
        """The figures; needs edge pixels."""
        # A pattern that lies too far right by m is too dark or too light by -m times the slope.
        fitted = np.linalg.lstsq(self._normal, self._right, rcond=None)[0]
        left = max(self._edge_squares - float(fitted @ self._right), 0.0)
        middle = int(np.searchsorted(self._histogram.cumsum(), self.edge_pixels / 2))
        return ErrorRow(
            name=self.name,
            edge_rms_sigma=float(np.sqrt(self._edge_squares / self.edge_pixels)),
            edge_median_sigma=float(10 ** _LOG_BINS[middle]),
            shifted_edge_rms_sigma=float(np.sqrt(left / self.edge_pixels)),
            all_rms_sigma=float(np.sqrt(self._squares / self.pixels)),
            right_pixels=float(-fitted[0]),
            down_pixels=float(-fitted[1]),
            edge_pixels=self.edge_pixels,
            rip_cpu_s=float(np.median(self.rip_cpu_s)) if self.rip_cpu_s else None,
            predict_cpu_s=float(np.median(self.predict_cpu_s)) if self.predict_cpu_s else None,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorRow:
    """One way to predict, over all pages; errors in units of the temporal sigma."""

    name: str
    edge_rms_sigma: float
    edge_median_sigma: float
    """Half of the edge pixels lie closer."""
    shifted_edge_rms_sigma: float
    """After the best constant shift, the same on every page."""
    all_rms_sigma: float
    right_pixels: float
    down_pixels: float
    """How far the prediction lies to the right and down of the truth. [camera pixels]"""
    edge_pixels: int
    rip_cpu_s: float | None
    predict_cpu_s: float | None
    """CPU time of a page, the median over pages; None: not timed. [s]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeStudy:
    """Everything the result page shows."""

    pages: tuple[str, ...]
    criterion: str
    method: str
    from_vector: tuple[ErrorRow, ...]
    truth_itself: ErrorRow
    same_raster: tuple[ErrorRow, ...]


def write_edge_results(results: Path, study: EdgeStudy) -> None:
    """Write ``edges.md`` whole or not at all."""
    results.mkdir(parents=True, exist_ok=True)
    with whole_file(results / "edges.md") as unfinished:
        unfinished.write_text("\n".join(_page(study)) + "\n", encoding="utf-8")


def _page(study: EdgeStudy) -> list[str]:
    return [
        "# Prediction at edges",
        "",
        "Written by `prooflight study edges --pages DIR`. Errors are prediction minus truth in units of the temporal",
        "noise there (sigma), over pixels at edges unless it says all. No world's variation and no noise: only what",
        "prediction itself gets wrong. Nothing is random but the specimen, whose columns prediction knows.",
        "",
        *_goal(study),
        "",
        f"**Pages** ({len(study.pages)}): {', '.join(study.pages)}. {study.criterion}",
        "",
        f"**Method** {study.method}",
        "",
        "## The truth is the raster that is printed",
        "",
        "A press prints a raster. Prediction is given that very raster, so what is left is the camera's model: the",
        "table, and the footprint. Prediction filters with a short separable footprint, then corrects camera pixels",
        "from their neighbours for what that misses of a round lens whose light reaches far",
        "(`sensing.lens_correction`). *Short footprint alone*: without that correction. *FFT*: instead of it, the",
        "short footprint's transfer function divided out and the exact one put in its place over the whole page; about",
        "the least that a correction at the camera's own resolution can leave.",
        "",
        *_table(study.same_raster, shift=False),
        "",
        "## The truth is the vector page",
        "",
        "What ripping at a finite resolution loses, whoever rips. A raster without anti-aliasing puts an edge on the",
        "nearest raster pixel, off by up to 1 / (2 s) camera pixels, evenly: 0.14 camera pixels rms at s = 2. An",
        "edge's slope is about 3000 digital numbers a camera pixel where sigma is 2 to 8, so no such raster comes near",
        f"{GOAL_SIGMA} sigma. The error falls about as 1 / s: s = {_needed(study.from_vector):.0f} would be needed.",
        "A press that rips for itself, at its own resolution, prints edges up to half its own pixel off, too.",
        "",
        *_table(study.from_vector, shift=True),
        "",
        "*Shifted*: the rms after the best constant shift, the same for all pages. *right, down*: how far the",
        "prediction lies from the truth, in camera pixels. CPU: one whole page on one core, median over pages.",
        "*Signals averaged*: looked up at 8 raster pixels a camera pixel, averaged over blocks, then filtered.",
        "",
        "The truth's raster has edges of its own to place; seen from 16 raster pixels a camera pixel it errs so:",
        "",
        *_table((study.truth_itself,), shift=True),
    ]


def _goal(study: EdgeStudy) -> list[str]:
    """The goal against what the study found at the default supersampling."""

    def rms(rows: tuple[ErrorRow, ...], name: str) -> str:
        value = next(row.edge_rms_sigma for row in rows if row.name == name)
        return f"{_sigma(value)} ({'met' if value <= GOAL_SIGMA else 'missed'})"

    name = f"s = {SUPERSAMPLING}"
    return [
        f"Goal: at most {GOAL_SIGMA} sigma rms over edge pixels at {name}, the default. The truth is the raster that",
        f"the press prints, through the exact camera: {rms(study.same_raster, name)}.",
        f"Against the vector page, which no raster without anti-aliasing can follow: {rms(study.from_vector, name)}.",
        f"{study.same_raster[0].edge_pixels:,} pixels at edges (of the raster at {study.same_raster[0].name}).",
    ]


def _needed(rows: tuple[ErrorRow, ...]) -> float:
    """Raster pixels a camera pixel at which an error that falls as 1 / s from the default's would meet the goal."""
    name = f"s = {SUPERSAMPLING}"
    return SUPERSAMPLING * next(row.edge_rms_sigma for row in rows if row.name == name) / GOAL_SIGMA


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _table(rows: tuple[ErrorRow, ...], *, shift: bool) -> list[str]:
    timed = any(row.predict_cpu_s is not None for row in rows)
    heads = ["prediction", "edges rms", "edges median", "all rms"]
    heads += ["shifted rms", "right [px]", "down [px]"] * shift + ["rip CPU [s]"] * (shift and timed)
    heads += ["predict CPU [s]"] * timed
    lines = [f"| {' | '.join(heads)} |", f"|---{'|---:' * (len(heads) - 1)}|"]
    for row in rows:
        cells = [row.name, *map(_sigma, (row.edge_rms_sigma, row.edge_median_sigma, row.all_rms_sigma))]
        if shift:
            cells += [
                _sigma(row.shifted_edge_rms_sigma),
                f"{row.right_pixels:+.3f}",
                f"{row.down_pixels:+.3f}",
            ]
        if shift and timed:
            cells.append(_seconds(row.rip_cpu_s))
        if timed:
            cells.append(_seconds(row.predict_cpu_s))
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _sigma(value: float) -> str:
    return f"{value:.2f}" if value < 10 else f"{value:.1f}"
