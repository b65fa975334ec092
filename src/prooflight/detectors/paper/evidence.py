"""The statistics that a decision needs, computed in one pass over a scan."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import special

from prooflight.detectors.base import BLOCK_PIXELS, StoredArrays
from prooflight.kernels.comparison.one_pass import (
    CODE_STEPS,
    LINES,
    ROUNDING_VARIANCE_DN2,
    TILE,
    Z_STEPS,
    compare_lines,
)
from prooflight.pages.parallel import shared_out
from prooflight.prediction.compact import Lines, Scale, compact
from prooflight.rng import stream

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Decision

INTERVALS = 16
"""Number of nearly equally likely intervals of the error's distribution (15 degrees of freedom a sensor)."""
TILE_PIXELS = TILE
"""Side of the tiles that are tested separately: 6.7 mm, about a word, with 256 pixels expected in each
interval."""
PART_PIXELS = 1 << 20
"""Pixels that are compared in one call: few enough to stay below 64 MB, enough to make a call's overhead
negligible."""
NOISE_SIZE = 1 << 14
"""Size of the table of random numbers; each line starts at a position of its own."""
SHARP_SIGMA_DN = 4.0
"""Sigma below which the dither's distribution needs more than two terms."""
UNSURE_SIGMA_DN = math.sqrt(1 + ROUNDING_VARIANCE_DN2)
"""Sigma below which, 1 DN before rounding, it needs more than four:
tests/detectors/paper/test_kernels.py."""


def interval_edges() -> NDArray[np.int8]:
    """Return the inner edges of intervals, (INTERVALS - 1,): quantiles of N(0, 1), rounded to sigma / 64."""
    quantiles = special.ndtri(np.arange(1, INTERVALS) / INTERVALS)
    return np.asarray(np.rint(quantiles * CODE_STEPS).astype(np.int8))


@cache
def interval_shares() -> NDArray[np.float64]:
    """Return each interval's exact probability under N(0, 1), (INTERVALS,), within 6 % of 1/16; read-only."""
    shares = np.diff(special.ndtr(interval_edges() / CODE_STEPS), prepend=0.0, append=1.0)
    shares.setflags(write=False)
    return np.asarray(shares)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """Evidence of a scan against its prediction. z is limited to 32 sigma and rounded to sigma / 128."""

    tile_histogram: NDArray[np.int64]
    """(sensors, tile rows, tile columns, intervals) pixels in each interval, with rounding to integers taken
    into account; ``interval_shares`` are expected. Tiles have 64 x 64 pixels; the last of each row and column
    contain the remainder as well."""
    naive_histogram: NDArray[np.int64]
    """(sensors, intervals) histogram of the whole page, as if digital numbers were not integers: it rejects
    every good page. Empty unless requested."""
    block_z: NDArray[np.float32]
    """(sensors, block rows, block columns) mean of z over 8 x 8 pixels times 8: N(0, 1) on a good page.
    [-]"""

    @property
    def histogram(self) -> NDArray[np.int64]:
        """(sensors, intervals) histogram of the whole page."""
        return self.tile_histogram.sum(axis=(1, 2))


class Camera(NamedTuple):
    """Integer scales of a prediction, for the compiled loops."""

    top_code: np.uint16
    mean_bits: np.uint16
    inverse_bits: int
    inverse_drop: np.uint16
    drop: np.uint16
    sharp: np.uint16
    unsure: np.uint16

    @classmethod
    def of(cls, scale: Scale) -> Camera:
        """Return the scales of one sensor."""
        one = 1 << scale.inverse_bits
        return cls(
            top_code=np.uint16(scale.top_code_dn),
            mean_bits=np.uint16(scale.mean_bits),
            inverse_bits=scale.inverse_bits,
            inverse_drop=np.uint16(scale.inverse_bits - 14),
            drop=np.uint16(scale.mean_bits + scale.inverse_bits - 10),
            sharp=np.uint16(min(one / SHARP_SIGMA_DN, 65535)),
            unsure=np.uint16(min(one / UNSURE_SIGMA_DN, 65535)),
        )


