"""What a detector is: it prepares a page, and what it prepared inspects scans of that page.

Whoever meets ``Detector`` and ``PreparedPage`` is used by `inspect`, `watch`, the journal and the studies like those
that come with Prooflight. ``StationDetector`` and ``PreparedOnly`` leave ``prepare`` and ``inspect`` to write.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Protocol, Self, runtime_checkable

import numpy as np

from prooflight.errors import RequestError
from prooflight.prediction.predict import predict
from prooflight.scans.placement import IN_PLACE
from prooflight.shown import Shown

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from PIL.Image import Image

    from prooflight.detectors.cost import RunningCosts
    from prooflight.detectors.verdict import Decision, Region, Verdict
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zone import PageZones
    from prooflight.prediction.predict import Prediction
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.placement import Placement
    from prooflight.scans.scan import Scan

Area = tuple[slice, slice]
"""Lines and columns of a scan."""
LAMP_WAVES: Final = 6
"""Of the lamp over the field: cosines of so many half waves."""
BLOCK_PIXELS: Final = 8
"""Side of the squares whose means pictures show."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Station:
    """What a detector needs to know of the press that it looks at."""

    name: str
    sensors: tuple[SensorModel, ...]
    geometry: ScanGeometry
    costs: RunningCosts
    fringes: bool = False
    """Whether planes that share edges are followed where their fringes show them."""
    floor_share: float = 0.0
    """Difference from the expected light, as a share of paper white, that is a misprint in flat places; 0: none is."""
    threads: int | None = None
    """That one page may take; None: one a core."""

    def predict(self, page: Page, placement: Placement = IN_PLACE) -> Prediction:
        """The lines that the camera must see of a page where it lies."""
        sensors, geometry = self.sensors, self.geometry
        return predict(page, sensors=sensors, geometry=geometry, placement=placement, threads=self.threads)


class PlannedPage:
    """A page as it is to enter the press."""

    def __init__(self, page: Page, station: Station, zones: PageZones | None = None) -> None:
        self.page, self.station, self.zones = page, station, zones

    @cached_property
    def expected(self) -> Prediction:
        """The lines that the camera must see of it in its place; made when first asked for."""
        return self.station.predict(self.page)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PrintState:
    """What one print did as good ones do, for the run's control charts."""

    amounts: Mapping[str, float] = field(default_factory=dict)
    """By channel of ``line.monitor.channels``."""
    excess: NDArray[np.floating] = field(default_factory=lambda: np.zeros((1, 0)))
    """(parts, columns) light of narrow columns over what was expected, in parts of the page's height."""
    light: NDArray[np.floating] = field(default_factory=lambda: np.zeros((1, 0)))
    """(parts, columns) light that was expected there."""
    pitch_mm: float = 1.0
    """Of the columns."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inspection(Shown):
    """A verdict and what it rests on; arrays cover the page's area of the scan."""

    verdict: Verdict
    placement: Placement
    """Where the page lies."""
    area: Area
    """Lines and columns of the scan that were judged."""
    measured_dn: NDArray[np.uint16]
    """(sensors, lines, columns) [DN]"""
    block_z: NDArray[np.float32]
    """(sensors or 1, block rows, block columns) how far squares of 8 x 8 pixels are lighter than they should be, in
    standard deviations of good prints."""
    expect: Callable[[], Prediction]
    """Of the area of the page as it lies; made when asked for, where the detector itself did without."""
    kept: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """By which ``Detector.decided_again`` comes to the same decision."""
    state: Callable[[], PrintState] = PrintState
    """What the run's control charts take from it."""
    summary: NDArray[np.float64] | None = None
    """By which ``RunTest`` ranks the page, (groups,); None: it shows another page, or its detector has no such test."""
    variation: Callable[[], NDArray[np.float32]] | None = None
    """What the page tells of how good prints vary (``matched_filter.variation``); None: its detector does not say."""
    planned: PlannedPage | None = None
    """The page as it entered the press; None: a detector was asked without an ``Inspector``, which puts it here."""

    @property
    def regions(self) -> tuple[Region, ...]:
        """Places on the page that differ from what was expected, the worst first; none on a good page."""
        return self.verdict.regions

    def picture(self) -> Image:
        """What was expected, what the camera saw and where they differ, side by side, with the regions.

        RequestError: it is of no ``Inspector``, and nothing says where its pixels lie.
        """
        return Shown.renderer().picture(self)


