"""Figures compared with frozen ones: numbers in units of their scale, regions by overlap, words letter by letter.

A processor, its vector units and the number of threads decide in which order numbers are added, so their last bits
differ. ``spread.json`` holds how far each figure moved between the runs of ``tests.frozen.runs``; a figure may move by
``MARGIN`` times as much. Words and regions are compared where none of these runs decided otherwise, nor one on a press
whose columns were moved by a hundred times what single precision rounds to.
"""

from __future__ import annotations

import json
import math
import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

Box = tuple[float, float, float, float]

SPREAD = Path(__file__).with_name("spread.json")
MARGIN = 10.0
"""By which measured spreads are multiplied: the processors that were imitated are not all that there are."""
LEAST = 1e-3
"""Tolerance that every number has, as a share of its scale: sums of a million terms, and fits that go on from them."""
LEAST_OF_SUMS = 1e-5
"""The same of sums with random signs, as a share of their array's norm: single precision."""
LEAST_OF_REGIONS = 0.2
"""The same of regions, 1 less their overlap: a verdict rounds sides to 0.01 mm, and glyphs are 0.4 mm wide."""
LEAST_OF_ROUNDED = {"gain_percent": 0.02, "dot_gain_percent": 0.02, "shift_mm": 0.0002, "area": 1.0}
"""The same of figures that a verdict rounds, in their own units: two of their last digits, and one pixel."""
LEARNED = 0.002
"""Spread that is taken for granted where a detector is taught on this processor, which makes more of last bits: so far
were thresholds and scores apart on real processors with and without AVX-512. [share of the scale]"""
FLIPS = 8.0
"""What counts and digital numbers may add to a sum with signs: a value on the edge of a bin adds 2 when it is moved."""


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """How far one figure is from the frozen one."""

    path: str
    amount: float
    """Share of the figure's scale; of regions 1 less the least overlap; infinite where words or shapes differ."""
    least: float
    """Tolerance that the figure has at least, in the same unit."""
    found: Any
    frozen: Any

    @property
    def name(self) -> str:
        """The figure's name within its case, without the print that it belongs to."""
        return "/".join(re.sub(r"\[\d+\]", "", self.path).split("/")[-2:])

    def __str__(self) -> str:
        return f"{self.path}: {self.found!r} instead of {self.frozen!r} ({self.amount:.2g})"


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How far the figures of one case moved between runs."""

    numbers: dict[str, float]
    """By the names of ``Deviation``."""
    open: frozenset[str]
    """Paths of words and regions that another processor may decide otherwise; they are not compared."""
    least: float = 0.0
    """Spread of every number that moved less."""

    @classmethod
    def of(cls, processors: Iterable[Any], shaken: Iterable[Any], frozen: Any) -> Self:
        """From a case's figures on several processors, and on shaken presses, of which numbers do not count."""
        numbers: dict[str, float] = defaultdict(float)
        undecided = set()
        for counts, runs in ((True, processors), (False, shaken)):
            for one in (one for figures in runs for one in deviations(figures, frozen)):
                if math.isinf(one.amount):
                    undecided.add(one.path)
                elif counts and one.least > 0:  # words have none
                    numbers[one.name] = max(numbers[one.name], one.amount)
        return cls(numbers=dict(numbers), open=frozenset(undecided))

    @classmethod
    def read(cls, case: str, *, least: float = 0.0) -> Self:
        """As measured for a case."""
        kept = json.loads(SPREAD.read_text(encoding="utf-8"))["cases"][case]
        return cls(numbers=kept["numbers"], open=frozenset(kept["open"]), least=least)

    def rounded(self) -> dict[str, Any]:
        """As ``read`` takes it."""
        numbers = {name: float(f"{amount:.2g}") for name, amount in sorted(self.numbers.items())}
        return {"open": sorted(self.open), "numbers": numbers}

    def allows(self, one: Deviation) -> bool:
        """Whether another processor may have caused a deviation."""
        spread = max(self.numbers.get(one.name, 0.0), self.least)
        return one.path in self.open or one.amount <= max(one.least, MARGIN * spread)


