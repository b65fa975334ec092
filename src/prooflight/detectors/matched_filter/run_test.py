"""Our detector's ``RunTest``: ``ExchangeabilityTest`` of one run, with its random numbers and its words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from prooflight.detectors.matched_filter.exchangeability import ExchangeabilityTest
from prooflight.detectors.matched_filter.naming import family_in_words
from prooflight.rng import stream

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressRunTest:
    """Of one run of a press; see ``RunTest``."""

    test: ExchangeabilityTest
    rng: np.random.Generator

    @classmethod
    def of(cls, ours: CalibratedDetector, *, seed: int) -> Self:
        """Before the run's first page."""
        return cls(test=ExchangeabilityTest.of(ours), rng=stream(seed, "exchangeability-ties"))

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
        return family_in_words(self.test.strangest) or self.test.strangest
