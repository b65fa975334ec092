"""Every error this package raises on purpose.

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
"""Characters of a path, a name or a value that a message repeats."""
TOLD_MAX: Final = 800
"""Characters that a message says of what is wrong, or of what would be right."""
_LONG = re.compile(rf"""(['"`])[^'"`]{{{QUOTED_MAX + 1},}}\1|\S{{{QUOTED_MAX + 1},}}""")


def visible(text: object) -> str:
    """Text with what cannot be printed as escapes: a terminal shows it and obeys none of it.

    Control characters, marks of direction and halves of characters would move the cursor, colour what follows, hide
    letters, or not be written at all.
    """
    return "".join(one if one.isprintable() else _escaped(one) for one in str(text))


def plain(text: object, *, longest: int = QUOTED_MAX) -> str:
    """A name or value for a message: ``visible``, on one line, its middle cut out where it is long."""
    return _cut(visible(_cut(str(text), longest)), longest)


def sentence(text: object) -> str:
    """What is said in words, on one line: as ``plain``, line breaks are spaces, and long values in it are cut."""
    words = " ".join(_cut(str(text), 100 * TOLD_MAX).split())
    return plain(_LONG.sub(lambda found: _cut(found[0], QUOTED_MAX), words), longest=TOLD_MAX)


def _cut(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    head = (longest - 3) // 2
    return f"{text[:head]}...{text[len(text) - (longest - 3 - head) :]}"


def _escaped(one: str) -> str:
    return one.encode("unicode_escape", "surrogatepass").decode("ascii")


class ProoflightError(Exception):
    """Base of everything raised on purpose; its text is one line for a person."""


class InputError(ProoflightError, ValueError):
    """Input that cannot be used: where it is wrong, what is wrong, and what would be right."""

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
