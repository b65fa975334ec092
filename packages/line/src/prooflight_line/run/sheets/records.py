"""Records of the sheets that passed, and of pages that did not come."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.scans.lines import Unseen

FaultKind = Literal[
    "slip",
    "stretch",
    "lost-lines",
    "extra-lines",
    "blank",
    "repeated",
    "missing",
    "unwatched",
    "out-of-order",
    "splice",
    "unknown",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A fault of the paper path or of the camera's lines; not a misprint.

    slip: the sheet came early or late relative to those before it. stretch: it is longer or shorter than it
    should be. lost-lines, extra-lines: the camera lost lines, its count jumps or goes back, or the sheet lacks
    lines or has too many at one place. blank: nothing is printed on it. repeated: a page that had passed already.
    missing: pages before this one have not come. unwatched: it passed while the run had broken off.
    out-of-order: a page came later than its turn. splice: a tape
    lies across the sheet. unknown: it is no page of the job, or less than a sheet.
    """

    kind: FaultKind
    first_line: int
    """First line of the fault, in the camera's count."""
    detail: str
    """Message for a person."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenPage:
    """One sheet that passed."""

    scan: NDArray[np.uint16]
    """(sensors, lines, pixels), cut as ``ScanGeometry`` says: the sheet's edge lies lead-in below its first line.
    [DN]"""
    first_line: int
    """The camera's count at the scan's first line."""
    last_line_time_s: float
    """When the scan's last line was read, by the source's clock."""
    job_page: int | None
    """Index in ``expected`` of the page that it shows; None: it shows none of them."""
    first_line_time_s: float | None = None
    """When the scan's first line was read, by the same clock; None: it is not known."""
    faults: tuple[Fault, ...] = ()
    taken_for: int | None = None
    """The page in whose place it came, if its content could not be identified: ``job_page`` is None then."""
    unseen: tuple[Unseen, ...] = ()
    """Lines of the scan that the camera lost."""
    begun_within: bool = False
    """Whether the lines began within it, so that its first part was never seen. It is torn then."""
    torn: bool = False
    """Whether an unknown number of lines was lost within the sheet."""
    cut_short: bool = False
    """Whether the lines ended before the sheet did, so that it could not be identified; if not, the thumbnail
    of its page was unknown."""

    @property
    def lines_s(self) -> float:
        """Time from its first line to its last; 0 where it is not known. [s]"""
        return 0.0 if self.first_line_time_s is None else self.last_line_time_s - self.first_line_time_s


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingPage:
    """A page of the job that has not come, or passed unwatched, reported when pages after it have come."""

    job_page: int
    """Index in ``expected`` of the page."""
    faults: tuple[Fault, ...]

    @property
    def is_unwatched(self) -> bool:
        """Whether it passed while nothing watched."""
        return any(fault.kind == "unwatched" for fault in self.faults)
