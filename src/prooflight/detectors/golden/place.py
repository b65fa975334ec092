"""Registration of a scan to a golden scan: a displacement field, stiff in bending, from tiles with edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft, sparse
from scipy.linalg import solveh_banded

Steps = Sequence[tuple[int, float, float]]

TILE_PIXELS: Final = 32
"""Minimum side of a tile; large scans have larger ones, ``MOST_TILES`` along the longer side."""
MOST_TILES: Final = 48
COARSE_PIXELS: Final = 512
"""Maximum length of the longer side of the shrunk images in which the first shift is searched for."""
CANDIDATES: Final = 6
"""Maximum number of first shifts that are tried: an array of pads looks the same if shifted by its pitch."""
NEARLY: Final = 0.8
"""Share of the best shift's likeness from which another shift is tried as well."""
FAR: Final = 0.02
"""Penalty of a shift as great as ``REACH``: of shifts that fit equally, the shorter one is preferred.
[likeness]"""
REACH: Final = 0.06
"""Greatest first shift, as a share of the longer side: 12 mm of A4, as far as misprints are displaced
(worlds.toml)."""
STARTS: Final = (
    ((8, 0.05, 0.02), (8, 0.05, 0.02), (4, 0.1, 0.02), (4, 0.2, 0.02)),
    ((4, 0.1, 0.02), (4, 0.2, 0.02)),
)
"""First stages of the field's measurement; the better one is used: the first reaches further, but a fine
array misleads it. Each step: the shrink factor; the standard deviation of the field's second difference
between tiles [pixels of the full scan]; and that of its slope [-]. A step is linear and leaves about a
tenth."""
STEPS: Final = ((2, 0.4, 0.03), (2, 0.4, 0.03), (1, 1.0, 0.1), (1, 1.0, 0.1), (1, 1.0, 0.1))
"""Further stages. They are stiff at first, while a tile may still mistake one track for the next, and soft at
last, so that a board that is bent or displaced within a few tiles is followed. Chosen on the tuning half of
docs/results/detector/golden.md and known transforms."""
SMOOTH_PIXELS: Final = 1.0
"""Standard deviation of the blur before gradients are taken: scans may be binary."""
TILE_SD_PIXELS: Final = 0.3
"""Standard deviation of a tile's displacement beyond its noise: edges that moved independently (widths that
vary)."""
EDGE_SD: Final = 0.1
"""Standard deviation of a pixel's residual while the field is fitted, as a share of the scan's contrast."""
LEAST_INFORMATION: Final = 1e-6
"""Minimum information of a tile, so that one without edges has a place: its own. [1/pixel^2]"""
WEAK: Final = 1e-6
"""Information by which a tile is held at its place in any case. [1/pixel^2]"""
BANDS: Final = 2
"""Number of rows of tiles that a second difference reaches."""
MOST_STEP: Final = 2.0
"""Maximum displacement of a tile in one step, in pixels of the current resolution: a linear step reaches no
further."""
MARGIN_PIXELS: Final = 4
"""Margin of a golden that is not judged: the displacement of its border is measured by half a tile only."""
LEAST_EDGE: Final = 0.02
"""Minimum gradient of an edge [contrast/pixel]: a golden scan without any has no place."""
LIKE: Final = 0.5
"""Minimum correlation of edges at an eighth of the resolution (0.98 and more on good scans). [-]"""
OWN_REACH: Final = 2
"""Distance from a golden's edges within which those of a scan are compared that has others as well: 16 pixels of the
scan. Pages of a public paper then have 0.73 to 0.96 on their scans, and other public pages 0.31 at most. [pixels, at
an eighth of the resolution]"""
LIKE_BENT: Final = 0.9
"""Minimum correlation if the field is bent: another page may be bent to look similar. [-]"""
FED_OTHERWISE: Final = tuple(product((-0.01, -0.005, 0.0, 0.005, 0.01), (-0.009, 0.0, 0.009)))
"""Stretches along and turns [rad] that are tried where a scan is less like its golden than ``LIKE_BENT``: a feeder
stretches a sheet that goes in by its other edge by up to 0.8 % more or less, and turns it by up to half a degree
between two scans."""
FED_STEPS: Final = ((1, 3.0, 0.1),) * 3
"""Last stages from there: what a device distorts across the sheet shows twice, by a pixel and more between tiles."""
MOST_BENT: Final = 0.03
"""Maximum difference of displacements, as a share of the longer side: a stretch of 3 % or a turn of 1.7
degrees."""
MOST_LOOSE: Final = 4
"""Maximum increase of the edge tolerance where the field bends. [pixels]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoldenPlace:
    """Displacement of each place of the golden scan in a scan, to the right and down."""

    nodes: NDArray[np.float32]
    """(2, rows, columns) displacement across and along at the centres of tiles. [pixels]"""
    tile_pixels: int
    likeness: float
    """Correlation of the edges of both, with the golden moved. [-]"""

    @classmethod
    def same(cls, shape: tuple[int, ...]) -> Self:
        """Return the place of a scan (..., lines, pixels) that is aligned with the golden."""
        return cls(nodes=np.zeros((2, 1, 1), np.float32), tile_pixels=max(shape[-2:]), likeness=1.0)

    @property
    def located(self) -> bool:
        """Whether the scan has the golden's content."""
        return self.likeness >= (LIKE_BENT if self.bent else LIKE)

    @property
    def bent(self) -> bool:
        """Whether the scan is too far out of shape for its field to be reliable."""
        most = max(float(np.ptp(node)) for node in self.nodes)
        return most > MOST_BENT * self.tile_pixels * max(self.nodes.shape[1:])

    @property
    def shift_pixels(self) -> tuple[float, float]:
        """Mean displacement across and along. [pixels]"""
        return float(self.nodes[0].mean()), float(self.nodes[1].mean())

    @property
    def slopes(self) -> NDArray[np.float64]:
        """(2, 2) mean displacement across and along, per pixel across and along. [-]"""
        _, rows, columns = self.nodes.shape
        along, across = np.mgrid[:rows, :columns] * float(self.tile_pixels)
        places = np.stack([across - across.mean(), along - along.mean()]).reshape(2, -1)
        return np.asarray(self.nodes.reshape(2, -1) @ np.linalg.pinv(places), np.float64)

    def shifted(self, by: tuple[float, float]) -> Self:
        """Return the place that lies further across and along. [pixels]"""
        return replace(self, nodes=self.nodes + np.array(by, np.float32)[:, None, None])

    def loose_pixels(self, shape: tuple[int, ...]) -> NDArray[np.uint8]:
        """Return the increase of the edge tolerance, (lines, pixels): the field's bend in whole pixels.

        Between tiles the field is linear. Where a part of a board is displaced, its error is up to its bend.
        """
        bend = np.zeros(self.nodes.shape[1:], np.float32)
        for axis in (1, 2):
            if self.nodes.shape[axis] > 2:
                inner = [slice(1, -1) if at == axis else slice(None) for at in (1, 2)]
                second = np.abs(np.diff(self.nodes, 2, axis=axis)).max(axis=0)
                bend[tuple(inner)] = np.maximum(bend[tuple(inner)], second)
        loose = np.minimum(cv2.dilate(bend, np.ones((3, 3), np.uint8)), MOST_LOOSE).astype(np.uint8)
        size = (loose.shape[1] * self.tile_pixels, loose.shape[0] * self.tile_pixels)
        return cv2.resize(loose, size, interpolation=cv2.INTER_NEAREST)[: shape[-2], : shape[-1]]

    def moved(self, image: NDArray[np.float32], *, shrink: int = 1) -> NDArray[np.float32]:
        """Move the golden's ``image`` (lines, pixels), ``shrink`` times smaller, to where this scan shows it.

        It is NaN within ``MARGIN_PIXELS`` of the golden's border and beyond.
        """
        lines, pixels = image.shape
        across, along = (
            _upsampled(node, image.shape, self.tile_pixels // shrink) / shrink for node in self.nodes
        )
        x = np.arange(pixels, dtype=np.float32) - across
        y = np.arange(lines, dtype=np.float32)[:, None] - along
        shown = cv2.remap(image, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        outer = MARGIN_PIXELS / shrink - 0.5
        shown[(x < outer) | (x > pixels - 1 - outer) | (y < outer) | (y > lines - 1 - outer)] = np.nan
        return shown


def place(golden: NDArray[np.float32], scan: NDArray[np.float32]) -> GoldenPlace:
    """Find where ``scan`` shows ``golden``, both (lines, pixels) of one shape, contrast about 1.

    The best of several shifts by correlation of edges is the start of a field of displacements, from coarse
    to fine: one linear least-squares step at each tile (Lucas and Kanade), all tiles together under a penalty
    on first and second differences, and tiles that do not fit omitted step by step.
    """
    tile = max(TILE_PIXELS, 8 * int(np.ceil(max(golden.shape) / MOST_TILES / 8)))
    rows, columns = (int(np.ceil(extent / tile)) for extent in golden.shape)
    slopes, bends = (_stiffness(rows, columns, order) for order in (1, 2))
    pictures = {shrink: (_small(golden, shrink, tile), _small(scan, shrink, tile)) for shrink in (1, 2, 4, 8)}

    def stepped(where: GoldenPlace, steps: Steps) -> GoldenPlace:
        for shrink, bend_pixels, slope in steps:
            stiff = slopes / (slope * tile) ** 2 + bends / bend_pixels**2
            where = replace(where, nodes=_step(where, *pictures[shrink], shrink, stiff))
        return where

    def compared(where: GoldenPlace, shrink: int, reach: int | None = None) -> GoldenPlace:
        small, seen = pictures[shrink]
        return replace(where, likeness=_likeness(where.moved(small, shrink=shrink), seen, reach=reach))

    def penalised_likeness(where: GoldenPlace) -> float:
        return where.likeness - FAR * (np.hypot(*where.shift_pixels) / (REACH * max(golden.shape))) ** 2

    def best_from(starts: Sequence[GoldenPlace], further: Steps) -> GoldenPlace:
        tried = [compared(stepped(start, steps), 2) for start in starts for steps in STARTS]
        return compared(stepped(max(tried, key=penalised_likeness), further), 8)

    flat = GoldenPlace(nodes=np.zeros((2, rows, columns), np.float32), tile_pixels=tile, likeness=1.0)
    best = best_from([flat.shifted(shift) for shift, _ in _first_shifts(golden, scan)], STEPS)
    if best.likeness >= LIKE_BENT:
        return best
    again = best_from([_fed_otherwise(*pictures[8], flat)], STEPS + FED_STEPS)
    best = max(best, again, key=lambda where: where.likeness)
    # Of a sheet with little print, a stamp may have most edges.
    return best if best.located or best.bent else compared(best, 8, OWN_REACH)


def residual_pixels(golden: NDArray[np.float32], scan: NDArray[np.float32], where: GoldenPlace) -> float:
    """Return by how far tiles lie off the field that follows them, rms along an axis, weighted by their precision.

    golden, scan: as for ``place``, which returned ``where``. It includes the noise of the measurement itself, and
    edges as sharp as a pixel seem to lie up to 30 % further off than they do.
    """
    own, precision = _tile_moves(
        where, _small(golden, 1, where.tile_pixels), _small(scan, 1, where.tile_pixels), 1
    )
    far2 = np.einsum("na,nab,nb->", own, precision, own)
    return float(np.sqrt(far2 / max(np.einsum("naa->", precision), LEAST_INFORMATION)))


def _fed_otherwise(golden: NDArray[np.float32], scan: NDArray[np.float32], flat: GoldenPlace) -> GoldenPlace:
    """Return the likeliest of the stretches and turns of ``FED_OTHERWISE``, both images eight times smaller."""
    _, rows, columns = flat.nodes.shape
    down, right = (np.mgrid[:rows, :columns] * np.float32(flat.tile_pixels)).astype(np.float32)
    down, right = down - down.mean(), right - right.mean()
    places = []
    for along, turn in FED_OTHERWISE:
        start = replace(flat, nodes=np.stack([-turn * down, turn * right + along * down]))
        moved = start.moved(golden, shrink=8)
        for shift, alike in _first_shifts(np.where(np.isfinite(moved), moved, scan), scan)[:1]:
            places.append((alike, start.shifted((8 * shift[0], 8 * shift[1]))))
    return max(places, key=lambda one: one[0], default=(0.0, flat))[1]


def _small(image: NDArray[np.float32], shrink: int, tile: int) -> NDArray[np.float32]:
    """Pad an image to whole tiles, average over shrink x shrink pixels, and blur."""
    lines, pixels = (-extent % tile for extent in image.shape)
    padded = cv2.copyMakeBorder(image, 0, lines, 0, pixels, cv2.BORDER_REPLICATE)
    if shrink > 1:
        size = (padded.shape[1] // shrink, padded.shape[0] // shrink)
        padded = cv2.resize(padded, size, interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(padded, (0, 0), SMOOTH_PIXELS)


def _upsampled(node: NDArray[np.float32], shape: tuple[int, ...], tile: int) -> NDArray[np.float32]:
    rows, columns = node.shape
    full = cv2.resize(node, (columns * tile, rows * tile), interpolation=cv2.INTER_LINEAR)
    return full[: shape[0], : shape[1]]


def _edges(image: NDArray[np.float32]) -> NDArray[np.complex64]:
    across = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    along = cv2.Sobel(image, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    return np.asarray(across + 1j * along, np.complex64)


def _first_shifts(
    golden: NDArray[np.float32], scan: NDArray[np.float32]
) -> list[tuple[tuple[float, float], float]]:
    """Return shifts across and along [pixels] and their similarity of edges, to a coarse pixel, best first.

    Similarity is twice the correlation over the energy of both where they overlap: otherwise the shift of an
    array of pads would be underestimated, because a smaller shift has more overlap.
    """
    shrink = max(1, int(np.ceil(max(golden.shape) / COARSE_PIXELS)))
    size = (golden.shape[1] // shrink, golden.shape[0] // shrink)
    one, two = (_edges(cv2.resize(image, size, interpolation=cv2.INTER_AREA)) for image in (golden, scan))
    reach = int(REACH * max(size)) + 1
    near = np.arange(-reach, reach + 1)
    padded = [fft.next_fast_len(extent + reach) for extent in one.shape]
    product = np.conj(fft.fft2(one, padded)) * fft.fft2(two, padded)
    both = fft.ifft2(product).real[np.ix_(near, near)]
    energy = _overlapping(np.abs(one) ** 2, -near) + _overlapping(np.abs(two) ** 2, near)
    alike = 2 * both / np.maximum(energy, 1e-6 * max(float(energy.max()), 1e-9))
    alike -= FAR * np.add.outer((near / reach) ** 2, (near / reach) ** 2)
    # Where nothing agrees, the greatest may be below 0.
    least = min(NEARLY * alike.max(), alike.max())
    peaks = (alike == cv2.dilate(alike, np.ones((5, 5)))) & (alike >= least)
    order = np.argsort(-alike[peaks], kind="stable")[:CANDIDATES]
    return [
        ((float(near[x] * shrink), float(near[y] * shrink)), float(alike[y, x]))
        for y, x in np.argwhere(peaks)[order]
    ]


def _overlapping(energy: NDArray[np.float32], shifts: NDArray[np.int_]) -> NDArray[np.float64]:
    """Return the sum of ``energy`` (lines, pixels) that overlaps an image of its shape, shifted against it.

    (shifts, shifts), along and across; a positive shift is down or right, so that the first lines do not
    overlap.
    """
    lines, pixels = energy.shape
    total = cv2.integral(energy, sdepth=cv2.CV_64F)
    top, bottom = np.maximum(shifts, 0), np.minimum(lines, lines + shifts)
    left, right = np.maximum(shifts, 0), np.minimum(pixels, pixels + shifts)
    corners = (total[np.ix_(y, x)] for y, x in ((bottom, right), (top, left), (bottom, left), (top, right)))
    whole, outer, below, upper = corners
    return np.asarray(whole + outer - below - upper, np.float64)


def _likeness(moved: NDArray[np.float32], scan: NDArray[np.float32], *, reach: int | None = None) -> float:
    """Return the correlation of the scan's edges with those of the moved golden, where both are defined.

    reach: only edges of the scan at most so many pixels from one of the golden count; None: all do.
    """
    valid = np.isfinite(moved)
    one, two = _edges(np.where(valid, moved, scan)), _edges(scan)
    if reach is not None:
        edges = (np.abs(one) >= LEAST_EDGE).view(np.uint8)
        valid &= cv2.dilate(edges, np.ones((2 * reach + 1,) * 2, np.uint8)) > 0
    one, two = one[valid], two[valid]
    if np.abs(one).max(initial=0) < LEAST_EDGE:
        return 0.0
    energy = np.sqrt((np.abs(one) ** 2).sum() * (np.abs(two) ** 2).sum())
    return float((np.conj(one) * two).sum().real) / max(float(energy), 1e-9)


def _step(
    now: GoldenPlace,
    golden: NDArray[np.float32],
    scan: NDArray[np.float32],
    shrink: int,
    stiff: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Return the field after one linear step at one resolution."""
    own, precision = _tile_moves(now, golden, scan, shrink)
    start = now.nodes.reshape(2, -1).T.astype(np.float64)
    goal = start + own
    weight = np.ones(len(goal))
    field = start
    for _ in range(4):
        field = _solved(precision * weight[:, None, None], goal, stiff)
        far = goal - field
        far2 = np.einsum("na,nab,nb->n", far, precision, far)
        weight = 1 / (1 + far2 / 4)
    return np.ascontiguousarray(field.T.reshape(now.nodes.shape), np.float32)


def _tile_moves(
    now: GoldenPlace, golden: NDArray[np.float32], scan: NDArray[np.float32], shrink: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return tiles' own displacements (tiles, 2) [pixels] and their precision (tiles, 2, 2) [1/pixel^2]."""
    moved = now.moved(golden, shrink=shrink)
    valid = np.isfinite(moved)
    moved = np.where(valid, moved, scan)
    slope = np.where(valid, _edges(moved), np.complex64(0)) / np.float32(shrink * EDGE_SD)
    off = (moved - scan) / np.float32(EDGE_SD)
    tile = now.tile_pixels // shrink
    gx, gy = np.asarray(slope.real, np.float32), np.asarray(slope.imag, np.float32)
    # A constant offset over a tile is light, not a displacement: means are removed.
    parts = (gx * gx, gx * gy, gy * gy, gx * off, gy * off, gx, gy, off, valid.astype(np.float32))
    xx, xy, yy, x, y, *sums = (_tile_sums(part, tile).astype(np.float64).ravel() for part in parts)
    sum_x, sum_y, sum_off = (each / np.sqrt(np.maximum(sums[-1], 1)) for each in sums[:-1])
    xx, xy, yy = xx - sum_x**2, xy - sum_x * sum_y, yy - sum_y**2
    x, y = x - sum_x * sum_off, y - sum_y * sum_off
    normal = np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2) + np.eye(2) * LEAST_INFORMATION
    own = np.linalg.solve(normal, np.stack([x, y], axis=-1)[..., None])[..., 0]
    most = MOST_STEP * shrink
    own *= np.minimum(1, most / np.maximum(np.abs(own).max(axis=1, keepdims=True), 1e-9))
    spread = np.linalg.inv(normal) + np.eye(2) * TILE_SD_PIXELS**2
    return np.asarray(own, np.float64), np.asarray(np.linalg.inv(spread), np.float64)


def _tile_sums(image: NDArray[np.float32], tile: int) -> NDArray[np.float32]:
    rows, columns = image.shape[0] // tile, image.shape[1] // tile
    return image.reshape(rows, tile, columns, tile).sum(axis=(1, 3))


def _stiffness(rows: int, columns: int, order: int) -> NDArray[np.float64]:
    """Return the sum of squared first or second differences of a grid of displacements, as a quadratic form.

    The grid is (rows x columns). The result has upper bands, as for ``solveh_banded``; unknowns are by tile,
    across and along in turn.
    """

    def difference(count: int, order: int) -> sparse.csr_matrix:
        matrix = sparse.eye(count, format="csr")
        for _ in range(order):
            matrix = matrix[1:] - matrix[:-1]
        return matrix

    along, across = sparse.eye(rows), sparse.eye(columns)
    parts = []
    if columns > order:
        parts.append(sparse.kron(along, difference(columns, order)))
    if rows > order:
        parts.append(sparse.kron(difference(rows, order), across))
    if order == 2 and rows > 1 and columns > 1:
        parts.append(np.sqrt(2) * sparse.kron(difference(rows, 1), difference(columns, 1)))
    count = rows * columns
    total = sum((part.T @ part for part in parts), sparse.csr_matrix((count, count)))
    both = sparse.coo_matrix(sparse.kron(total, sparse.eye(2)))
    bands = np.zeros((2 * BANDS * columns + 2, 2 * count))
    upper = both.row <= both.col
    row, column = both.row[upper], both.col[upper]
    bands[len(bands) - 1 + row - column, column] = both.data[upper]
    return bands


def _solved(
    precision: NDArray[np.float64], goal: NDArray[np.float64], stiff: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the field (tiles, 2) that balances the tiles' own goals and stiffness.

    Tiles without information are held weakly.
    """
    regularised = precision + np.eye(2) * WEAK
    bands = stiff.copy()
    bands[-1] += np.einsum("naa->na", regularised).ravel()
    bands[-2, 1::2] += regularised[:, 0, 1]
    wanted = np.einsum("nab,nb->na", regularised, goal).ravel()
    return np.asarray(solveh_banded(bands, wanted, overwrite_ab=True, check_finite=False)).reshape(-1, 2)
