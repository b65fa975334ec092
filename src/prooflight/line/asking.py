"""Of which sheets a person is asked for a word: every alarm, and a random sample of those that passed.

Words on alarms alone say nothing of the misprints that passed, and nothing of how many good sheets there were. A sample
of known probability says both, by the reciprocal of that probability (Horvitz and Thompson 1952).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.rng import stream

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Asking:
    """Of one run."""

    sample: float = 0.0
    """Probability with which a sheet that passed is drawn. [-]"""
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.sample <= 1:
            message = f"sample must be 0 to 1, got {self.sample}"
            raise ValueError(message)

    def probability(self, verdict: Verdict, sheet: int) -> float | None:
        """With which a sheet was drawn; None: it was not. The same whenever and by whomever it is asked.

        A sheet that was not inspected has passed nothing: it is never asked.
        """
        if verdict.verdict == "misprint":
            return 1.0
        if verdict.verdict != "good" or not self.sample:
            return None
        return self.sample if stream(self.seed, "asked-sheets", sheet).random() < self.sample else None
