"""Kind of a misprint, as named in ``worlds.toml``, from the strongest families of evidence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from prooflight.detectors.placing import WRONG_PAGE_KIND

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.statistics.statistic import Observed, Statistic
    from prooflight.registration.register import Registration

SMALL_TILES: Final = 8
"""Maximum size of boxes that indicate a spot or a void: 4 mm. [tiles]"""
UNKNOWN: Final = "unknown"
KIND_OF_FAMILY: Final = {
    "streak": "streak",
    "ghost": "ghost-smear",
    "wave": "banding",
    "swap": "swapped-planes",
    "moved": "plane-register",
    "step": "density",
}
"""Kinds of families that indicate one kind alone."""
DENSITY: Final = ("gain", "gain-all", "gain-rms", "dot", "tilt", "shape", "shape-most")
"""Amounts of the fit that state how much ink there is."""
OTHER_CONTENT: Final = ("unlike", "foreign")
"""Amounts of placement that depend on the page's content; the others state its place, or that this is
unknown."""
FAMILIES: Final = {
    "box": "places that are lighter or darker than in good prints",
    "apart": "places that stand out from the rest of the page",
    "flat": "places that stand out from the page's flat parts",
    "spread": "differences spread over many places",
    "excess": "more deviating places than good prints have",
    "mark": "small places that are darker or lighter than places of their kind",
    **dict.fromkeys(("streak", "line", "calm"), "lines along the travel"),
    "band": "lines and waves across the travel",
    **dict.fromkeys(("wave", "swell"), "waves along the travel"),
    **dict.fromkeys(("ghost", "echo", "double"), "echoes of the page's own content"),
    **dict.fromkeys(("slant", "askew"), "straight lines at a slant"),
    "step": "an ink that deviates in a part of the page",
    "swap": "inks that are exchanged",
    "moved": "ink planes at another position",
    "fit": "deviations of the page as a whole",
    "place": "the position of page and ink planes, and their likeness to the design",
    "energy": "differences of any kind",
    "glyph": "letters and digits that are not the page's",
}
"""Descriptions of the first words of statistics."""


def family_text(label: str) -> str | None:
    """Return a description of the statistics with this first word; None: there is none.

    >>> family_text("streak")
    'lines along the travel'
    """
    return FAMILIES.get(label)


def kind_of(statistic: Statistic) -> str:
    """Return the kind of misprint that a statistic indicates.

    >>> from prooflight.detectors.matched_filter.statistics.statistic import Statistic
    >>> [kind_of(Statistic.parse(key)) for key in ("box/add-C+/4", "streak/light/2/full")]
    ['spots-voids', 'streak']
    """
    match statistic.family:
        case "place" if statistic.mode in ("plane", "planes"):
            return "plane-register"
        case "place":
            return WRONG_PAGE_KIND if statistic.mode in OTHER_CONTENT else UNKNOWN
        case "fit" if statistic.mode == "plane":
            return "plane-register"
        case "fit":
            return "density" if statistic.mode in DENSITY else UNKNOWN
        case "box" | "spread":
            return _of_box(statistic)
        case "mark":
            return "spots-voids"
    return KIND_OF_FAMILY.get(statistic.family, UNKNOWN)


def named(strongest: Sequence[tuple[str, Observed]]) -> str:
    """Return the kind that the evidence indicates, the strongest first, without training on kinds.

    Tiles that do not look as designed are the least specific indication.
    """
    kinds = [kind_of(statistic.statistic) for _, statistic in strongest]
    specific = [kind for kind in kinds if kind != UNKNOWN]
    return next((kind for kind in specific if kind != WRONG_PAGE_KIND), specific[0] if specific else UNKNOWN)


def supported(kind: str, registration: Registration, inks: str) -> str:
    """Return a kind, or another one that is possible.

    It is unknown if it is ``wrong-page`` and the page was not found: any page then looks like another. A page of one
    of ``inks`` has no planes to swap: ink is off.
    """
    if kind == "swapped-planes" and len(inks) < 2:
        return "density"
    return UNKNOWN if kind == WRONG_PAGE_KIND and not registration.located else kind


def _of_box(box: Statistic) -> str:
    small = box.size is not None and box.size <= SMALL_TILES
    if box.mode == "blur":
        return "local-blur"
    if box.mode == "void":
        return "spots-voids" if small and box.sign != "+" else "missing-content"
    if small:
        return "spots-voids"
    return "missing-plane" if box.mode in ("gain", "gain-all") else "scum"
