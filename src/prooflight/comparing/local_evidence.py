"""What a fitted scan still says: matched filters for every way in which ink goes wrong, at every size and place.

For a mode m with the effect P on the signal, residual r and variance V, a place says N = sum P r / V with the
information D = sum P^2 / V; N / D is the amount and 1 / sqrt(D) its standard deviation. What moves all light alike
(cloudy paper, lamp) is taken out of every other mode: N' = N - C N0 / (D0 + 1/t^2), D' = D - C^2 / (D0 + 1/t^2),
C = sum P P0 / V. The statistic is T = N' / sqrt(c F + c' G + t^2 D'^2), F and G what flat places and edges add to D':
noise, what registration leaves at edges, and the tolerance of good prints; c, c' and t are learned.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from scipy import ndimage

from prooflight.comparing.summing.kernels import column_gains, line_sums, take_columns, tile_sums

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.acquiring.geometry import ScanGeometry
    from prooflight.comparing.modes import Modes, Sight
    from prooflight.predicting.predict import Prediction
    from prooflight.predicting.tables import SensorModel

TILE_MM: Final = 0.5
MODES: Final = (
    "light", "add-C", "add-M", "add-Y", "add-K", "gain-C", "gain-M", "gain-Y", "gain-K", "void", "blur", "gain-all",
)  # fmt: skip
LINE_MODES: Final = 10
SIZES: Final = (2, 4, 8, 16, 32, 64)
"""Sides of boxes. [tiles]"""
WIDTHS: Final = (1, 2, 4, 8, 16)
"""Of streaks. [pixels at 0.254 mm]"""
WIDTH_UNIT_MM: Final = 0.254
SPANS: Final = ("quarter", "half", "full")
SEGMENTS: Final = 4
BASELINE_MM: Final = 24.0
COMMON: Final = 0.003
"""Standard deviation of what moves all light alike from place to place: paper 0.2 %, lamp, flicker. [-]"""
SMALL: Final = 4
LEVEL_MM: Final = 3.0
COMMON_NEAR: Final = 0.001
"""The same within a few millimetres."""
COLUMN_SD: Final = 0.0015
"""Of a column's gain that flat-fielding left (worlds.toml)."""
COLUMN_MM: Final = 8.0
FLICKER: Final = 0.0015
PERIODS_MM: Final = (2.0, 40.0)
HARMONICS: Final = 4
LAGS_MM: Final = (3.0, 60.0)
GHOST_BOXES_MM: Final = ((15.0, 40.0), (40.0, 120.0))
LEAST_POWER: Final = 1e-3
"""Information below which a place says nothing: such an amount would have a standard deviation of 30 whole inks."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sums:
    """Pushes N, powers D and shared C of every mode."""

    tiles: NDArray[np.float32]
    """(4, modes + 1, tile rows, tile columns): N, D, C, and the edges' part of D; the last mode is the energy."""
    columns: NDArray[np.float32]
    """(4, LINE_MODES, SEGMENTS, pixels), columns of the page."""
    cover: NDArray[np.float32]
    """(4, tile rows, tile columns) mean ink area."""
    tile_mm: float
    pixel_mm: float
    left_mm: float
    """Where the first tile begins on the page. [mm]"""
    top_mm: float


