"""Text of the sample job, read from ``copy_text.toml``."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib import resources
from typing import Any, Final


@dataclass(frozen=True, slots=True, kw_only=True)
class Chapter:
    """Chapter of the book."""

    number: str
    title: str
    summary: str
    """Line for the table of contents."""
    paragraphs: list[str]
    note: str
    """Footnote of its first page."""


_TEXTS: Final[dict[str, Any]] = tomllib.loads(
    resources.files("prooflight.simulation.corpus.sample_job").joinpath("copy_text.toml").read_text("utf-8")
)

# The book.
TITLE: Final[str] = _TEXTS["title"]
SUBTITLE: Final[str] = _TEXTS["subtitle"]
SERIES: Final[str] = _TEXTS["series"]
IMPRINT: Final[str] = _TEXTS["imprint"]
CHAPTERS: Final = tuple(Chapter(**chapter) for chapter in _TEXTS["chapters"])
LIGHT, INKS, RUN = CHAPTERS
GLOSSARY: Final[list[tuple[str, str]]] = _TEXTS["glossary"]
COLOPHON: Final[list[str]] = _TEXTS["colophon"]

# Captions, articles and advertising copy of the other pages.
RETINA: Final[str] = _TEXTS["retina"]
CAT_CAPTION: Final[str] = _TEXTS["cat_caption"]
CAT: Final[list[str]] = _TEXTS["cat"]
BROCHURE: Final[list[tuple[str, str]]] = _TEXTS["brochure"]
OFFERS: Final[list[tuple[str, str, str]]] = _TEXTS["offers"]
LAUNCH: Final[list[str]] = _TEXTS["launch"]
LECTURES: Final[list[tuple[str, str]]] = _TEXTS["lectures"]
LETTER: Final[list[str]] = _TEXTS["letter"]
RICH: Final[str] = _TEXTS["rich"]
ALONE: Final[str] = _TEXTS["alone"]
SPOT: Final[str] = _TEXTS["spot"]
OVERPRINTED: Final[str] = _TEXTS["overprinted"]
KNOCKED_OUT: Final[str] = _TEXTS["knocked_out"]
