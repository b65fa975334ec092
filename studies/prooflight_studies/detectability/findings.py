"""Results of the study of detectability on each page of a job."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight_studies.harness.psychometric import SURE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.press.artefact import Press
    from prooflight_studies.detectability.closed_form import Reach

PRINTS: Final = 4
"""Number of good prints of a page, one of which must pass."""
NAMES: Final = {"spot": "spots", "streak": "streaks", "patch": "pale patches", "ink": "pale inks"}
DEFECTS: Final = tuple(NAMES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Caught:
    """Counts of one defect on one page, printed as faint as should be caught at 99 %."""

    of: int
    caught: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageReach:
    """Results of one page of the job."""

    name: str
    reach: Reach
    half: Reach
    """Least defects that are caught in every second print."""
    wanted: dict[str, tuple[float, float]]
    """Strengths that are caught in every second print and in 99 of 100, by defect."""
    verified: dict[str, Caught]
    """Counts by defect; ``none``: good prints that alarmed."""

    @property
    def picture(self) -> str:
        """File name of the page's picture."""
        return f"detectability-{self.name}.png"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JobReach:
    """Results of all pages."""

    pages: list[PageReach]
    prints: dict[str, int]
    """Number of prints from which the necessary strength was learned, by defect."""
    alarming: list[str]
    """Names of pages of which ``PRINTS`` good prints alarmed, so that a defect could not be distinguished."""


def job_results(
    job: JobReach, press: Press, detector: CalibratedDetector, *, trials: int, seed: int
) -> dict[str, Any]:
    """Return all figures of the page; trials: prints of each page and defect for verification."""
    return {
        "press": press.name,
        "sensors": len(press.sensors),
        "pixel_pitch_mm": press.geometry.pixel_pitch_mm,
        "promise": detector.guarantee,
        "trials": trials,
        "seed": seed,
        "good_prints": PRINTS,
        "asked": SURE,
        "names": NAMES,
        "prints": job.prints,
        "alarming": job.alarming,
        "pages": [
            {
                "name": page.name,
                "picture": page.picture,
                "sure": _of_reach(page.reach),
                "half": _of_reach(page.half),
                "wanted": page.wanted,
                "verified": page.verified,
            }
            for page in job.pages
        ],
        "verified": {
            defect: Caught(
                of=sum(page.verified[defect].of for page in job.pages),
                caught=sum(page.verified[defect].caught for page in job.pages),
            )
            for defect in (*DEFECTS, "none")
        },
    }


def _of_reach(reach: Reach) -> dict[str, Any]:
    return {
        "spot_mm": _spread(reach.spot_mm),
        "streak_percent": _spread(reach.streak_percent),
        "patch_percent": _spread(reach.patch_percent),
        "inks": [{"ink": letter, "percent": least} for letter, least in reach.inks_percent.items()],
    }


def _spread(values: NDArray[np.float64]) -> dict[str, float | None]:
    """Return percentiles over the page, and the share of its places where values are infinite: nothing is caught."""
    on_page = values[~np.isnan(values)]
    finite = on_page[np.isfinite(on_page)]
    low, middle, high = np.percentile(finite, (5, 50, 95)).tolist() if finite.size else (None, None, None)
    nowhere = 1 - finite.size / max(on_page.size, 1)
    return {"low": low, "middle": middle, "high": high, "nowhere": nowhere}
