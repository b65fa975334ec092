"""Replacement of simulated good pages by real ones, by which adaptation and false-alarm rate are fitted again."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.training.adapting import fit_for
from prooflight.commissioning.training.learn import Pages
from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from prooflight.detectors.matched_filter.calibrated import ScannedPage
    from prooflight.press.artefact import Press

FEWEST_REAL: Final = 20
"""Least number of pages: fewer could not even guarantee one false alarm in 20."""
SEEN: Final = "real_pages"
"""Key in ``Press.origin`` of the digests of the scans used in training, so that none counts twice."""


def new_scans(press: Press, digests: Mapping[str, str]) -> dict[str, str]:
    """Return the digests, by page, of scans that this press was not trained on and that do not come twice."""
    seen = set(press.origin.get(SEEN, "").split())
    fresh: dict[str, str] = {}
    for page, digest in digests.items():
        if digest not in seen:
            seen.add(digest)
            fresh[page] = digest
    return fresh


def recalibrated(
    press: Press, pages: Sequence[ScannedPage], digests: Mapping[str, str], *, false_alarm_rate: float
) -> Press:
    """Adapt the press to these good pages; digests: of the scans, by page, of those to train on.

    Real pages take the place of simulated ones, and add up over calls. A page of the job is a design and
    counts once. RequestError: the press was not trained with the matched-filter detector, or altogether there
    are too few real pages.
    """
    detector = press.ours
    if detector is None:
        remedy = "build it with `prooflight press build --detector quick`"
        raise RequestError("press", f"{press.name} was not taught our detector", remedy=remedy)
    fresh = [page for page in pages if page.name in digests]
    if astray := [page.name for page in fresh if page.another]:
        what = f"{', '.join(astray[:5])} {'shows' if len(astray) == 1 else 'show'} another page"
        raise RequestError("good pages", what, remedy="leave out what is not good")
    values = [detector.pages.values[: detector.real], *(page.values[None] for page in fresh)]
    features = [detector.pages.page_features[: detector.real], *(page.page_features[None] for page in fresh)]
    before = detector.pages.glyphs[: detector.real]
    count = detector.real + len(fresh)
    if count < FEWEST_REAL:
        what = f"{count} good pages that were not learned from before"
        raise RequestError(
            "good pages", what, remedy=f"give {FEWEST_REAL} or more, each another page of a job"
        )
    good = Pages(
        values=np.concatenate(values),
        page_features=np.concatenate(features),
        design=np.arange(count),
        kind=np.full(count, ""),
        press=np.zeros(count, np.int64),
    )
    learned = fit_for(
        detector.model,
        detector.references,
        good,
        np.zeros(count, bool),
        false_alarm_rate=false_alarm_rate,
        misprint_rate=detector.misprint_rate,
        real=True,
        glyphs=np.append(before, [page.glyphs for page in fresh]) if before.size == detector.real else None,
    )
    variations = [detector.pages.variation, *(page.variation[None] for page in fresh)]
    learned = replace(learned, pages=replace(learned.pages, variation=np.concatenate(variations)))
    seen = " ".join([*press.origin.get(SEEN, "").split(), *digests.values()])
    return replace(press, ours=learned, origin=dict(press.origin) | {SEEN: seen})
