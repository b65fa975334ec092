"""Pairs of a golden scan and a scan with marked defects, and the overlap of detections with the marks.

A golden may be moved by a known field. It moves, so that the marks stay where they are; both are then cropped to what
the golden's real signal covers.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.errors import RequestError, ScanError
from prooflight.files.given import GivenFiles
from prooflight.rng import stream
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


# --- golden scans displaced, turned, stretched and warped ---

CUT_PIXELS: Final = 16
"""Pixels cropped from every side, since the signal beyond the golden's edge is unknown."""
WAVE_PIXELS: Final = 60.0
"""Standard deviation of the blur that smooths a warp, which changes direction within two to four tiles."""
Field = Callable[[tuple[int, int], np.random.Generator], "NDArray[np.float32]"]
"""Function of a shape (lines, pixels): displacement of each point across and along (2, lines, pixels). [pixels]"""


def shifted(most_pixels: float) -> Field:
    """Return a field that shifts by 0 to ``most_pixels`` in a random direction, uniformly."""

    def field(shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
        far, way = most_pixels * rng.random(), 2 * np.pi * rng.random()
        return _everywhere(shape, far * np.cos(way), far * np.sin(way))

    return field


def turned(degrees: float) -> Field:
    """Return a field that rotates about the middle, in either direction."""

    def field(shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
        across, along = _from_middle(shape)
        turn = np.radians(degrees) * _either(rng)
        return np.stack([-turn * along, turn * across]).astype(np.float32)

    return field


def stretched(percent: float) -> Field:
    """Return a field that stretches or shrinks about the middle, across and along independently."""

    def field(shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
        across, along = _from_middle(shape)
        parts = [_either(rng) * percent / 100 * across, _either(rng) * percent / 100 * along]
        return np.stack(parts).astype(np.float32)

    return field


def warped(most_pixels: float) -> Field:
    """Return a smooth field of which the greatest displacement is ``most_pixels``."""

    def field(shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
        border = int(4 * WAVE_PIXELS)
        noise = rng.standard_normal((2, *(extent + 2 * border for extent in shape))).astype(np.float32)
        waves = np.stack([cv2.GaussianBlur(part, (0, 0), WAVE_PIXELS) for part in noise])
        waves = waves[:, border:-border, border:-border]
        return waves * np.float32(most_pixels / np.hypot(*waves).max())

    return field


def set_off(pixels: float) -> Field:
    """Return a field that displaces one part, across or along, beyond a random line in the middle half."""

    def field(shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
        moves = np.zeros((2, *shape), np.float32)
        axis, way, share = int(rng.integers(2)), int(rng.integers(2)), rng.uniform(0.25, 0.75)
        begin = int(share * shape[axis])
        part = (way, slice(begin, None)) if axis == 0 else (way, slice(None), slice(begin, None))
        moves[part] = pixels * _either(rng)
        return moves

    return field


def combined(*fields: Field) -> Field:
    """Return the sum of fields; they are so small that it approximates their composition."""

    def field(shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
        return np.sum([one(shape, rng) for one in fields], axis=0, dtype=np.float32)

    return field


TRANSFORMS: Final[dict[str, Field]] = {
    "shifted by 0 to 12 pixels": shifted(12),
    "turned by 0.25 degrees": turned(0.25),
    "turned by 0.5 degrees": turned(0.5),
    "stretched by 0.3 %": stretched(0.3),
    "stretched by 1 %": stretched(1.0),
    "warped by 1 pixel": warped(1),
    "warped by 2 pixels": warped(2),
    "warped by 3 pixels": warped(3),
    "a part set off by 1 pixel": set_off(1),
    "a part set off by 2 pixels": set_off(2),
    "all at once": combined(shifted(12), turned(0.2), stretched(0.3), warped(2), set_off(1.5)),
    "a part set off by 4 pixels": set_off(4),
    "stretched by 4 %": stretched(4),
}
"""Fields that move the golden, by name."""
TUNED_ON: Final = (
    "shifted by 0 to 12 pixels",
    "warped by 3 pixels",
    "a part set off by 2 pixels",
    "all at once",
)
"""Transforms used in tuning, of its own half.

The others are intermediate, and the last two are out of specification.
"""


def transformed(pair: GoldenPair, field: Field, rng: np.random.Generator) -> GoldenPair:
    """Return the pair with its golden moved and binarised again, as its makers did; both scans are cropped.

    Marks that the crop cuts are kept separately (``cut``): detections there are neither right nor false.
    """
    lines, pixels = pair.golden.shape[1:]
    across, along = field((lines, pixels), rng)
    x = np.arange(pixels, dtype=np.float32) - across
    y = np.arange(lines, dtype=np.float32)[:, None] - along
    moved = cv2.remap(pair.golden[0], x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    dark, light = float(pair.golden.min()), float(pair.golden.max())
    moved = np.where(moved > (dark + light) / 2, light, dark).astype(np.float32)
    inner = (slice(CUT_PIXELS, lines - CUT_PIXELS), slice(CUT_PIXELS, pixels - CUT_PIXELS))
    most = (pixels - 2 * CUT_PIXELS, lines - 2 * CUT_PIXELS)
    whole = [
        at for at, box in enumerate(pair.marked) if min(box[:2]) >= CUT_PIXELS and _within(box, pixels, lines)
    ]
    boxes = [_cut(box, most) for box in pair.marked]
    return replace(
        pair,
        golden=np.ascontiguousarray(moved[inner])[None],
        scan=np.ascontiguousarray(pair.scan[:, *inner]),
        marked=tuple(boxes[at] for at in whole),
        kinds=tuple(pair.kinds[at] for at in whole),
        cut=tuple(box for at, box in enumerate(boxes) if at not in whole),
    )


def transformed_pairs(pairs: list[GoldenPair], name: str, *, seed: int) -> list[GoldenPair]:
    """Return every pair moved by a field of ``TRANSFORMS``, each by its own draw."""
    row = list(TRANSFORMS).index(name)
    return [
        transformed(pair, TRANSFORMS[name], stream(seed, "golden-transforms", row, at))
        for at, pair in enumerate(pairs)
    ]


def _within(box: Box, pixels: int, lines: int) -> bool:
    return box[2] <= pixels - CUT_PIXELS and box[3] <= lines - CUT_PIXELS


def _cut(box: Box, most: tuple[int, int]) -> Box:
    left, top, right, bottom = (min(max(side - CUT_PIXELS, 0), most[at % 2]) for at, side in enumerate(box))
    return left, top, right, bottom


def _everywhere(shape: tuple[int, int], across: float, along: float) -> NDArray[np.float32]:
    return np.broadcast_to(np.array([across, along], np.float32)[:, None, None], (2, *shape)).copy()


def _from_middle(shape: tuple[int, int]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    along, across = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    return across - (shape[1] - 1) / 2, along - (shape[0] - 1) / 2


def _either(rng: np.random.Generator) -> float:
    return float(2 * rng.integers(2) - 1)
