"""The detector interface: a detector prepares a page, and the prepared page inspects scans of that page.

Any class that meets ``Detector`` and ``PreparedPage`` is used by `inspect`, `watch`, the journal and the
studies like those that come with Prooflight. ``ContextDetector`` and ``PreparedOnly`` leave ``prepare`` and
``inspect`` to write. What a detector may do besides is in ``optional``, how it is registered in ``entry``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.errors import RequestError
from prooflight.prediction.predict import Prediction, predict
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.shown import Shown

if TYPE_CHECKING:
    from PIL.Image import Image

    from prooflight.detectors.cost import RunningCosts
    from prooflight.detectors.verdict import Decision, Region, Verdict
    from prooflight.pages.pdf.area_averages import InkLight
    from prooflight.pages.raster import Page
    from prooflight.pages.screen import Screen
    from prooflight.pages.zones.zone import Kind, PageZones
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.scan import Scan

Area = tuple[slice, slice]
"""Lines and columns of a scan."""
Device = Literal["cpu", "gpu"]
"""Where a detector computes images of scans, if it can do so on a graphics card."""
LAMP_WAVES: Final = 6
"""Waves of the lamp over the field: number of cosines, the k-th of k half waves."""
BLOCK_PIXELS: Final = 8
"""Side of the squares whose means pictures show."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressContext:
    """Properties of the press that a detector needs."""

    name: str
    sensors: tuple[SensorModel, ...]
    geometry: ScanGeometry
    costs: RunningCosts
    fringes: bool = False
    """Whether planes that share edges are followed where their fringes show them."""
    floor_share: float = 0.0
    """Difference from the expected light, as a share of paper white, that is a misprint in flat places; 0:
    none is."""
    screen: tuple[Screen, InkLight] | None = None
    """Screen of the press, and the light that its tints take; None: not stated."""
    own_light: InkLight | None = None
    """Light that the inks of a press take that rips pages itself, at a stated resolution; None: it is not stated."""
    threads: int | None = None
    """Number of threads that one page may use; None: one per core."""
    device: Device = "cpu"

    def predict(self, page: Page, placement: Placement = IN_PLACE) -> Prediction:
        """Predict the lines that the camera must see of a page at its placement."""
        sensors, geometry = self.sensors, self.geometry
        return predict(page, sensors=sensors, geometry=geometry, placement=placement, threads=self.threads)


class PlannedPage:
    """A page that is to enter the press."""

    def __init__(self, page: Page, press_context: PressContext, zones: PageZones | None = None) -> None:
        self.page, self.press_context, self.zones = page, press_context, zones

    @cached_property
    def expected(self) -> Prediction:
        """The lines that the camera must see of it in its nominal place; computed at the first access."""
        return self.press_context.predict(self.page)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PrintState:
    """Variation of one print within that of good ones, for the run's control charts."""

    amounts: Mapping[str, float] = field(default_factory=dict)
    """Amounts by channel of ``run.monitor.channels``."""
    excess: NDArray[np.floating] = field(default_factory=lambda: np.zeros((1, 0)))
    """(parts, columns) light of narrow columns minus the expected light, in parts of the page's height."""
    light: NDArray[np.floating] = field(default_factory=lambda: np.zeros((1, 0)))
    """(parts, columns) light that was expected there."""
    pitch_mm: float = 1.0
    """Pitch of the columns."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inspection(Shown):
    """A verdict and its basis; arrays cover the page's area of the scan."""

    verdict: Verdict
    placement: Placement
    """Placement of the page."""
    area: Area
    """Lines and columns of the scan that were judged."""
    measured_dn: NDArray[np.uint16]
    """(sensors, lines, columns) [DN]"""
    block_z: NDArray[np.float32]
    """(sensors or 1, block rows, block columns) how far squares of 8 x 8 pixels are lighter than they should
    be, in standard deviations of good prints."""
    expect: Callable[[], Prediction]
    """Prediction of the area of the page at its placement; computed on demand, if the detector itself does
    not need it."""
    stored_arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Arrays from which ``Detector.decided_again`` repeats the decision."""
    state: Callable[[], PrintState] = PrintState
    """State of the print, for the run's control charts."""
    summary: NDArray[np.float64] | None = None
    """Summary by which ``RunTest`` ranks the page, (groups,); None: it shows another page, or its detector
    has no such test. A running press counts it where ``verdict.shift_mm`` says where the page lies."""
    variation: Callable[[], NDArray[np.float32]] | None = None
    """How good prints vary, as determined from the page; None: its detector
    does not measure it."""
    planned: PlannedPage | None = None
    """The page as it entered the press; None: a detector was called without an ``Inspector``, which sets
    it."""

    @property
    def regions(self) -> tuple[Region, ...]:
        """Places on the page that differ from what was expected, the worst first; none on a good page."""
        return self.verdict.regions

    def picture(self) -> Image:
        """Draw expected lines, measured lines and their difference side by side, with the regions.

        RequestError: no ``Inspector`` made it, so that the position of its pixels is unknown.
        """
        return Shown.renderer().picture(self)


