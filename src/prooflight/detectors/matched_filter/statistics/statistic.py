"""Statistics by which a page is judged: their identity, value and place.

Artefacts, rows and verdicts store a statistic's key, such as ``box/gain-C+/8``; only ``Statistic.parse``
reads it. Its first word encodes two things: what is searched for, and the reference that it is compared with.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS

Box = tuple[float, float, float, float]
"""x, y, width, height. [mm]"""
NOWHERE: Final[Box] = (np.nan,) * 4


class Reference(Enum):
    """Reference that a page is compared with."""

    GOOD_PRINTS = "good prints"
    OWN_PAGE = "own page"
    FLAT_AREAS = "flat areas"
    """Flat areas of the same page, away from edges."""


GOOD_PRINTS, OWN_PAGE, FLAT_AREAS = Reference
LABELS: Final = {
    ("box", OWN_PAGE): "apart",
    ("box", FLAT_AREAS): "flat",
    ("streak", OWN_PAGE): "line",
    ("streak", FLAT_AREAS): "calm",
    ("wave", GOOD_PRINTS): "band",
    ("wave", OWN_PAGE): "wave",
    ("wave", FLAT_AREAS): "swell",
    ("ghost", OWN_PAGE): "echo",
    ("ghost", FLAT_AREAS): "double",
    ("energy", OWN_PAGE): "excess",
    ("slant", OWN_PAGE): "askew",
}
"""First words of keys, by family and reference; otherwise the word is the family, compared with good
prints."""
_MEANINGS: Final = {label: meaning for meaning, label in LABELS.items()}
PAGE_WIDE: Final = ("fit", "place", "energy")
"""First words of statistics each of which is a cause of its own."""
OF_ALL_SORTS: Final = ("ghost", "swap", "energy")
"""Families whose statistics make up one cause."""
SCREEN_MODES: Final = ("light", "void")
"""Modes that need none of an ink's own images."""
SCREEN_FAMILIES: Final = ("box", "spread", "streak", "wave", "slant")
"""Families whose statistics depend on one mode each."""


class Statistic(NamedTuple):
    """Identity of a statistic: subject of the search, and reference; unused fields are empty or None."""

    family: str
    """box, streak, wave, ghost, spread, energy, swap, step, slant, moved, mark; of the page as a whole: fit,
    place."""
    mode: str = ""
    """How ink or light is off, such as gain, void, light; for fit and place the amount; for marks the class
    of place."""
    ink: str = ""
    """A letter of CMYK, or two for swapped inks."""
    sign: str = ""
    """``+``: more of the mode; ``-``: less."""
    size: int | None = None
    """Size of boxes and lines [tiles], of marks [binned pixels]; for streaks of ``local_evidence.WIDTHS``;
    for ghosts the index in ``GHOST_BOXES_MM``."""
    part: str = ""
    """One of several numbers of one cause, such as a streak's span."""
    reference: Reference = GOOD_PRINTS

    @classmethod
    def parse(cls, key: str) -> Self:
        """Read a ``key``, or a cause, which has no size.

        >>> Statistic.parse("box/gain-C+/8")[:5], Statistic.parse("calm/void/2/full").reference.value
        (('box', 'gain', 'C', '+', 8), 'flat areas')
        """
        return cls._make(_parsed(key))

    @property
    def key(self) -> str:
        """The string that identifies it."""
        middle = self.mode + "-" * bool(self.mode and self.ink) + self.ink + self.sign
        size = "" if self.size is None else str(self.size)
        return "/".join(part for part in (self.label, middle, size, self.part) if part)

    @property
    def label(self) -> str:
        """First word of the key."""
        return LABELS.get((self.family, self.reference), self.family)

    @property
    def cause(self) -> str:
        """Key of the cause that it supports: one cause at all sizes, or a number that is one by itself.

        >>> [Statistic.parse(key).cause for key in ("apart/void-/4", "streak/void/1/full", "ghost/C/0", "place/skew")]
        ['apart/void-', 'streak/void', 'ghost', 'place/skew']
        """
        if self.label in PAGE_WIDE:
            return self.key
        if self.family in OF_ALL_SORTS:
            return self.label
        return self._replace(size=None, part="").key


@lru_cache(maxsize=4096)
def _parsed(key: str) -> Statistic:
    """Parse a key; cached, because a press is read several times and has a thousand of them."""
    label, *rest = key.split("/")
    mode = ink = sign = ""
    if rest and not _is_size(rest[0]):
        first = rest.pop(0)
        sign = first[-1] if first[-1:] in ("+", "-") else ""
        mode, ink = mode_and_ink(first.removesuffix(sign))
    size = int(rest.pop(0)) if rest and _is_size(rest[0]) else None
    family, reference = _MEANINGS.get(label, (label, GOOD_PRINTS))
    return Statistic(family, mode, ink, sign, size, "/".join(rest), reference)


def in_screen(statistic: Statistic) -> bool:
    """Return whether a statistic is computed for every page.

    These decide for which pages the others are needed.

    >>> [in_screen(Statistic.parse(key)) for key in ("apart/void-/4", "box/add-K+/4", "place/skew", "ghost/C/0")]
    [True, False, True, False]
    """
    return statistic.label in (*PAGE_WIDE, "excess", "mark") or (
        statistic.family in SCREEN_FAMILIES and statistic.mode in SCREEN_MODES
    )


def mode_and_ink(name: str) -> tuple[str, str]:
    """Split a mode's name into mode and ink, one of which may be empty.

    >>> mode_and_ink("gain-C"), mode_and_ink("gain-all"), mode_and_ink("CM")
    (('gain', 'C'), ('gain-all', ''), ('', 'CM'))
    """
    mode, dash, ink = name.rpartition("-")
    if bool(dash) == bool(mode) and ink and not set(ink) - set(INK_LETTERS):
        return mode, ink
    return name, ""


def _is_size(text: str) -> bool:
    return text.isdecimal() and text == str(int(text))


@dataclass(frozen=True, slots=True, kw_only=True)
class Observed:
    """Value and place of one statistic on one page."""

    statistic: Statistic
    value: float
    """Higher is worse."""
    box: Box = NOWHERE
    """Place; NaN: the page as a whole."""


def values_of(statistics: Sequence[Observed]) -> NDArray[np.float32]:
    """Return the values of statistics, (n,)."""
    return np.array([one.value for one in statistics], np.float32)


def keys_of(statistics: Iterable[Observed]) -> list[str]:
    """Return the keys of statistics, in their order."""
    return [one.statistic.key for one in statistics]
