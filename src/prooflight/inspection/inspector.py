"""Inspection of pages and their scans by any detector; work that needs no scan is done in advance."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Self

from prooflight.detectors.base import Detector, Device, Inspection, PlannedPage, PreparedPage, engine_name
from prooflight.detectors.optional import DecidesFirst
from prooflight.detectors.registry import detector as detector_of
from prooflight.detectors.verdict import Verdict
from prooflight.errors import RequestError, ScanError
from prooflight.inspection.codes.finding import PageCode, page_codes
from prooflight.inspection.codes.reading import with_codes
from prooflight.inspection.light_level import LitSquares, light_levels, lit_squares, wrong_light
from prooflight.scans.scan import Scan

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from prooflight.detectors.print_prior import PrintPrior
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zones_file import JobZones
    from prooflight.press.artefact import Press


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """Page as it enters the press, with all data that can be computed in advance of its scans."""

    page: Page
    prepared_page: PreparedPage
    """Page as its detector prepared it."""
    lit: LitSquares
    """Squares by which a scan's light is compared with the light that the press was calibrated for."""
    codes: tuple[PageCode, ...] = ()
    """Bar codes and matrix codes that its scans must show."""


def raster_of(page: Page | Prepared) -> Page:
    """Return the page itself, prepared or not."""
    return page.page if isinstance(page, Prepared) else page


@dataclass(frozen=True, slots=True, init=False)
class Inspector:
    """Press with a detector; small and picklable."""

    press: Press
    detector: Detector
    zones: JobZones | None
    print_prior: PrintPrior = field(init=False)
    """How the press's good prints vary."""

    def __init__(
        self, press: Press, detector: Detector | None = None, *, zones: JobZones | None = None
    ) -> None:
        """Use the given detector; None: the matched-filter detector if the press was trained with it, else chi-square.

        zones: of the job's pages, priced on this press (``JobZones.refuse_unpriced``). PressError: the press,
        or its light as it has been followed, holds a value that none may. RequestError: the detector does not
        know zones of these kinds.
        """
        _sound(press)
        object.__setattr__(self, "press", press)
        object.__setattr__(self, "detector", detector_of(None, press) if detector is None else detector)
        object.__setattr__(self, "zones", zones)
        object.__setattr__(self, "print_prior", press.print_prior)
        if zones is not None and (unknown := zones.kinds - self.detector.zone_kinds):
            kind = f"{min(unknown)} zones" if self.detector.zone_kinds else "zones"
            what = f"{self.detector.name!r} does not support {kind}"
            raise RequestError("zones", what, remedy="leave them out, or inspect by the matched filter")

    @classmethod
    def of(cls, press: Press, name: str | None = None, *, zones: JobZones | None = None) -> Self:
        """Create an inspector with the detector of the user's ``name``; see ``registry.detector``."""
        return cls(press, detector_of(name, press), zones=zones)

    @property
    def guarantee(self) -> str:
        """Describe how rarely a good page alarms, and on what that rests."""
        return self.detector.guarantee

    def under(self, press: Press) -> Self:
        """Return the same inspector on a press whose light has changed a little."""
        own = self.detector.press_context
        press_context = replace(press.press_context(own.threads), device=own.device)
        return replace(self, press=press, detector=self.detector.at(press_context))

    def with_threads(self, threads: int | None) -> Self:
        """Return the same inspector with so many threads for one page; None: one a core."""
        return replace(self, detector=self.detector.at(replace(self.detector.press_context, threads=threads)))

    def on(self, device: Device) -> Self:
        """Return the same inspector with images of scans computed on the processor or on a graphics card.

        RequestError: there is no card, or the detector cannot use one.
        """
        return replace(self, detector=self.detector.at(replace(self.detector.press_context, device=device)))

    @property
    def engine(self) -> str:
        """Engine that computes images of scans, as journals record it: cpu, or gpu with the card's name and driver."""
        return engine_name(self.detector.press_context.device)

    def planned(self, page: Page, *, threads: int | None = None) -> PlannedPage:
        """Return a page as it is to enter the press (``ScanGeometry.lay``).

        threads: number used to prepare it.
        """
        zones = None if self.zones is None else self.zones.page(page)
        own = self.detector.press_context
        return PlannedPage(page, own if threads is None else replace(own, threads=threads), zones)

    def prepare(self, page: Page | PlannedPage) -> Prepared:
        """Compute all data of a page, as it enters the press (``ScanGeometry.lay``), that need no scan."""
        planned = page if isinstance(page, PlannedPage) else self.planned(page)
        prepared = self.detector.prepare(planned)
        sensors, geometry = self.press.sensors, self.press.geometry
        lit = lit_squares(planned.expected, planned.page, sensors=sensors, geometry=geometry)
        codes = page_codes(planned, sensors, geometry)
        if (zones := planned.zones) is not None:
            codes = tuple(code for code in codes if not zones.ignores(code.box_mm))
        return Prepared(page=planned.page, prepared_page=prepared, lit=lit, codes=codes)

    def inspect(
        self,
        page: Page | Prepared,
        scan: Scan | NDArray[np.uint16],
        *,
        scan_name: str = "the scan",
        seed: int = 0,
        decided: Callable[[Verdict], None] | None = None,
    ) -> Inspection:
        """Locate the page, compare it with its scan and decide.

        A scan that shows another page, or this one where no good print lies, is the misprint ``wrong-page``;
        one in which a bar code or a matrix code does not read as the page's is the misprint ``code``. One
        made under light that the press was not calibrated for is not inspected: the false-alarm rate of its
        detector does not hold then.

        Parameters
        ----------
        page
            Page as it enters the press, or as ``prepare`` returned it.
        scan
            Scan, or its numbers (sensors, lines, pixels) [DN] alone; for one that lacks lines see
            ``lost_lines.inspect_where_seen``.
        scan_name
            Name of the scan in errors, where its numbers alone are given.
        seed
            Seed of the detector's random draws.
        decided
            Called with the verdict on a misprint, without its explanation, as soon as it is known; only of detectors
            that know it before (``DecidesFirst``).

        Raises
        ------
        ScanError
            If the scan does not fit press or page.
        """
        started = time.perf_counter()
        prepared = page if isinstance(page, Prepared) else self.prepare(page)
        if not isinstance(scan, Scan):
            scan = Scan(dn=scan, name=scan_name)
        scan = replace(scan, dn=inspected_lines(scan.name, scan.dn, prepared.page, self.press))
        result = self._inspected(prepared, scan, seed, decided)
        lit = replace(result, verdict=self._under_its_light(result.verdict, prepared, scan))
        sensors, geometry = self.press.sensors, self.press.geometry
        done = lit
        if prepared.codes:
            done = with_codes(
                lit, prepared.codes, scan, page=prepared.page, sensors=sensors, geometry=geometry
            )
        milliseconds = round((time.perf_counter() - started) * 1e3, 1)
        planned = PlannedPage(prepared.page, self.detector.press_context)
        return replace(done, verdict=replace(done.verdict, milliseconds=milliseconds), planned=planned)

    def _inspected(
        self, prepared: Prepared, scan: Scan, seed: int, decided: Callable[[Verdict], None] | None
    ) -> Inspection:
        page = prepared.prepared_page
        if decided is None or not isinstance(page, DecidesFirst):
            return page.inspect(scan, seed=seed)

        def of_misprint(verdict: Verdict) -> None:
            if self._under_its_light(verdict, prepared, scan).verdict == "misprint":
                decided(verdict)

        return page.decide_and_explain(scan, decided=of_misprint)

    def _under_its_light(self, verdict: Verdict, prepared: Prepared, scan: Scan) -> Verdict:
        """Return the verdict, or one of not-inspected with the reason where the light is wrong."""
        sensors = self.press.sensors
        levels = light_levels(prepared.lit, scan.dn, sensors, lost=scan.lost)
        wrong = wrong_light(levels, sensors, prior=self.print_prior)
        if wrong is None or (wrong.of_sheet and verdict.verdict == "misprint"):
            return verdict
        return replace(
            Verdict.skipped(verdict.page, wrong.reason),
            shift_mm=verdict.shift_mm,
            detector=verdict.detector,
        )


