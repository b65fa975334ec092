"""Landmarks of a design by which its page is registered; computed once a design, ahead of its scans."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.kernels.prediction.lookup import NODE_STEP, NODES
from prooflight.kernels.prediction.summing import FEW
from prooflight.kernels.registration.coarse import SHRINK
from prooflight.kernels.registration.landmarks import edge_shares, tile_information, tile_signals
from prooflight.kernels.registration.measuring import SensorTaps
from prooflight.kernels.registration.rendering import EIGHT
from prooflight.prediction.quantised_table import quantised_table
from prooflight.registration.coarse import CoarsePage, coarse_page
from prooflight.registration.field import Basis, Prior

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.prediction.predict import Prediction
    from prooflight.prediction.tables import SensorModel
    from prooflight.registration.pose import Pose
    from prooflight.scans.geometry import ScanGeometry

TILE_MM: Final = 4.0
"""Side of the tiles that are measured: a word or two, over which a warp smooth over 25 mm is constant."""
TILE_PIXELS: Final = (16, 32)
"""Least and greatest side of a tile: fewer pixels are hardly more than an edge's blur, more cost time."""
CELL_MM: Final = 10.0
"""Side of the cells from each of which one tile is taken for each direction of edges, so that tiles are
spread out. Small pages have smaller cells. (Eight designs of their own at 0.254 mm: edges leave 0.34 of the
variance that they were taken to leave, 0.56 with tiles of 8 mm from cells of 16, 0.30 with every tile.)"""
LEAST_CELLS: Final = 150
REACH_PIXELS: Final = 1.5
"""Half width of the rendered part of a footprint; it holds 99 % of the light (prototype camera)."""
MARGIN_PIXELS: Final = 3
"""Distance from a tile's border within which edges are not used: they, and the inks that make them, are half
outside."""
TILE_SD_PIXELS: Final = 0.03
"""Standard deviation of a tile's displacement beyond its noise, from the page's warp within a tile
(assumed)."""
MIX_SD_PIXELS: Final = 0.12
"""Standard deviation of a tile's displacement where planes out of register share edges. An ink hidden by
another shows only where it emerges on one side, which shares cannot describe. It is multiplied by the root of
``_shares``' second result; on designs used in development tiles lay 0.1 to 0.25 pixels off. Where one ink ends
as others begin and the light hardly changes, it is far above 1, and multiplies it again: a plane slightly out of
register moves such a tile by pixels."""
MIXED_SD_PIXELS: Final = 0.5
"""Standard deviation of a tile's displacement in either direction, of planes out of register, from which it says
nothing of the page's place, nor of whether another page is shown. assumed: an edge's blur is about as wide."""
PHASES: Final = 256
HALFTONE: Final = 0.07
"""Contrast of halftones in the camera's image (worlds.toml: 0.03 at 0.254 mm, here 0.105 mm)."""
GRADIENT_NOISE: Final = 0.02
"""Variance per squared gradient, as if every edge were 0.14 pixels off (register of planes, jitter)."""
SIGNAL_NOISE: Final = 0.015
"""Standard deviation of a print's signal, as a share of it (ink gain, lamp)."""
LEAST_INFORMATION: Final = 100.0
"""Least information of a tile in one direction to be chosen; it then has its place to 0.1 pixels.
[1/pixel^2]"""


