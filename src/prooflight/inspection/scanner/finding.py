"""Which scanned page shows which page of the job, and where it lies there.

Sheets come out of a feeder in any order and either way up, so each scan is compared with the pages of the job rather
than taken for the page whose turn it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from scipy.optimize import linear_sum_assignment

from prooflight.errors import ScanError
from prooflight.inspection.scanner.placing import (
    LEAST_LIKENESS,
    NOTHING_SHOWN,
    NOWHERE,
    ExpectedPage,
    Whereabouts,
    agreement_of,
    channels_of,
    drawn_scan,
    most_likely,
    placed,
    seen_coarsely,
)
from prooflight.pages.job import JobSource, opened
from prooflight.scans.recorded import RecordedScan

if TYPE_CHECKING:
    from prooflight.press.artefact import Press
    from prooflight.scans.scanner.feeder import FeederPrior
    from prooflight.scans.scanner.reading import ScannedPage, ScannerSettings

NEAR_PAGES: Final = 16
"""Distance in the job within which a scan is compared with pages before and after the one whose turn it is."""
ALIKE: Final = 0.1
"""Difference of likeness within which pages are told apart by their drawn scan, pixel by pixel."""
PAGES_CACHED: Final = 2 * NEAR_PAGES + 1
"""Number of pages that are kept ready, some 60 MB each of A4 at 150 dpi."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedScan(RecordedScan):
    """Scanned page with its place; stands for the recorded scan of a page of the job."""

    scan: ScannedPage
    where: Whereabouts
    trouble: str = ""
    """Reason why the page could not be placed; empty: it could."""

    @property
    def nowhere(self) -> bool:
        """Whether it is not even known roughly where the page lies, so that no finer search could find it."""
        return self.where is NOWHERE or self.trouble == NOTHING_SHOWN

    @classmethod
    def of(cls, scan: ScannedPage, where: Whereabouts, trouble: str, *, sensors: int) -> Self:
        """Return a scan with its place."""
        first = scan.number - 1
        return cls(
            path=scan.path, first_image=first, sensors=sensors, scan=scan, where=where, trouble=trouble
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedPages:
    """Pages of a job as they are expected in scans."""

    job: JobSource
    press: Press
    feeder: FeederPrior

    def __call__(self, number: int) -> ExpectedPage:
        """Return page ``number``, from 1; JobError: it cannot be drawn or does not fit the press."""
        page = self.press.geometry.lay(opened(self.job).page(number))
        return ExpectedPage.of(page, self.press.press_context().predict(page), self.press, self.feeder)


def placed_scans(
    scans: Sequence[ScannedPage],
    pages: ExpectedPages,
    count: int,
    *,
    settings: ScannerSettings,
    progress: Callable[[str], None] = lambda _step: None,
) -> list[tuple[int, PlacedScan | None]]:
    """Return every page of a job of ``count`` pages with the scan that shows it, in job order; None: none does.

    A scan that shows no page of the job is given to one that has none. ScanError: there are more scans than pages, or
    one cannot be read.
    """
    if len(scans) > count:
        source = scans[0].path if len({scan.path for scan in scans}) == 1 else scans[0].path.parent
        raise ScanError(source, f"holds {len(scans)} scans", remedy=f"the job has {count} pages")
    kept, sensors = lru_cache(maxsize=PAGES_CACHED)(pages), len(pages.press.sensors)
    likeness = np.zeros((len(scans), count))
    results: list[PlacedScan] = []
    for turn, scan in enumerate(scans):
        progress(f"looking for the page that {scan.name} shows")
        try:
            picture = channels_of(scan.read(settings), sensors)
        except ScanError as error:  # it costs the page that is left for it, and no other
            results.append(PlacedScan.of(scan, NOWHERE, f"{error.what}; {error.remedy}", sensors=sensors))
            continue
        near = range(max(1, turn + 1 - NEAR_PAGES), min(count, turn + 1 + NEAR_PAGES) + 1)
        starts = {number: most_likely(seen_coarsely(picture, kept(number)), kept(number)) for number in near}
        best = max(starts, key=lambda number: starts[number].likeness)
        greatest = starts[best].likeness
        expected = kept(best).fed_by(pages.feeder.of_scan(turn))
        where, trouble = placed(picture, expected, starts[best], pages.press)
        results.append(PlacedScan.of(scan, where, trouble, sensors=sensors))
        for number, start in starts.items():
            likeness[turn, number - 1] = start.likeness
        close = [number for number in near if starts[number].likeness >= greatest - ALIKE]
        if len(close) > 1 and greatest >= LEAST_LIKENESS:
            for number in close:  # pages of one size and the same frame: one place serves all
                drawn = drawn_scan(picture, kept(number).page, where, pages.press)
                likeness[turn, number - 1] = greatest + ALIKE * agreement_of(drawn, kept(number))
    rows, columns = linear_sum_assignment(-likeness)
    by_page = {
        int(column) + 1: _doubted(results[row], float(likeness[row, column]))
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
    }
    return [(number, by_page.get(number)) for number in range(1, count + 1)]


def _doubted(scan: PlacedScan, likeness: float) -> PlacedScan:
    """Return a scan that shows nothing of the page that was left for it with that reason."""
    if scan.trouble or likeness >= LEAST_LIKENESS:
        return scan
    return replace(scan, trouble=NOTHING_SHOWN)
