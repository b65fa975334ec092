"""Matched filters on the residuals of a fitted scan, for every mode of misprinting, at every size and place.

For a mode m with the effect P on the signal, residual r and variance V, a place has the score N = sum P r / V
and the information D = sum P^2 / V; N / D is the amount and 1 / sqrt(D) its standard deviation. Changes
common to all light (cloudy paper, lamp) are projected out of every other mode: N' = N - C N0 / (D0 + 1/t^2),
D' = D - C^2 / (D0 + 1/t^2), C = sum P P0 / V. The statistic is T = N' / sqrt(c F + c' G + t^2 D'^2), where F
and G are the parts of D' from flat places and from edges: noise, the displacement that registration leaves at
edges, and the tolerance of good prints; c, c' and t are learned.

Of planes far out of register, the share of a residual that each ink's plane, printed elsewhere, explains is computed.

Registration follows a plane by its slopes, over a few tenths of a millimetre; further off, edges are beyond
the range of the linear model. Here every shift within reach is tried. With P the effect of a plane's ink, r
the residual and V its variance, N(d) = sum (P(x - d) - P(x)) r / V and D(d) = sum (P(x - d) - P(x))^2 / V,
and N / D is the share of the plane at that shift: 1 for the whole plane. For so few shifts, direct summation
takes a tenth of the time of transforms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from prooflight.cmyk import INKS
from prooflight.detectors.matched_filter.fit.binning import binned
from prooflight.detectors.print_prior import PrintPrior
from prooflight.kernels.memory import unset
from prooflight.kernels.residuals.residuals import column_gains, take_columns
from prooflight.kernels.statistics.misplaced_planes import shift_sums
from prooflight.kernels.statistics.streaks import levelled_parts, widened
from prooflight.kernels.statistics.tiles import ResidualImages, line_sums, tile_sums
from prooflight.pages.parallel import parts_of, shared_out

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.fit.beat import RowBeats
    from prooflight.detectors.matched_filter.fit.nuisance import PlacedScan
    from prooflight.detectors.matched_filter.statistics.statistic import Box
    from prooflight.scans.geometry import ScanGeometry

TILE_MM: Final = 0.5
MODES: Final = (
    "light", "add-C", "add-M", "add-Y", "add-K", "gain-C", "gain-M", "gain-Y", "gain-K", "void", "blur", "gain-all",
)  # fmt: skip
LINE_MODES: Final = MODES[:10]
"""Modes of columns."""
SIZES: Final = (2, 4, 8, 16, 32, 64)
"""Sides of boxes, each twice the previous one. [tiles]"""
WIDTHS: Final = (1, 2, 4, 8, 16)
"""Widths of streaks. [pixels at 0.254 mm]"""
WIDTH_UNIT_MM: Final = 0.254
SPANS: Final = ("quarter", "half", "full")
QUARTER: Final = 4
"""Segments in a quarter of the page's height, the step between the starts of a span."""
SEGMENTS: Final = 4 * QUARTER
"""Segments of a column: light is taken to be constant within one of them, 19 mm of A4, and to differ between
them. (worlds.toml: paper is cloudy over 5 to 20 mm)"""
SPAN_SEGMENTS: Final = (QUARTER, 2 * QUARTER, SEGMENTS)
BASELINE_MM: Final = 24.0
SMALL: Final = 4
"""Maximum size of boxes from which the smooth level about them is removed. [tiles]"""
LEVEL_MM: Final = 3.0
UNEVEN_MM: Final = 20.0
"""Length along a row over which light is taken to be constant."""
COLUMN_MM: Final = 8.0
PERIODS_MM: Final = (2.0, 40.0)
HARMONICS: Final = 4
GHOST_BOXES_MM: Final = ((15.0, 40.0), (40.0, 120.0))
"""Heights and widths of boxes in which ghosts are searched for."""
FLAT: Final = 0.25
"""Share of the variance from edges up to which a place is flat."""
EDGE_CLASSES: Final = (1.0, FLAT)
"""Greatest shares of variance from edges of the pixels that count for ``Sums.columns`` and ``flat_columns``."""
LEAST_POWER: Final = 1e-3
"""Minimum information of a place: below it an amount would have a standard deviation of 30 whole inks."""
SCATTER_SHAPES: Final = {
    "boxes": (len(MODES), len(SIZES)),
    "streaks": (len(LINE_MODES), len(WIDTHS), len(SPANS)),
    "bands": (len(MODES),),
    "ghosts": (INKS, len(GHOST_BOXES_MM)),
}
"""Shapes of the arrays of ``Scatter``, without their last axis."""


