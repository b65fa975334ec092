"""A sum of shallow decision trees, as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


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
