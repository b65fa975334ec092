"""One scan of one page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scan:
    """The lines that a camera saw of one sheet."""

    dn: NDArray[Any]
    """(sensors, lines, pixels) raw digital numbers, uint16; of a picture file its own numbers. [DN]"""
    name: str = "the scan"
    """Of the file or the sheet, for errors."""