def assumed_light(prior: PrintPrior) -> NDArray[np.float64]:
    """Return the default of ``Scatter.light``, before anything is learned: (sizes,)."""
    return np.where(np.array(SIZES) <= SMALL, prior.place_near, prior.place)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sums:
    """Scores N, information D and common terms C of every mode."""

    tiles: NDArray[np.float32]
    """(4, modes + 1, tile rows, tile columns): N, D, C and the edges' part of D; the last mode is the
    energy."""
    columns: NDArray[np.float32]
    """(4, line modes, SEGMENTS, pixels) by columns of the page."""
    flat_columns: NDArray[np.float32]
    """The same, for pixels away from edges."""
    cover: NDArray[np.float32]
    """(4, tile rows, tile columns) mean ink area."""
    shifts: NDArray[np.float64]
    """(4, 4) ``plane_shifts``; 0 unless all modes were summed up."""
    tile_mm: float
    pixel_mm: float
    left_mm: float
    """Position of the first tile on the page. [mm]"""
    top_mm: float
    prior: PrintPrior
    """Prior of good prints."""
    column_gains: NDArray[np.float32]
    """(sensors, pixels) gain that was removed from each column of the camera. [-]"""
    modes: tuple[str, ...] = MODES
    """Modes that were summed up, of ``MODES``; light is the first."""
    row_beats: RowBeats | None = None
    """Beat of a stated screen along rows; None: there is none."""

    def of_modes(self, names: Sequence[str]) -> Sums:
        """Select modes, light the first, and the energy.

        The arrays are contiguous, so that kernels vectorise.
        """
        which = [self.modes.index(name) for name in names]
        lines = [index for index in which if index < len(self.line_modes)]
        return replace(
            self,
            tiles=self.tiles.take([*which, len(self.modes)], axis=1),
            columns=self.columns.take(lines, axis=1),
            flat_columns=self.flat_columns.take(lines, axis=1),
            modes=tuple(names),
        )

    def cells_of(self, box: Box, shape: tuple[int, ...], cell_mm: tuple[float, float]) -> tuple[slice, slice]:
        """Return the rows and columns of a grid (rows, columns) whose middles are in a box, at least one of each.

        cell_mm: height and width of a cell of the grid, whose first has the corner of the first tile. A box without
        a place is the page as a whole.
        """
        if math.isnan(box[0]):
            return slice(0, shape[0]), slice(0, shape[1])
        cells = []
        for axis, first_mm, count, pitch_mm in (
            (1, self.top_mm, shape[0], cell_mm[0]),
            (0, self.left_mm, shape[1], cell_mm[1]),
        ):
            end_mm = min(box[axis] + box[axis + 2], first_mm + count * pitch_mm)
            first, last = (math.ceil((at - first_mm) / pitch_mm - 0.5) for at in (box[axis], end_mm))
            first = min(max(first, 0), count - 1)
            cells.append(slice(first, max(last, first + 1)))
        return cells[0], cells[1]

    @property
    def line_modes(self) -> tuple[str, ...]:
        """Its modes of columns."""
        return tuple(name for name in self.modes if name in LINE_MODES)


def summed(
    scan: PlacedScan,
    light: NDArray[np.float32],
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    of_edges: NDArray[np.float32],
    *,
    geometry: ScanGeometry,
    page_width_mm: float,
    prior: PrintPrior,
    analysed_modes: tuple[str, ...] = MODES,
    row_beats: RowBeats | None = None,
    threads: int = 1,
) -> Sums:
    """Sum up the residuals of all sensors in one pass.

    Gains of single columns are removed from the residuals on the way.

    Parameters
    ----------
    scan : the scan at its page's placement.
    light : ``PlacedScan.light`` [DN].
    left : (sensors, lines, pixels) residuals without the variation of good prints [DN].
    weight : (sensors, lines, pixels) inverse variance of residuals [1/DN^2].
    of_edges : (sensors, lines, pixels) the edges' share of that [-].
    geometry : of the pixels.
    page_width_mm : width of the page [mm].
    prior : of good prints.
    analysed_modes : modes that are summed up, of ``MODES``, light the first.
    row_beats : see ``Sums``.
    threads : number of threads that share the work.
    """
    modes, sensors, side = scan.modes, scan.sensors, tile_side(geometry)
    which = np.array([MODES.index(name) for name in analysed_modes])
    white = np.stack([sensor.white_dn * sensor.column_gain for sensor in sensors]).astype(np.float32)
    # Without added inks their images are unused, but need the right shape.
    add = modes.gain if modes.add is None else modes.add
    images = ResidualImages(left, weight, light, white, add, modes.gain, of_edges)
    columns, gains = _column_sums(scan, images, which, prior, threads)
    gains = own_gains(gains, geometry)
    tiles, shifts = _tile_sums(images, gains, side, which, geometry.pixel_pitch_mm, threads)
    cover = _means(modes.cover, side)
    return sums_from(
        tiles,
        columns,
        cover,
        gains,
        shifts=shifts,
        geometry=geometry,
        page_width_mm=page_width_mm,
        prior=prior,
        modes=analysed_modes,
        row_beats=row_beats,
    )


