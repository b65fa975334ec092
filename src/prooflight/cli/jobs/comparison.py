"""What ``prooflight inspect`` compares: the pages of a job, the scans of each, and the work on a pair."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from prooflight.cli import imposition, show
from prooflight.cli.jobs.check import checked_early
from prooflight.cli.jobs.zones import zones_in_force
from prooflight.detectors.registry import PREFERRED
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.job import InspectPage, Pair, paired
from prooflight.inspection.prepared_store import PreparedStore
from prooflight.press.artefact import Press
from prooflight.press.pages import job_source

if TYPE_CHECKING:
    from prooflight.detectors.base import Device
    from prooflight.pages.check import EarlyWarnings
    from prooflight.pages.layout.plan import SheetPlan


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options of the command that concern the job and its press."""

    layout: str | None
    detector: str | None
    """Name of the detector; None: the one that the press prefers."""
    device: Device
    zones: Path | None
    profile: Path | None
    json: bool
    """Whether the output is for a program, which reads no progress."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A job whose pages, or sides, are to be compared with their scans."""

    work: InspectPage
    pairs: Sequence[Pair]
    job: str
    """Name of the job."""
    press: str
    """Name of the press."""
    plan: SheetPlan | None
    """How the pages lie on sheets; None: each is a sheet."""
    early: EarlyWarnings


def on_press(job: Path, scans: Path, press: Path, options: Options) -> Comparison:
    """Compare with what a press artefact predicts; errors as of reading them."""
    loaded = Press.load(press)
    inspector = Inspector.of(loaded, options.detector).on(options.device)  # a wrong name ends before any work
    source, plan = imposition.imposed(
        job_source(job, loaded, profile=options.profile), options.layout, loaded.geometry
    )
    with source.open() as opened:
        inspector = replace(inspector, zones=zones_in_force(options.zones, opened, inspector))
        pairs = paired(opened, scans, sensors=len(loaded.sensors))
        name, early = opened.name, checked_early(opened, json=options.json)
    stored = PreparedStore.of(inspector, source) if plan is None else None
    work = InspectPage(job=source, inspector=inspector, scans=scans, stored=stored)
    return Comparison(work=work, pairs=pairs, job=name, press=loaded.name, plan=plan, early=early)


def on_scanner(
    job: Path, scans: Path, press: Path | None, options: Options, *, tone: str | None, scan_dpi: float | None
) -> Comparison:
    """Compare with scans of an office scanner, which are placed first; errors as of reading job and scans.

    Without a press artefact and a detector, pages are drawn as printer and scanner show them (decision 49).
    """
    from prooflight.cli.jobs import scanner  # what it needs takes a second to load
    from prooflight.inspection.scanner.inspected import InspectScannedPage, drawn_detector
    from prooflight.scans.scanner.reading import scanned_pages

    say = show.steps(quiet=options.json)
    drawn = options.detector == scanner.DRAWN or (options.detector is None and press is None)
    settings = scanner.scanner_settings(tone, scan_dpi)
    sheets = scanned_pages(scans)
    picture = scanner.first_readable(sheets, settings)

    def shown(days: Iterable[Any], total: int, what: str) -> Iterator[Any]:
        return iter(days) if options.json else show.progress(days, total=total, what=what)

    loaded = (
        Press.load(press)
        if press is not None
        else scanner.scanner_press(
            job,
            picture,
            profile=options.profile,
            train=options.detector == PREFERRED,
            as_fine=drawn,
            progress=say,
            shown=shown,
        )
    )
    inspector = Inspector.of(loaded, None if drawn else options.detector).on(options.device)
    source, plan = imposition.imposed(
        job_source(job, loaded, profile=options.profile), options.layout, loaded.geometry
    )
    with source.open() as opened:
        if drawn:
            zones = scanner.zones_of_scans(options.zones, opened.page_sizes_mm)
        else:
            zones = zones_in_force(options.zones, opened, inspector)
        pairs = scanner.scanner_pairs(source, len(opened), sheets, loaded, settings, progress=say)
        name, early = opened.name, checked_early(opened, json=options.json)
    if drawn:
        detector, pairs = drawn_detector(pairs, source, loaded, settings, zones=zones, progress=say)
        inspector = Inspector(loaded, detector)
    work = InspectScannedPage(
        job=source, inspector=replace(inspector, zones=zones), scans=scans, settings=settings
    )
    return Comparison(work=work, pairs=pairs, job=name, press=loaded.name, plan=plan, early=early)
