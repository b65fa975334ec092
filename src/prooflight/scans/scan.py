"""One scan of one page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from prooflight.scans.lines import Unseen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scan:
    """Lines of one sheet as a camera saw them."""

    dn: NDArray[Any]
    """Raw digital numbers, uint16, (sensors, lines, pixels); of a picture file its own numbers. [DN]"""
    name: str = "the scan"
    """Name of the file or the sheet, for errors."""
    unseen: Sequence[Unseen] = ()
    """Lines that were not seen, whose values must not be used."""

    @property
    def lost(self) -> NDArray[np.bool_] | None:
        """Flags of the lines that no camera saw, (sensors, lines); None if all were seen."""
        flags = np.zeros(self.dn.shape[:2], bool)
        for first, end, sensor in self.unseen:
            flags[slice(None) if sensor is None else sensor, first:end] = True
        return flags if flags.any() else None


def in_groups(lost: NDArray[np.bool_], size: int, groups: int) -> NDArray[np.bool_]:
    """Return which groups of ``size`` lines contain a lost one (sensors, lines): (sensors, groups)."""
    padded = np.zeros((len(lost), groups * size), bool)
    lines = min(lost.shape[1], groups * size)
    padded[:, :lines] = lost[:, :lines]
    return np.asarray(padded.reshape(len(lost), groups, size).any(axis=2))


def touching(lost: NDArray[np.bool_], tops: NDArray[np.int64], size: int) -> NDArray[np.bool_]:
    """Return which squares of ``size`` lines from ``tops`` (n,) touch lost lines (sensors, lines): (sensors, n)."""
    before = np.pad(np.cumsum(lost, axis=1), ((0, 0), (1, 0)))
    first, after = (np.clip(tops + step, 0, lost.shape[1]) for step in (0, size))
    return np.asarray(before[:, after] > before[:, first])
