"""Plan and findings of the press study."""

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
    from prooflight_studies.press.judging import MethodResult, RateCheck, Verdicts


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
"""Number of each scene's first design. They are separated so that one scene may grow without changing the others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PressPlan:
    """Numbers of designs.

    Each is printed once well and ``misprints`` times wrong; those of the pilot and the looser press are never printed
    wrong.
    """

    seed: int
    pilot: int = 30
    """Number of designs from which the scatter of statistics is learned."""
    designs: int = 1500
    """Number of designs that are judged, each part by models trained on others."""
    misprints: int = 1
    """Number of misprints of each judged design; further designs are more informative than further copies."""
    teaching: int = 500
    """Number of designs on which every part is trained in addition to other parts' designs."""
    teaching_misprints: int = 3
    """Number of misprints of each of the ``teaching`` designs: a kind is learned from its own misprints."""
    learning: int = 2000
    """Number of designs printed once, well, on which every part is trained as well.

    What good pages do is learned from many.
    """
    looser_known: int = 200
    """Number of good pages that are learned from a press that varies more than was assumed."""
    looser: int = 150
    """Number of good pages of that press that are judged."""
    ideal: int = 400
    """Number of designs of the ideal world, each printed wrong twice."""
    promise: int = 5000
    """Number of designs printed once, well, that only set the thresholds of target false-alarm rates."""
    trial: int = 5000
    """Number of designs printed once, well, on which low false-alarm rates are verified: rare alarms need many."""
    per_day: int = 10
    """Number of designs printed on one press day; there must be five days to divide into parts."""
    trees: int = TREES
    ablations: bool = True

    def __post_init__(self) -> None:
        for (name, first), (_, next_first) in pairwise(FIRST.items()):
            if first + self.count(name) > next_first:
                raise ValueError(f"{name}: there are {next_first - first} designs, not {self.count(name)}")

    @classmethod
    def quick(cls, seed: int) -> PressPlan:
        """Return a small plan that exercises the whole study."""
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
        """Number of ``promise`` designs by target false-alarm rate.

        With fewer designs the rates are those that their number allows.
        """
        counts = {0.01: min(1500, self.promise), 0.001: self.promise}
        return {max(rate, 1.01 / (count + 1)): count for rate, count in counts.items()}

    def count(self, scene: str) -> int:
        """Return the number of designs of a scene of ``FIRST``."""
        if scene == "ideal_pilot":
            return self.pilot
        return self.looser_known + self.looser if scene == "looser" else int(getattr(self, scene))

    def days_of(self, scene: str) -> list[Day]:
        """Return the press days on which the designs of a scene of ``FIRST`` are printed."""
        return self.days(FIRST[scene], self.count(scene))

    def days(self, first: int, count: int) -> list[Day]:
        """Return the press days on which ``count`` designs from ``first`` on are printed."""
        return in_days("test", range(first, first + count), self.per_day)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressFindings:
    """All data from which the page of results is written."""

    plan: PressPlan
    pitch_mm: float
    fringes: bool
    """``Press.fringes``."""
    main: Rows
    verdicts: Verdicts
    kept: list[RateCheck]
    """Target false-alarm rates with thresholds set by separate designs, and the alarms on the judged designs."""
    tried: list[RateCheck]
    """The same thresholds, and the alarms on further good designs."""
    looser: dict[str, NDArray[np.bool_]]
    """Whether each good page of the looser press alarmed, by the data that set the threshold."""
    ideal: Verdicts
    real: MethodResult | None
    """Result on real pages; None: there were none."""

    @property
    def page(self) -> str:
        """File name of the page of results."""
        return "press.md" if self.fringes else "press-without-fringes.md"
