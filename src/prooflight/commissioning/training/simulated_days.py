"""Prints of a press that has not printed yet: designs on simulated press days, looked at as its scans will be."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from prooflight.detectors.matched_filter.analysis import analyse, prepare_page
from prooflight.detectors.matched_filter.fit.nuisance import PrintPrior, ResidualVariance
from prooflight.detectors.matched_filter.statistics.families import all_statistics, samples
from prooflight.detectors.matched_filter.statistics.local_evidence import assumed_light
from prooflight.detectors.matched_filter.statistics.statistic import keys_of, values_of
from prooflight.detectors.paper.bayes import window_statistics, window_unit
from prooflight.detectors.paper.detector import page_evidence
from prooflight.detectors.placing import shows_another
from prooflight.rng import stream
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.worlds import Amounts, amounts_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.analysis import PreparedPage, ScanAnalysis
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
    from prooflight.detectors.matched_filter.statistics.statistic import Observed
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.simulation.captures import Printed
    from prooflight.simulation.corpus.corpus import Designs

    Rows = dict[str, NDArray[Any]]

DESIGNS_A_DAY: Final = 4
"""assumed: few, since days differ by more than prints of a day do."""
LONGEST: Final = 1.45
"""Height over width at which a page that is cut to the field is cut off: A4's and a little."""
LEAST_TIMES: Final = 0.2
"""assumed: that much is found of what good prints do even where they do none of it."""

FOLLOWS: Final = {
    "white": ("camera.table_gain_percent", "paper.white_channel_percent"),
    "common": ("paper.white_percent",),
    "lamp": ("lamp.profile_percent", "lamp.profile_print_percent"),
    "shape": ("camera.table_shape_percent",),
    "gain": ("ink.gain_session_percent", "ink.gain_print_percent"),
    "tilt": ("ink.gain_tilt_percent",),
    "dot": ("ink.dot_gain_percent",),
    "plane_mm": ("register.plane_um",),
    "most_plane_mm": ("register.plane_clip_um",),
    "place": ("paper.cloudiness_percent",),
    "place_near": ("paper.cloudiness_percent",),
    "column": ("camera.column_gain_percent",),
    "flicker": ("lamp.flicker_percent",),
    "turn_deg": ("page.skew_deg",),
    "stretch_percent": ("page.scale_percent",),
    "warp_across_um": ("page.warp_across_um",),
    "warp_along_um": ("page.warp_along_um",),
}
"""Amounts of a press that each of ``PrintPrior`` follows."""


def good_residual_variance(press: Press) -> ResidualVariance:
    """What good prints of a press scatter by: as many times what they do in the press world as ``[variation]`` says.

    Nothing where it says that nothing varies.
    """
    if amounts_of(press).exact:
        return ResidualVariance.none()
    world = ResidualVariance()
    return ResidualVariance(
        edge=world.edge * _times(press, "page.warp_along_um", "register.plane_um") ** 2,
        contrast=world.contrast * _times(press, "ink.halftone_contrast") ** 2,
        share=world.share * _times(press, "paper.cloudiness_percent"),
        dark=world.dark * _times(press, "camera.table_shape_percent"),
    )


def good_prior(press: Press) -> PrintPrior:
    """What good prints of a press do, likewise.

    Where nothing varies, that of the press world: nothing of it is excused, and all of it is evidence.
    """
    world = PrintPrior()
    if amounts_of(press).exact:
        return world
    own = {name: getattr(world, name) * _times(press, *of) for name, of in FOLLOWS.items()}
    return replace(world, **own)


def _times(press: Press, *names: str) -> float:
    """How many times as much as in the press world amounts vary, added up as independent ones."""
    own, world = (
        math.hypot(*(attrgetter(name)(of) for name in names)) for of in (amounts_of(press), Amounts.stated())
    )
    return max(own / world, LEAST_TIMES)


def fitted(page: Page, geometry: ScanGeometry) -> Page:
    """A design as it enters the press; of one that is wider than the field, the middle."""
    if geometry.sees(page.width_mm):
        return page
    rows, columns = page.cmyk.shape[:2]
    width = int(geometry.field_mm / page.pixel_mm)
    height = min(rows, int(LONGEST * width))
    left, top = (columns - width) // 2, (rows - height) // 2
    return replace(page, cmyk=np.ascontiguousarray(page.cmyk[top : top + height, left : left + width]))


