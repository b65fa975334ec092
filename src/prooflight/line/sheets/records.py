"""What is said of the sheets that passed, and of those that did not."""

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
    "out-of-order",
    "splice",
    "unknown",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """Something that went wrong on the way from the press to the lines; not a misprint.

    slip: the sheet came early or late against those before it. stretch: it is longer or shorter than it should be.
    lost-lines, extra-lines: the camera lost lines, its count jumps or goes back, or the sheet lacks lines or has too
    many at one place. blank: nothing is printed on it. repeated: a page that had passed already. missing: pages before
    this one have not come. out-of-order: a page came later than its turn. splice: a tape lies across the sheet.
    unknown: it is no page of the job, or less than a sheet.
    """

    kind: FaultKind
    first_line: int
    """Where it begins, in the camera's count."""
    detail: str
    """For a person."""


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
    """Which of ``expected`` it shows; None: none of them."""
    faults: tuple[Fault, ...] = ()
    taken_for: int | None = None
    """The page in whose place it came, where it could not be told which it shows: ``job_page`` is None then."""
    unseen: tuple[Unseen, ...] = ()
    """Of the scan's lines, those that the camera lost."""
    begun_within: bool = False
    """Whether the lines began within it: what lies before was never seen. It is torn then."""
    torn: bool = False
    """Whether lines were lost within the sheet, and nobody knows how many."""
    cut_short: bool = False
    """Whether that is because the lines ended before the sheet did; else the page's look was not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingPage:
    """A page of the job that has not come, said when the pages behind it have."""

    job_page: int
    """Which of ``expected``."""
    faults: tuple[Fault, ...]
