"""One scan of one page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.scans.lines import Unseen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scan:
    """The lines that a camera saw of one sheet."""

    dn: NDArray[Any]
    """(sensors, lines, pixels) raw digital numbers, uint16; of a picture file its own numbers. [DN]"""
    name: str = "the scan"
    """Of the file or the sheet, for errors."""
    unseen: Sequence[Unseen] = ()
    """Lines that nobody saw; whatever stands in their place says nothing."""

    @property
    def lost(self) -> NDArray[np.bool_] | None:
        """Which lines no camera saw, (sensors, lines); None: all were seen."""
        found = np.zeros(self.dn.shape[:2], bool)
        for first, end, sensor in self.unseen:
            found[slice(None) if sensor is None else sensor, first:end] = True
        return found if found.any() else None


def in_groups(lost: NDArray[np.bool_], size: int, groups: int) -> NDArray[np.bool_]:
    """Which of so many groups of ``size`` lines hold a lost one (sensors, lines): (sensors, groups)."""
    found = np.zeros((len(lost), groups * size), bool)
    lines = min(lost.shape[1], groups * size)
    found[:, :lines] = lost[:, :lines]
    return np.asarray(found.reshape(len(lost), groups, size).any(axis=2))


def touching(lost: NDArray[np.bool_], tops: NDArray[np.int64], size: int) -> NDArray[np.bool_]:
    """Which squares of so many lines, the first at ``tops`` (n,), lie on lost lines (sensors, lines): (sensors, n)."""
    before = np.pad(np.cumsum(lost, axis=1), ((0, 0), (1, 0)))
    first, behind = (np.clip(tops + step, 0, lost.shape[1]) for step in (0, size))
    return np.asarray(before[:, behind] > before[:, first])