class ScanEvidence(NamedTuple):
    """Evidence that one scan gives before anything is decided."""

    statistics: list[Observed]
    another: bool
    """Whether it shows another page."""
    glyphs: float
    """``WeighedPage.score``."""
    floor_mm2: float
    """``FloorFinding.area_mm2``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressDay:
    """A press on one day, with its page designs at hand."""

    day: SimulatedDay
    page: Callable[[int], Page]
    """A design as it enters the press."""
    residual_variance: ResidualVariance
    """What good prints are taken to scatter by ..."""
    prior: PrintPrior
    """... and to do."""

    @classmethod
    def of(cls, press: Press, pages: Designs, *, seed: int, first: int) -> PressDay:
        """The day on which design ``first`` is printed first."""
        return cls(
            day=SimulatedDay.begin("press", press, stream(seed, "training-session", first)),
            page=lambda index: fitted(pages.page(index), press.geometry),
            residual_variance=good_residual_variance(press),
            prior=good_prior(press),
        )

    def design(self, index: int) -> tuple[Printed, PreparedPage]:
        """A good print of a design, and what is known of it ahead of its scans."""
        press, good = self.day.press, self.day.good(self.page(index))
        known = prepare_page(
            good.page,
            good.expected,
            sensors=press.sensors,
            geometry=press.geometry,
            fringes=press.fringes,
            prior=self.prior,
            glyphs=True,
        )
        return good, known

    def wrong(
        self, good: Printed, kind: str, others: Sequence[int], rng: np.random.Generator
    ) -> Printed | None:
        """``SimulatedDay.wrong`` among the day's designs."""
        return self.day.wrong(good, kind, others=others, fetch=self.page, rng=rng)

    def scan(self, printed: Printed, rng: np.random.Generator) -> NDArray[np.uint16]:
        """One more print of it, as the camera records it."""
        return self.day.recorded(self.day.seen(printed, rng), rng)

    def analysed(self, known: PreparedPage, scan: NDArray[np.uint16]) -> ScanAnalysis:
        """A scan looked at as this press's are."""
        floor_share = self.day.press.floor_share
        return analyse(known, scan, residual_variance=self.residual_variance, floor_share=floor_share)

    def evidence(self, known: PreparedPage, scan: NDArray[np.uint16], scatter: Scatter) -> ScanEvidence:
        """Return the evidence of a scan of a prepared page."""
        analysis = self.analysed(known, scan)
        statistics = all_statistics(analysis.sums, analysis.marks, analysis.fit, analysis.found, scatter)
        return ScanEvidence(
            statistics=statistics,
            another=shows_another(analysis.found),
            glyphs=analysis.glyphs.score,
            floor_mm2=analysis.marks.floor.area_mm2,
        )

    def scatter_draws(self, designs: Iterable[tuple[int, np.random.Generator]]) -> Rows:
        """What ``learn_scatter`` learns from: draws by name, (designs, ...), of a good print of each with its rng."""
        drawn: dict[str, list[Any]] = defaultdict(list)
        for index, rng in designs:
            good, known = self.design(index)
            analysis = self.analysed(known, self.scan(good, rng))
            for name, values in samples(analysis.sums, assumed_light(self.prior), rng).items():
                drawn[name].append(values)
        return {name: np.stack(values) for name, values in drawn.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class ScatterWork:
    """Good prints of a day's designs -> draws that ``learn_scatter`` learns from; travels to worker processes."""

    press: Press
    pages: Designs
    seed: int

    def __call__(self, designs: tuple[int, ...]) -> Rows:
        """``PressDay.scatter_draws``."""
        day = PressDay.of(self.press, self.pages, seed=self.seed, first=designs[0])
        return day.scatter_draws((index, stream(self.seed, "training-print", index)) for index in designs)


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitWork:
    """The same good prints as ``ScatterWork``'s -> how wide their error's window means scatter.

    Column: unit (sensors,), a row each.
    """

    press: Press
    pages: Designs
    seed: int

    def __call__(self, designs: tuple[int, ...]) -> Rows:
        """``bayes.window_unit`` of each design's print."""
        day = PressDay.of(self.press, self.pages, seed=self.seed, first=designs[0])
        units = []
        for index in designs:
            rng = stream(self.seed, "training-print", index)
            good = day.day.good(day.page(index))
            evidence = page_evidence(good.page, day.scan(good, rng), self.press.station())
            units.append(window_unit(evidence.block_z))
        return {"unit": np.stack(units)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StatisticsWork:
    """A good print of each of a day's designs, and a misprint if asked for -> what each scan says, a row each.

    Columns: design, kind ("" where good), values (statistics,), portrait, another (the scan shows another page),
    glyphs, floor_mm2; with a ``unit`` also windows (3 sensors,), the paper's statistics.
    """

    press: Press
    pages: Designs
    seed: int
    scatter: Scatter
    misprints: bool
    unit: NDArray[np.float64] | None = None
    """(sensors,) of the paper's statistics, ``bayes.window_statistics``; None: they are not asked for."""

    def __call__(self, designs: tuple[int, ...]) -> Rows:
        """Rows in the order of designs; ``names`` of the statistics beside them."""
        day = PressDay.of(self.press, self.pages, seed=self.seed, first=designs[0])
        columns: dict[str, list[Any]] = defaultdict(list)
        names: list[str] = []
        for index in designs:
            rng = stream(self.seed, "training-print", index)
            good, known = day.design(index)
            scans = {"": day.scan(good, rng)}
            if self.misprints:
                others = [other for other in designs if other != index]
                wrong = day.wrong(good, KINDS[index % len(KINDS)], others, rng)
                if wrong is not None:
                    scans[wrong.kind] = day.scan(wrong, rng)
            for kind, scan in scans.items():
                said = day.evidence(known, scan, self.scatter)
                names = keys_of(said.statistics)
                row: dict[str, Any] = {
                    "design": index,
                    "kind": kind,
                    "values": values_of(said.statistics),
                    "portrait": known.page_features,
                    "another": said.another,
                    "glyphs": said.glyphs,
                    "floor_mm2": said.floor_mm2,
                }
                if self.unit is not None:
                    evidence = page_evidence(good.page, scan, self.press.station())
                    row["windows"] = window_statistics(evidence.block_z, unit=self.unit).ravel()
                for name, value in row.items():
                    columns[name].append(value)
        rows = {name: np.array(values) for name, values in columns.items()}
        return rows | {"kind": rows["kind"].astype("U16"), "names": np.array(names, "U48")}
