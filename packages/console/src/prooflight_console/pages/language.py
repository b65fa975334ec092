"""Texts of pages, in English and in German."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from math import ceil
from typing import TYPE_CHECKING, Any, Final, cast

from prooflight.reporting.defect_phrases import KINDS
from prooflight.reporting.sentences import Sentences, reasons

if TYPE_CHECKING:
    from prooflight.reporting.defect_phrases import Code

ENGLISH: Final = "en"


class Language:
    """Texts of one language by their keys.

    An unknown key is an error; a kind that a package adds is shown by its name.
    """

    def __init__(self, code: Code) -> None:
        self.code = code
        folder = files("prooflight_console.pages") / "languages"
        self._words = {f"kind.{name}": text for name, text in KINDS[code].items()}
        self._words["kind.none"] = KINDS[code]["unknown"]
        rooms = ("", "-office", "-engineering", "-kiosk", "-quality")
        for name in (f"{code}{room}.json" for room in rooms):
            self._words |= json.loads((folder / name).read_text("utf-8"))

    def __call__(self, key: str, **values: Any) -> str:
        """Return the text of a key with the values inserted; raises KeyError."""
        return self._words[key].format(**values)

    def named(self, group: str, name: str | None) -> str:
        """Return the text of an item of a group (``kind``, ``action``, ...), or its name if untranslated."""
        return self._words.get(f"{group}.{name or 'none'}", str(name))

    def sentence(self, text: str) -> str:
        """Return a reason, a message of an error or a subject of the audit trail in this language, if it has it."""
        return _sentences().of(text, self.code)

    def count(self, key: str, number: int, **values: Any) -> str:
        """Return a number and its noun: ``KEY.one`` or ``KEY.many``, with other values inserted."""
        text = self._words[f"{key}.one" if number == 1 else f"{key}.many"]
        return text.format(n=self.number(number), **values)

    def duration(self, seconds: float) -> str:
        """Return a time in seconds or minutes, rounded up."""
        if seconds < 90:
            return self("seconds", n=ceil(seconds))
        return self("minutes", n=ceil(seconds / 60))

    def number(self, value: float, digits: int = 0) -> str:
        """Return a number with the language's separators."""
        text = f"{value:,.{digits}f}"
        return text if self.code == ENGLISH else text.translate(str.maketrans(",.", "\u202f,"))

    def exact(self, value: float, digits: int = 6) -> str:
        """Return a number with the digits that it has, six at most."""
        text = f"{value:.{digits}g}"
        return text if self.code == ENGLISH else text.replace(".", ",")

    def keys(self) -> set[str]:
        """Return all keys."""
        return set(self._words)

    def group(self, beginning: str) -> dict[str, str]:
        """Return the texts whose keys have this prefix, by the rest of the key, for scripts."""
        return {
            key.removeprefix(beginning): words
            for key, words in self._words.items()
            if key.startswith(beginning)
        }


@cache
def _sentences() -> Sentences:
    own = Sentences.read("prooflight_console.pages", "languages/messages.json")
    return Sentences((*own.rows, *reasons().rows))


@cache
def language(code: str) -> Language:
    """Return one of ``LANGUAGES``."""
    return Language(cast("Code", code))
