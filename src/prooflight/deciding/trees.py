"""Decision trees as arrays: a sum of shallow ones, a mean of deep ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

LEAST_CHANCE: Final = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trees:
    """Complete binary trees of one depth; node n has the children 2 n + 1 and 2 n + 2."""

    column: NDArray[np.int32]
    """(trees, nodes) what a node looks at."""
    cut: NDArray[np.float32]
    """(trees, nodes) above it goes right; infinite: all go left."""
    leaf: NDArray[np.float32]
    """(trees, nodes + 1) what is added at the ends."""
    start: float

    def score(self, columns: NDArray[np.floating]) -> NDArray[np.float64]:
        """Log odds of rows (pages, columns): (pages,)."""
        depth = (self.column.shape[1] + 1).bit_length() - 1
        total = np.full(len(columns), self.start)
        every = np.arange(len(columns))
        for column, cut, leaf in zip(self.column, self.cut, self.leaf, strict=True):
            node = np.zeros(len(columns), np.int64)
            for _ in range(depth):
                node = 2 * node + 1 + (columns[every, column[node]] > cut[node])
            total += leaf[node - self.column.shape[1]]
        return total


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Forest:
    """The mean of many deep decision trees, their nodes one after the other."""

    column: NDArray[np.int32]
    """(nodes,) what a node looks at; -1: it is an end."""
    cut: NDArray[np.float32]
    """(nodes,) above it goes right."""
    left: NDArray[np.int32]
    """(nodes,) where it goes else; right is beside it in ``right``."""
    right: NDArray[np.int32]
    share: NDArray[np.float32]
    """(nodes,) of misprints among what ended there in learning."""
    root: NDArray[np.int32]
    """(trees,) first nodes."""

    def score(self, columns: NDArray[np.floating]) -> NDArray[np.float64]:
        """Log odds of rows (pages, columns): (pages,); bounded, for no forest has seen more than so many pages."""
        place = np.broadcast_to(self.root, (len(columns), self.root.size)).copy()
        rows = np.arange(len(columns))[:, None]
        narrow = np.asarray(columns, np.float32)
        while (going := self.column[place] >= 0).any():
            above = narrow[rows, np.maximum(self.column[place], 0)] > self.cut[place]
            further = np.where(above, self.right[place], self.left[place])
            place = np.where(going, further, place)
        chance = self.share[place].mean(axis=1, dtype=np.float64)
        return np.log((chance + LEAST_CHANCE) / (1 + LEAST_CHANCE - chance))
