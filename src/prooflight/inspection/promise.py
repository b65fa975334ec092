"""Whether the detector's promise stands for a run's pages, page after page in the order of the run."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Self

from prooflight.detectors.base import ChecksRuns
from prooflight.inspection.common_cause import CommonCause

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.detectors.base import Detector, Inspection, RunTest
    from prooflight.detectors.verdict import Verdict
    from prooflight.pages.warnings import PageWarning

SUSPENDED: Final = (
    "this press's good pages are not like those that the promise rests on (most of all: {}): the promised "
    "false-alarm rate does not hold; {}"
)
MISPRINTS: Final = (
    "{}: look for the cause on the press; how many alarms of this run are false is not promised"
)
"""Where alarms have a kind and a place in common: such sheets teach a press nothing good."""


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One page's verdict, and what it adds to its run."""

    verdict: Verdict
    summary: NDArray[np.float64] | None = None
    """``summary_of``."""
    warnings: tuple[PageWarning, ...] = ()
    """Of its page."""


def summary_of(inspection: Inspection) -> NDArray[np.float64] | None:
    """What an inspected page says of its run; None: it was not inspected, or says nothing.

    A misprint by its verdict says as much as a good page: pages left out for what they say are not exchangeable.
    """
    return None if inspection.verdict.verdict == "not-inspected" else inspection.summary


@dataclass(slots=True, kw_only=True)
class PromiseWatch:
    """Adds up what the pages of one run say, until they say that the promise does not hold; that is final."""

    test: RunTest | None = None
    """None: the detector has none, or it has said all that it can."""
    unlike: str = ""
    """In what the run's pages are not like the press's own, and what is to be done; empty: nothing says so."""
    seen: set[int] = field(default_factory=set)
    """Designs of which a sheet came."""
    cause: CommonCause = field(default_factory=CommonCause)
    """Counts the run's alarms by kind and place."""

    @classmethod
    def of(cls, detector: Detector, *, seed: int = 0) -> Self:
        """Before the run's first page. seed: of what the test draws at random."""
        return cls(test=detector.run_test(seed=seed) if isinstance(detector, ChecksRuns) else None)

    @property
    def suspended(self) -> str:
        """Why the promise does not hold, in one line, and what is to be done; empty: nothing says so."""
        if not self.unlike:
            return ""
        return MISPRINTS.format(self.cause.in_words) if self.cause.in_words else self.unlike

    def add(self, verdict: Verdict, summary: NDArray[np.float64] | None, design: int) -> bool:
        """The next page of the run; whether the promise is suspended by it, which happens once.

        Of each design the first sheet counts: copies of one are not exchangeable with pages of many.
        """
        self.cause.add(verdict)
        if self.test is None or summary is None or design in self.seen:
            return False
        self.seen.add(design)
        self.test.add(summary)
        if not self.test.suspended:
            return False
        self.unlike = SUSPENDED.format(self.test.strangest, self.test.remedy)
        self.test = None
        return True

    def marked(self, verdict: Verdict) -> Verdict:
        """The verdict on the page that came last, or on one behind it."""
        return replace(verdict, promise_suspended=True) if self.unlike else verdict
