"""What one statistic says of a page, and where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

Box = tuple[float, float, float, float]
"""x, y, width, height. [mm]"""
NOWHERE: Final[Box] = (np.nan,) * 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Statistic:
    """One statistic of one page."""

    name: str
    """``family/detail``."""
    value: float
    """Higher is worse."""
    box: Box = NOWHERE
    """Where; NaN: the page as a whole."""


def values_of(statistics: Sequence[Statistic]) -> NDArray[np.float32]:
    """Values of statistics, (n,)."""
    return np.array([one.value for one in statistics], np.float32)
