"""Errors that this package raises on purpose.

Which one when:

=================== ==========================================================================
JobError            a job or page to be printed (PDF, TIFF, JPEG, folder) cannot be used
ProfileError        an ICC profile cannot be used
ChartError          a characterisation chart cannot be used
PressFileError      a press file (TOML) is wrong: the field is named
PressError          a press artefact (.press) is damaged, of another schema or for another camera
ScanError           a camera scan does not fit the press or its page
RequestError        a command was asked for something that does not exist (page 99 of 24, ...)
=================== ==========================================================================

Wrong *types* stay TypeError and files that the system cannot open stay OSError.
"""

from __future__ import annotations

import re
from typing import Final

QUOTED_MAX: Final = 200
"""Greatest length of a path, a name or a value in a message. [characters]"""
MESSAGE_MAX: Final = 800
"""Greatest length of what a message states as wrong, or as right. [characters]"""
_LONG = re.compile(rf"""(['"`])[^'"`]{{{QUOTED_MAX + 1},}}\1|\S{{{QUOTED_MAX + 1},}}""")


def visible(text: object) -> str:
    """Escape all characters that cannot be printed, so that a terminal displays the text and obeys none of it.

    Control characters, direction marks and lone surrogates would move the cursor, colour later text, hide
    letters, or not be written at all.
    """
    return "".join(one if one.isprintable() else _escaped(one) for one in str(text))


def plain(text: object, *, longest: int = QUOTED_MAX) -> str:
    """Return a name or value for a message: ``visible``, on one line, with its middle cut out where it is long."""
    return _cut(visible(_cut(str(text), longest)), longest)


def sentence(text: object) -> str:
    """Return prose for a message: as ``plain``, with spaces for line breaks, and with long values in it cut."""
    one_line = " ".join(_cut(str(text), 100 * MESSAGE_MAX).split())
    return plain(_LONG.sub(lambda match: _cut(match[0], QUOTED_MAX), one_line), longest=MESSAGE_MAX)


def _cut(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    head = (longest - 3) // 2
    return f"{text[:head]}...{text[len(text) - (longest - 3 - head) :]}"


def _escaped(one: str) -> str:
    return one.encode("unicode_escape", "surrogatepass").decode("ascii")


class ProoflightError(Exception):
    """Base of all errors raised on purpose; its text is one line for a person."""


class InputError(ProoflightError, ValueError):
    """Input that cannot be used; it states where it is wrong, what is wrong, and what would be right."""

    def __init__(self, where: object, what: str, *, remedy: str) -> None:
        self.where, self.what, self.remedy = str(where), what, remedy
        super().__init__(where, what, remedy)

    def __str__(self) -> str:
        return f"{plain(self.where)}: {sentence(self.what)}; {sentence(self.remedy)}"

    def __reduce__(self) -> tuple[object, ...]:
        return (_rebuild, (type(self), self.where, self.what, self.remedy))


def _rebuild(kind: type[InputError], where: str, what: str, remedy: str) -> InputError:
    return kind(where, what, remedy=remedy)


class JobError(InputError):
    """A job or page to be printed cannot be used."""


class ProfileError(InputError):
    """An ICC profile cannot be used."""


class ChartError(InputError):
    """A characterisation chart cannot be used."""


class PressFileError(InputError):
    """A press file is wrong; ``where`` is file and field."""


class PressError(InputError):
    """A press artefact is damaged, of another schema, or made for another camera."""


class ScanError(InputError):
    """A camera scan does not fit the press or its page."""


class RequestError(InputError):
    """A command was asked for something that does not exist."""
