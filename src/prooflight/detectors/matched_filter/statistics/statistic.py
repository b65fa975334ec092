"""Which statistic it is that a page is judged by, what it says of one page, and where.

Artefacts, rows and verdicts hold a statistic's key, such as ``box/gain-C+/8``; ``Statistic.parse`` alone reads it. Its
first word says two things at once: what is looked for, and against which reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from prooflight.cmyk import INK_LETTERS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

Box = tuple[float, float, float, float]
"""x, y, width, height. [mm]"""
NOWHERE: Final[Box] = (np.nan,) * 4


class Reference(Enum):
    """What a page is compared with."""

    GOOD_PRINTS = "good prints"
    OWN_PAGE = "own page"
    FLAT_AREAS = "flat areas"
    """Of the same page, away from edges."""


GOOD_PRINTS, OWN_PAGE, FLAT_AREAS = Reference
WORDS: Final = {
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
"""First words of keys by family and reference; of all others it is the family, compared with good prints."""
_MEANINGS: Final = {word: meaning for meaning, word in WORDS.items()}
PAGE_WIDE: Final = ("fit", "place", "energy")
"""First words of statistics that are causes of their own."""
OF_ALL_SORTS: Final = ("ghost", "swap", "energy")
"""Families whose statistics are one cause together."""
SCREEN_MODES: Final = ("light", "void")
"""Modes that need none of an ink's own images ..."""
SCREEN_FAMILIES: Final = ("box", "spread", "streak", "wave", "slant")
"""... and families that say something of each mode by itself."""


class Statistic(NamedTuple):
    """What is looked for, and against which reference; what does not apply is empty or None."""

    family: str
    """box, streak, wave, ghost, spread, energy, swap, step, slant, moved, mark; of the page as a whole: fit, place."""
    mode: str = ""
    """In which way ink or light is off, such as gain, void, light; of fit and place the amount; of marks the class of
    place."""
    ink: str = ""
    """A letter of CMYK, or two that have changed places."""
    sign: str = ""
    """``+``: more of the mode; ``-``: less."""
    size: int | None = None
    """Of boxes and lines [tiles], of marks [binned pixels], of streaks ``local_evidence.WIDTHS``, of ghosts which of
    ``GHOST_BOXES_MM``."""
    part: str = ""
    """Which of the numbers that one cause gives, such as a streak's span."""
    reference: Reference = GOOD_PRINTS

    @classmethod
    def parse(cls, key: str) -> Self:
        """From ``key``; or a cause, which says no size.

        >>> Statistic.parse("box/gain-C+/8")[:5], Statistic.parse("calm/void/2/full").reference.value
        (('box', 'gain', 'C', '+', 8), 'flat areas')
        """
        return cls._make(_parsed(key))

    @property
    def key(self) -> str:
        """The string that stands for it."""
        middle = self.mode + "-" * bool(self.mode and self.ink) + self.ink + self.sign
        size = "" if self.size is None else str(self.size)
        return "/".join(part for part in (self.word, middle, size, self.part) if part)

    @property
    def word(self) -> str:
        """First of the key."""
        return WORDS.get((self.family, self.reference), self.family)

    @property
    def cause(self) -> str:
        """Key of what it is evidence for together with others: one cause at all sizes, or a number that stands alone.

        >>> [Statistic.parse(key).cause for key in ("apart/void-/4", "streak/void/1/full", "ghost/C/0", "place/skew")]
        ['apart/void-', 'streak/void', 'ghost', 'place/skew']
        """
        if self.word in PAGE_WIDE:
            return self.key
        if self.family in OF_ALL_SORTS:
            return self.word
        return self._replace(size=None, part="").key


@lru_cache(maxsize=4096)
def _parsed(key: str) -> Statistic:
    """A press is read several times, and has a thousand of them each time."""
    word, *rest = key.split("/")
    mode = ink = sign = ""
    if rest and not _is_size(rest[0]):
        first = rest.pop(0)
        sign = first[-1] if first[-1:] in ("+", "-") else ""
        mode, ink = mode_and_ink(first.removesuffix(sign))
    size = int(rest.pop(0)) if rest and _is_size(rest[0]) else None
    family, reference = _MEANINGS.get(word, (word, GOOD_PRINTS))
    return Statistic(family, mode, ink, sign, size, "/".join(rest), reference)


def in_screen(statistic: Statistic) -> bool:
    """Whether it is of those that every page is looked at for; they say of which pages all the others are worth it.

    >>> [in_screen(Statistic.parse(key)) for key in ("apart/void-/4", "box/add-K+/4", "place/skew", "ghost/C/0")]
    [True, False, True, False]
    """
    return statistic.word in (*PAGE_WIDE, "excess", "mark") or (
        statistic.family in SCREEN_FAMILIES and statistic.mode in SCREEN_MODES
    )


def mode_and_ink(name: str) -> tuple[str, str]:
    """Parts of a mode's name, one of which may be empty.

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
    """What one statistic says of one page."""

    statistic: Statistic
    value: float
    """Higher is worse."""
    box: Box = NOWHERE
    """Where; NaN: the page as a whole."""


def values_of(statistics: Sequence[Observed]) -> NDArray[np.float32]:
    """Values of statistics, (n,)."""
    return np.array([one.value for one in statistics], np.float32)


def keys_of(statistics: Iterable[Observed]) -> list[str]:
    """Of statistics, in their order."""
    return [one.statistic.key for one in statistics]
