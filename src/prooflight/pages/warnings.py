"""What is printed of a page otherwise than its file asks, or may be: a substituted font, a layer that is left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

WHOLE_FILE: Final = -1
"""``PageWarning.page`` of what concerns a file and none of its pages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageWarning:
    """One such thing, for people and for programs."""

    page: int
    """Place of the page in its job or file, from 0; ``WHOLE_FILE``: it is of no page."""
    kind: str
    """A word for programs, as ``font-substituted``; ``docs/reference/commands.md`` lists them."""
    message: str
    """One sentence: what is wrong, where, and what to do about it."""
    object_name: str = ""
    """The object that it is about, as the file names it: a font, an image, a colorant; empty: the page itself."""