class PreparedPage(Protocol):
    """A page, with everything that its detector can compute before its scans."""

    def inspect(self, scan: Scan, *, seed: int = 0) -> Inspection:
        """Find the page in a scan, compare, decide.

        The scan is of the press's camera and has no more lines than its page (``inspection.inspector``).
        seed: of anything that is drawn at random. Called from several threads at once.
        """
        ...

    def under(self, press_context: PressContext) -> PreparedPage | None:
        """Return the page under a slightly changed light of the press; None: it has to be prepared again."""
        ...


class Detector(Protocol):
    """A detector, which decides whether pages are misprints; small and picklable."""

    @property
    def name(self) -> str:
        """Name by which users select it."""
        ...

    @property
    def guarantee(self) -> str:
        """False-alarm rate that is guaranteed, and its basis, in words."""
        ...

    @property
    def press_context(self) -> PressContext:
        """The press that it is for."""
        ...

    def prepare(self, planned: PlannedPage) -> PreparedPage:
        """Compute everything that needs no scan."""
        ...

    @property
    def false_alarm_rate(self) -> float | None:
        """The rate that ``guarantee`` guarantees; None: none. [-]"""
        ...

    @property
    def zone_kinds(self) -> frozenset[Kind]:
        """Kinds of zones that it knows; pages with others are refused."""
        ...

    def at(self, press_context: PressContext) -> Self:
        """Return the detector for a slightly changed press, another number of threads or another device.

        RequestError: it cannot compute on that device.
        """
        ...

    def decided_again(self, stored: StoredArrays) -> Decision:
        """Repeat the decision from ``Inspection.kept``; RequestError: it is not of this detector."""
        ...


class RunTest(Protocol):
    """A test whether the pages of one run are like those that the detector's guarantee rests on."""

    def add(self, summary: NDArray[np.float64]) -> None:
        """Add the next page of the run by its ``Inspection.summary``."""
        ...

    @property
    def suspended(self) -> bool:
        """Whether the pages were ever too different for the guarantee to hold."""
        ...

    @property
    def strangest(self) -> str:
        """Property in which they differ most, in words."""
        ...

    @property
    def remedy(self) -> str:
        """What a person can do about it, in words."""
        ...


class PreparedOnly:
    """A prepared page that cannot follow the light: it is prepared again."""

    def under(self, press_context: PressContext) -> PreparedPage | None:
        """See ``PreparedPage``."""
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class ContextDetector:
    """Common part of detectors that know their press by its station alone."""

    press_context: PressContext

    @property
    def false_alarm_rate(self) -> float | None:
        """See ``Detector``; none is guaranteed."""
        return None

    @property
    def zone_kinds(self) -> frozenset[Kind]:
        """See ``Detector``; it knows no zones."""
        return frozenset()

    def at(self, press_context: PressContext) -> Self:
        """See ``Detector``; it computes on the processor alone."""
        if press_context.device != "cpu":
            what = f"{getattr(self, 'name', 'the detector')!r} computes on the processor alone"
            raise RequestError("--device gpu", what, remedy="leave it out, or inspect by the matched filter")
        return replace(self, press_context=press_context)

    def decided_again(self, stored: StoredArrays) -> Decision:
        """See ``Detector``; a detector that stores no evidence cannot repeat a decision."""
        raise stored.refusal("contains no data for a decision")


@dataclass(frozen=True, slots=True)
class StoredArrays:
    """Stored evidence, of which every array is checked before a detector uses it."""

    stored_arrays: Mapping[str, NDArray[Any]]
    detector: str

    @property
    def wrong_page(self) -> bool:
        """Whether the scan showed another page."""
        return bool(self.array("wrong_page", "b", ()))

    def array(
        self, name: str, kinds: str, shape: tuple[int | None, ...], *, finite: bool = False
    ) -> NDArray[Any]:
        """Return one array; kinds of its numbers; shape: None for any size above 0.

        RequestError: it does not fit.
        """
        if name not in self.stored_arrays:
            raise self.refusal(f"does not hold {name!r}")
        array = np.asarray(self.stored_arrays[name])
        fits = len(array.shape) == len(shape) and all(
            size == wanted or (wanted is None and size)
            for size, wanted in zip(array.shape, shape, strict=True)
        )
        if not fits or array.dtype.kind not in kinds or (finite and not np.isfinite(array).all()):
            raise self.refusal(f"holds {name!r} of {array.dtype} {array.shape} that cannot be of its page")
        return array

    def refusal(self, what: str) -> RequestError:
        """Return an error that states why the evidence cannot be judged."""
        what = f"{what}, which {self.detector} needs"
        return RequestError("evidence", what, remedy="only stored evidence can be replayed")


REMEDY: Final = "leave it out, or install prooflight[gpu] on a machine with an NVIDIA card and its driver"


def engine_name(device: Device) -> str:
    """Return the name of what computes: cpu, or gpu with the card's name and the version of its driver."""
    if device == "cpu":
        return "cpu"
    from prooflight.kernels.gpu.runners import card_name

    return f"gpu: {card_name()}"


def refuse_without_card() -> None:
    """Raise RequestError where no card can be used."""
    from prooflight.kernels.gpu.runners import lacking

    if (lacks := lacking()) is not None:
        raise RequestError("--device gpu", lacks, remedy=REMEDY)
