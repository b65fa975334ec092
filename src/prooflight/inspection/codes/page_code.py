"""Code of a page, and its expected image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.inspection.codes.profiles import Profile
    from prooflight.inspection.codes.symbols import Symbol


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageCode:
    """Code of a page, and its place in the camera's lines."""

    symbol: Symbol
    """Code that was read; its corners are in pixels of ``light``."""
    corner: tuple[int, int]
    """First line and column of ``light`` in the scan of a page in its place."""
    light: NDArray[np.float32]
    """Expected light of the code and its quiet zone (lines, columns), bare paper 1."""
    box_mm: tuple[float, float, float, float]
    """Place x, y, width and height on the page as printed, without quiet zone."""
    profiles: tuple[Profile | None, ...]
    """Scan lines of a bar code as they must be seen (``profiles.profiles``)."""
    sure: bool
    """Whether it reads in harder pictures than good prints make: only then must scans show it."""