class PreparedPage(Protocol):
    """A page, with all that its detector can know of it ahead of its scans."""

    def inspect(self, scan: Scan, *, seed: int = 0) -> Inspection:
        """Find the page in a scan, compare, decide.

        The scan is of the press's camera and holds no more lines than its page's (``inspection.inspector``). seed: of
        whatever is drawn at random. Called from several threads at once.
        """
        ...

    def under(self, station: Station) -> PreparedPage | None:
        """The same where only the light of the press has changed a little; None: it has to be prepared again."""
        ...


class Detector(Protocol):
    """Says of pages whether they are misprints; small and picklable."""

    @property
    def name(self) -> str:
        """By which users ask for it."""
        ...

    @property
    def promise(self) -> str:
        """How rarely a good page alarms, and on what that rests, in words."""
        ...

    @property
    def station(self) -> Station:
        """The press that it looks at."""
        ...

    def prepare(self, planned: PlannedPage) -> PreparedPage:
        """All that needs no scan."""
        ...

    def at(self, station: Station) -> Self:
        """The same detector where the press, or the number of threads, has changed a little."""
        ...

    def decided_again(self, kept: KeptArrays) -> Decision:
        """The decision that ``Inspection.kept`` led to; RequestError: it is none of this detector's."""
        ...


class RunTest(Protocol):
    """Whether the pages of one run are like those that the detector's promise rests on."""

    def add(self, summary: NDArray[np.float64]) -> None:
        """The next page of the run, ``Inspection.summary``."""
        ...

    @property
    def suspended(self) -> bool:
        """Whether the pages were ever too unlike for the promise to hold."""
        ...

    @property
    def strangest(self) -> str:
        """In what they are most unlike, in words."""
        ...

    @property
    def remedy(self) -> str:
        """What a person can do about it, in words."""
        ...


@runtime_checkable
class ChecksRuns(Protocol):
    """A detector that knows the good pages of its press, and says when a run's are not like them."""

    def run_test(self, *, seed: int) -> RunTest | None:
        """Before a run's first page; seed: of what is drawn at random."""
        ...


@runtime_checkable
class MadeReadyInTwo(Protocol):
    """A prepared page of which some is made when first needed, or before where many scans of it will come."""

    def complete(self) -> None:
        """Make the rest."""
        ...


@runtime_checkable
class LeavesLostLinesOut(Protocol):
    """A prepared page that asks nothing of lines that nobody saw (``Scan.unseen``).

    Any other is given a scan with its page's own prediction in their place (``inspection.lost_lines``).
    """

    @property
    def leaves_lost_lines_out(self) -> bool:
        """Whether it does."""
        ...


class PreparedOnly:
    """A prepared page that cannot follow the light: it is prepared again."""

    def under(self, station: Station) -> PreparedPage | None:
        """See ``PreparedPage``."""
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class StationDetector:
    """What detectors have in common that know their press by its station alone."""

    station: Station

    def at(self, station: Station) -> Self:
        """See ``Detector``."""
        return replace(self, station=station)

    def decided_again(self, kept: KeptArrays) -> Decision:
        """See ``Detector``; a detector that keeps nothing decides nothing again."""
        raise kept.refusal("holds nothing to decide by")


@dataclass(frozen=True, slots=True)
class KeptArrays:
    """Kept evidence, of which every array is checked before a detector sees it."""

    kept: Mapping[str, NDArray[Any]]
    detector: str

    @property
    def wrong_page(self) -> bool:
        """Whether the scan showed another page."""
        return bool(self.array("wrong_page", "b", ()))

    def array(
        self, name: str, kinds: str, shape: tuple[int | None, ...], *, finite: bool = False
    ) -> NDArray[Any]:
        """One array; kinds of its numbers, its shape, None where any size above 0 will do. RequestError."""
        if name not in self.kept:
            raise self.refusal(f"does not hold {name!r}")
        array = np.asarray(self.kept[name])
        fits = len(array.shape) == len(shape) and all(
            size == wanted or (wanted is None and size)
            for size, wanted in zip(array.shape, shape, strict=True)
        )
        if not fits or array.dtype.kind not in kinds or (finite and not np.isfinite(array).all()):
            raise self.refusal(f"holds {name!r} of {array.dtype} {array.shape} that cannot be of its page")
        return array

    def refusal(self, what: str) -> RequestError:
        """Says why the evidence cannot be judged."""
        what = f"{what}, which {self.detector} looks at"
        return RequestError("evidence", what, remedy="only what the run kept can be replayed")
