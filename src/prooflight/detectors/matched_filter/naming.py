"""From the families of evidence that say most to the kind of misprint, in the words of ``worlds.toml``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.detectors.matched_filter.statistics.families import Statistic

SMALL_TILES: Final = 8
"""Boxes of at most so many tiles, 4 mm, are a spot's or a void's."""
UNKNOWN: Final = "unknown"
FIRST: Final = {
    "streak": "streak",
    "line": "streak",
    "calm": "streak",
    "ghost": "ghost-smear",
    "echo": "ghost-smear",
    "double": "ghost-smear",
    "band": "banding",
    "wave": "banding",
    "swell": "banding",
    "swap": "swapped-planes",
    "moved": "plane-register",
}
"""Kinds by the first word of a statistic's name."""


def kind_of(statistic: Statistic) -> str:
    """What kind of misprint a statistic speaks of.

    >>> from prooflight.detectors.matched_filter.statistics.families import Statistic
    >>> kind_of(Statistic(name="box/add-C+/4", value=9.0)), kind_of(Statistic(name="streak/light/2/full", value=9.0))
    ('spots-voids', 'streak')
    """
    first, *rest = statistic.name.split("/")
    if first in FIRST:
        return FIRST[first]
    if first == "place":
        return "plane-register" if rest[0].startswith("plane") else "wrong-page"
    if first == "fit":
        return _of_fit(rest[0])
    if first in ("box", "apart", "flat", "spread"):
        return _of_box(rest[0].rstrip("+-"), int(rest[1]), darker=rest[0].endswith("+"))
    return UNKNOWN


def named(strongest: Sequence[tuple[str, Statistic]]) -> tuple[str, Statistic | None]:
    """Kind, and the statistic with a place that speaks for it, from what says most; most telling first."""
    if not strongest:
        return UNKNOWN, None
    kind = next((found for _, statistic in strongest if (found := kind_of(statistic)) != UNKNOWN), UNKNOWN)
    place = next((statistic for _, statistic in strongest if statistic.box[0] == statistic.box[0]), None)
    return kind, place


def _of_fit(name: str) -> str:
    if name.startswith("plane"):
        return "plane-register"
    if name.startswith(("gain", "dot", "tilt", "shape")):
        return "density"
    return UNKNOWN


def _of_box(mode: str, tiles: int, *, darker: bool) -> str:
    if mode == "blur":
        return "local-blur"
    if mode == "void":
        return "missing-content" if darker or tiles > SMALL_TILES else "spots-voids"
    if tiles <= SMALL_TILES:
        return "spots-voids"
    return "missing-plane" if mode.startswith("gain") else "scum"