@lru_cache(maxsize=2)
def _sound(press: Press) -> None:
    press.check()


def refuse_other_camera(where: object, scan: NDArray[np.generic], press: Press) -> None:
    """Raise ScanError if a scan (sensors, lines, pixels) is not of this press's camera."""
    (sensors, _, pixels), expected = scan.shape, press.geometry.pixels
    if sensors != len(press.sensors) or pixels != expected:
        what = f"is of {sensors} sensors x {pixels} pixels"
        remedy = f"press {press.name} has {len(press.sensors)} sensors x {expected} pixels"
        raise ScanError(where, what, remedy=remedy)


def inspected_lines(name: str, scan: NDArray[np.uint16], page: Page, press: Press) -> NDArray[np.uint16]:
    """Return the lines of a scan (sensors, lines, pixels) that are inspected: no more than scans of such a page have.

    It may have fewer if it holds the page in its place; later stages take missing ones as unknown. ScanError:
    it is not of this press's camera, or ends before its page does.
    """
    refuse_other_camera(name, scan, press)
    lines = scan.shape[1]
    rows, _ = press.geometry.on_page(page.width_mm, page.height_mm)
    if lines < rows.stop:
        what = f"ends after {lines} lines, {lines * press.geometry.line_pitch_mm:.1f} mm"
        raise ScanError(name, what, remedy=f"page {page.number} needs {rows.stop} lines")
    return scan[:, : press.geometry.lines(page.height_mm)]
