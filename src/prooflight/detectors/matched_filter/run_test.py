"""``RunTest`` of the matched-filter detector: ``ExchangeabilityTest`` with random numbers and wording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from prooflight.detectors.matched_filter.exchangeability import ExchangeabilityTest
from prooflight.detectors.matched_filter.naming import family_text
from prooflight.rng import stream

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector


PAGES_TO_LEARN: Final = 40
"""Number of good pages that a person is asked to inspect. (assumed: what a person inspects in one session)"""
TRAINING_REMEDY: Final = (
    f"look at {PAGES_TO_LEARN} good pages and run `prooflight press learn X.press JOB SCANS --good`"
)
FEEDBACK_REMEDY: Final = (
    "watch runs with --sample, say what their sheets were, and run `prooflight press recalibrate`"
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressRunTest:
    """Test of one run of a press; see ``RunTest``."""

    test: ExchangeabilityTest
    rng: np.random.Generator
    remedy: str = TRAINING_REMEDY
    """See ``RunTest``."""

    @classmethod
    def of(cls, detector: CalibratedDetector, *, seed: int) -> Self:
        """Start the test of a run."""
        rng = stream(seed, "exchangeability-ties")
        if detector.told:
            return cls(
                test=ExchangeabilityTest.of_labelled(detector.told[-1], rng), rng=rng, remedy=FEEDBACK_REMEDY
            )
        return cls(test=ExchangeabilityTest.of(detector), rng=rng)

    def add(self, summary: NDArray[np.float64]) -> None:
        """See ``RunTest``."""
        self.test.add(summary, self.rng)

    @property
    def suspended(self) -> bool:
        """See ``RunTest``."""
        return self.test.suspended

    @property
    def strangest(self) -> str:
        """See ``RunTest``."""
        return family_text(self.test.strangest) or "their scores"
