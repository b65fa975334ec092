"""Measurement of tiles: their displacements from where they were rendered, with precision."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from prooflight.kernels.registration.measuring import SUMS, SensorLight, TileWindows, measure_tiles
from prooflight.kernels.registration.rendering import EIGHT
from prooflight.kernels.registration.solving import solve_tiles
from prooflight.pages.parallel import parts_of, shared_out
from prooflight.registration.landmarks import GRADIENT_NOISE, SIGNAL_NOISE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.prediction.tables import SensorModel
    from prooflight.registration.landmarks import Landmarks

MOST_MOVE_PIXELS: Final = 3.0
"""Displacement above which one linear step is not valid. assumed: an edge is blurred over two pixels, and
planes and warp of good prints move tiles by one."""
STEP_SHARE: Final = 0.25
"""Share of a displacement that one linear step leaves, as a tolerance, so that no tile is lost for it."""


class Workspace(NamedTuple):
    """Buffers of one thread for rendering a tile."""

    value: NDArray[np.float32]
    """Sums of raster rows for eight lines, (8 x width of a window,)."""
    tilt: NDArray[np.float32]
    """Their derivatives by the page's displacement along."""
    lines: NDArray[np.int64]
    """Places at which each line's raster rows and weights begin, (2, size)."""
    columns: NDArray[np.int64]
    """The same of each column's raster columns."""

    @classmethod
    def of(cls, width: int, *, size: int) -> Self:
        """Allocate buffers for windows of that width and tiles of size x size pixels."""
        value, tilt = np.empty((2, EIGHT * width), np.float32)
        lines, columns = np.empty((2, 2, size), np.int64)
        return cls(value=value, tilt=tilt, lines=lines, columns=columns)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TileMoves:
    """Displacements of n tiles, combined over all sensors."""

    moves: NDArray[np.float64]
    """Displacement of each tile to the right and down of where it was rendered, (n, 2). [pixels]"""
    precision: NDArray[np.float64]
    """Inverse covariance, zero where a tile has no information, (n, 2, 2). [1/pixel^2]"""
    seen: NDArray[np.bool_]
    """Whether the tile lies inside the scan, (n,)."""
    good: NDArray[np.bool_]
    """Whether it is seen and looks like the design, (n,)."""
    foreign: NDArray[np.bool_]
    """Whether it is seen, does not look like the design and is not empty, (n,)."""
    gain: NDArray[np.float64]
    """Contrast, 1 for the design's, (n,)."""
    gain_sd: NDArray[np.float64]
    """Standard deviation of the contrast, (n,)."""

    def within_reach(self) -> TileMoves:
        """Return the same with zero precision where a tile lies further off than one linear step is valid.

        Strips of bare paper along the edge of a dark page look like that.
        """
        near = np.abs(self.moves).max(axis=1) <= MOST_MOVE_PIXELS
        return replace(self, precision=self.precision * near[:, None, None])

    def put(self, at: NDArray[np.intp], other: TileMoves) -> None:
        """Replace the tiles at these indices by ``other``."""
        for name in TileMoves.__slots__:
            getattr(self, name)[at] = getattr(other, name)


def measured(
    landmarks: Landmarks,
    scan: NDArray[np.uint16],
    tiles: NDArray[np.int64],
    moves: NDArray[np.float64],
    *,
    unsure_pixels: float,
    lost: NDArray[np.bool_] | None = None,
    threads: int = 1,
) -> TileMoves:
    """Measure the displacements of tiles in a scan.

    Parameters
    ----------
    tiles : (n,) indices of the tiles
    moves : (n, 2) displacement from the page's nominal place at which each is rendered [pixels]
    unsure_pixels : standard deviation of these; edges weigh less by it
    lost : (sensors, lines) missing lines, which are left out
    threads : number of threads that measure tiles
    """
    gathered = np.zeros((len(landmarks.sensors), tiles.size, SUMS + 1), np.float32)
    parts = [slice(*part) for part in parts_of(tiles.size, threads)]
    missing = np.zeros(scan.shape[:2], bool) if lost is None else lost
    tasks = [
        partial(
            _measure,
            landmarks,
            scan,
            missing,
            index,
            tiles[part],
            moves[part],
            unsure_pixels,
            gathered[index, part],
        )
        for index in range(len(landmarks.sensors))
        for part in parts
    ]
    shared_out(tasks, threads=threads)
    moved, precision = np.empty((tiles.size, 2)), np.empty((tiles.size, 2, 2))
    flags, contrast = np.empty((tiles.size, 3), np.bool_), np.empty((tiles.size, 3))
    solve_tiles(
        gathered, landmarks.beyond[tiles], STEP_SHARE * unsure_pixels, moved, precision, flags, contrast
    )
    seen, good, foreign = flags.T
    return TileMoves(
        moves=moved,
        precision=precision,
        seen=seen,
        good=good,
        foreign=foreign & ~landmarks.mixed[tiles],
        gain=contrast[:, 0],
        gain_sd=contrast[:, 1],
    )


def pixel_noise(sensor: SensorModel, *, halftone2: float, by_slope: float) -> NDArray[np.float32]:
    """Return the variance of a sensor's pixels, (4,): without light, by signal, by signal squared, by slope squared.

    halftone2: squared contrast of halftones.
    """
    dark, white_dn = sensor.dark_variance_dn2, sensor.white_dn
    per_dn = (float(sensor.variance_dn2[0, 0, 0, 0]) - dark) / white_dn
    noise = [2 * dark + 1, 2 * per_dn + halftone2 * white_dn, SIGNAL_NOISE**2 - halftone2, by_slope]
    return np.array(noise, np.float32)


def _measure(
    landmarks: Landmarks,
    scan: NDArray[np.uint16],
    lost: NDArray[np.bool_],
    index: int,
    tiles: NDArray[np.int64],
    moves: NDArray[np.float64],
    unsure_pixels: float,
    sums: NDArray[np.float32],
) -> None:
    """Run ``measure_tiles`` for one sensor; sums (n, SUMS + 1) is written."""
    sensor, taps = landmarks.sensors[index], landmarks.taps[index]
    noise = pixel_noise(sensor, halftone2=landmarks.halftone**2, by_slope=GRADIENT_NOISE + unsure_pixels**2)
    light = SensorLight(offset=sensor.column_offset_dn, per_gain=1 / sensor.column_gain, noise=noise)
    windows = TileWindows(
        signals=landmarks.windows[index],
        origins=landmarks.origins,
        lines=landmarks.lines,
        columns=landmarks.columns,
    )
    size = landmarks.tile_pixels
    workspace = Workspace.of(landmarks.windows.shape[3], size=size)
    measure_tiles(scan[index], lost[index], light, windows, taps, tiles, moves, size, workspace, sums)
