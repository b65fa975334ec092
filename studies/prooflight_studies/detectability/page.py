"""``detectability.md``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight_studies.detectability.findings import DEFECTS, NAMES, PRINTS, Caught

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.press.artefact import Press
    from prooflight_studies.detectability.closed_form import Reach
    from prooflight_studies.detectability.findings import JobReach


def page_lines(
    job: JobReach, press: Press, ours: CalibratedDetector, *, trials: int, seed: int
) -> Iterator[str]:
    """Its lines."""
    yield "# What would be caught before it is printed"
    yield ""
    yield (
        f"Press {press.name} ({len(press.sensors)} sensor{'s' * (len(press.sensors) > 1)}, camera pixels of "
        f"{press.geometry.pixel_pitch_mm:.3f} mm on the page), our detector; {ours.promise}. The least that is "
        "caught in 99 of 100 prints of the press world: medians over the page with the 5th and 95th percentile in "
        "brackets, and the share of places where nothing of the kind is."
    )
    yield ""
    if job.alarming:
        yield (
            f"Not foretold: {', '.join(job.alarming)}, of which {PRINTS} good prints alarmed, so that whatever were "
            "wrong would drown. Most likely no design that taught the press is like that."
        )
        yield ""
    yield from _reach_lines((page.name, page.reach) for page in job.pages)
    yield "The same, caught in every second print:"
    yield ""
    yield from _reach_lines((page.name, page.half) for page in job.pages)
    yield (
        "How strong a defect must be was learned from prints of these pages with such defects: for each page from its "
        "own first, and as far as they are few from those of the others. Strength: what the defect adds to the "
        "statistic that tells it best, in standard deviations of good prints (of a spot: of the noise of the pixels "
        "under it, edges left out), in closed form from the page's own information."
    )
    yield ""
    yield "Strengths that are caught in every second print, and in 99 of 100:"
    yield ""
    yield "| page | " + " | ".join(NAMES.values()) + " |"
    yield "|---" * (len(NAMES) + 1) + "|"
    for page in job.pages:
        strengths = (" - ".join(_two_digits(one) for one in page.wanted[defect]) for defect in NAMES)
        yield f"| {page.name} | " + " | ".join(strengths) + " |"
    yield "| prints of all pages | " + " | ".join(str(job.prints[defect]) for defect in NAMES) + " |"
    yield ""
    yield (
        f"Verified: {trials} further prints of each page with each defect at a place drawn at random, just as strong "
        f"as should be caught at 99 %, and as many good prints; every print by itself, one press day a page, seed "
        f"{seed}."
    )
    yield ""
    yield (
        "| page | "
        + " | ".join(f"{name} caught" for name in NAMES.values())
        + " | good prints that alarmed |"
    )
    yield "|---" * (len(NAMES) + 2) + "|"
    rows = [(page.name, page.verified) for page in job.pages]
    every = {
        defect: Caught(
            of=sum(found[defect].of for _, found in rows),
            caught=sum(found[defect].caught for _, found in rows),
        )
        for defect in (*DEFECTS, "none")
    }
    for name, found in [*rows, ("all", every)]:
        yield f"| {name} | " + " | ".join(_share(found[defect]) for defect in (*DEFECTS, "none")) + " |"
    yield ""
    for page in job.pages:
        yield f"![{page.name}]({page.picture})"
        yield ""


def _reach_lines(pages: Iterable[tuple[str, Reach]]) -> Iterator[str]:
    yield (
        "| page | black spot [mm] | nowhere | black streak of 0.5 mm [% ink] | nowhere | "
        "loss of all inks in 16 mm [%] | nowhere | loss of one ink all over [%] |"
    )
    yield "|---" * 8 + "|"
    for name, reach in pages:
        inks = ", ".join(_of_ink(letter, least) for letter, least in reach.inks_percent.items())
        cells = (_spread(a) for a in (reach.spot_mm, reach.streak_percent, reach.patch_percent))
        yield f"| {name} | " + " | ".join(" | ".join(cell) for cell in cells) + f" | {inks} |"
    yield ""


def _spread(values: NDArray[np.float64]) -> tuple[str, str]:
    known = values[~np.isnan(values)]
    finite = known[np.isfinite(known)]
    nowhere = f"{1 - finite.size / max(known.size, 1):.0%}"
    if not finite.size:
        return "-", nowhere
    low, middle, high = np.percentile(finite, (5, 50, 95))
    return f"{middle:.2g} [{low:.2g}-{high:.2g}]", nowhere


def _two_digits(value: float) -> str:
    """Two significant ones, and never as a power of ten."""
    return f"{float(f'{value:.2g}'):g}"


def _of_ink(letter: str, least: float) -> str:
    return f"{letter} {least:.0f}" if np.isfinite(least) else f"{letter} -"


def _share(found: Caught) -> str:
    return f"{found.caught} of {found.of}" if found.of else "-"
