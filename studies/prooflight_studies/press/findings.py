"""What the press study is to do, and what it found."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from prooflight_studies.harness.protocol import Day, in_days
from prooflight_studies.press.judging import TREES

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from prooflight_studies.harness.result_cache import Rows
    from prooflight_studies.press.judging import Kept, MethodResult, Verdicts


FIRST: Final[Mapping[str, int]] = {
    "pilot": 0,
    "designs": 30,
    "looser": 1530,
    "promise": 2060,
    "teaching": 7060,
    "learning": 7560,
    "trial": 12_000,
    "ideal_pilot": 20_000,
    "ideal": 20_030,
}
"""Number of each scene's first design: apart, so that one may grow and leave the others as they are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PressPlan:
    """How many designs; each is printed once well and so often wrong, the pilot's and the looser press's never."""

    seed: int
    pilot: int = 30
    """They teach how statistics scatter."""
    designs: int = 1500
    """Judged, each part by what others taught."""
    misprints: int = 1
    """Of each design that is judged: designs tell more than copies."""
    teaching: int = 500
    """Designs that teach every part beside other parts' designs ..."""
    teaching_misprints: int = 3
    """... and are printed so often wrong: a kind is learned from its own misprints."""
    learning: int = 2000
    """Designs printed once, well, that teach every part as well: what good pages do is learned from many."""
    looser_known: int = 200
    """Good pages that are learned from a press that varies more than was assumed."""
    looser: int = 150
    """Good pages of that press that are judged."""
    ideal: int = 400
    """Designs of the ideal world, each printed wrong twice."""
    promise: int = 5000
    """Designs printed once, well, that only set the thresholds of promises."""
    trial: int = 5000
    """Designs printed once, well, on which promises are tried: so rare a false alarm is seen only among many."""
    per_day: int = 10
    """Designs printed on one press day; there must be five days to cut into parts."""
    trees: int = TREES
    ablations: bool = True

    def __post_init__(self) -> None:
        for (name, first), (_, next_first) in pairwise(FIRST.items()):
            if first + self.count(name) > next_first:
                raise ValueError(f"{name}: there are {next_first - first} designs, not {self.count(name)}")

    @classmethod
    def quick(cls, seed: int) -> PressPlan:
        """To see that all of it works."""
        return cls(
            seed=seed,
            pilot=6,
            designs=60,
            teaching=8,
            learning=16,
            looser_known=12,
            looser=6,
            ideal=20,
            promise=24,
            trial=16,
            per_day=4,
            trees=40,
            ablations=False,
        )

    @property
    def calibration(self) -> dict[float, int]:
        """Designs of ``promise`` by the rate that they are to promise; fewer promise what their number allows."""
        counts = {0.01: min(1500, self.promise), 0.001: self.promise}
        return {max(rate, 1.01 / (count + 1)): count for rate, count in counts.items()}

    def count(self, scene: str) -> int:
        """Designs of a scene of ``FIRST``."""
        if scene == "ideal_pilot":
            return self.pilot
        return self.looser_known + self.looser if scene == "looser" else int(getattr(self, scene))

    def days_of(self, scene: str) -> list[Day]:
        """Press days on which the designs of a scene of ``FIRST`` are printed."""
        return self.days(FIRST[scene], self.count(scene))

    def days(self, first: int, count: int) -> list[Day]:
        """Press days on which designs ``first`` and further are printed."""
        return in_days("test", range(first, first + count), self.per_day)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressFindings:
    """All that the page of results says."""

    plan: PressPlan
    pitch_mm: float
    fringes: bool
    """``Press.fringes``."""
    main: Rows
    verdicts: Verdicts
    kept: list[Kept]
    """Promises that designs of their own made, as they came on the judged designs ..."""
    tried: list[Kept]
    """... and on further good designs."""
    looser: dict[str, NDArray[np.bool_]]
    """Whether each good page of the looser press alarmed, by what the threshold rests on."""
    ideal: Verdicts
    real: MethodResult | None
    """On real pages; None: there were none."""

    @property
    def page(self) -> str:
        """Name of the page of results."""
        return "press.md" if self.fringes else "press-without-fringes.md"
