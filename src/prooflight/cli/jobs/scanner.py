"""``prooflight inspect --scanner``: press and pairs of pages and scans where an office scanner is the camera."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError, ScanError
from prooflight.inspection.scanner.finding import ExpectedPages, placed_scans
from prooflight.pages.job import JobSource
from prooflight.press.artefact import Press
from prooflight.press.scanner import feeder_of, field_mm, press_dpi, scanner_press_file
from prooflight.scans.scanner.reading import ScannedPage, ScannedPicture, ScannerSettings, Tone

if TYPE_CHECKING:
    from prooflight.commissioning.training.train import Shown
    from prooflight.inspection.job import Pair
    from prooflight.pages.zones.zones_file import JobZones

DESIGNS: Final = 24
"""Designs printed to train the matched filter for a scanner, as for the demonstration's press."""
SEED: Final = 1
MOST_DPI: Final = 400.0
"""Resolution beyond which scans are averaged for the drawn way: marks that people see have tens of pixels. assumed"""
DRAWN: Final = "drawn"


def scanner_settings(tone: str | None, dpi: float | None) -> ScannerSettings:
    """Return the settings of ``--tone`` and ``--scan-dpi``; RequestError: one of them is nothing of the kind."""
    return ScannerSettings(tone=None if tone is None else Tone.parse(tone), dpi=dpi)


def scanner_press(
    job: Path,
    picture: ScannedPicture,
    *,
    profile: Path | None,
    train: bool,
    as_fine: bool,
    progress: Callable[[str], None],
    shown: Shown,
) -> Press:
    """Return a press of the scanner's preset for scans like ``picture``, from the cache where it holds it.

    train: whether the matched-filter detector is trained, which takes minutes when it is done first. as_fine: whether
    it sees as finely as the scan, as the drawn way does; the matched filter wants what a device sharpens averaged away.
    Errors as of reading job and scans.
    """
    from prooflight.commissioning.build import build_press
    from prooflight.commissioning.training.cache import COMPOSED_SEED, cached_press
    from prooflight.commissioning.training.train import trained
    from prooflight.simulation.corpus.corpus import Corpus

    with JobSource(path=job, dpi=1.0, profile=profile).open() as opened:
        sizes_mm = opened.page_sizes_mm
    finest = max(picture.dpi)
    press_file = scanner_press_file(
        dpi=min(finest, MOST_DPI) if as_fine else press_dpi(finest),
        grey=len(picture.light) == 1,
        width_mm=field_mm(sizes_mm),
    )

    def build() -> Press:
        progress("building a press of the scanner, once for all scans of this resolution")
        press = build_press(press_file, seed=SEED, progress=progress)
        if not train:
            return press
        corpus = Corpus(seed=COMPOSED_SEED + SEED, dpi=press.dpi)
        return trained(press, corpus, designs=DESIGNS, seed=SEED, shown=shown)

    return cached_press(f"{press_file.text} {train} {DESIGNS} {SEED}", build, progress=progress)


def first_readable(scans: Sequence[ScannedPage], settings: ScannerSettings) -> ScannedPicture:
    """Return the first scan that can be read; ScanError: none can, and why the first cannot."""
    first: ScanError | None = None
    for scan in scans:
        try:
            return scan.read(settings)
        except ScanError as error:
            first = first or error
    assert first is not None
    raise first


def scanner_pairs(
    source: JobSource,
    count: int,
    scans: Sequence[ScannedPage],
    press: Press,
    settings: ScannerSettings,
    *,
    progress: Callable[[str], None],
) -> list[Pair]:
    """Return every page of a job of ``count`` pages with the scan that shows it; see ``placed_scans``."""
    pages = ExpectedPages(job=source, press=press, feeder=feeder_of(press))
    return list(placed_scans(scans, pages, count, settings=settings, progress=progress))


def zones_of_scans(path: Path | None, sizes_mm: Sequence[tuple[float, float]]) -> JobZones | None:
    """Return the ignored zones of a run by the drawn way, which have no price; None: there are none.

    JobError: the file holds no zones, or they do not fit the pages. RequestError: it holds careful zones.
    """
    if path is None:
        return None
    from prooflight.pages.zones.zones_file import JobZones

    zones = JobZones.read(path, sizes_mm)
    if "careful" in zones.kinds:
        what = "holds careful zones, which this detector does not support"
        raise RequestError(path, what, remedy="leave them out, or choose --detector matched_filter")
    return zones
