"""Sequential test of whether the detector's false-alarm rate holds for a run's pages, in the order of the run."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, Self

from prooflight.detectors.optional import ChecksRuns
from prooflight.inspection.common_cause import CommonCause

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.detectors.base import Detector, Inspection, RunTest
    from prooflight.detectors.verdict import Verdict
    from prooflight.pages.warnings import PageWarning

SUSPENDED: Final = (
    "this press's good pages differ from those that the promise is based on (most of all: {}): the promised "
    "false-alarm rate does not hold; {}"
)
MISPRINTS: Final = "{}: look for the cause on the press; the false-alarm rate of this run is not promised"
"""Message where alarms have a kind and a place in common: such sheets are no good pages to train a press on."""


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One page's verdict, and its contribution to its run."""

    verdict: Verdict
    summary: NDArray[np.float64] | None = None
    """Summary of the page, by ``summary_of``."""
    warnings: tuple[PageWarning, ...] = ()
    """Warnings of its page."""


def summary_of(inspection: Inspection) -> NDArray[np.float64] | None:
    """Return an inspected page's summary for the test of its run; None: it was not inspected, or gives none.

    A misprint by its verdict counts like a good page: pages chosen by their own values are not exchangeable.
    """
    return None if inspection.verdict.verdict == "not-inspected" else inspection.summary


@dataclass(slots=True, kw_only=True)
class GuaranteeMonitor:
    """Test of one run's pages, until it shows that the false-alarm rate does not hold; that is final."""

    test: RunTest | None = None
    """Test of the run; None: the detector has none, or it has ended."""
    unlike: str = ""
    """Difference of the run's pages from the press's own, and the remedy; empty: none is shown."""
    seen: set[Hashable] = field(default_factory=set)
    """Keys of designs of which a sheet came."""
    cause: CommonCause = field(default_factory=CommonCause)
    """Counter of the run's alarms by kind and place."""

    @classmethod
    def of(cls, detector: Detector, *, seed: int = 0) -> Self:
        """Create the test before the run's first page. seed: of the test's random draws."""
        return cls(test=detector.run_test(seed=seed) if isinstance(detector, ChecksRuns) else None)

    @property
    def suspended(self) -> str:
        """Return why the false-alarm rate does not hold, in one line with the remedy.

        An empty text means that nothing shows it.
        """
        if not self.unlike:
            return ""
        return MISPRINTS.format(self.cause.description) if self.cause.description else self.unlike

    def resume(self, designs: Iterable[Hashable], suspended: str) -> None:
        """Continue the test of a run whose first part was watched by a process that has ended.

        ``designs`` came in that part, and do not count again. ``suspended`` is what it reported of the guarantee.
        """
        self.seen.update(designs)
        if suspended:
            self.unlike, self.test = suspended, None

    def add(self, verdict: Verdict, summary: NDArray[np.float64] | None, design: Hashable) -> bool:
        """Add the next page of the run; return whether it suspends the guarantee, which happens once.

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
        """Mark the verdict on the page that came last, or on one after it."""
        return replace(verdict, promise_suspended=True) if self.unlike else verdict
