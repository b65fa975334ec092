"""What one statistic says of a page, and where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

Box = tuple[float, float, float, float]
"""x, y, width, height. [mm]"""
NOWHERE: Final[Box] = (np.nan,) * 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """One statistic of one page."""

    name: str
    """``family/detail``."""
    value: float
    """Higher is worse."""
    box: Box = NOWHERE
    """Where; NaN: the page as a whole."""
