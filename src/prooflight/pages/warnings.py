"""Warnings of a page's print, which deviates or may deviate from its file: a substituted font, an omitted layer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

WHOLE_FILE: Final = -1
"""Value of ``PageWarning.page`` for a warning that concerns a whole file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageWarning:
    """One warning, for people and for programs."""

    page: int
    """Index of the page in its job or file, from 0; ``WHOLE_FILE``: the warning is of no page."""
    kind: str
    """Identifier for programs, such as ``font-substituted``; ``docs/reference/commands.md`` lists them."""
    message: str
    """One sentence: what is wrong, where, and what to do about it."""
    object_name: str = ""
    """The object that it is about, as the file names it: a font, an image, a colorant; empty: the page
    itself."""
