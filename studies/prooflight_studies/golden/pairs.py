"""Pairs of a golden scan and a scan with marked defects, and the overlap of detections with the marks."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.errors import RequestError, ScanError
from prooflight.files.given import GivenFiles
from prooflight.scans.pictures import PictureFile

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

_WHOLE: Final = re.compile(r"[0-9]{1,9}")
Box = tuple[int, int, int, int]
"""Left, top, right, bottom. [pixels]"""

KINDS: Final = {1: "open", 2: "short", 3: "mousebite", 4: "spur", 5: "spurious copper", 6: "pin-hole"}
"""Kinds of defects, as the data set DeepPCB numbers them."""
MARK_FILES: Final = GivenFiles(
    error=ScanError,
    remedy="write left top right bottom kind, whole numbers, a line for each defect",
    largest_mb=0.25,
)
LEAST_OVERLAP: Final = 0.33
"""Intersection over union above which a detection matches a mark (DeepPCB's own measure)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoldenPair:
    """A golden scan, and another scan of the same design with marked defects."""

    name: str
    golden: NDArray[np.float32]
    """(1, lines, pixels)."""
    scan: NDArray[np.float32]
    marked: tuple[Box, ...]
    kinds: tuple[int, ...]
    cut: tuple[Box, ...] = ()
    """Marked boxes that are only partly on the scan: neither missed nor false."""


def read_pairs(folder: Path) -> list[GoldenPair]:
    """Read pairs NAME_temp.jpg, NAME_test.jpg, NAME.txt by name; the text has a line for each defect.

    A line is: left top right bottom kind. RequestError: the folder holds none. ScanError: a file of a pair cannot be
    used.
    """
    lists = sorted(folder.glob("*.txt")) if folder.is_dir() else []
    pairs = [_read(path) for path in lists if path.with_name(f"{path.stem}_temp.jpg").is_file()]
    if not pairs:
        what = "holds no pairs of scans"
        raise RequestError(folder, what, remedy="give a folder of NAME_temp.jpg, NAME_test.jpg and NAME.txt")
    return pairs


def _read(path: Path) -> GoldenPair:
    golden, scan = (
        PictureFile(path=path.with_name(f"{path.stem}_{which}.jpg"), first_image=0, images=1).read().grey
        for which in ("temp", "test")
    )
    if golden.shape != scan.shape:
        what = f"belongs to scans of {golden.shape} and {scan.shape}"
        raise ScanError(path, what, remedy="give scans of one size")
    rows = _marks(path, lines=golden.shape[-2], pixels=golden.shape[-1])
    marked = tuple((row[0], row[1], row[2], row[3]) for row in rows)
    return GoldenPair(
        name=path.stem, golden=golden, scan=scan, marked=marked, kinds=tuple(row[4] for row in rows)
    )


def _marks(path: Path, *, lines: int, pixels: int) -> list[tuple[int, ...]]:
    """Return left, top, right, bottom and kind of every defect.

    ScanError: a line is something else, or off the scan.
    """
    rows: list[tuple[int, ...]] = []
    for at, line in enumerate(MARK_FILES.read_text(path).split("\n"), start=1):
        fields = line.split()
        if not fields:
            continue
        row = tuple(map(int, fields)) if all(map(_WHOLE.fullmatch, fields)) else ()
        if len(row) != 5 or row[4] not in KINDS:
            what = f"is not a list of marked defects: line {at} is something else"
            raise ScanError(path, what, remedy=MARK_FILES.remedy)
        if not (0 <= row[0] < row[2] <= pixels and 0 <= row[1] < row[3] <= lines):
            what = f"line {at}: the defect is outside the scan of {pixels} x {lines} pixels"
            raise ScanError(path, what, remedy=MARK_FILES.remedy)
        rows.append(row)
    return rows


def halves(pairs: Sequence[GoldenPair]) -> tuple[list[GoldenPair], list[GoldenPair]]:
    """Return the pairs for tuning and for the test: every second pair by name, the first for tuning."""
    return list(pairs[0::2]), list(pairs[1::2])


def overlap(one: Box, other: Box) -> float:
    """Return the intersection over union.

    >>> overlap((0, 0, 10, 10), (5, 0, 15, 10))
    0.3333333333333333
    """
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    if width <= 0 or height <= 0:
        return 0.0
    areas = sum((box[2] - box[0]) * (box[3] - box[1]) for box in (one, other))
    return width * height / (areas - width * height)


def touching(one: Box, other: Box) -> bool:
    """Return whether two boxes have a pixel in common."""
    return all(max(one[side], other[side]) < min(one[side + 2], other[side + 2]) for side in (0, 1))


def matched(detected: Sequence[Box], marked: Sequence[Box]) -> dict[int, tuple[int, float]]:
    """Return the marked box that each detected one matches, and their overlap.

    Each box is used once, the best overlaps first.
    """
    likely = sorted(
        ((overlap(one, other), at, to) for at, one in enumerate(detected) for to, other in enumerate(marked)),
        reverse=True,
    )
    pairs: dict[int, tuple[int, float]] = {}
    taken: set[int] = set()
    for much, at, to in likely:
        if much > LEAST_OVERLAP and at not in pairs and to not in taken:
            pairs[at] = (to, much)
            taken.add(to)
    return pairs
