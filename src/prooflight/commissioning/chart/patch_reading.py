"""Readings of a detected chart's patches against the paper around them.

The paper between the patches is the scan's own white reference. It gives each column's gain (lamp, lens,
pixel), each line's (a lamp that flickers) and the slow remainder (clouds in the paper); patches are read in
units of it. Light that strays a millimetre and more, by diffraction or glare, makes paper near dark patches
darker and dark patches brighter; its strength is fitted to the paper and removed from both.

The light of a point at a distance r falls as k / r^3, as the tail of diffraction does (Airy's rings on
average); k, a length, is estimated from the paper between the patches, which is darker near dark ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft
from scipy.stats import spearmanr

from prooflight.commissioning.chart.edge_spread import EdgeSample, mark_samples
from prooflight.commissioning.chart.finding import DetectedChart, find_chart
from prooflight.commissioning.chart.scan import AUTO, ChartScan, read_chart_scan
from prooflight.errors import ScanError
from prooflight.inks.built_in import built_in_inks
from prooflight.inks.chart_layout import STEPS_PER_MM, PlacedRecipes
from prooflight.inks.chart_print import painted

_GUARD_MM, _GUARD_PIXELS = 0.3, 1.6  # paper: so far from any ink, the greater of both
_INSIDE_MM, _INSIDE_PIXELS = 0.7, 3.0  # a patch's inside: so far from its edge
_BORDER_MM: Final = 1.0  # paper: so far from the edge of the page
_NOTE_MM: Final = (100.0, 6.5)  # the line of text that the PDF has between the lower marks
_CLOUD_MM: Final = 3.0  # standard deviation of the window in which the paper's slow rest is averaged
_OUTLIER: Final = 4.0  # robust standard deviations
_LEAST_PIXELS: Final = 30
_CLIPPED_SHARE: Final = 0.02
_ROUNDS: Final = 3
_FROM_MM: Final = 0.3  # nearer light belongs to the pixel's footprint
_STEP_MM: Final = 0.2
# assumed: ten times what diffraction at F/2.8 strays; more is blur, not stray light
_MOST_MM: Final = 5e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PatchReadings:
    """Patches of one scan; arrays over patches (n,) or sensors and patches (s, n)."""

    recipe: NDArray[np.int64]
    """Row (n,) in the chart's recipes."""
    page: int
    light: NDArray[np.float64]
    """Light (s, n) over the paper's around them. [-]"""
    light_variance: NDArray[np.float64]
    """Variance (s, n) of ``light``, from the spread between pixels. [-]"""
    dn: NDArray[np.float64]
    """Digital numbers (s, n) as they stand in the scan. [DN]"""
    pixel_variance_dn2: NDArray[np.float64]
    """Variance (s, n) between neighbouring lines of a column: temporal noise and halftone, no fixed pattern. [DN^2]"""
    pixels: NDArray[np.float64]
    """Number (n,) of pixels read."""
    centre_mm: NDArray[np.float64]
    """Centre (n, 2) on the chart. [mm]"""
    white_dn: NDArray[np.float64]
    """Digital number (s,) of the paper in the middle of the field. [DN]"""
    column_gain: NDArray[np.float64]
    """Paper's light (s, pixels) in each column, over the middle's; NaN where no paper was seen. [-]"""
    gain: NDArray[np.float64]
    """Gain (s, n) of the columns that saw the patch. [-]"""
    paper_variance_dn2: NDArray[np.float64]
    """Variance (s,) of bare paper between neighbouring lines. [DN^2]"""
    stray_mm: NDArray[np.float64]
    """Strength k (s,) of stray light, k / r^3 of the light at a distance r. [mm]"""
    backing_dn: NDArray[np.float64]
    """Digital number (s,) beyond the page; NaN where none is seen. [DN]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Maps:
    """Label of each pixel of a scan."""

    patch: NDArray[np.int32]
    """Index of the patch (lines, pixels) whose inside a pixel lies in, plus 1, else 0."""
    paper: NDArray[np.bool_]
    beyond: NDArray[np.bool_]


def read_patches(scan: ChartScan, chart: DetectedChart, placed: PlacedRecipes) -> PatchReadings:
    """Read every patch of the detected page; ScanError: paper is clipped, or patches lie off the scan."""
    here = np.flatnonzero(placed.place[:, 0] == chart.page)
    maps = _maps(scan, chart, placed, here)
    pixels = np.bincount(maps.patch.ravel(), minlength=len(here) + 1)[1:]
    off = int((pixels < _LEAST_PIXELS).sum())
    if off:
        what = f"{off} of {len(here)} patches of page {chart.page} are outside the scan or too small in it"
        raise ScanError(scan.path, what, remedy="scan the whole page, at 100 dpi or more")
    _refuse_clipping(scan, maps)
    boxes = np.array([placed.layout.patch_box(row, column) for _, row, column in placed.place[here].tolist()])
    centre = boxes[:, :2] + boxes[:, 2:] / 2
    per_sensor = [_read_sensor(dn, chart, placed, here, maps) for dn in scan.dn]
    return PatchReadings(
        recipe=here,
        page=chart.page,
        pixels=pixels.astype(np.float64),
        centre_mm=centre,
        **{
            name: np.array([values[name] for values in per_sensor], dtype=np.float64)
            for name in per_sensor[0]
        },
    )


def _maps(scan: ChartScan, chart: DetectedChart, placed: PlacedRecipes, here: NDArray[np.int64]) -> _Maps:
    layout, steps = placed.layout, STEPS_PER_MM
    pitch = max(chart.pitch_mm)
    guard = max(_GUARD_MM, _GUARD_PIXELS * pitch)
    inside = max(_INSIDE_MM, _INSIDE_PIXELS * pitch)
    size = (round(layout.height_mm * steps), round(layout.width_mm * steps))
    border = round(_BORDER_MM * steps)
    paper = np.zeros(size, np.uint8)
    paper[border:-border, border:-border] = 1
    for (x, y, width, height), _ in painted(placed, chart.page):
        left, top, right, bottom = (
            round(edge * steps) for edge in (x - guard, y - guard, x + width + guard, y + height + guard)
        )
        paper[max(top, 0) : bottom, max(left, 0) : right] = 0
    across, high = (round(extent * steps) for extent in _NOTE_MM)
    low = size[0] - round(layout.margin_mm * steps)
    paper[low - high : low, (size[1] - across) // 2 : (size[1] + across) // 2] = 0
    labels = np.zeros(size, np.int16)
    for number, (_, row, column) in enumerate(placed.place[here].tolist(), start=1):
        x, y, width, height = layout.patch_box(row, column)
        left, top = round((x + inside) * steps), round((y + inside) * steps)
        bottom, right = round((y + height - inside) * steps), round((x + width - inside) * steps)
        labels[top:bottom, left:right] = number
    off = 1 - _seen(np.ones(size, np.uint8), scan, chart)
    return _Maps(
        patch=_seen(labels, scan, chart).astype(np.int32),
        paper=_seen(paper, scan, chart).astype(bool),
        beyond=cv2.erode(off, np.ones((3, 3)), iterations=round(_BORDER_MM / pitch)) > 0,
    )


def _seen(raster: NDArray[np.generic], scan: ChartScan, chart: DetectedChart) -> NDArray[np.generic]:
    """Sample a raster of the chart, ``STEPS_PER_MM``, at the scan's pixels; 0 off the chart."""
    to_raster = chart.to_chart * STEPS_PER_MM
    to_raster[:, 2] -= 0.5
    lines, pixels = scan.dn.shape[1:]
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(raster, to_raster, (pixels, lines), flags=flags))


