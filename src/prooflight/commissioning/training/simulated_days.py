"""Simulated prints of a press that has not printed yet: designs on press days, analysed as its scans will be."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.matched_filter.analysis import ScanAnalysis, analyse
from prooflight.detectors.matched_filter.design import PreparedPage, prepare_page
from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
from prooflight.detectors.matched_filter.statistics.families import all_statistics, samples
from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter, assumed_light
from prooflight.detectors.matched_filter.statistics.statistic import Observed, keys_of, values_of
from prooflight.detectors.paper.bayes import window_statistics, window_unit
from prooflight.detectors.paper.detector import page_evidence
from prooflight.detectors.placing import shows_another
from prooflight.detectors.print_prior import PrintPrior
from prooflight.rng import stream
from prooflight.simulation.captures import Printed, SimulatedDay
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import Amounts, amounts_of, stated_amounts

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.simulation.corpus.corpus import Designs

Rows = dict[str, NDArray[Any]]
"""Columns of statistics, by name."""
DESIGNS_A_DAY: Final = 4
"""assumed: few, since days differ by more than prints of a day do."""
LONGEST: Final = 1.45
"""Height over width beyond which a page that is cut to the field is cut off: A4's and a little."""
LEAST_TIMES: Final = 0.2
"""Least factor on the assumed variation of good prints.

assumed: even where they do not vary, some is measured.
"""

