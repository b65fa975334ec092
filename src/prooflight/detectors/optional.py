"""What detectors, their models and prepared pages may do besides ``detectors.base``: ask by ``isinstance``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self, runtime_checkable

from prooflight.detectors.entry import TrainedModel

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.detectors.base import Detector, Inspection, PlannedPage, PreparedPage, RunTest
    from prooflight.detectors.cost import RunningCosts
    from prooflight.detectors.false_alarm_rate import Guarantee
    from prooflight.detectors.print_prior import PrintPrior
    from prooflight.detectors.verdict import Verdict
    from prooflight.detectors.visible_marks import VisibleMarks
    from prooflight.detectors.weighted_conformal import LabelledPages
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zone import Calibration
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.scan import Scan


# --- models ---


@runtime_checkable
class Recalibrates(TrainedModel, Protocol):
    """A model whose threshold can be set again by pages that people labelled."""

    @property
    def guarantee(self) -> Guarantee:
        """False-alarm rate that is guaranteed."""
        ...

    @property
    def threshold(self) -> float:
        """Score above which a page alarms."""
        ...

    @property
    def recalibrations(self) -> tuple[LabelledPages, ...]:
        """Labelled pages of each recalibration, of which the last applies."""
        ...

    def recalibrated(self, labelled: LabelledPages) -> Self:
        """Return the model with the threshold of labelled pages; RequestError: they are too few."""
        ...

    def before_recalibration(self) -> Self | None:
        """Return the model that ``recalibrated`` was applied to; None: it never was."""
        ...


@runtime_checkable
class FollowsCosts(TrainedModel, Protocol):
    """A model whose threshold follows from the costs of errors."""

    def at_costs(self, costs: RunningCosts) -> Self:
        """Return the model with the threshold of these costs."""
        ...


@runtime_checkable
class StatesPrintPrior(Protocol):
    """A model that states how the press's good prints vary."""

    @property
    def print_prior(self) -> PrintPrior:
        """Their variation."""
        ...


@runtime_checkable
class StatesTrials(Protocol):
    """A model that was tried on misprints when it was trained."""

    @property
    def trials(self) -> str:
        """The result, in one line."""
        ...


# --- detectors ---


@runtime_checkable
class ChecksRuns(Protocol):
    """A detector that stores the good pages of its press, and detects when a run's are not like them."""

    def run_test(self, *, seed: int) -> RunTest | None:
        """Start the test of a run; seed: of what is drawn at random."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScannedPage:
    """A real good page of a press, as its scan shows it to a detector that learns."""

    name: str
    score: float
    evidence: Mapping[str, NDArray[Any]]
    """``Inspection.kept``."""
    digest: str
    """Digest of the scan."""
    variation: NDArray[np.float32]
    """``Inspection.variation``."""
    design: str = ""
    """Digest of the page's raster, which copies of a page share; empty: not computed."""

    @property
    def another(self) -> bool:
        """Whether the scan shows another page."""
        return bool(self.evidence["wrong_page"])


@runtime_checkable
class LearnsPages(Protocol):
    """A detector whose model is fitted again to real good pages of its press."""

    def for_learning(self) -> Detector:
        """Return the detector with all that learning needs in ``Inspection.kept``; verdicts are the same."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoodPrint:
    """Scores of one good print of a page with zones."""

    number: int
    """Number of its page."""
    before: float
    """Score without zones."""
    after: float
    """Score of the page as a whole without ignored areas."""
    careful: NDArray[np.float32] | None
    """Statistics (statistics,) of careful areas; None: the page has no careful area."""


class ZonePricing(Protocol):
    """Calibration of zones by good prints of the pages that have them."""

    @property
    def rate(self) -> float:
        """False-alarm rate that a page as a whole and its careful areas share. [-]"""
        ...

    def fewest_prints(self, careful_share: float) -> int:
        """Return the number of good prints that most likely suffices.

        careful_share: share of the pages that have a careful area.
        """
        ...

    def score(self, inspection: Inspection) -> float:
        """Return the score of an inspected page as a whole, without careful areas."""
        ...

    def alarms(self, score: float) -> bool:
        """Return whether a page without zones alarms by its score."""
        ...

    def calibration(self, prints: Sequence[GoodPrint]) -> Calibration:
        """Return the calibration of zones by these prints; RequestError: they are too few."""
        ...

    def alarmed(
        self, prints: Sequence[GoodPrint], calibration: Calibration, share: float
    ) -> tuple[list[tuple[GoodPrint, bool]], float]:
        """Return the prints that calibrate, whether each alarms when the others judge it, and the careful areas' rate.

        share: part of ``rate`` that careful areas may use. RequestError: the prints are too few.
        """
        ...


@runtime_checkable
class PricesZones(Protocol):
    """A detector whose zones are calibrated by good prints, so that they have a price."""

    @property
    def zone_pricing(self) -> ZonePricing:
        """Their calibration."""
        ...


@runtime_checkable
class ShowsVisibleMarks(Protocol):
    """A detector that states ahead of a page's print which marks it would catch."""

    def visible_marks(self, planned: PlannedPage) -> VisibleMarks:
        """Return the smallest spot and the narrowest hair that alarm at each place of a page."""
        ...

    def visible_on_tint(self, black: float) -> tuple[float, float]:
        """Return the smallest spot and the narrowest hair that alarm on a large tint of ``black`` ink. [mm]"""
        ...


@runtime_checkable
class StoresPages(Protocol):
    """A detector whose prepared pages can be written to a file and read again."""

    def stored(self, page: PreparedPage) -> tuple[Any, Mapping[str, Sequence[SensorModel]]]:
        """Return what is pickled of a page, and by kind the sensors in it that the press holds."""
        ...

    def shared_sensors(self) -> Mapping[str, Sequence[SensorModel]]:
        """Return the sensors that the press holds, by kind: those that take the place of a stored page's."""
        ...

    def restored(self, stored: Any) -> PreparedPage:
        """Return the page of which ``stored`` returned this."""
        ...


# --- prepared pages ---


@runtime_checkable
class PacksArrays(Protocol):
    """A prepared page that is kept with its large arrays packed, and written out for each scan."""

    @property
    def of_press(self) -> object:
        """Parts of it that all pages of a press share, whose memory is not the page's."""
        ...

    def without_arrays(self) -> tuple[PreparedPage, Mapping[str, NDArray[Any]]]:
        """Return the page without raster and other large arrays, and the others by name; none: it stays as it is."""
        ...

    def with_arrays(self, page: Page, arrays: Mapping[str, NDArray[Any]]) -> PreparedPage:
        """Return the page of which ``without_arrays`` returned these; page: its raster."""
        ...


@runtime_checkable
class DecidesFirst(Protocol):
    """A prepared page whose misprints are known before they are explained, which takes twice as long."""

    def decide_and_explain(self, scan: Scan, *, decided: Callable[[Verdict], None]) -> Inspection:
        """Inspect as ``PreparedPage.inspect``; of a misprint, ``decided`` gets an unexplained verdict first."""
        ...


@runtime_checkable
class LeavesLostLinesOut(Protocol):
    """A prepared page that does not use missing lines (``Scan.unseen``).

    Any other is given a scan with its page's own prediction in their place (``inspection.lost_lines``).
    """

    @property
    def leaves_lost_lines_out(self) -> bool:
        """Whether it does not use them."""
        ...