def _refuse_clipping(scan: ChartScan, maps: _Maps) -> None:
    """Raise ScanError if the paper, or a patch next to the blackest, is at an end of a sensor's range."""
    for name, dn in zip(scan.names, scan.dn, strict=True):
        greatest = float(dn.max())
        share = float((dn[maps.paper] >= greatest).mean())
        if share > _CLIPPED_SHARE:
            what = f"sensor {name} is saturated: {share:.0%} of the bare paper reads {greatest:g}"
            remedy = "lower exposure or brightness so that paper stays below the top"
            raise ScanError(scan.path, what, remedy=remedy)
        share = float((dn[maps.patch > 0] <= 0).mean())
        if share > 0.3:
            what = f"sensor {name}: {share:.0%} of the pixels in patches read 0"
            remedy = "raise black level or exposure, or switch tone correction off"
            raise ScanError(scan.path, what, remedy=remedy)


def _read_sensor(
    dn: NDArray[np.float32],
    chart: DetectedChart,
    placed: PlacedRecipes,
    here: NDArray[np.int64],
    maps: _Maps,
) -> dict[str, ArrayLike]:
    """Read one sensor's part of ``PatchReadings``."""
    columns, lines = _gains(dn, maps.paper)
    order, starts = _by_patch(maps.patch, len(here))
    stray = np.zeros_like(dn)
    for _ in range(2):  # what strays depends on the patches, and their light a little on what strays
        flat = dn / (columns * lines[:, None]) + stray
        light, _ = _trimmed(flat.ravel()[order], starts)
        paper = _clean(flat, maps.paper)
        spread = strayed(placed, chart, here, light, dn.shape)
        strength = strength_of(dn / (columns * lines[:, None]), paper, spread)
        stray = np.float32(strength) * spread
        columns, lines = _gains(dn / (1 - stray), maps.paper)
    flat = dn / (columns * lines[:, None])
    corrected = (flat + stray) / _cloud(flat + stray, paper, chart)
    light, used = _trimmed(corrected.ravel()[order], starts)
    values, member = corrected.ravel()[order][used], np.repeat(np.arange(len(here)), np.diff(starts))[used]
    count = np.bincount(member, minlength=len(here))
    variance = np.bincount(member, (values - light[member]) ** 2, minlength=len(here)) / count
    middle = np.nanmedian(columns[len(columns) // 3 : -(len(columns) // 3)])
    gain = np.bincount(member, np.broadcast_to(columns, dn.shape).ravel()[order][used]) / count / middle
    seen = np.bincount(member, dn.ravel()[order][used]) / count
    steady = dn / lines[:, None]
    return {
        "light": light,
        "light_variance": variance / count,
        "dn": seen,
        "pixel_variance_dn2": _line_variance(steady, maps.patch, len(here)),
        "white_dn": middle,
        "column_gain": np.where(maps.paper.sum(axis=0) >= _LEAST_PIXELS, columns / middle, np.nan),
        "gain": gain,
        "paper_variance_dn2": _line_variance(steady, paper.astype(np.int32), 1)[0],
        "stray_mm": strength,
        "backing_dn": np.median(dn[maps.beyond]) if maps.beyond.sum() > 500 else np.nan,
    }


def _gains(
    dn: NDArray[np.float32], paper: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return paper's light in each column (pixels,) [DN] and each line's over the mean (lines,) [-].

    Outliers are left out. Columns that see no paper take their neighbours'; lines likewise.
    """
    used = paper.copy()
    white = np.where(used, dn, 0)
    columns = lines = np.ones(1, np.float32)
    for turn in range(_ROUNDS):
        scaled = white / lines[:, None] if turn else white
        columns = _means(scaled, used, axis=0)
        lines = _means(white / columns, used, axis=1)
        lines /= lines.mean()
        away = np.abs(dn / (columns * lines[:, None]) - 1)
        used = paper & (away < _OUTLIER * 1.48 * np.median(away[used]))
        white = np.where(used, dn, 0)
    return columns, lines


def _means(values: NDArray[np.floating], used: NDArray[np.bool_], *, axis: int) -> NDArray[np.float32]:
    """Return the means of used values along an axis; where those are too few, between neighbours."""
    count = used.sum(axis=axis)
    means = values.sum(axis=axis, dtype=np.float64) / np.maximum(count, 1)
    enough = np.flatnonzero(count >= _LEAST_PIXELS)
    return np.interp(np.arange(count.size), enough, means[enough]).astype(np.float32)


def _clean(flat: NDArray[np.float32], paper: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return paper without its specks."""
    away = np.abs(flat - 1)
    return paper & (away < _OUTLIER * 1.48 * np.median(away[paper]))


def _by_patch(patch: NDArray[np.int32], count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the flat indices of patches' pixels, patch by patch, and where each begins (count + 1,)."""
    flat = patch.ravel()
    inside = np.flatnonzero(flat)
    order = inside[np.argsort(flat[inside], kind="stable")]
    return order, np.searchsorted(flat[order], np.arange(1, count + 2))


def _trimmed(
    values: NDArray[np.float32], starts: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the mean of each patch and its used pixels: those within four robust sigmas of its median."""
    means = np.empty(len(starts) - 1)
    used = np.zeros(values.size, dtype=bool)
    for at, (first, last) in enumerate(pairwise(starts.tolist())):
        part = values[first:last]
        away = np.abs(part - np.median(part))
        # A sigma of nothing: digital numbers that do not vary at all.
        used[first:last] = away <= max(_OUTLIER * 1.48 * float(np.median(away)), 1e-3)
        means[at] = part[used[first:last]].mean(dtype=np.float64)
    return means, used


def _cloud(flat: NDArray[np.float32], paper: NDArray[np.bool_], chart: DetectedChart) -> NDArray[np.float32]:
    """Return the paper's slow variation, (lines, pixels), about 1: its mean in a Gaussian window."""
    sigma = [_CLOUD_MM / pitch for pitch in chart.pitch_mm]
    step = max(round(min(sigma) / 6), 1)
    small = tuple(extent // step for extent in flat.shape)

    def smooth(values: NDArray[np.generic]) -> NDArray[np.float32]:
        binned = cv2.resize(values.astype(np.float32), small[::-1], interpolation=cv2.INTER_AREA)
        return cv2.GaussianBlur(binned, (0, 0), sigma[0] / step, sigmaY=sigma[1] / step)

    mean = smooth(np.where(paper, flat - 1, 0)) / np.maximum(smooth(paper), 1e-3)
    return 1 + cv2.resize(mean, flat.shape[::-1], interpolation=cv2.INTER_LINEAR)


def _line_variance(dn: NDArray[np.float32], label: NDArray[np.int32], count: int) -> NDArray[np.float64]:
    """Return half the mean square difference of neighbouring lines inside a label, (count,).

    Outliers are left out.
    """
    both = (label[1:] == label[:-1]) & (label[1:] > 0)
    member = label[1:][both] - 1
    square = ((dn[1:][both] - dn[:-1][both]) ** 2).astype(np.float64) / 2
    used = np.ones(square.size, dtype=bool)
    mean = np.zeros(count)
    for _ in range(2):
        pairs = np.bincount(member[used], minlength=count)
        mean = np.bincount(member[used], square[used], count) / np.maximum(pairs, 1)
        used = square <= 16 * np.maximum(mean[member], 1e-9)
    return mean


def strayed(
    placed: PlacedRecipes,
    chart: DetectedChart,
    here: NDArray[np.int64],
    light: NDArray[np.float64],
    shape: tuple[int, ...],
) -> NDArray[np.float32]:
    """Return the net loss of each pixel by stray light of a strength of 1 mm: own minus the others' over r^3."""
    layout, step = placed.layout, _STEP_MM
    margin = 20.0
    size = [round((extent + 2 * margin) / step) for extent in (layout.height_mm, layout.width_mm)]
    fine = 2  # squares of a tenth of a millimetre
    page = np.ones([extent * fine for extent in size], np.float32)
    levels = dict(zip(map(tuple, placed.place[here, 1:].tolist()), light.tolist(), strict=True))
    boxes = [(layout.patch_box(row, column), level) for (row, column), level in levels.items()]
    darkest = float(light.min())
    marks = [(box, darkest if black else 1.0) for box, black in layout.black_and_white(chart.page)]
    for (x, y, width, height), level in (*marks, *boxes):
        left, top, right, bottom = (
            round((edge + margin) / step * fine) for edge in (x, y, x + width, y + height)
        )
        page[top:bottom, left:right] = level
    coarse = cv2.resize(page, (size[1], size[0]), interpolation=cv2.INTER_AREA)
    # Within a square the neighbours' light is even, so its middle stands for it.
    reach = round(margin / step)
    away = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) * step
    kernel = np.where(away >= _FROM_MM, step**2 / np.maximum(away, step) ** 3, 0.0)
    total = fft.next_fast_len(size[0] + 2 * reach), fft.next_fast_len(size[1] + 2 * reach)
    product = fft.rfft2(1 - coarse, total) * fft.rfft2(kernel, total)
    others = fft.irfft2(product, total)[reach : reach + size[0], reach : reach + size[1]]
    net = (others - kernel.sum() * (1 - coarse)).astype(np.float32)
    to_grid = chart.to_chart / step
    to_grid[:, 2] += margin / step - 0.5
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(net, to_grid, (shape[1], shape[0]), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    )


def strength_of(flat: NDArray[np.float32], paper: NDArray[np.bool_], spread: NDArray[np.float32]) -> float:
    """Estimate the strength of stray light from the paper.

    It is the least-squares fit of the paper's light against ``spread``, both without the part of columns and
    lines, which is already in their gains.
    """
    seen, strayed = (_without_gains(values, paper) for values in (flat, spread))
    moment = float(np.sum(strayed**2, dtype=np.float64))
    strength = -np.sum(strayed * seen, dtype=np.float64) / moment if moment > 0 else 0.0
    return float(np.clip(strength, 0.0, _MOST_MM))


def _without_gains(values: NDArray[np.float32], paper: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return an image over the paper without the means of columns and lines; 0 elsewhere."""
    left = np.where(paper, values - values[paper].mean(), 0).astype(np.float32)
    for axis in (0, 1, 0, 1):
        mean = left.sum(axis=axis, keepdims=True) / np.maximum(paper.sum(axis=axis, keepdims=True), 1)
        left -= mean.astype(np.float32)
        left *= paper
    return left


_AGREES: Final = 0.6
"""assumed: rank correlation of patches with usual inks is above 0.9 for a chart's own recipes, about 0 for others'."""
_FEWEST_PATCHES: Final = 12  # fewer patches than that say nothing of whose they are


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScanRead:
    """Measurements of one scan of a chart."""

    name: str
    """Name of the file."""
    sensors: tuple[str, ...]
    lines: int
    pixels: int
    top_code_dn: int
    encoding: str
    chart: DetectedChart
    patches: PatchReadings
    edges: tuple[tuple[tuple[EdgeSample, ...], tuple[EdgeSample, ...]], ...]
    """Edges of the marks in each sensor, across the columns and across the lines."""


def read_scan(path: Path, placed: PlacedRecipes, *, encoding: str = AUTO) -> ScanRead:
    """Read one scan of a page of a chart; ScanError if that cannot be done."""
    image = read_chart_scan(path, encoding=encoding)
    chart = find_chart(image, placed.layout)
    if not 1 <= chart.page <= placed.pages:
        what = f"the scan is of another chart: it is page {chart.page}, the recipe file has {placed.pages}"
        raise ScanError(path, what, remedy="give the recipe file of the chart that was scanned")
    patches = read_patches(image, chart, placed)
    _refuse_other_chart(path, patches, placed)
    edges = []
    for dn, white, columns in zip(image.dn, patches.white_dn, patches.column_gain, strict=True):
        flat = dn / (white * np.where(np.isfinite(columns), columns, 1.0)).astype(np.float32)
        edges.append(mark_samples(flat, chart, placed.layout))
    return ScanRead(
        name=path.name,
        sensors=image.names,
        lines=image.dn.shape[1],
        pixels=image.dn.shape[2],
        top_code_dn=image.top_code_dn,
        encoding=image.encoding,
        chart=chart,
        patches=patches,
        edges=tuple(edges),
    )


def _refuse_other_chart(path: Path, patches: PatchReadings, placed: PlacedRecipes) -> None:
    """Raise ScanError if patches are not as dark as their recipes would be in any usual inks."""
    usual = built_in_inks().reflectance(placed.cmyk[patches.recipe]).mean(axis=1)
    if usual.size < _FEWEST_PATCHES or np.ptp(usual) == 0:
        return
    agreement = float(spearmanr(usual, patches.light.mean(axis=0)).statistic)
    if not agreement >= _AGREES:
        what = (
            f"the scan is of another chart: patches and recipes agree with rank correlation {agreement:.2f}"
        )
        raise ScanError(path, what, remedy="give the recipe file of the chart that was scanned")
