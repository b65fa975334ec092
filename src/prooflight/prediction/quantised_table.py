"""Compact integer table of a sensor's signal over CMYK, for prediction.

The square root of the table (plus an offset) is interpolated instead of the table: ink on paper adds up to
amplitudes rather than intensities (Yule and Nielsen 1951, n near 2), and an error of a root is the same share
of shot noise everywhere. Roots are nearly straight along most inks, so 2^16 cells are as accurate as 2^20 of
the table: each ink has as many cells as its own curve needs.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from math import prod
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from prooflight.cmyk import INKS
from prooflight.kernels.prediction.lookup import NODE_STEP, NODES
from prooflight.prediction.tables import SameArray

if TYPE_CHECKING:
    from numpy.typing import NDArray

CELL_BITS = 16
"""Bits of a recipe's 32 that number the cells of all four inks together; the other 16 are fractions."""
FEWEST, MOST = 3, 5
"""Bits of one ink's cells: 8 to 32 cells."""
OFFSET = 1 / 50
"""Share of a table's greatest value that is added before the root, which is steep near black without it.
assumed: about read noise over shot noise at white; ten times more or less changes little."""
CODES = 32767


class QuantisedTable(NamedTuple):
    """Quantised table: value = unit x (65536 x interpolated code)^2 - offset."""

    codes: NDArray[np.int16]
    """Codes at the corners of the cells, (2^16, 16); cells and corners with black slowest and cyan
    fastest."""
    inner: NDArray[np.int16]
    """Weights of cyan and magenta's four corners at each pair of their fractions, (.., 4)."""
    outer: NDArray[np.int32]
    """Weights of yellow and black's corners, each twice, (.., 8)."""
    bits: NDArray[np.uint32]
    """Bits of each ink's cells, cyan first, (4,)."""
    unit: np.float32
    offset: np.float32

    @classmethod
    def of(cls, table: NDArray[np.float32]) -> Self:
        """Quantise a table (33, 33, 33, 33) over cyan, magenta, yellow, black.

        Recipes of bare paper and solid inks alone have the table's own value; those between are fitted by
        least squares.
        """
        exact = np.array(
            table, np.float64, order="C"
        )  # 9 MB: changed in place, since to clear as much takes longer
        for ink in range(INKS):
            _end_at_solid(exact, ink)
        offset = OFFSET * max(float(exact.max()), 1.0) - min(float(exact.min()), 0.0)
        exact += offset
        roots = np.sqrt(exact, out=exact)
        bits = cells_bits(roots)
        for ink in range(INKS):
            roots = _along(_fit(bits[ink]), roots, ink)
        white = float(roots[0, 0, 0, 0])
        scale = np.floor(CODES * white / roots.max()) / white  # so that white itself is a whole number
        codes = np.rint(roots * scale).astype(np.int16)
        fractions = [8 - count for count in bits]
        return cls(
            codes=_by_cell(codes),
            inner=_weights(fractions[1], fractions[0]).astype(np.int16),
            outer=np.repeat(_weights(fractions[3], fractions[2]), 2, axis=1).astype(np.int32),
            bits=np.array(bits, np.uint32),
            unit=np.float32((1 / (scale * 65536)) ** 2),
            offset=np.float32(offset),
        )


@lru_cache(maxsize=64)
def _quantised(table: SameArray) -> QuantisedTable:
    return QuantisedTable.of(table.array)


def quantised_table(table: NDArray[np.float32]) -> QuantisedTable:
    """Return ``QuantisedTable.of``, computed once for each table."""
    return _quantised(SameArray(table))


def cells_bits(roots: NDArray[np.float64]) -> tuple[int, ...]:
    """Return the bits of each ink's cells, ``CELL_BITS`` together, of least square error; roots (33, 33, 33, 33)."""
    thin = tuple(slice(None, None, 4) for _ in range(INKS))
    cost = np.empty((INKS, MOST + 1))
    for ink in range(INKS):
        nodes = (*thin[:ink], slice(None), *thin[ink + 1 :])
        along = roots[nodes]
        for count in range(FEWEST, MOST + 1):
            cost[ink, count] = np.square(_along(_fit_and_back(count), along, ink) - along).mean()
    choices = [c for c in product(range(FEWEST, MOST + 1), repeat=INKS) if sum(c) == CELL_BITS]
    return min(choices, key=lambda choice: sum(cost[ink, count] for ink, count in enumerate(choice)))