def deviations(found: Any, frozen: Any, path: str = "") -> Iterator[Deviation]:
    """Every figure's deviation; where shapes differ, one infinite deviation of the whole."""
    name = path.rpartition("/")[2]
    if isinstance(frozen, dict) and isinstance(found, dict) and set(found) == set(frozen):
        if "norm" in frozen:
            yield from _of_array(found, frozen, path)
            return
        for key, one in frozen.items():
            yield from deviations(found[key], one, f"{path}/{key}" if path else key)
    elif name == "regions":
        yield _deviation(path, _apart(found, frozen), LEAST_OF_REGIONS, found, frozen)
    elif isinstance(frozen, list) and isinstance(found, list) and len(found) == len(frozen):
        for at, (one, other) in enumerate(zip(found, frozen, strict=True)):
            yield from deviations(one, other, f"{path}[{at}]")
    elif _is_number(frozen) and _is_number(found):
        rounded = LEAST_OF_ROUNDED.get(re.sub(r"(\[\d+\])+$", "", name))
        scale, least = (max(abs(frozen), 1.0), LEAST) if rounded is None else (1.0, rounded)
        yield _deviation(path, abs(found - frozen) / scale, least, found, frozen)
    else:
        yield _deviation(path, 0.0 if found == frozen else math.inf, 0.0, found, frozen)


def _of_array(found: dict[str, Any], frozen: dict[str, Any], path: str) -> Iterator[Deviation]:
    """Of a ``digest``, in units of the array's norm and of its root mean square."""
    norm = max(frozen["norm"], 1e-9)
    rms = norm / math.sqrt(max(math.prod(frozen["shape"]), 1))
    flips = FLIPS / norm if frozen["counts"] else 0.0
    for key, one in frozen.items():
        where, other = f"{path}/{key}" if path else key, found[key]
        if key == "sums":
            for at, (mine, its) in enumerate(zip(other, one, strict=True)):
                yield _deviation(
                    f"{where}[{at}]", abs(mine - its) / norm, max(LEAST_OF_SUMS, flips), mine, its
                )
        elif key in ("norm", "mean"):
            yield _deviation(where, abs(other - one) / (norm if key == "norm" else rms), LEAST, other, one)
        else:
            yield _deviation(where, 0.0 if other == one else math.inf, 0.0, other, one)


def _deviation(path: str, amount: float, least: float, found: Any, frozen: Any) -> Deviation:
    return Deviation(path=path, amount=amount, least=least, found=found, frozen=frozen)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _apart(found: list[dict[str, Any]], frozen: list[dict[str, Any]]) -> float:
    """1 less the least overlap of regions with their partners, in whatever order; infinite if one has no partner."""
    if len(found) != len(frozen):
        return math.inf
    left, most = list(found), 0.0
    for region in frozen:
        apart, partner = min(
            ((1 - overlap(region["box_mm"], other["box_mm"]), at) for at, other in enumerate(left)),
        )
        if apart == 1 or left.pop(partner)["kind"] != region["kind"]:
            return math.inf
        most = max(most, apart)
    return most


def overlap(one: Box, other: Box) -> float:
    """Area that two boxes (x, y, width, height) share, over the area that they cover together.

    >>> overlap((0, 0, 2, 1), (1, 0, 2, 1)), overlap((0, 0, 1, 1), (0, 0, 1, 1)), overlap((0, 0, 1, 1), (5, 0, 1, 1))
    (0.3333333333333333, 1.0, 0.0)
    """
    shared = math.prod(
        max(min(one[axis] + one[axis + 2], other[axis] + other[axis + 2]) - max(one[axis], other[axis]), 0)
        for axis in (0, 1)
    )
    both = one[2] * one[3] + other[2] * other[3] - shared
    return shared / both if both else float(one == other)