def _column_sums(
    scan: PlacedScan, images: ResidualImages, which: NDArray[np.intp], prior: PrintPrior, threads: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the sums along the columns, as ``sums_from`` takes them, and the gains (sensors, pixels) of columns.

    which: modes that are summed up, by their places in ``MODES``.
    """
    sensors, lines, pixels = images.residual.shape
    modes = which[which < len(LINE_MODES)]
    columns = np.zeros((2, 4, modes.size, SEGMENTS, pixels), np.float32)
    shift = -np.rint(scan.where.slant()).astype(np.int64)
    segment, least = segment_lines(lines), np.array(EDGE_CLASSES, np.float32)
    gains, information = np.empty((sensors, pixels), np.float32), np.float32(1 / prior.column**2)

    def down(first: int, last: int) -> None:
        for index in range(sensors):
            own = ResidualImages._make(image[index] for image in images)
            line_sums(own, least, shift, segment, modes, first, last, columns)

    def gained(index: int) -> None:
        of_sensor = images.residual[index], images.weight[index], images.light[index]
        column_gains(*of_sensor, information, 0, pixels, gains[index])

    tasks = [partial(down, *part) for part in parts_of(SEGMENTS, threads)]
    # Not in parts: last bits of columns at their ends would depend on the number of threads.
    tasks += [partial(gained, index) for index in range(sensors)]
    shared_out(tasks, threads=threads)
    return columns, gains


def _tile_sums(
    images: ResidualImages,
    gains: NDArray[np.float32],
    side: int,
    which: NDArray[np.intp],
    pixel_mm: float,
    threads: int,
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return the sums over tiles of ``side`` pixels, as ``sums_from`` takes them, and the shifts of planes.

    The gains (sensors, pixels) of single columns are removed from the residuals. The shifts are measured with
    all modes only, and are 0 otherwise.
    """
    _, lines, pixels = images.residual.shape
    tiles = unset((4, which.size + 1, lines // side, pixels // side))
    shifts = np.zeros((INKS, 4))

    def shifted() -> None:
        left = images.residual.copy()
        for index, own in enumerate(gains):
            take_columns(left[index], images.weight[index], images.light[index], own, 0, lines)
        shifts[:] = plane_shifts(left, images.weight, images.gain, pixel_mm=pixel_mm)

    tasks = [partial(shifted)] if which.size == len(MODES) else []
    tasks += [
        partial(tile_sums, images, gains, side, which, *part, tiles)
        for part in parts_of(lines // side, 2 * threads)
    ]
    shared_out(tasks, threads=threads)
    return tiles, shifts


def tile_side(geometry: ScanGeometry) -> int:
    """Return the side of a tile. [pixels]"""
    return max(round(TILE_MM / geometry.pixel_pitch_mm), 1)


def segment_lines(lines: int) -> int:
    """Return the lines of one of ``SEGMENTS`` of a page's height."""
    return -(-lines // SEGMENTS)


def own_gains(gains: NDArray[np.float32], geometry: ScanGeometry) -> NDArray[np.float32]:
    """Return columns' gains (sensors, pixels) without what is smooth across: that is lamp or scum."""
    near = round(COLUMN_MM / geometry.pixel_pitch_mm) | 1
    return np.asarray(gains - ndimage.uniform_filter1d(gains, near, mode="nearest"))


def sums_from(
    tiles: NDArray[np.float32],
    columns: NDArray[np.float32],
    cover: NDArray[np.float32],
    gains: NDArray[np.float32],
    *,
    shifts: NDArray[np.float64] | None = None,
    geometry: ScanGeometry,
    page_width_mm: float,
    prior: PrintPrior,
    modes: tuple[str, ...],
    row_beats: RowBeats | None = None,
) -> Sums:
    """Return sums with their place on the page.

    tiles, cover, gains, shifts: as in ``Sums``; columns (2, 4, line modes, SEGMENTS, pixels): its ``columns`` and
    ``flat_columns``; the others as in ``summed``.
    """
    whole, flat = columns
    return Sums(
        tiles=tiles,
        columns=whole,
        flat_columns=flat,
        cover=cover,
        shifts=np.zeros((INKS, 4)) if shifts is None else shifts,
        tile_mm=tile_side(geometry) * geometry.pixel_pitch_mm,
        pixel_mm=geometry.pixel_pitch_mm,
        left_mm=-geometry.left_mm(page_width_mm),
        top_mm=-geometry.lead_in_mm,
        prior=prior,
        column_gains=gains,
        modes=modes,
        row_beats=row_beats,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scatter:
    """Parameters of T's denominator, learned from good prints; (..., 3): noise c, edges c', tolerance t^2."""

    boxes: NDArray[np.float64]
    """(modes, sizes, 3)"""
    streaks: NDArray[np.float64]
    """(line modes, widths, spans, 3)"""
    bands: NDArray[np.float64]
    """(modes, 3) for rows of tiles."""
    ghosts: NDArray[np.float64]
    """(inks, boxes, 3)"""
    light: NDArray[np.float64]
    """(sizes,) standard deviation of a change common to all light in a box. [-]"""

    def of_modes(self, names: Sequence[str]) -> Scatter:
        """Select modes of ``MODES``; ghosts depend on inks alone, and stay."""
        which = np.array([MODES.index(name) for name in names])
        lines = which[which < len(LINE_MODES)]
        return replace(self, boxes=self.boxes[which], streaks=self.streaks[lines], bands=self.bands[which])

    @classmethod
    def white(cls) -> Scatter:
        """Return the scatter of noise alone, of an office-class press."""
        one = np.array([1.0, 1.0, 0.0])
        shapes = SCATTER_SHAPES.items()
        scatters = {name: np.broadcast_to(one, (*shape, 3)).copy() for name, shape in shapes}
        return cls(**scatters, light=assumed_light(PrintPrior()))


def without_common(
    sums: NDArray[np.float32], common: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return N', D' and the edges' part of D' of all modes from (4, modes, ...) sums.

    The first mode is the common one.
    """
    pushes, powers, shared, edges = sums
    level = powers[0] + np.float32(1 / common**2)
    own = pushes - shared * (pushes[0] / level)
    power = np.maximum(powers - shared**2 / level, 0)
    own[0], power[0] = pushes[0], powers[0]
    return own, power, edges * np.minimum(power / np.maximum(powers, 1e-9), 1)


def spread_of(
    power: NDArray[np.floating], edges: NDArray[np.floating], scatter: NDArray[np.float64]
) -> NDArray[np.floating]:
    """Return the variance of N', from D' and the edges' part of it; scatter (3,)."""
    noise, at_edges, tolerance = (np.float32(one) for one in scatter)
    power, edges = np.maximum(power, 0), np.maximum(edges, 0)
    spread = noise * np.maximum(power - edges, 0) + at_edges * edges + tolerance * power * power
    return np.asarray(spread + np.float32(1e-6))


def t_statistic(
    own: NDArray[np.floating],
    power: NDArray[np.floating],
    edges: NDArray[np.floating],
    scatter: NDArray[np.float64],
) -> NDArray[np.floating]:
    """Return T; 0 where there is no information."""
    return np.where(power > LEAST_POWER, own / np.sqrt(spread_of(power, edges, scatter)), 0)


def flicker(sums: Sums) -> NDArray[np.float32]:
    """Return the lamp's flicker from line to line, (tile rows,) [-], without its smooth part."""
    push, power = (sums.tiles[part, 0].sum(axis=1) for part in (0, 1))
    gain = push / (power + 1 / sums.prior.flicker**2)
    gain -= ndimage.uniform_filter1d(gain, round(COLUMN_MM / sums.tile_mm) | 1, mode="nearest")
    return gain.astype(np.float32)


def smooth_level(sums: Sums) -> NDArray[np.float32]:
    """Return the change of light as a whole, smoothed over ``LEVEL_MM``: (tile rows, tile columns) [-]."""
    size = sums.tiles.shape[-1], sums.tiles.shape[-2]
    halves = max(size[0] // 2, 1), max(size[1] // 2, 1)
    push, power = (
        cv2.GaussianBlur(
            cv2.resize(sums.tiles[part, 0], halves, interpolation=cv2.INTER_AREA),
            (0, 0),
            LEVEL_MM / (2 * sums.tile_mm),
        )
        for part in (0, 1)
    )
    level = push / (power + np.float32(1e-3 + (sums.tile_mm / (sums.prior.place * LEVEL_MM)) ** 2))
    return cv2.resize(level, size, interpolation=cv2.INTER_LINEAR)


def streaks(sums: Sums) -> Iterator[tuple[int, int, NDArray[np.float32]]]:
    """Yield streaks of each of ``WIDTHS`` over parts of the page's height, each of ``SPANS``.

    Yields the width, the span, and N', D', edges of line modes: (3, modes, parts, pixels). All three are
    reduced by the variance that light which varies along a column adds to N' (``with_unevenness``).
    """
    wide = round(BASELINE_MM / sums.pixel_mm) | 1
    of_spans = []
    for length in SPAN_SEGMENTS:
        modes, _, pixels = sums.columns.shape[1:]
        parts = np.empty((4, modes, (SEGMENTS - length) // QUARTER + 1, pixels), np.float32)
        levelled_parts(sums.columns, length, QUARTER, np.float32(1 / sums.prior.place**2), wide, parts)
        of_spans.append(parts)
    for w, width in enumerate(WIDTHS):
        count = max(round(width * WIDTH_UNIT_MM / sums.pixel_mm), 1)
        for s, parts in enumerate(of_spans):
            maps = np.empty_like(parts)
            widened(parts.reshape(-1, parts.shape[-1]), count, maps.reshape(-1, parts.shape[-1]))
            # Light varies less between columns than along them, so that all are taken to vary alike.
            yield w, s, with_unevenness(maps[:3], count * sums.prior.place**2 * maps[3])


def with_unevenness(maps: NDArray[np.float32], variance: NDArray[np.floating]) -> NDArray[np.float32]:
    """Reduce N', D' and edges (3, ...) by an additional variance of N', from uneven light.

    N'' = s N' and D'' = s D' with s = D' / (D' + variance): D'' is the remaining information, and N'' / D''
    is the same amount.
    """
    power = maps[1]
    return np.asarray(maps * (power / (power + variance + np.float32(1e-9))), np.float32)


def rows(sums: Sums) -> NDArray[np.float32]:
    """Return N', D', edges and a screen's wave (4, modes, tile rows) over the whole width, the local level removed.

    As for columns, all are reduced by the variance that light which varies along a row adds to N', and by that of a
    screen's beat. The wave is the amplitude of N' that its strongest wave has, if the dots of all tiles are in step.
    """
    tiles = sums.tiles[:, : len(sums.modes)]
    of_rows = tiles @ np.ones(tiles.shape[-1], np.float32)  # a third of the time of ``sum``
    own, power, edges = without_common(of_rows, sums.prior.place)
    wide = round(2 * PERIODS_MM[1] / sums.tile_mm) | 1
    push, sure = (
        ndimage.uniform_filter1d(one.astype(np.float64), wide, mode="nearest") for one in (own, power)
    )
    maps = np.stack([own - push / (sure + 1e-6) * power, power, edges]).astype(np.float32)
    parts = np.arange(0, tiles.shape[-1], round(UNEVEN_MM / sums.tile_mm))
    light = np.add.reduceat(tiles[1, 0], parts, axis=-1)
    shared = np.add.reduceat(tiles[2, 1:], parts, axis=-1)
    of_light = shared.sum(axis=-1) / (light.sum(axis=-1) + np.float32(1 / sums.prior.place**2))
    unevenness = np.zeros_like(maps[0])
    unevenness[1:] = ((shared - light * of_light[..., None]) ** 2).sum(axis=-1)
    wave, sd = _row_beat(sums, tiles)
    maps = np.concatenate([maps, wave[None]])
    return with_unevenness(maps, sums.prior.place**2 * unevenness + sd**2)


def _row_beat(sums: Sums, tiles: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return what a screen's beat adds to N', (2, modes, tile rows): amplitude of its wave, and standard deviation.

    Only tiles without edges count: the mean ink of others is no tint.
    """
    out = np.zeros((2, *tiles.shape[1:3]), np.float32)
    if sums.row_beats is None:
        return out
    flat = 1 - np.minimum(sums.tiles[3, 0] / np.maximum(sums.tiles[1, 0], np.float32(1e-9)), 1)
    level = tiles[1, 0].sum(axis=-1) + np.float32(1 / sums.prior.place**2)
    for beat, of_beat in zip(sums.row_beats.at(sums.cover), out, strict=True):
        push = (tiles[2] * (beat * flat)).sum(axis=-1)
        push[0] = (tiles[1, 0] * (beat * flat)).sum(axis=-1)
        of_beat[:] = push
        of_beat[1:] -= tiles[2, 1:].sum(axis=-1) * (push[0] / level)
    return np.abs(out)


def periodogram(
    own: NDArray[np.float32],
    power: NDArray[np.float32],
    edges: NDArray[np.float32],
    beat: NDArray[np.float32],
    scatter: NDArray[np.float64],
    tile_mm: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies [1/mm], wave power (chi-square of 2 on good prints), and power with harmonics.

    A screen's wave (``rows``) may have any frequency, so that the power which it has at its own is expected at all.
    """
    noise, at_edges, tolerance = scatter
    share = edges / np.maximum(power, 1e-9)
    trust = 1 / (noise * (1 - share) + at_edges * share + tolerance * power.astype(np.float64))
    transform = np.fft.rfft(own * trust, 4 * own.size)
    information = (power * trust).sum().clip(min=1e-9)
    spectrum = np.asarray(2 * np.abs(transform) ** 2 / information, np.float64)
    spectrum /= 1 + float((beat * trust).sum()) ** 2 / (4 * information)
    frequency = np.fft.rfftfreq(4 * own.size, tile_mm)
    lowest, highest = 1 / PERIODS_MM[1], 1 / PERIODS_MM[0]
    wanted = np.flatnonzero((frequency >= lowest) & (frequency <= highest))
    harmonics = np.zeros(wanted.size)
    for k in range(1, HARMONICS + 1):
        place = k * wanted
        harmonics += np.where(place < spectrum.size, spectrum[np.minimum(place, spectrum.size - 1)] - 2, 0)
    return np.asarray(frequency[wanted]), spectrum[wanted], np.asarray(harmonics / np.sqrt(HARMONICS))


CELL_MM: Final = 0.5
REACH_MM: Final = 2.0
NEAR_MM: Final = 0.2
"""Minimum shift: registration and the fit measure smaller ones better."""
DOUBT: Final = 0.05
"""Standard deviation of a plane's displaced share on good prints, from what edges leave. assumed: press
world, 5 %."""


def plane_shifts(
    left: NDArray[np.float32], weight: NDArray[np.float32], gain: NDArray[np.float32], *, pixel_mm: float
) -> NDArray[np.float64]:
    """Test each plane for a displacement: (inks, 4) significance [sd], share [-], right and down [mm].

    left, weight (sensors, lines, pixels): residuals, darker is more [DN], and 1 / V; gain (sensors, inks,
    lines, pixels): darkening by a whole plane [DN].
    """
    side = max(int(CELL_MM / pixel_mm + 0.5), 1)
    reach = round(REACH_MM / (side * pixel_mm))
    weights, pushes = _means(weight, side) * side**2, _means(left * weight, side) * side**2
    steps = np.arange(-reach, reach + 1) * side * pixel_mm
    away_mm = np.hypot(*np.meshgrid(steps, steps))
    wanted = (away_mm >= NEAR_MM) & (away_mm <= REACH_MM)
    result = np.zeros((gain.shape[1], 4))
    for ink in range(gain.shape[1]):
        explained, power = np.zeros((2, *wanted.shape))
        for sensor, push in enumerate(pushes):
            plane = np.pad(_means(gain[sensor, ink], side), reach)
            shift_sums(push, weights[sensor], plane, wanted, explained, power)
        doubt = np.sqrt(power + (DOUBT * power) ** 2 + 1)
        sure = (explained / doubt).clip(min=0)
        share = (explained / (power + 1 / DOUBT**2)).clip(min=0)
        down, right = np.unravel_index(sure.argmax(), sure.shape)
        result[ink] = sure.max(), share.max(), steps[right], steps[down]
    return result


def _means(images: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """Return means over whole squares of side x side pixels: (..., lines // side, pixels // side)."""
    return binned(images, side)[..., : images.shape[-2] // side, :]
