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


class ProoflightError(Exception):
    """Base of everything raised on purpose; its text is one line for a person."""


class InputError(ProoflightError, ValueError):
    """Input that cannot be used: where it is wrong, what is wrong, and what would be right."""

    def __init__(self, where: object, what: str, *, remedy: str) -> None:
        self.where, self.what, self.remedy = str(where), what, remedy
        super().__init__(where, what, remedy)

    def __str__(self) -> str:
        return f"{self.where}: {self.what}; {self.remedy}"

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