def _end_at_solid(table: NDArray[np.float64], ink: int) -> None:
    """Move the last node of an ink, in place, from byte value 256 to 255."""
    nodes = np.moveaxis(table, ink, 0)
    nodes[-1] -= (nodes[-1] - nodes[-2]) / NODE_STEP


def _places() -> NDArray[np.float64]:
    """Return the byte values of the nodes of a table that ends at solid, (33,)."""
    return np.append(np.arange(NODES - 1) * float(NODE_STEP), 255.0)


def _hats(cells: int) -> NDArray[np.float64]:
    """Return the weight of each node of so many equal cells over 0..256 at each of ``_places``, (33, cells + 1)."""
    return np.maximum(1 - np.abs(_places()[:, None] / (256 / cells) - np.arange(cells + 1)), 0)


@lru_cache
def _fit(bits: int) -> NDArray[np.float64]:
    """Return the matrix from values at ``_places`` to nodes of 2^bits cells, (2^bits + 1, 33).

    It is a least squares fit with both ends kept as they are.
    """
    hats = _hats(1 << bits)
    if bits == MOST:
        return np.asarray(np.linalg.inv(hats), np.float64)
    weight = np.ones(NODES)
    weight[1::2], weight[2:-1:2] = 4, 2  # Simpson's rule
    ends = [0, NODES - 1]
    end_rows = hats[ends]
    system = np.block([[hats.T @ (weight[:, None] * hats), end_rows.T], [end_rows, np.zeros((2, 2))]])
    right = np.vstack([hats.T * weight, np.eye(NODES)[ends]])
    solved = np.linalg.solve(system, right)
    return np.asarray(solved[: hats.shape[1]], np.float64)


@lru_cache
def _fit_and_back(bits: int) -> NDArray[np.float64]:
    """Return the matrix from values at ``_places`` to their approximation there by 2^bits cells, (33, 33)."""
    return np.asarray(_hats(1 << bits) @ _fit(bits), np.float64)


def _along(matrix: NDArray[np.float64], values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Return ``matrix`` (m, n) times every line of ``values`` (.., n, ..) along ``axis``: (.., m, ..)."""
    before, after = values.shape[:axis], values.shape[axis + 1 :]
    lines = values.reshape(prod(before), matrix.shape[1], prod(after))
    # Lines as they lie: turned so that all are one product, they would be copied, which takes longer than the product.
    result = lines[..., 0] @ matrix.T if not after else np.matmul(matrix, lines)
    return np.asarray(result.reshape(*before, len(matrix), *after), np.float64)


def _weights(slow_bits: int, fast_bits: int) -> NDArray[np.int64]:
    """Return the corners' weights at every pair of fractions of two inks, (2^(slow_bits + fast_bits), 4)."""
    sides = [
        np.stack([(1 << bits) - np.arange(1 << bits), np.arange(1 << bits)], axis=1)
        for bits in (slow_bits, fast_bits)
    ]
    return np.asarray(np.einsum("ai,bj->abij", *sides), np.int64).reshape(-1, 4)


def _by_cell(codes: NDArray[np.int16]) -> NDArray[np.int16]:
    """Gather nodes of cyan, magenta, yellow, black as corners of each cell, (2^16, 16), aligned to the cache."""
    nodes = np.ascontiguousarray(codes.transpose())
    cells = tuple(count - 1 for count in nodes.shape)
    # A cell of 32 bytes must not straddle two lines of the cache.
    room = np.empty((1 << CELL_BITS) * 16 + 32, np.int16)
    first = -room.ctypes.data % 64 // 2
    by_cell = room[first : first + (1 << CELL_BITS) * 16].reshape(-1, 16)
    corners = by_cell.reshape(*cells, 16)
    for place, corner in enumerate(product((0, 1), repeat=INKS)):
        within = tuple(slice(start, start + count) for start, count in zip(corner, cells, strict=True))
        corners[..., place] = nodes[within]
    return by_cell
