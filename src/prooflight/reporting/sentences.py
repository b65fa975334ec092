"""Sentences that programs have stored or composed in English, in a reader's language.

A journal, a gate's log or an error contains its reason as one English line with numbers and names in it. A table lists
each such line as a template, its German form, and the forms that earlier versions stored, which are shown in the
present form. Text that no template matches is shown as it is.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING, Final, Self

if TYPE_CHECKING:
    from prooflight.reporting.defect_phrases import Code

_PLACE: Final = re.compile(r"\{(\w+)\}")
_NUMBER: Final = r"[-+]?[\d…][\d.,…]*"
_DECIMAL: Final = re.compile(r"(?<=[\d…])\.(?=[\d…])")
_THOUSANDS: Final = re.compile(r"(?<=\d),(?=\d{3})")
BETWEEN: Final = "; "
"""What separates several reasons in one line."""
MOST_SHOWN: Final = 2000
"""Letters beyond which a text is not searched: no sentence of a table is as long."""


@dataclass(frozen=True, slots=True)
class _Row:
    patterns: tuple[re.Pattern[str], ...]
    texts: dict[Code, str]


@dataclass(frozen=True, slots=True)
class Sentences:
    """A table of sentences. In a template, a name in braces stands for a part that varies:

    ``{n...}`` a number, ``{text...}`` another sentence of the table, any other name text that stays as it is.
    """

    rows: tuple[_Row, ...]

    @classmethod
    def read(cls, package: str, name: str) -> Self:
        """Read a table: a JSON list of [English, German, earlier English ...]."""
        table = json.loads((files(package) / name).read_text("utf-8"))
        return cls(
            tuple(
                _Row(tuple(_pattern(one) for one in (english, *earlier)), {"en": english, "de": german})
                for english, german, *earlier in table
            )
        )

    def of(self, text: str, language: Code) -> str:
        """Return a text in this language; one that the table does not contain, as it is.

        >>> reasons().of("the camera was away for 0.4 s", "de")
        'die Kamera war 0,4 s lang getrennt'
        """
        return self._translated(text, language) or text

    def contains(self, text: str) -> bool:
        """Return whether the table contains a text, with all sentences in it."""
        match = self._match(text)
        if match is None:
            parts = text.split(BETWEEN)
            return len(parts) > 1 and all(map(self.contains, parts))
        inner = (value for name, value in match[1].groupdict().items() if name.startswith("text"))
        return all(map(self.contains, inner))

    def _match(self, text: str) -> tuple[_Row, re.Match[str]] | None:
        if len(text) > MOST_SHOWN:
            return None
        for row in self.rows:
            for pattern in row.patterns:
                if found := pattern.fullmatch(text):
                    return row, found
        return None

    def _translated(self, text: str, language: Code) -> str:
        match = self._match(text)
        if match is None:
            parts = text.split(BETWEEN)
            return text if len(parts) == 1 else BETWEEN.join(self._translated(one, language) for one in parts)
        row, found = match
        values = {name: self._value(name, value, language) for name, value in found.groupdict().items()}
        return row.texts[language].format(**values)

    def _value(self, name: str, value: str, language: Code) -> str:
        if name.startswith("text"):
            return self._translated(value, language)
        if language == "de" and _is_number(name):
            return _DECIMAL.sub(",", _THOUSANDS.sub("\u202f", value))
        return value


@cache
def reasons() -> Sentences:
    """Return the table of reasons: of verdicts, of losses of lines, of the gate, and of the reprint list."""
    return Sentences.read("prooflight.reporting", "reasons.json")


@lru_cache(maxsize=4096)
def reason(text: str, language: Code) -> str:
    """Return a stored reason in this language; as ``Sentences.of``."""
    return reasons().of(text, language)


def _is_number(name: str) -> bool:
    return re.fullmatch(r"n\d*", name) is not None


def _pattern(template: str) -> re.Pattern[str]:
    parts, end = [], 0
    for place in _PLACE.finditer(template):
        parts.append(re.escape(template[end : place.start()]))
        parts.append(f"(?P<{place[1]}>{_NUMBER if _is_number(place[1]) else '.+?'})")
        end = place.end()
    return re.compile("".join((*parts, re.escape(template[end:]))))
