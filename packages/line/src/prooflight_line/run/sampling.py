"""Selection of the sheets that a person is asked to label: every alarm, and a random sample of the others.

Labels of alarms alone tell neither how many misprints passed nor how many sheets were good. A sample whose
inclusion probability is known estimates both, by weighting with the reciprocal of that probability (Horvitz and
Thompson 1952).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.rng import stream

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampling:
    """Sampling design of one run: which of its sheets are reviewed by a person."""

    sample: float = 0.0
    """Probability that a sheet that passed is sampled for review. [-]"""
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.sample <= 1:
            message = f"sample must be 0 to 1, got {self.sample}"
            raise ValueError(message)

    def probability(self, verdict: Verdict, sheet: int) -> float | None:
        """Return the probability with which a sheet was sampled for review, or None if it was not.

        The draw depends only on the seed and the sheet's number, so that every process and every later call
        agree. A sheet that was not inspected has no verdict to review and is never sampled.
        """
        if verdict.verdict == "misprint":
            return 1.0
        if verdict.verdict != "good" or not self.sample:
            return None
        return self.sample if stream(self.seed, "asked-sheets", sheet).random() < self.sample else None
