"""Kinds of page, by what a page prints: so that a promise can say for which pages it was learned."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.matched_filter.fit.modes import PAGE_FEATURES

if TYPE_CHECKING:
    from numpy.typing import NDArray

KINDS: Final = ("text", "mixed", "photo", "sparse")
SPARSE_BELOW: Final = 0.02
"""Share of the page with ink below which it is sparse. (assumed: a few lines of type)"""
PHOTO_FROM: Final = 0.35
"""Area of tints, summed over inks, from which a page is a photo. (assumed: a picture on half of a page)"""
TEXT_BELOW: Final = 0.12
"""Area of tints below which a page is text: type that the lens blurs counts as tint. (assumed)"""


def page_kind(page_features: NDArray[np.floating]) -> str:
    """Return the kind, of ``KINDS``, of a page by its features (``fit.modes.page_features``).

    Tints are each ink's area without its solids.
    """
    printed = np.exp(page_features[8]) - 1e-3
    tints = (np.exp(page_features[:4]) - 1e-4 - page_features[4:8]).clip(min=0).sum()
    if printed < SPARSE_BELOW:
        return "sparse"
    if tints >= PHOTO_FROM:
        return "photo"
    return "text" if tints < TEXT_BELOW else "mixed"


def kinds_of(page_features: NDArray[np.floating]) -> tuple[tuple[str, int], ...]:
    """Return how many of these pages (pages, PAGE_FEATURES) are of each kind, in the order of ``KINDS``.

    Empty without pages, and where their features are of another version.
    """
    if not len(page_features) or page_features.shape[1] != PAGE_FEATURES:
        return ()
    counts = Counter(page_kind(row) for row in page_features)
    return tuple((kind, counts[kind]) for kind in KINDS)
