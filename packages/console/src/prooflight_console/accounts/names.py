"""Names of people and tokens: text that people can read, and can tell from every other name."""

from __future__ import annotations

import unicodedata
from typing import Final

from prooflight.errors import RequestError

MOST_NAME: Final = 60
FORBIDDEN: Final = frozenset("/\\?#%")
"""Characters that have a meaning in an address."""
SCRIPTS: Final = frozenset({"LATIN", "CYRILLIC", "GREEK", "ARMENIAN"})
"""Scripts with letters that look like those of another.

The first word of a letter's Unicode name is its script.
"""
_PAIRS: Final = (
    "аa вb еe ёë кk мm нh оo рp сc тt уy хx іi їï јj ѕs ԁd ԛq ԝw һh ӏl ьb "
    "αa βb εe ζz ηh ιi κk μm νn οo ρp τt υy χx օo սu հh ոn ɑa ɡg ıi"
)
"""Pairs of a letter and the Latin one that it looks like in upper or lower case.

Source: Unicode Technical Standard 39, confusables, for the scripts above.
"""
_CONFUSABLE: Final = str.maketrans({pair[0]: pair[1] for pair in _PAIRS.split()})


def checked_name(text: str) -> str:
    """Return the name in normal form with single spaces.

    Raises RequestError if people could not read it, or could not tell it from other names.
    """
    name = unicodedata.normalize("NFC", " ".join(part for part in text.split(" ") if part))
    if not 0 < len(name) <= MOST_NAME or not name.isprintable() or not any(map(str.isalnum, name)):
        remedy = f"give 1 to {MOST_NAME} letters that can be printed, on one line"
        raise RequestError("name", f"{name[:MOST_NAME]!r} is not a name", remedy=remedy)
    if wrong := sorted(FORBIDDEN & set(name)):
        raise RequestError(
            "name", f"{name!r} has {wrong[0]!r}", remedy="leave it out: names are part of addresses"
        )
    if len(mixed := scripts(name)) > 1:
        what = f"{name!r} mixes letters of {' and '.join(sorted(one.capitalize() for one in mixed))}"
        raise RequestError("name", what, remedy="write it in one script: some of their letters look alike")
    return name


def appearance(name: str) -> str:
    """Reduce a name to what it looks like: names of the same appearance cannot be told apart."""
    return unicodedata.normalize("NFKC", name).casefold().translate(_CONFUSABLE)


def readable(text: str) -> str:
    """Return the name closest to a text from elsewhere; empty if no letter or digit of it is left."""
    shown = "".join(one if one.isprintable() and one not in FORBIDDEN else " " for one in text)
    name = unicodedata.normalize("NFC", " ".join(shown.split()))
    return name if any(map(str.isalnum, name)) else ""


def scripts(name: str) -> set[str]:
    """Return the scripts of ``SCRIPTS`` in which the name is written."""
    return {unicodedata.name(one, "").partition(" ")[0] for one in name if one.isalpha()} & SCRIPTS
