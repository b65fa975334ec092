"""What pages say, in English and in German."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any, Final

ENGLISH: Final = "en"


class Language:
    """Words of one language by their keys. An unknown key is a fault; of kinds that packages add, their name stands."""

    def __init__(self, code: str) -> None:
        self.code = code
        folder = files("prooflight.server.pages") / "languages"
        self._words: dict[str, str] = {}
        for name in (f"{code}.json", f"{code}-office.json"):
            self._words |= json.loads((folder / name).read_text("utf-8"))

    def __call__(self, key: str, **values: Any) -> str:
        """The words of a key, with values put in; KeyError."""
        return self._words[key].format(**values)

    def named(self, group: str, name: str | None) -> str:
        """Of something that has a name: ``kind``, ``action``, ...; the name itself where nobody translated it."""
        return self._words.get(f"{group}.{name or 'none'}", str(name))

    def count(self, key: str, number: int) -> str:
        """A number and its noun: ``KEY.one`` or ``KEY.many``."""
        return self._words[f"{key}.one" if number == 1 else f"{key}.many"].format(n=self.number(number))

    def number(self, value: float, digits: int = 0) -> str:
        """With the language's separators."""
        told = f"{value:,.{digits}f}"
        return told if self.code == ENGLISH else told.translate(str.maketrans(",.", "\u202f,"))

    def keys(self) -> set[str]:
        """All of them."""
        return set(self._words)

    def group(self, beginning: str) -> dict[str, str]:
        """Those whose keys begin so, by the rest of the key; scripts get them."""
        return {
            key.removeprefix(beginning): words
            for key, words in self._words.items()
            if key.startswith(beginning)
        }


@cache
def language(code: str) -> Language:
    """One of ``LANGUAGES``."""
    return Language(code)