def summed(
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    of_edges: NDArray[np.float32],
    seen: Prediction,
    modes: Modes,
    where: Sight,
    *,
    sensors: Sequence[SensorModel],
    geometry: ScanGeometry,
    page_width_mm: float,
) -> Sums:
    """One pass over the residuals of all sensors; columns' own gains are taken out of them on the way, in place."""
    side = max(round(TILE_MM / geometry.pixel_pitch_mm), 1)
    lines, pixels = where.inside.shape
    tiles = np.zeros((4, len(MODES) + 1, lines // side, pixels // side), np.float32)
    columns = np.zeros((4, LINE_MODES, SEGMENTS, pixels), np.float32)
    middle = where.columns[:, pixels // 2] - where.columns[lines // 2, pixels // 2]
    shift = -np.rint(middle).astype(np.int64)
    for index, sensor in enumerate(sensors):
        light = seen.expected_dn[index] - sensor.column_offset_dn
        white = (sensor.white_dn * sensor.column_gain).astype(np.float32)
        images = (
            left[index],
            weight[index],
            light,
            white,
            modes.add[index],
            modes.gain[index],
            of_edges[index],
        )
        line_sums(*images, shift, SEGMENTS, -(-lines // SEGMENTS), *columns)
        gains = np.empty(pixels, np.float32)
        column_gains(left[index], weight[index], light, np.float32(1 / COLUMN_SD**2), gains)
        # What is smooth across is lamp or scum, not a column's own gain.
        gains -= ndimage.uniform_filter1d(
            gains, round(COLUMN_MM / geometry.pixel_pitch_mm) | 1, mode="nearest"
        )
        take_columns(left[index], weight[index], light, gains)
        tile_sums(*images, side, *tiles)
    size = (pixels // side, lines // side)
    cover = np.stack(
        [
            cv2.resize(c[: size[1] * side, : size[0] * side], size, interpolation=cv2.INTER_AREA)
            for c in modes.cover
        ]
    )
    return Sums(
        tiles=tiles,
        columns=columns,
        cover=cover,
        tile_mm=side * geometry.pixel_pitch_mm,
        pixel_mm=geometry.pixel_pitch_mm,
        left_mm=-geometry.left_mm(page_width_mm),
        top_mm=-geometry.lead_in_mm,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scatter:
    """How T's denominator is made: learned from good prints; (..., 3): noise c, of edges c', tolerance t^2."""

    boxes: NDArray[np.float64]
    """(modes, sizes, 3)"""
    streaks: NDArray[np.float64]
    """(LINE_MODES, widths, spans, 3)"""
    bands: NDArray[np.float64]
    """(modes, 3) of rows of tiles."""
    ghosts: NDArray[np.float64]
    """(inks, boxes, 3)"""

    @classmethod
    def white(cls) -> Scatter:
        """Nothing but noise."""
        one = np.array([1.0, 1.0, 0.0])
        shapes = [
            (len(MODES), len(SIZES)),
            (LINE_MODES, len(WIDTHS), len(SPANS)),
            (len(MODES),),
            (4, len(GHOST_BOXES_MM)),
        ]
        return cls(
            **{
                name: np.broadcast_to(one, (*shape, 3)).copy()
                for name, shape in zip(("boxes", "streaks", "bands", "ghosts"), shapes, strict=True)
            }
        )


def without_common(
    sums: NDArray[np.float32], common: float = COMMON
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """N', D' and the edges' part of D' of all modes from (4, modes, ...) sums; the first mode is the common one."""
    pushes, powers, shared, edges = sums
    level = powers[0] + np.float32(1 / common**2)
    own = pushes - shared * (pushes[0] / level)
    power = np.maximum(powers - shared**2 / level, 0)
    own[0], power[0] = pushes[0], powers[0]
    return own, power, edges * np.minimum(power / np.maximum(powers, 1e-9), 1)


def statistic(
    own: NDArray[np.floating],
    power: NDArray[np.floating],
    edges: NDArray[np.floating],
    scatter: NDArray[np.float64],
) -> NDArray[np.floating]:
    """T; 0 where there is no information."""
    noise, at_edges, tolerance = (np.float32(one) for one in scatter)
    power, edges = np.maximum(power, 0), np.maximum(edges, 0)
    spread = noise * np.maximum(power - edges, 0) + at_edges * edges + tolerance * power * power
    return np.where(power > LEAST_POWER, own / np.sqrt(spread + np.float32(1e-6)), 0)


def boxes(sums: Sums, size: int) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], int]:
    """N', D', edges of boxes of ``size`` tiles that overlap by half, and the tiles from one to the next."""
    step = max(size // 2, 1)
    maps = steady(sums)
    if size > 1:
        flat = maps.reshape(-1, *maps.shape[-2:])
        added = [
            cv2.boxFilter(one, -1, (size, size), normalize=False, borderType=cv2.BORDER_CONSTANT)
            for one in flat
        ]
        maps = np.stack([one[step // 2 :: step, step // 2 :: step] for one in added]).reshape(
            *maps.shape[:2], *(added[0][step // 2 :: step, step // 2 :: step].shape)
        )
    if size <= SMALL:
        level = smooth_level(sums)
        if size > 1:
            level = level[step // 2 :: step, step // 2 :: step]
        maps = maps.copy()
        maps[0] -= maps[2] * level
    return *without_common(maps, COMMON_NEAR if size <= SMALL else COMMON), step


def steady(sums: Sums) -> NDArray[np.float32]:
    """Tile sums (4, modes, ...) without the lamp's flicker from line to line; what is smooth along it stays."""
    maps = sums.tiles[:, : len(MODES)].copy()
    push, power = maps[0, 0].sum(axis=1, dtype=np.float64), maps[1, 0].sum(axis=1, dtype=np.float64)
    gain = push / (power + 1 / FLICKER**2)
    gain -= ndimage.uniform_filter1d(gain, round(COLUMN_MM / sums.tile_mm) | 1, mode="nearest")
    maps[0] -= maps[2] * gain[:, None].astype(np.float32)
    return maps


def smooth_level(sums: Sums) -> NDArray[np.float32]:
    """Change of light as a whole, smooth over ``LEVEL_MM``: (tile rows, tile columns) [-]."""
    push, power = (
        cv2.GaussianBlur(np.ascontiguousarray(one), (0, 0), LEVEL_MM / sums.tile_mm)
        for one in sums.tiles[:2, 0]
    )
    return np.asarray(push / (power + 1e-3 + 1 / (COMMON**2 * LEVEL_MM**2 / sums.tile_mm**2)), np.float32)


def streaks(sums: Sums, width: int, span: str) -> tuple[NDArray[np.float32], ...]:
    """N', D', edges (modes, parts, pixels) of streaks so wide over parts of the page's height."""
    count = max(round(width * WIDTH_UNIT_MM / sums.pixel_mm), 1)
    length = {"quarter": 1, "half": 2, "full": SEGMENTS}[span]
    columns = sums.columns
    parts = np.stack(
        [columns[:, :, k : k + length].sum(axis=2) for k in range(SEGMENTS - length + 1)], axis=2
    )
    own, power, edges = without_common(parts)
    own = _levelled(own, power, round(BASELINE_MM / sums.pixel_mm) | 1)
    return tuple(
        np.asarray(ndimage.uniform_filter1d(one, count, mode="constant") * count, np.float32)
        for one in (own, power, edges)
    )


def rows(sums: Sums) -> tuple[NDArray[np.float32], ...]:
    """N', D', edges (modes, tile rows) over the whole width, the local level taken out."""
    own, power, edges = without_common(sums.tiles[:, : len(MODES)].sum(axis=-1))
    return _levelled(own, power, round(2 * PERIODS_MM[1] / sums.tile_mm) | 1), power, edges


def _levelled(own: NDArray[np.float32], power: NDArray[np.float32], wide: int) -> NDArray[np.float32]:
    """N' without the mean amount over ``wide`` places about it."""
    push, said = (
        ndimage.uniform_filter1d(one.astype(np.float64), wide, mode="nearest") for one in (own, power)
    )
    return np.asarray(own - push / (said + 1e-6) * power, np.float32)


def periodogram(
    own: NDArray[np.float32],
    power: NDArray[np.float32],
    edges: NDArray[np.float32],
    scatter: NDArray[np.float64],
    tile_mm: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies [1/mm], power of the waves there (chi-square of 2 on good prints), first harmonics added."""
    noise, at_edges, tolerance = scatter
    share = edges / np.maximum(power, 1e-9)
    trust = 1 / (noise * (1 - share) + at_edges * share + tolerance * power.astype(np.float64))
    said = np.fft.rfft(own * trust, 4 * own.size)
    spectrum = np.asarray(2 * np.abs(said) ** 2 / (power * trust).sum().clip(min=1e-9), np.float64)
    frequency = np.fft.rfftfreq(4 * own.size, tile_mm)
    lowest, highest = 1 / PERIODS_MM[1], 1 / PERIODS_MM[0]
    wanted = np.flatnonzero((frequency >= lowest) & (frequency <= highest))
    together = np.zeros(wanted.size)
    for k in range(1, HARMONICS + 1):
        place = k * wanted
        together += np.where(place < spectrum.size, spectrum[np.minimum(place, spectrum.size - 1)] - 2, 0)
    return np.asarray(frequency[wanted]), spectrum[wanted], np.asarray(together / np.sqrt(HARMONICS))


def ghosts(sums: Sums) -> list[list[tuple[NDArray[np.float32], ...]]]:
    """For each ink, lag by lag: N', D', edges of an echo at every place; boxes of them are ``ghost_boxes``."""
    maps = sums.tiles[:, : len(MODES)]
    halved = [extent // 2 * 2 for extent in maps.shape[-2:]]
    maps = maps[..., : halved[0], : halved[1]]
    maps = maps.reshape(*maps.shape[:2], halved[0] // 2, 2, halved[1] // 2, 2).sum(axis=(3, 5))
    own, power, edges = without_common(maps)
    cover = halved_means(sums.cover, halved)
    pitch = 2 * sums.tile_mm
    wide = round(15.0 / pitch) | 1
    found: list[list[tuple[NDArray[np.float32], ...]]] = []
    for ink in range(4):
        detail = cover[ink] - cv2.blur(cover[ink], (wide, wide))
        of_ink: list[tuple[NDArray[np.float32], ...]] = []
        if detail.std() > 1e-3:
            for lag in range(round(LAGS_MM[0] / pitch), round(LAGS_MM[1] / pitch) + 1):
                echo = np.zeros_like(detail)
                echo[lag:] = detail[: detail.shape[0] - lag]
                squared = echo * echo
                of_ink.append((own[1 + ink] * echo, power[1 + ink] * squared, edges[1 + ink] * squared))
        found.append(of_ink)
    return found


def ghost_boxes(
    maps: tuple[NDArray[np.float32], ...], box_mm: tuple[float, float], pitch: float
) -> tuple[NDArray[np.float32], ...]:
    """Sums over boxes (height, width) that overlap by three quarters."""
    height, width = (max(round(extent / pitch), 1) for extent in box_mm)
    down, across = max(height // 4, 1), max(width // 4, 1)
    return tuple(
        np.asarray(
            cv2.boxFilter(one, -1, (width, height), normalize=False, borderType=cv2.BORDER_CONSTANT)[
                ::down, ::across
            ]
        )
        for one in maps
    )


def halved_means(images: NDArray[np.float32], extents: list[int]) -> NDArray[np.float32]:
    """Means of 2 x 2."""
    cut = images[:, : extents[0], : extents[1]]
    return cut.reshape(len(cut), extents[0] // 2, 2, extents[1] // 2, 2).mean(axis=(2, 4)).astype(np.float32)
