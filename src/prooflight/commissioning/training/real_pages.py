"""Real good pages take the place of simulated ones: the threshold is set anew, and what is promised said anew."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from prooflight.press.artefact import Press

FEWEST_REAL: Final = 20
"""Pages: fewer could not even promise one false alarm in 20."""
SEEN: Final = "real_pages"
"""In ``Press.origin``: digests of the scans learned from, so that none counts twice."""


def new_scans(press: Press, digests: Mapping[str, str]) -> dict[str, str]:
    """Of digests by page, those of scans that this press has not learned from and that do not come twice."""
    seen = set(press.origin.get(SEEN, "").split())
    found: dict[str, str] = {}
    for page, digest in digests.items():
        if digest not in seen:
            seen.add(digest)
            found[page] = digest
    return found


def recalibrated(
    press: Press, scores: Mapping[str, float], digests: Mapping[str, str], *, false_alarm_rate: float
) -> Press:
    """The press after good pages scored so, by page; digests: of their scans.

    A page of the job is a design and counts once. RequestError: the press was not taught our detector, or altogether
    there are too few real pages.
    """
    ours = press.ours
    if ours is None:
        remedy = "build it with `prooflight press build --detector quick`"
        raise RequestError("press", f"{press.name} was not taught our detector", remedy=remedy)
    real = np.concatenate([ours.real, np.array([scores[page] for page in digests], np.float64)])
    if real.size < FEWEST_REAL:
        what = f"{real.size} good pages that were not learned from before"
        raise RequestError(
            "good pages", what, remedy=f"give {FEWEST_REAL} or more, each another page of a job"
        )
    learned = CalibratedDetector.calibrated(
        ours.model,
        simulated=ours.simulated,
        real=real,
        false_alarm_rate=false_alarm_rate,
        misprint_rate=ours.misprint_rate,
    )
    seen = " ".join([*press.origin.get(SEEN, "").split(), *digests.values()])
    return replace(press, ours=learned, origin=dict(press.origin) | {SEEN: seen})
