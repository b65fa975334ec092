"""The demonstration: a job printed on the simulated press with some misprints, and every print inspected."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Final

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.cache import preset_once
from prooflight.errors import RequestError
from prooflight.files.atomic import whole_file
from prooflight.files.program import program_digest
from prooflight.files.user_folders import user_folder
from prooflight.inspection.inspector import Inspector
from prooflight.pages.job import JobSource, opened
from prooflight.press.press_file import TWO_SENSORS, PressFile
from prooflight.reporting.report import PageEntry, page_entry
from prooflight.reporting.two_worlds import TwoWorlds, two_worlds
from prooflight.reporting.visibility_picture import VisibleOnPage
from prooflight.rng import stream
from prooflight.scans.scan import Scan
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.scans import MisprintRequest, SimulatedScan, scan_page
from prooflight.simulation.session import session_of
from prooflight.simulation.worlds import Gate

if TYPE_CHECKING:
    from prooflight.commissioning.training.train import Shown
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

FEWEST_PRINTS = 8
"""Fewest prints: a shorter job is printed several times, so that each kind of misprint can be shown next
to good prints."""
SAMPLE_PRINTS = 14
"""Prints of the sample job, from its first page to its last: each of its sections is shown, and four misprints."""
MISPRINT_SHARE = 2 / 7
LEAST_SEVERITY = 0.8
"""Least severity of misprints: severities of 0.8 to 1 of ``worlds.toml`` are seen at a glance."""
AT_A_GLANCE = Gate(blurred_peak_percent=math.inf, rms_percent=1.0)
"""Least visibility of misprints. assumed: a change that is seen at a glance is as much as 6 mm2 of solid
black on an A4 page, a short word."""
MARGIN_MM = 2.0
"""Margin of a widened line on either side of a page that is too wide for the prototype's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Print:
    """One sheet of the run."""

    index: int
    """Number of the sheet in the run, from 0."""
    page: int
    """Number of the job's page."""
    copy: int
    """Copy of the page; 1 for the first time this page is printed."""
    first_kind: str | None
    """Kind of misprint to try first; None: a good print."""

    @property
    def suffix(self) -> str:
        """Suffix that distinguishes later copies of a page from the first."""
        return f"-{self.copy}" if self.copy > 1 else ""


