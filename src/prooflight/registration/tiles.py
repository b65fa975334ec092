"""Tiles measured: by how much each lies off where it is thought to lie, and what that is worth."""

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

    from prooflight.kernels.registration.measuring import SensorTaps
    from prooflight.prediction.tables import SensorModel
    from prooflight.registration.landmarks import Landmarks

HALFTONE: Final = 0.07
"""Contrast of halftones as the camera sees them (worlds.toml: 0.03 at 0.254 mm, here 0.105 mm)."""
MOST_MOVE_PIXELS: Final = 3.0
"""Further than that one linear step does not tell where a tile lies. assumed: an edge is blurred over two pixels, and
planes and warp of good prints move tiles by one."""
STEP_SHARE: Final = 0.25
"""What one linear step leaves of a displacement, near enough, so that no tile is lost for it."""


class Workspace(NamedTuple):
    """What rendering a tile needs to work in; a thread's own."""

    value: NDArray[np.float32]
    """(width of a window and more,), 0 beyond it."""
    slope: NDArray[np.float32]
    begins: NDArray[np.int64]
    weights: NDArray[np.float32]
    by_move: NDArray[np.float32]
    starts: NDArray[np.int64]

    @classmethod
    def of(cls, width: int, taps: SensorTaps, *, size: int) -> Self:
        """For windows so wide, of tiles of size x size pixels."""
        pixels = int(np.ceil((EIGHT - 1) * taps.across_ratio)) + taps.across.shape[1] + 1
        blocks = size // EIGHT
        value, slope = np.zeros((2, width + pixels), np.float32)
        weights, by_move = np.empty((2, blocks * pixels * EIGHT), np.float32)
        begins, starts = np.empty(blocks, np.int64), np.empty(taps.along.shape[1], np.int64)
        return cls(value=value, slope=slope, begins=begins, weights=weights, by_move=by_move, starts=starts)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TileMoves:
    """What n tiles of all sensors together say."""

    moves: NDArray[np.float64]
    """(n, 2) by how much each lies too far right and down of where it was rendered. [pixels]"""
    precision: NDArray[np.float64]
    """(n, 2, 2) inverse covariance; zero where a tile tells nothing. [1/pixel^2]"""
    seen: NDArray[np.bool_]
    """(n,) inside the scan."""
    good: NDArray[np.bool_]
    """(n,) seen, and looking like the design."""
    foreign: NDArray[np.bool_]
    """(n,) seen, not looking like the design, and not empty either."""
    gain: NDArray[np.float64]
    """(n,) contrast, 1 for the design's."""
    gain_sd: NDArray[np.float64]
    """(n,) how well that is known."""

    def within_reach(self) -> TileMoves:
        """The same with no precision where a tile seems to lie further off than one step tells: strips of bare paper
        along the edge of a dark page look like that.
        """
        near = np.abs(self.moves).max(axis=1) <= MOST_MOVE_PIXELS
        return replace(self, precision=self.precision * near[:, None, None])

    def put(self, at: NDArray[np.intp], other: TileMoves) -> None:
        """Write ``other`` in place of the tiles at these places."""
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
    """Measure ``tiles`` (n,) of a scan, rendered where ``moves`` (n, 2) says the page lies off its place [pixels].

    unsure_pixels: standard deviation of these; edges weigh less by it. lost (sensors, lines): lines that were not seen,
    which say nothing. threads: that share the tiles out.
    """
    gathered = np.zeros((len(landmarks.sensors), tiles.size, SUMS + 1), np.float32)
    parts = [slice(*part) for part in parts_of(tiles.size, threads)]
    gone = np.zeros(scan.shape[:2], bool) if lost is None else lost
    tasks = [
        partial(
            _measure,
            landmarks,
            scan,
            gone,
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
    flags, told = np.empty((tiles.size, 3), np.bool_), np.empty((tiles.size, 3))
    solve_tiles(gathered, landmarks.beyond[tiles], STEP_SHARE * unsure_pixels, moved, precision, flags, told)
    seen, good, foreign = flags.T
    return TileMoves(
        moves=moved,
        precision=precision,
        seen=seen,
        good=good,
        foreign=foreign,
        gain=told[:, 0],
        gain_sd=told[:, 1],
    )


def pixel_noise(sensor: SensorModel, *, halftone2: float, by_slope: float) -> NDArray[np.float32]:
    """Variance of a sensor's pixels, (4,): without light, by signal, by signal squared, by slope squared.

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
    """``measure_tiles`` of one sensor; sums (n, SUMS + 1) is written."""
    sensor, taps = landmarks.sensors[index], landmarks.taps[index]
    noise = pixel_noise(sensor, halftone2=HALFTONE**2, by_slope=GRADIENT_NOISE + unsure_pixels**2)
    light = SensorLight(offset=sensor.column_offset_dn, per_gain=1 / sensor.column_gain, noise=noise)
    windows = TileWindows(
        signals=landmarks.windows[index],
        origins=landmarks.origins,
        lines=landmarks.lines,
        columns=landmarks.columns,
    )
    size = landmarks.tile_pixels
    workspace = Workspace.of(landmarks.windows.shape[3], taps, size=size)
    measure_tiles(scan[index], lost[index], light, windows, taps, tiles, moves, size, workspace, sums)