FOLLOWS: Final = {
    "white": ("camera.table_gain_percent", "paper.white_channel_percent"),
    "common": ("paper.white_percent",),
    "lamp": ("lamp.profile_percent", "lamp.profile_print_percent"),
    "shape": ("camera.table_shape_percent",),
    "gain": ("ink.gain_session_percent", "ink.gain_print_percent"),
    # Assumed: of what varies from place to place on all sheets alike, as much looks like a tilt as a mid-tint varies.
    "tilt": ("ink.gain_tilt_percent", "sheet.tint_percent"),
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
"""Amounts of a press that each field of ``PrintPrior`` scales with."""


def good_residual_variance(press: Press) -> ResidualVariance:
    """Return the residual variance of a press's good prints: the press world's, scaled by ``[variation]``.

    It is zero where ``[variation]`` states that nothing varies.
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
    """Return the prior of a press's good prints, scaled likewise; one that states several worlds has the widest.

    Where nothing varies, it is that of the press world: no deviation is excused, and each is evidence.
    """
    world = PrintPrior()
    if amounts_of(press).exact:
        return world
    own = {name: getattr(world, name) * _times(press, *of) for name, of in FOLLOWS.items()}
    paper = amounts_of(press).paper
    seen = 0.0 if paper.specks_per_page == 0 else max(paper.specks_ink_percent) / 100
    area_mm2 = np.pi / 4 * max(paper.specks_diameter_mm) ** 2
    return replace(world, **own, speck_share=seen, speck_mm2=float(area_mm2))


def _times(press: Press, *names: str) -> float:
    """Return the ratio of a press's amounts to the press world's, added up as independent ones.

    It is the greatest of the worlds that the press states.
    """
    *own, world = (
        math.hypot(*(amount_named(name, of) for name in names))
        for of in (*stated_amounts(press), Amounts.stated())
    )
    return max(max(own) / world, LEAST_TIMES)


def amount_named(name: str, amounts: Amounts) -> float:
    """Return the amount of a name in ``FOLLOWS``; 0: its block is not of this press's world."""
    block, field = name.split(".")
    of_block = getattr(amounts, block)
    return 0.0 if of_block is None else float(getattr(of_block, field))


def fitted(page: Page, geometry: ScanGeometry) -> Page:
    """Return a design as it enters the press; for one that is wider than the field, the middle."""
    if geometry.sees(page.width_mm):
        return page
    rows, columns = page.cmyk.shape[:2]
    width = int(geometry.field_mm / page.pixel_mm)
    height = min(rows, int(LONGEST * width))
    left, top = (columns - width) // 2, (rows - height) // 2
    return replace(page, cmyk=np.ascontiguousarray(page.cmyk[top : top + height, left : left + width]))


def days_of(designs: range) -> list[tuple[int, ...]]:
    """Return the designs of each day.

    >>> days_of(range(2, 8))
    [(2, 3, 4, 5), (6, 7)]
    """
    return [tuple(designs[at : at + DESIGNS_A_DAY]) for at in range(0, len(designs), DESIGNS_A_DAY)]


def world_in_turn(first: int, worlds: int) -> int:
    """Return the number of the world, of so many that a press states, of the day that begins with a design.

    >>> [world_in_turn(first, 2) for first in (0, 4, 8, 34, 38)]
    [0, 1, 0, 0, 1]
    """
    return first // DESIGNS_A_DAY % worlds


def worlds_of(designs: range, worlds: int) -> NDArray[np.int64]:
    """Return the number of the world of each design, (designs,), which is that of its day.

    >>> worlds_of(range(2, 8), 2).tolist()
    [0, 0, 0, 0, 1, 1]
    """
    return np.concatenate([np.full(len(day), world_in_turn(day[0], worlds)) for day in days_of(designs)])


class ScanEvidence(NamedTuple):
    """Evidence of one scan before any decision."""

    statistics: list[Observed]
    another: bool
    """Whether it shows another page."""
    glyphs: float
    """Score of the page's glyphs, ``ScoredPage.score``."""
    floor_mm2: float
    """Area below the floor, ``FloorFinding.area_mm2``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressDay:
    """Press on one day, with its page designs."""

    day: SimulatedDay
    page: Callable[[int], Page]
    """Function that returns a design as it enters the press."""
    residual_variance: ResidualVariance
    """Residual variance of good prints."""
    prior: PrintPrior
    """Prior of good prints."""

    @classmethod
    def of(cls, press: Press, pages: Designs, *, seed: int, first: int) -> PressDay:
        """Begin the day on which design ``first`` is printed first.

        Days of a press that states several worlds are of each in turn.
        """
        worlds = stated_amounts(press)
        amounts = worlds[world_in_turn(first, len(worlds))]
        session = Session.draw(amounts, press, stream(seed, "training-session", first))
        return cls(
            day=SimulatedDay(press=press, session=session),
            page=lambda index: fitted(pages.page(index), press.geometry),
            residual_variance=good_residual_variance(press),
            prior=good_prior(press),
        )

    def design(self, index: int) -> tuple[Printed, PreparedPage]:
        """Print a design once, and prepare its page in advance of its scans."""
        press, good = self.day.press, self.day.good(self.page(index))
        prepared = prepare_page(
            good.page,
            good.expected,
            sensors=press.sensors,
            geometry=press.geometry,
            fringes=press.fringes,
            prior=self.prior,
            glyphs=True,
        )
        return good, prepared

    def wrong(
        self, good: Printed, kind: str, others: Sequence[int], rng: np.random.Generator
    ) -> Printed | None:
        """Print a misprint, as ``SimulatedDay.wrong`` does, among the day's designs."""
        return self.day.wrong(good, kind, others=others, fetch=self.page, rng=rng)

    def scan(self, printed: Printed, rng: np.random.Generator) -> NDArray[np.uint16]:
        """Print it once more, and record it with the camera."""
        return self.day.recorded(self.day.seen(printed, rng), rng)

    def analysed(self, prepared: PreparedPage, scan: NDArray[np.uint16]) -> ScanAnalysis:
        """Analyse a scan as this press's scans are analysed."""
        floor_share = self.day.press.floor_share
        return analyse(prepared, scan, residual_variance=self.residual_variance, floor_share=floor_share)

    def evidence(self, prepared: PreparedPage, scan: NDArray[np.uint16], scatter: Scatter) -> ScanEvidence:
        """Return the evidence of a scan of a prepared page."""
        analysis = self.analysed(prepared, scan)
        statistics = all_statistics(
            analysis.sums, analysis.marks, analysis.fit, analysis.registration, scatter
        )
        return ScanEvidence(
            statistics=statistics,
            another=shows_another(analysis.registration),
            glyphs=analysis.glyphs.score,
            floor_mm2=analysis.marks.floor.area_mm2,
        )

    def scatter_draws(self, designs: Iterable[tuple[int, np.random.Generator]]) -> Rows:
        """Return the draws that ``learn_scatter`` needs, by name, (designs, ...).

        They are of a good print of each design with its rng.
        """
        drawn: dict[str, list[Any]] = defaultdict(list)
        for index, rng in designs:
            good, prepared = self.design(index)
            analysis = self.analysed(prepared, self.scan(good, rng))
            for name, values in samples(analysis.sums, assumed_light(self.prior), rng).items():
                drawn[name].append(values)
        return {name: np.stack(values) for name, values in drawn.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class ScatterWork:
    """Work of drawing ``learn_scatter``'s samples from a day's good prints.

    It can be sent to worker processes.
    """

    press: Press
    pages: Designs
    seed: int

    def __call__(self, designs: tuple[int, ...]) -> Rows:
        """Return ``PressDay.scatter_draws``."""
        day = PressDay.of(self.press, self.pages, seed=self.seed, first=designs[0])
        return day.scatter_draws((index, stream(self.seed, "training-print", index)) for index in designs)


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitWork:
    """Work of measuring the scatter of the error's window means on the same good prints as ``ScatterWork``'s.

    Column: unit (sensors,), a row each.
    """

    press: Press
    pages: Designs
    seed: int

    def __call__(self, designs: tuple[int, ...]) -> Rows:
        """Return ``bayes.window_unit`` of each design's print."""
        day = PressDay.of(self.press, self.pages, seed=self.seed, first=designs[0])
        units = []
        for index in designs:
            rng = stream(self.seed, "training-print", index)
            good = day.day.good(day.page(index))
            evidence = page_evidence(good.page, day.scan(good, rng), self.press.press_context())
            units.append(window_unit(evidence.block_z))
        return {"unit": np.stack(units)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StatisticsWork:
    """Work of computing the statistics of a good print of each of a day's designs, and of a misprint if requested.

    Columns: design, kind ("" where good), values (statistics,), portrait, another (the scan shows another
    page), glyphs, floor_mm2; with a ``unit`` also windows (3 sensors,), the paper's statistics.
    """

    press: Press
    pages: Designs
    seed: int
    scatter: Scatter
    misprints: bool
    unit: NDArray[np.float64] | None = None
    """Unit (sensors,) of the paper's statistics, ``bayes.window_statistics``; None: they are not computed."""

    def __call__(self, designs: tuple[int, ...]) -> Rows:
        """Return rows in the order of designs, with ``names`` of the statistics."""
        day = PressDay.of(self.press, self.pages, seed=self.seed, first=designs[0])
        columns: dict[str, list[Any]] = defaultdict(list)
        names: list[str] = []
        for index in designs:
            rng = stream(self.seed, "training-print", index)
            good, prepared = day.design(index)
            scans = {"": day.scan(good, rng)}
            if self.misprints:
                others = [other for other in designs if other != index]
                wrong = day.wrong(good, KINDS[index % len(KINDS)], others, rng)
                if wrong is not None:
                    scans[wrong.kind] = day.scan(wrong, rng)
            for kind, scan in scans.items():
                scan_evidence = day.evidence(prepared, scan, self.scatter)
                names = keys_of(scan_evidence.statistics)
                row: dict[str, Any] = {
                    "design": index,
                    "kind": kind,
                    "values": values_of(scan_evidence.statistics),
                    "portrait": prepared.page_features,
                    "another": scan_evidence.another,
                    "glyphs": scan_evidence.glyphs,
                    "floor_mm2": scan_evidence.floor_mm2,
                }
                if self.unit is not None:
                    evidence = page_evidence(good.page, scan, self.press.press_context())
                    row["windows"] = window_statistics(evidence.block_z, unit=self.unit).ravel()
                for name, value in row.items():
                    columns[name].append(value)
        rows = {name: np.array(values) for name, values in columns.items()}
        return rows | {"kind": rows["kind"].astype("U16"), "names": np.array(names, "U48")}