def plan(job_pages: int, prints: int | None, *, seed: int) -> tuple[Print, ...]:
    """Return the sheets to print, and which of them go wrong: about two in seven.

    ``prints`` is their number; None: the job once, or as often as makes 8. Fewer than the job has pages are
    spread evenly over it, and misprints over the kinds.
    """
    count = prints or max(job_pages, math.ceil(FEWEST_PRINTS / job_pages) * job_pages)
    rng = stream(seed, "demonstration-misprints")
    bad = sorted(rng.permutation(count)[: max(1, round(count * MISPRINT_SHARE))].tolist())
    step = max(len(KINDS) // len(bad), 1)
    kinds = {index: KINDS[turn * step % len(KINDS)] for turn, index in enumerate(bad)}
    pages = [i * job_pages // count if count < job_pages else i % job_pages for i in range(count)]
    return tuple(
        Print(index=i, page=page + 1, copy=i // job_pages + 1, first_kind=kinds.get(i))
        for i, page in enumerate(pages)
    )


DETECTOR: Final[dict[str, str]] = {"press": "matched_filter", "ideal": "chi-square"}
"""Detector that inspects the sheets: in the ideal world, that of the paper, the paper's first detector."""
DESIGNS: Final = 24
"""Designs printed to train the matched filter for the press; so few suffice, as its ranking was trained on
this press too."""


def demo_press(
    sizes_mm: Sequence[tuple[float, float]],
    *,
    world: str,
    seed: int,
    progress: Callable[[str], None],
    shown: Shown = lambda items, _total, _what: iter(items),
) -> Press:
    """Build the paper's press, with its second sensor and the matched-filter detector in the press world.

    Its line is widened if some page does not fit either way round.
    """
    press_file = PressFile.preset(TWO_SENSORS) if world == "press" else PressFile.prototype()
    geometry = press_file.geometry(press_file.camera())
    widest_mm = max(min(size) for size in sizes_mm)
    pixels = None
    if not geometry.sees(widest_mm):
        pixels = math.ceil((widest_mm + 2 * MARGIN_MM) / geometry.pixel_pitch_mm)
        progress(f"widening the line to {pixels} pixels for pages {widest_mm:.0f} mm wide")
    if world == "ideal":
        return build_press(press_file, seed=seed, pixels=pixels, progress=progress)
    return preset_once(press_file, pixels=pixels, designs=DESIGNS, seed=seed, progress=progress, shown=shown)


SAMPLE_SIZE_MM: Final = (210.0, 297.0)
"""Width and height of the pages of the sample job."""


def sample_job(path: Path, *, seed: int) -> tuple[str, ...]:
    """Write the sample job, and return the titles of its pages; the last that was composed is cached.

    It needs the extra [demo].
    """
    from prooflight.simulation.corpus.sample_job.sample_job import make_sample_job

    earlier = stored_sample_job(path, seed=seed)
    if earlier is not None:
        return earlier
    stored, titles = _place_of_sample_job(seed), make_sample_job(path, seed=seed).titles
    with suppress(OSError):  # where nothing can be written, each run composes it
        shutil.rmtree(stored.parent, ignore_errors=True)
        with whole_file(stored) as unfinished:
            shutil.copyfile(path, unfinished)
        with whole_file(stored.with_suffix(".json")) as unfinished:
            unfinished.write_text(json.dumps(titles), encoding="utf-8")
    return titles


def stored_sample_job(path: Path, *, seed: int) -> tuple[str, ...] | None:
    """Write the sample job as it was composed before, and return its titles; None: it is not in the cache."""
    stored = _place_of_sample_job(seed)
    with suppress(OSError, ValueError):
        titles = tuple(json.loads(stored.with_suffix(".json").read_text(encoding="utf-8")))
        with whole_file(path) as unfinished:
            shutil.copyfile(stored, unfinished)
        return titles
    return None


def _place_of_sample_job(seed: int) -> Path:
    key = f"{seed} {version('reportlab')} {program_digest()}"
    return user_folder("cache") / "sample-job" / f"{hashlib.sha256(key.encode()).hexdigest()}.pdf"


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintAndInspect:
    """The work on one print; small and picklable, so that it can be sent to worker processes."""

    job: JobSource
    press: Press
    world: str
    seed: int
    titles: tuple[str, ...] = ()
    """Title of each page of the job, for people; may be empty."""

    def __call__(self, sheet: Print) -> PageEntry:
        """Rip, print, scan, inspect and picture one sheet."""
        page = self._placed(sheet.page)
        page = replace(page, name=page.name + sheet.suffix)
        scan = self.scan(page, sheet)
        inspector = Inspector.of(self.press, DETECTOR[self.world])
        inspection = inspector.inspect(page, Scan(dn=scan.dn, name=page.name), seed=self.seed + sheet.index)
        title = self.titles[sheet.page - 1] if self.titles else ""
        return page_entry(page, inspection, self.press, truth=scan.misprint, title=title)

    def worlds(self, sheet: Print) -> TwoWorlds | None:
        """Compare the two worlds by a good print of a page in each, inspected by chi-square and by the
        matched filter.

        None: the page is too small to show the difference.
        """
        page, paper = self._placed(sheet.page), Inspector.of(self.press, DETECTOR["ideal"])
        good = replace(sheet, first_kind=None)
        ideal, printed = (replace(self, world=world).scan(page, good).dn for world in ("ideal", "press"))
        return two_worlds(
            ideal=paper.inspect(page, ideal),
            plain=paper.inspect(page, printed),
            matched_filter=Inspector.of(self.press, DETECTOR["press"]).inspect(page, printed),
            press=self.press,
        )

    def visible(self) -> VisibleOnPage | None:
        """Return the marks that would be caught on the job's first page."""
        return VisibleOnPage.of(Inspector.of(self.press, DETECTOR[self.world]), self._placed(1))

    def with_pictures(self, sheets: Sequence[Print]) -> _WithPictures:
        """Return the same work, which also makes the pictures of the report as a whole.

        Its first sheet brings the marks that would be caught; the first good print after it brings the two worlds, so
        that no sheet takes so long that others wait for it.
        """
        good = [sheet.index for sheet in sheets if sheet.first_kind is None]
        compared = next((index for index in good if index > 0), 0 if good else None)
        return _WithPictures(work=self, compared=compared if self.world == "press" else None)

    def _placed(self, number: int) -> Page:
        return self.press.geometry.lay(opened(self.job).page(number))

    def scan(self, page: Page, sheet: Print) -> SimulatedScan:
        """Return a print with a misprint of the kind to try first, or of the next that is visible on this page."""
        rng = stream(self.seed, "print", sheet.index)
        others = tuple(number for number in range(1, len(opened(self.job)) + 1) if number != sheet.page)
        requests: list[MisprintRequest | None] = [None]
        if sheet.first_kind is not None:
            turn = KINDS.index(sheet.first_kind)
            severity = float(rng.uniform(LEAST_SEVERITY, 1.0))
            kinds = KINDS[turn:] + KINDS[:turn]
            requests = [*(MisprintRequest(kind=kind, severity=severity) for kind in kinds), None]
        for request in requests:
            try:
                return scan_page(
                    page,
                    press=self.press,
                    request=request,
                    others=others,
                    fetch=self._placed,
                    rng=rng,
                    least=AT_A_GLANCE,
                    session=session_of(self.press, self.seed, self.world),
                )
            except RequestError:
                continue  # this kind shows nothing on this page
        raise AssertionError  # the last request is for a good print, which never fails


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintShown:
    """Part of the report that comes with one sheet."""

    entry: PageEntry
    worlds: TwoWorlds | None
    visible: VisibleOnPage | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _WithPictures:
    work: PrintAndInspect
    compared: int | None
    """Number, in the run, of the print that is shown in both worlds."""

    def __call__(self, sheet: Print) -> PrintShown:
        return PrintShown(
            entry=self.work(sheet),
            worlds=self.work.worlds(sheet) if sheet.index == self.compared else None,
            visible=self.work.visible() if sheet.index == 0 else None,
        )
