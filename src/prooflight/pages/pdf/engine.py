"""Engines that draw the pages of a PDF: MuPDF, Ghostscript, or the press's own front end, run as a command.

MuPDF opens every PDF and measures its pages; another engine draws them. It runs below the process that rips
(``worker``), within the same limits of memory and time, and writes one page as a CMYK TIFF.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal, get_args

from pydantic import Field

from prooflight.files.fields import NO_OTHER_FIELDS

EngineName = Literal["mupdf", "ghostscript", "command"]
ENGINES: Final[tuple[EngineName, ...]] = get_args(EngineName)
GHOSTSCRIPT: Final = "gs"
PLACEHOLDERS: Final = ("pdf", "page", "dpi", "out")
"""Placeholders in a command's arguments: the PDF, the page's number from 1, the resolution, the TIFF to be
written."""
ARGUMENTS_MAX: Final = 100
ARGUMENT_LETTERS_MAX: Final = 4000
_PLACEHOLDER: Final = re.compile(r"\{([^{}]*)\}")


@dataclass(frozen=True, slots=True, kw_only=True)
class RipEngine:
    """One engine, as ``[rip]`` of a press file names it."""

    __pydantic_config__: ClassVar = NO_OTHER_FIELDS

    name: EngineName = "mupdf"
    command: tuple[Annotated[str, Field(strict=True, max_length=ARGUMENT_LETTERS_MAX)], ...] = ()
    """Program and arguments of the engine ``command``, which are passed without a shell; empty: another
    engine."""

    def __post_init__(self) -> None:
        """Check the command; ValueError if it is missing, invalid, or belongs to no engine."""
        if self.name not in ENGINES:
            message = f"engine must be {', '.join(ENGINES)}"
            raise ValueError(message)
        if (self.name == "command") != bool(self.command):
            message = 'command goes with engine = "command", and with no other'
            raise ValueError(message)
        if self.command:
            _check_command(self.command)

    @property
    def program(self) -> str:
        """The program that it runs; empty: MuPDF, which is a library."""
        return {"mupdf": "", "ghostscript": GHOSTSCRIPT}.get(self.name) or "".join(self.command[:1])

    @property
    def missing(self) -> str:
        """Reason why it cannot be run on this machine; empty: it can."""
        program = self.program
        if not program or shutil.which(program):
            return ""
        if self.name == "ghostscript":
            return "Ghostscript is not installed"
        return f"there is no program {program}"

    @property
    def remedy(self) -> str:
        """Advice for a missing engine."""
        if self.name == "ghostscript":
            return "install it (apt install ghostscript), or choose another [rip] engine and build the press again"
        return "name a program on PATH, or its whole path, in [rip] command, and build the press again"

    def filled(self, values: Mapping[str, str]) -> list[str]:
        """Return the command's arguments with ``values`` in place of its placeholders."""
        return [
            _PLACEHOLDER.sub(lambda match: values.get(match[1], match[0]), argument)
            for argument in self.command
        ]


def _check_command(command: tuple[str, ...]) -> None:
    if len(command) > ARGUMENTS_MAX or max(map(len, command)) > ARGUMENT_LETTERS_MAX or not command[0]:
        message = f"command must be a program and up to {ARGUMENTS_MAX - 1} arguments of {ARGUMENT_LETTERS_MAX} letters"
        raise ValueError(message)
    if any("\0" in argument for argument in command):
        message = "command must hold no zero byte"
        raise ValueError(message)
    named = {match for argument in command for match in _PLACEHOLDER.findall(argument)}
    for name in PLACEHOLDERS:
        if name not in named:
            message = f"command must contain {{{name}}}"
            raise ValueError(message)
    if unknown := sorted(named - set(PLACEHOLDERS)):
        message = f"command names {{{unknown[0]}}}, only {', '.join(f'{{{name}}}' for name in PLACEHOLDERS)} are known"
        raise ValueError(message)