PLENTY: Final = 2000.0
"""Information of a tile in both directions that makes it enough for its cell: it then has its place to 0.02
pixels, less than the page moves within it. [1/pixel^2]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Landmarks:
    """Tiles of one design to measure in every scan of it, and its coarse picture."""

    geometry: ScanGeometry
    sensors: tuple[SensorModel, ...]
    page_width_mm: float
    page_height_mm: float
    ratio: tuple[float, float]
    """Raster pixels per camera pixel, across and along."""
    tile_pixels: int
    """Side of the tiles."""
    lines: NDArray[np.int64]
    """First line of each tile with the page at its place, (tiles,)."""
    columns: NDArray[np.int64]
    """First column of each tile, (tiles,)."""
    shares: NDArray[np.float64]
    """Displacement of each tile across and along when an ink plane moves by 1, (tiles, 2, 4): that ink's part
    of its edges. The remainder to 1 is the part of the page's own edge. [-]"""
    beyond: NDArray[np.float64]
    """Variance of a tile's displacement across and along beyond its noise, (tiles, 2). [pixels^2]"""
    windows: NDArray[np.float32]
    """Signal of the raster under each tile, (sensors, tiles, height, width). [DN]"""
    origins: NDArray[np.float64]
    """Start of each tile's first footprint in its window, x and y, (tiles, 2). [raster pixels]"""
    taps: tuple[SensorTaps, ...]
    coarse: CoarsePage
    basis: Basis
    halftone: float = HALFTONE
    """Contrast of the print's halftones in the camera's image. [-]"""
    ignored: NDArray[np.bool_] | None = None
    """Pixels of the coarse picture that are left out, (rows, columns); None if none is."""

    @property
    def pitch_mm(self) -> NDArray[np.float64]:
        """Pixel and line pitch, (2,). [mm]"""
        return np.array([self.geometry.pixel_pitch_mm, self.geometry.line_pitch_mm])

    @property
    def mixed(self) -> NDArray[np.bool_]:
        """Whether planes mix so much in a tile's edges that it says nothing of the page's place, (tiles,)."""
        return np.asarray((self.beyond >= MIXED_SD_PIXELS**2).any(axis=1))

    def finer(self, times: int) -> Landmarks:
        """Return the landmarks with the weights of a raster so many times as fine; tiles' windows stay as they are."""
        ratio = np.array(self.ratio) * times
        pixel_mm = float(self.pitch_mm[0] / ratio[0])
        taps = tuple(_sensor_taps(sensor, ratio, pixel_mm, self.pitch_mm) for sensor in self.sensors)
        return replace(self, ratio=(float(ratio[0]), float(ratio[1])), taps=taps)

    def moves(self, pose: Pose, tiles: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the displacement of ``tiles`` (n,) by a page of that pose, (n, 2). [pixels]"""
        points = self.basis.points_mm[tiles]
        return np.stack(pose.displacement_mm(points[:, 0], points[:, 1]), axis=1) / self.pitch_mm


def prepare(
    page: Page,
    prediction: Prediction,
    *,
    sensors: Sequence[SensorModel],
    geometry: ScanGeometry,
    prior: Prior | None = None,
    halftone: float = HALFTONE,
    ignored: NDArray[np.bool_] | None = None,
) -> Landmarks:
    """Choose the landmarks of a page from its ``prediction`` at its nominal place.

    Tiles are chosen where edges carry most information given ``GRADIENT_NOISE`` and the like; page edges
    count as any others.

    Parameters
    ----------
    halftone : contrast of the print's halftones in the camera's image
    ignored : (rows, columns) pixels of the coarse picture, of ``SHRINK`` camera pixels a side,
        in which no landmark may be
    """
    size = tile_pixels(geometry)
    information = _information(prediction, sensors, size)
    if ignored is not None:
        information[_ignored_tiles(ignored, information.shape[:2], size // SHRINK)] = 0
    rows, columns = _chosen(information, round(CELL_MM / (size * geometry.pixel_pitch_mm)))
    lines, left = rows * size, columns * size
    pitch = np.array([geometry.pixel_pitch_mm, geometry.line_pitch_mm])
    ratio = pitch / page.pixel_mm
    x_mm = geometry.centres_x_mm(page.width_mm)
    y_mm = geometry.centres_y_mm(geometry.lines(page.height_mm))
    first = np.stack([x_mm[left], y_mm[lines]], axis=1)
    taps = tuple(_sensor_taps(sensor, ratio, page.pixel_mm, pitch) for sensor in sensors)
    begin, corners, (width, height) = raster_windows(first, size, page.pixel_mm, ratio, taps[0])
    windows = np.empty((len(sensors), rows.size, height, width), np.float32)
    packed = page.packed
    for sensor, window in zip(sensors, windows, strict=True):
        quantised, backing = quantised_table(sensor.mean_dn), np.float32(sensor.backing_dn)
        tile_signals(packed, corners[:, 1], corners[:, 0], quantised, backing, window)
    shares, mixed = _shares(
        page, sensors, np.floor(begin + REACH_PIXELS * ratio).astype(np.int64), ratio, size
    )
    centres = first + (size - 1) / 2 * pitch
    from_centre = centres - np.array([page.width_mm, page.height_mm]) / 2
    return Landmarks(
        geometry=geometry,
        sensors=tuple(sensors),
        page_width_mm=page.width_mm,
        page_height_mm=page.height_mm,
        ratio=(float(ratio[0]), float(ratio[1])),
        tile_pixels=size,
        lines=lines,
        columns=left,
        shares=shares,
        beyond=TILE_SD_PIXELS**2 + MIX_SD_PIXELS**2 * mixed * np.maximum(mixed, 1) ** 2,
        windows=windows,
        origins=begin - corners,
        taps=taps,
        coarse=coarse_page(prediction, sensors, geometry, page.width_mm, page.height_mm),
        basis=Basis.of(from_centre, page.width_mm, page.height_mm, prior or Prior()),
        halftone=halftone,
        ignored=ignored,
    )


def tile_pixels(geometry: ScanGeometry) -> int:
    """Return the side of tiles: about ``TILE_MM``, a multiple of the eight pixels that kernels process at once."""
    return int(np.clip(EIGHT * round(TILE_MM / (EIGHT * geometry.pixel_pitch_mm)), *TILE_PIXELS))


def _ignored_tiles(ignored: NDArray[np.bool_], tiles: tuple[int, ...], side: int) -> NDArray[np.bool_]:
    """Return which tiles (tile rows, tile columns) contain an ignored coarse pixel; ``side`` of these make a tile."""
    rows, columns = tiles
    cut = ignored[: rows * side, : columns * side].reshape(rows, side, columns, side)
    return np.asarray(cut.any(axis=(1, 3)))


def raster_windows(
    first_mm: NDArray[np.float64], size: int, pixel_mm: float, ratio: NDArray[np.float64], taps: SensorTaps
) -> tuple[NDArray[np.float64], NDArray[np.int64], tuple[int, int]]:
    """Return the windows of the raster under squares of ``size`` camera pixels.

    Parameters
    ----------
    first_mm : (n, 2) x, y of the squares' first pixels on the page [mm]

    Returns
    -------
    begin, corners : (n, 2) x, y each of the first footprints' starts and of the windows' corners [raster pixels]
    size : width and height of the windows, with room for a displacement by a camera pixel, and with the width padded as
        ``render_tile`` needs it [raster pixels]
    """
    begin = first_mm / pixel_mm - REACH_PIXELS * ratio
    corners = np.floor(begin - ratio).astype(np.int64)
    width, height = (
        int(np.ceil((size + 2) * per_pixel)) + weights.shape[1] + 2
        for per_pixel, weights in zip(ratio, (taps.across, taps.along), strict=True)
    )
    return begin, corners, (-(-width // FEW) * FEW, height)


def _information(prediction: Prediction, sensors: Sequence[SensorModel], size: int) -> NDArray[np.float32]:
    """Return the Fisher information of tiles about a displacement across and along, summed over the sensors.

    The result is (tile rows, tile columns, 2) for tiles of ``size`` pixels. [1/pixel^2]
    """
    rows, columns = (extent // size for extent in prediction.expected_dn.shape[1:])
    total = np.zeros((rows, columns, 2), np.float32)
    for index, sensor in enumerate(sensors):
        tile_information(
            prediction.expected_dn[index],
            prediction.variance_dn2[index],
            sensor.column_offset_dn,
            1 / sensor.column_gain,
            np.float32(GRADIENT_NOISE),
            np.float32(SIGNAL_NOISE**2),
            size,
            MARGIN_PIXELS,
            total,
        )
    return total


def _shares(
    page: Page,
    sensors: Sequence[SensorModel],
    corners: NDArray[np.int64],
    ratio: NDArray[np.float64],
    size: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the tiles' shares, (tiles, 2, 4), and how much planes mix in their edges, (tiles, 2).

    That is sum |s (1 - s)| over the planes and the page's own edge, s a share of the tile's edges, or, where
    that is more, what inks that end as others begin would add to the edges if they did not cancel in the light.
    """
    sums = np.zeros((len(corners), 2, 7))
    stride_x, stride_y = (max(round(float(along)), 1) for along in ratio)
    for sensor in sensors:
        logs = np.log(light_left(sensor)).astype(np.float32)
        backing = sensor.backing_dn / sensor.white_dn
        edge_shares(page.packed, corners[:, 1], corners[:, 0], size, stride_x, stride_y, logs, backing, sums)
    parts = sums / np.maximum(sums[..., 5:6], 1e-9)
    of_tile = np.abs(parts[..., :5] * (1 - parts[..., :5])).sum(axis=2)
    return parts[..., :4], np.maximum(of_tile, parts[..., 6])


def light_left(sensor: SensorModel) -> NDArray[np.float64]:
    """Return the share of the light that each ink alone leaves, (4, 256) by its byte."""
    mean = sensor.mean_dn
    solids = np.stack([mean[:, 0, 0, 0], mean[0, :, 0, 0], mean[0, 0, :, 0], mean[0, 0, 0, :]])
    ramps = np.array([np.interp(np.arange(256), NODE_STEP * np.arange(NODES), ramp) for ramp in solids])
    return np.asarray(np.maximum(ramps / sensor.white_dn, 1e-3))


def _chosen(information: NDArray[np.float32], most_side: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of the best tile of each cell for either direction, if its information is sufficient.

    One tile is enough for both directions where its information is ``PLENTY`` in the other as well.

    most_side: greatest side of cells. [tiles]
    """
    tile_rows, tile_columns = information.shape[:2]
    side = int(np.clip(np.sqrt(tile_rows * tile_columns / LEAST_CELLS), 1, max(most_side, 1)))
    rows, columns = -(-tile_rows // side), -(-tile_columns // side)
    framed = np.zeros((rows * side, columns * side, 2), np.float32)
    framed[:tile_rows, :tile_columns] = information
    cells = framed.reshape(rows, side, columns, side, 2).transpose(0, 2, 1, 3, 4).reshape(-1, side * side, 2)
    cell = np.arange(len(cells))
    both = cells.min(axis=2).argmax(axis=1)
    chosen = np.zeros(cells.shape[:2], bool)
    for axis in range(2):
        best = cells[..., axis].argmax(axis=1)
        best = np.where(cells[cell, both].min(axis=1) >= PLENTY, both, best)
        enough = cells[cell, best, axis] >= LEAST_INFORMATION
        chosen[cell[enough], best[enough]] = True
    grid = chosen.reshape(rows, columns, side, side).transpose(0, 2, 1, 3).reshape(framed.shape[:2])
    indices = np.nonzero(grid)
    return indices[0].astype(np.int64), indices[1].astype(np.int64)


def _sensor_taps(
    sensor: SensorModel, ratio: NDArray[np.float64], pixel_mm: float, pitch_mm: NDArray[np.float64]
) -> SensorTaps:
    footprint = sensor.footprint
    offsets_mm = np.linspace(-footprint.reach_mm, footprint.reach_mm, footprint.across.size)
    (across, across_slope), (along, along_slope) = (
        _taps(cumulative, offsets_mm, per_pixel, pixel_mm, pitch)
        for cumulative, per_pixel, pitch in zip(
            (footprint.across, footprint.along), ratio, pitch_mm, strict=True
        )
    )
    return SensorTaps(
        across=across,
        across_slope=across_slope,
        along=along,
        along_slope=along_slope,
        across_ratio=float(ratio[0]),
        along_ratio=float(ratio[1]),
    )


def _taps(
    cumulative: NDArray[np.float64],
    offsets_mm: NDArray[np.float64],
    per_pixel: float,
    pixel_mm: float,
    pitch_mm: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return one axis's weights by phase, and their slopes by displacement [1/pixel], (PHASES, taps) each."""
    reach_mm = REACH_PIXELS * pitch_mm
    low, high = np.interp([-reach_mm, reach_mm], offsets_mm, cumulative)
    edges = np.arange(int(np.ceil(2 * REACH_PIXELS * per_pixel)) + 2) - REACH_PIXELS * per_pixel

    def weights(phase: NDArray[np.float64]) -> NDArray[np.float64]:
        at = np.interp((edges - phase[:, None]) * pixel_mm, offsets_mm, cumulative)
        return np.diff((np.clip(at, low, high) - low) / (high - low), axis=1)

    phase, step = (np.arange(PHASES) + 0.5) / PHASES, 0.05
    slope = (weights(phase + step) - weights(phase - step)) / (2 * step)
    own, by_move = (np.ascontiguousarray(array, np.float32) for array in (weights(phase), -per_pixel * slope))
    return own, by_move
