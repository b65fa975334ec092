"""Report of one run: every page with its verdict, every alarm with the camera's image, in one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Self

from prooflight import __version__
from prooflight.cmyk import NAME_OF_INK
from prooflight.detectors.base import Inspection
from prooflight.detectors.disposition import without_gate
from prooflight.detectors.verdict import Region, Verdict
from prooflight.files.atomic import whole_file
from prooflight.inspection.guarantee import summary_of
from prooflight.inspection.inspector import raster_of
from prooflight.inspection.job import UNUSABLE, InspectPage, Pair, lacks_scan, scan_missing, unusable
from prooflight.inspection.sheets import Counts as SheetCounts
from prooflight.inspection.sheets import SetVerdict, SheetVerdict
from prooflight.pages.parallel import KILLED
from prooflight.reporting import pictures, wording
from prooflight.reporting.defect_text import describe, shown_kind
from prooflight.reporting.html import data_uri, template

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.inspection.inspector import Inspector, Prepared
    from prooflight.pages.raster import Page
    from prooflight.pages.warnings import PageWarning
    from prooflight.press.artefact import Press
    from prooflight.reporting.pictures import AlarmPictures, Frame, Zoom
    from prooflight.reporting.two_worlds import TwoWorlds
    from prooflight.reporting.visibility_picture import VisibleOnPage
    from prooflight.scans.recorded import RecordedScan
    from prooflight.simulation.misprints.kinds import Misprint

PAGE_PICTURE_PX = 320
ZOOM_SCREEN_PX = 360
"""Greatest width of a zoom on the screen, with 2 or 3 screen pixels for each camera pixel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageEntry:
    """One page of the run, small enough to travel between processes."""

    number: int
    """Place in the job, from 1."""
    name: str
    verdict: Verdict
    title: str = ""
    """Title of the page for people; may be empty."""
    size_mm: tuple[float, float] = (0.0, 0.0)
    """Width and height as the page lay in the press."""
    picture: bytes | None = None
    """The page as a person would see it, as WebP; None if it cannot be used."""
    alarm: AlarmPictures | None = None
    """Pictures of an alarm; None if there is nothing to show, or no scan."""
    truth: Misprint | None = None
    """Simulated misprint of the page; None if there is none, or unknown."""
    summary: NDArray[np.float64] | None = field(default=None, compare=False)
    """Contribution to the test of its run, as long as that is pending."""
    warnings: tuple[PageWarning, ...] = ()
    """Differences, certain or possible, between the page's file and what is printed."""

    @property
    def alarmed(self) -> bool:
        """Whether the verdict is a misprint."""
        return self.verdict.verdict == "misprint"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSummary:
    """Facts of the run as a whole, except for counts of pages."""

    job: str
    press: str
    press_digest: str
    guarantee: str
    """False-alarm rate of good pages, in words."""
    world: str | None
    """Simulated world, in which the truth about every page is known; None for a real run."""
    seed: int | None
    date: str
    pages_per_s: float
    suspended: str = ""
    """Why the false-alarm rate is not guaranteed for these pages; empty if nothing indicates it."""
    warnings: tuple[str, ...] = ()
    """Warnings of the job, a line each."""
    detector: str = "matched_filter"

    @classmethod
    def today(
        cls,
        inspector: Inspector,
        *,
        job: str,
        pages_per_s: float,
        world: str | None = None,
        seed: int | None = None,
        suspended: str = "",
        warnings: Sequence[str] = (),
    ) -> Self:
        """Return the facts of a job that was inspected today."""
        return cls(
            job=job,
            press=inspector.press.name,
            press_digest=inspector.press.digest,
            guarantee=inspector.guarantee,
            world=world,
            seed=seed,
            date=datetime.now(UTC).strftime("%Y-%m-%d"),
            pages_per_s=pages_per_s,
            suspended=suspended,
            warnings=tuple(warnings),
            detector=inspector.detector.name,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """Number of pages by verdict; the last four need the truth."""

    pages: int
    good: int
    alarms: int
    stopped: int
    not_inspected: int
    misprints: int
    caught: int
    missed: int
    false_alarms: int
    unusable: int = 0
    """Pages not inspected for another reason than a missing scan."""


def counts(entries: Sequence[PageEntry]) -> Counts:
    """Count the pages of a run."""
    alarmed = [entry for entry in entries if entry.alarmed]
    misprints = sum(entry.truth is not None for entry in entries)
    caught = sum(entry.truth is not None for entry in alarmed)
    return Counts(
        pages=len(entries),
        good=sum(entry.verdict.verdict == "good" for entry in entries),
        alarms=len(alarmed),
        stopped=sum(not entry.verdict.stopping_costs_more for entry in alarmed),
        not_inspected=sum(entry.verdict.verdict == "not-inspected" for entry in entries),
        misprints=misprints,
        caught=caught,
        missed=misprints - caught,
        false_alarms=len(alarmed) - caught,
        unusable=sum(
            entry.verdict.verdict == "not-inspected" and not lacks_scan(entry.verdict) for entry in entries
        ),
    )


def page_entry(
    page: Page,
    result: Inspection | Verdict | None,
    press: Press,
    *,
    truth: Misprint | None = None,
    title: str = "",
) -> PageEntry:
    """Make the entry of one page as it lay in the press, with all pictures of alarms and of missed misprints.

    result: the inspection, or the bare verdict (None: not inspected) of a page that has no scan to show.
    """
    if isinstance(result, Inspection):
        verdict = result.verdict
        shown = verdict.verdict == "misprint" or truth is not None
        place = _enlarged(verdict, truth)
        alarm = pictures.alarm_pictures(page, result, press, place=place) if shown else None
    else:
        verdict, alarm = result or Verdict.skipped(page.name), None
    return PageEntry(
        number=page.number,
        name=page.name,
        title=title,
        size_mm=(round(page.width_mm, 2), round(page.height_mm, 2)),
        verdict=verdict,
        picture=pictures.encoded(pictures.page_picture(page, press, width_px=PAGE_PICTURE_PX)),
        alarm=alarm,
        truth=truth,
        warnings=page.warnings,
    )


def unpictured_entry(number: int, verdict: Verdict) -> PageEntry:
    """Return the entry of a page that cannot be used itself, so that its appearance is unknown."""
    return PageEntry(number=number, name=verdict.page, verdict=verdict)


@dataclass(frozen=True, slots=True)
class PicturedPage:
    """A ``Tried`` that returns a report's entry instead of the bare verdict."""

    work: InspectPage

    def __call__(self, pair: Pair) -> PageEntry:
        """Inspect one page and make its entry, also without a scan, or with one that cannot be used."""
        number, scan = pair
        try:
            design = self.work.design(number)
            result = self._result(design, scan)
            summary = summary_of(result) if isinstance(result, Inspection) else None
            return replace(page_entry(raster_of(design), result, self.work.inspector.press), summary=summary)
        except UNUSABLE as error:
            return unpictured_entry(number, unusable(self.work.name(pair), error))

    def killed(self, pair: Pair) -> PageEntry:
        """Return the entry of a page whose inspection the system ended."""
        return unpictured_entry(pair[0], Verdict.skipped(self.work.name(pair), KILLED))

    def _result(self, design: Page | Prepared, scan: RecordedScan | None) -> Inspection | Verdict:
        name = raster_of(design).name
        if scan is None:
            return scan_missing(name, self.work.scans)
        try:
            return self.work.inspection(design, scan)
        except UNUSABLE as error:
            return unusable(name, error)


def _enlarged(verdict: Verdict, truth: Misprint | None) -> Region | None:
    """Return the first region detected; of a missed misprint, its true region."""
    if verdict.regions:
        return verdict.regions[0]
    if truth is None:
        return None
    x, y, width, height = truth.region_mm
    return Region(x_mm=x, y_mm=y, width_mm=width, height_mm=height, score=0.0, kind=truth.kind)


def write_report(
    path: Path,
    entries: Sequence[PageEntry],
    summary: RunSummary,
    *,
    worlds: TwoWorlds | None = None,
    visible: VisibleOnPage | None = None,
    sheets: Sequence[SheetVerdict | SetVerdict] = (),
) -> None:
    """Write one HTML file with all its pictures, in the order of entries; atomic.

    Parameters
    ----------
    worlds : shown first where there is such a picture
    visible : marks that would be caught on one page, shown last
    sheets : verdicts of a job that was imposed on sheets, with its sets; the entries then are their sides,
        in the order in which sheets number them
    """
    count, unit = counts(entries), "side" if sheets else "page"
    has_truth = summary.world is not None
    numbered = list(enumerate(entries, start=1))
    text = template("report").render(
        summary=summary,
        worlds=worlds,
        visible=visible,
        count=count,
        known=has_truth,
        sentence=sentence(count, unit),
        unit=unit,
        of_sheets=SheetCounts.of(sheets),
        sheets=[one for one in sheets if isinstance(one, SheetVerdict)],
        sets=[one for one in sheets if isinstance(one, SetVerdict)],
        entries=numbered,
        alarms=[(place, entry) for place, entry in numbered if entry.alarmed],
        unseen=[
            entry for entry in entries if entry.verdict.verdict == "not-inspected" and entry.verdict.reason
        ],
        missed=[(place, entry) for place, entry in numbered if entry.truth and not entry.alarmed],
        scale=[(100 * i / (len(pictures.SCALE) - 1), colour) for i, (_, colour) in enumerate(pictures.SCALE)],
        version=__version__,
        data=partial(data_uri, kind="webp"),
        place=_place,
        decided=lambda verdict: wording.disposition(*without_gate(verdict)),
        name_of_ink=NAME_OF_INK,
        describe=describe,
        shown_kind=shown_kind,
        screen_pixels=_screen_pixels,
        saturation=pictures.SATURATION,
    )
    with whole_file(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8")


def sentence(count: Counts, unit: str = "page") -> str:
    """Return the result of a run in one sentence. unit: what was inspected, a page or a side.

    >>> sentence(Counts(pages=3, good=2, alarms=1, stopped=1, not_inspected=0, misprints=0, caught=0, missed=0,
    ...                 false_alarms=0))
    '3 pages inspected: 2 passed as good, 1 stopped as a misprint.'
    """
    inspected = count.pages - count.not_inspected
    if not inspected:
        lacked = "could not be inspected" if count.unusable else "had no scan"
        return f"No {unit} inspected; {wording.count(count.pages, unit)} {lacked}."
    parts = [f"{count.good} passed as good"]
    as_what = "a misprint" if count.alarms == 1 else "misprints"
    if not count.alarms:
        parts.append("no misprint found")
    elif count.stopped == count.alarms:
        parts.append(f"{count.alarms} stopped as {as_what}")
    else:
        by_costs = count.alarms - count.stopped
        parts.append(
            f"{count.alarms} found to be {as_what}, {by_costs} of them accepted by the press file's costs"
        )
    unseen = "".join(
        f"; {wording.count(pages, f'more {unit}')} {lacked} and {'is' if pages == 1 else 'are'} held"
        for pages, lacked in (
            (count.not_inspected - count.unusable, "had no scan"),
            (count.unusable, "could not be inspected"),
        )
        if pages
    )
    return f"{wording.count(inspected, unit)} inspected: {', '.join(parts)}{unseen}."


def _screen_pixels(zoom: Zoom) -> int:
    return 3 if 3 * zoom.columns <= ZOOM_SCREEN_PX else 2


def _place(box: tuple[float, float, float, float], frame: Frame) -> str:
    """Return the CSS position of x, y, width, height [mm] of the page in a picture of frame; clipped to it."""
    x, y, width, height = box
    left, right = ((v - frame.x_mm) / frame.width_mm for v in (x, x + width))
    top, bottom = ((v - frame.y_mm) / frame.height_mm for v in (y, y + height))
    left, right, top, bottom = (min(max(v, 0.0), 1.0) for v in (left, right, top, bottom))
    return f"left:{left:.2%};top:{top:.2%};width:{max(right - left, 0):.2%};height:{max(bottom - top, 0):.2%}"