class Counts(NamedTuple):
    """Result of the compiled pass, initially 0."""

    reached: NDArray[np.int64]
    """(tile rows, tile columns, INTERVALS - 1) pixels at or above each edge."""
    block_sum: NDArray[np.int32]
    """(block rows, block columns) [sigma / 128]"""


class Part(NamedTuple):
    """Result of the pass over some rows of tiles of one sensor, in integers."""

    lines: int
    pixels: int
    counts: Counts

    @classmethod
    def empty(cls, lines: int, pixels: int) -> Part:
        """Return an empty part of a number of lines, which begin a row of tiles."""
        rows, columns = max(lines // TILE, 1), max(pixels // TILE, 1)
        counts = Counts(
            reached=np.zeros((rows, columns, INTERVALS - 1), np.int64),
            block_sum=np.zeros((lines // LINES, pixels // LINES), np.int32),
        )
        return cls(lines=lines, pixels=pixels, counts=counts)

    def histogram(self) -> NDArray[np.int64]:
        """Return the pixels in each interval, (tile rows, tile columns, INTERVALS)."""
        reached = self.counts.reached
        sides = (
            np.diff([*range(0, count * TILE, TILE), size])
            for count, size in zip(reached.shape, (self.lines, self.pixels), strict=False)
        )
        pixels = np.multiply.outer(*sides)
        return np.asarray(-np.diff(reached, axis=-1, prepend=pixels[..., None], append=0))


@cache
def _intervals() -> tuple[NDArray[np.int8], NDArray[np.float64]]:
    edges = interval_edges()
    return edges, np.asarray(special.ndtr(edges / CODE_STEPS))


@cache
def _noise(pixels: int) -> NDArray[np.uint16]:
    """Return every fourth 16-bit word in random order; its beginning is repeated, so that any line fits."""
    table = stream(None, "dither").permutation(NOISE_SIZE).astype(np.uint16) * np.uint16(4) + np.uint16(2)
    return np.resize(table, NOISE_SIZE + pixels)


def line_starts(seed: int, sensor: int, lines: range) -> NDArray[np.int64]:
    """Return lines' positions in the noise: splitmix64 of seed, sensor, line (Steele, Lea, Flood 2014)."""
    z = np.arange(lines.start, lines.stop, dtype=np.uint64) + np.uint64(
        ((seed << 8 | sensor) << 32) & (2**64 - 1)
    )
    z = z * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray((z >> np.uint64(64 - 14)).astype(np.int64))


def compare(
    measured_dn: NDArray[np.uint16],
    mean: NDArray[np.uint16],
    inverse: NDArray[np.uint16],
    *,
    scale: Scale,
    sensor: int,
    lines: range,
    seed: int,
    dither: bool = True,
) -> Part:
    """Compare ``lines`` of one sensor, one of the page's ``parts``, with their prediction.

    Each array is (lines, pixels).

    mean, inverse: as returned by ``compact``. ``join`` combines the parts.
    """
    part = Part.empty(len(lines), measured_dn.shape[1])
    edges, reach = _intervals()
    compare_lines(
        Lines.of(measured_dn),
        Lines.of(mean),
        Lines.of(inverse),
        Camera.of(scale),
        _noise(measured_dn.shape[1]),
        line_starts(seed, sensor, lines),
        edges,
        reach,
        dither,
        part.pixels,
        part.counts,
    )
    return part


def parts(lines: int, pixels: int) -> list[range]:
    """Return the lines of a page in ranges of whole rows of tiles, of about a megapixel each."""
    step = max(PART_PIXELS // (TILE * pixels), 1) * TILE
    starts = [0, *range(step, lines - step + 1, step)]
    return [range(start, end) for start, end in zip(starts, [*starts[1:], lines], strict=True)]


def join(of_sensors: Sequence[Sequence[Part]], naive: Sequence[Sequence[Part]] = ()) -> Evidence:
    """Return a page's evidence from each sensor's parts, top to bottom.

    naive: the same, compared without dither.
    """

    def stack(of_part: Callable[[Part], NDArray[Any]]) -> NDArray[Any]:
        return np.stack([np.concatenate([of_part(part) for part in of]) for of in of_sensors])

    step = np.float32(1 / Z_STEPS)
    naive_histogram = [np.sum([part.histogram().sum(axis=(0, 1)) for part in of], axis=0) for of in naive]
    return Evidence(
        tile_histogram=stack(Part.histogram),
        naive_histogram=np.array(naive_histogram, np.int64).reshape(-1, INTERVALS),
        block_z=stack(lambda part: part.counts.block_sum * (step / np.float32(BLOCK_PIXELS))),
    )


def gather(
    measured_dn: NDArray[np.uint16],
    expected_dn: NDArray[np.float32],
    variance_dn2: NDArray[np.float32],
    *,
    top_codes_dn: Sequence[int],
    seed: int,
    threads: int | None = None,
    naive: bool = False,
) -> Evidence:
    """Compute the evidence of a page's area in one pass.

    The prediction is compacted in the same pass.

    Parameters
    ----------
    measured_dn : (sensors, lines, pixels) signal of the area [DN].
    expected_dn, variance_dn2 : (sensors, lines, pixels) its prediction [DN, DN^2].
    top_codes_dn : greatest digital number of each sensor [DN].
    seed : of the random numbers that replace what rounding lost; the same seed gives the same result, whatever the
        number of threads.
    threads : number of threads that share the work; None: one per core.
    naive : whether the naive histogram is computed as well, which takes a second pass.
    """
    workers = threads or os.cpu_count() or 1
    sensors, lines, pixels = measured_dn.shape
    pieces = parts(lines, pixels)

    def least(sensor: int, piece: range) -> float:
        return float(variance_dn2[sensor, piece.start : piece.stop].min(initial=math.inf))

    of_pieces = shared_out(
        [partial(least, s, piece) for s in range(sensors) for piece in pieces], threads=workers
    )
    scales = [
        Scale.of(top_code_dn=top, least_variance_dn2=min(of_pieces[at : at + len(pieces)]))
        for top, at in zip(top_codes_dn, range(0, len(of_pieces), len(pieces)), strict=True)
    ]

    def one(sensor: int, piece: range, dither: bool) -> Part:
        rows, scale = (sensor, slice(piece.start, piece.stop)), scales[sensor]
        mean, inverse = compact(expected_dn[rows], variance_dn2[rows], scale, first_line=piece.start)
        seen = measured_dn[rows]
        return compare(seen, mean, inverse, scale=scale, sensor=sensor, lines=piece, seed=seed, dither=dither)

    passes = (True, False) if naive else (True,)
    tasks = [partial(one, s, piece, dither) for dither in passes for s in range(sensors) for piece in pieces]
    done = shared_out(tasks, threads=workers)
    of_sensors = [done[at : at + len(pieces)] for at in range(0, len(done), len(pieces))]
    return join(of_sensors[:sensors], of_sensors[sensors:])


class EvidenceDetector(Protocol):
    """Test that turns evidence into a decision.

    It contains the variation of a good page, and the costs those of errors.
    """

    @property
    def name(self) -> str:
        """Name by which users ask for it."""
        ...

    @property
    def guarantee(self) -> str:
        """False-alarm rate that is guaranteed, in words."""
        ...

    @property
    def false_alarm_rate(self) -> float | None:
        """The same as a number; None: none is guaranteed. [-]"""
        ...

    def decide(self, evidence: Evidence) -> Decision:
        """Decide on one page by its evidence, which is not changed."""
        ...

    def stored_arrays(self, evidence: Evidence) -> dict[str, NDArray[Any]]:
        """Return the arrays of the evidence that it uses."""
        ...

    def evidence_of(self, stored: StoredArrays, *, sensors: int) -> Evidence:
        """Restore the evidence that it uses; RequestError: the arrays are not of a page."""
        ...


def only(**given: NDArray[Any]) -> Evidence:
    """Return evidence of which only the given parts are filled."""
    nothing: dict[str, NDArray[Any]] = {
        "tile_histogram": np.zeros((0,) * 4, np.int64),
        "naive_histogram": np.zeros((0, 0), np.int64),
        "block_z": np.zeros((0,) * 3, np.float32),
    }
    return Evidence(**nothing | given)
