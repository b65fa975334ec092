"""Fonts of a page that print differently from its file: those that are not embedded, and glyphs that they lack.

Imported late, by ``device`` and ``document``: it needs PyMuPDF at import.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterable, Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pymupdf import mupdf

from prooflight.pages.pdf.colour_management import address
from prooflight.pages.pdf.resources import Resource, get, items, name_of, shown_name

_ITEM: Final = np.dtype(
    [("x", "f4"), ("y", "f4"), ("advance", "f4"), ("glyph", "i4"), ("letter", "i4"), ("code", "i4")]
)
"""Layout of MuPDF's ``fz_text_item``."""
_GLYPHS: Final = 256
"""Glyphs of a Type 3 font, each with flags of 16 bits."""
_BLANKS: Final = (9, 10, 13, 32, 0xA0, 0xAD)
"""Letters without a mark, which a font may lack."""


class DrawnFonts:
    """Fonts with which texts are drawn."""

    def __init__(self) -> None:
        self._fonts: dict[int, Any] = {}
        self.missing: dict[tuple[str, str], None] = {}
        """Names of fonts, and letters that were requested from them and that they lack."""

    def take_in(self, text: Any) -> None:
        """Record a text that is drawn (low level ``fz_text``)."""
        for span, glyphs in _spans(text):
            font = span.font
            key = address(font)
            if key not in self._fonts:  # a page has thousands of texts and few fonts
                self._fonts[key] = mupdf.FzFont(mupdf.ll_fz_keep_font(font))
            lacking = () if glyphs["glyph"].all() else glyphs["letter"][glyphs["glyph"] == 0].tolist()
            for letter in lacking:
                if letter not in _BLANKS and not mupdf.ll_fz_font_t3_procs(font):
                    self.missing[mupdf.ll_fz_font_name(font), _shown(letter)] = None

    def has(self, font: Any) -> bool:
        """Return whether a text was drawn with a font (low level)."""
        return address(font) in self._fonts


def has_outlines(text: Any) -> bool:
    """Return whether all glyphs of a text (low level ``fz_text``) have outlines; those of Type 3 have none."""
    return not any(mupdf.ll_fz_font_t3_procs(span.font) for span, _ in _spans(text))


def outlines(text: Any) -> Iterator[Any]:
    """Yield the outline of each glyph of a text as a path (low level ``fz_path``), in the text's own space."""
    for span, glyphs in _spans(text):
        of_span = span.trm.a, span.trm.b, span.trm.c, span.trm.d
        for glyph in glyphs[glyphs["glyph"] >= 0]:
            place = mupdf.ll_fz_make_matrix(*of_span, float(glyph["x"]), float(glyph["y"]))
            if path := mupdf.ll_fz_outline_glyph(span.font, int(glyph["glyph"]), place):
                try:
                    yield path
                finally:
                    mupdf.ll_fz_drop_path(path)


def _spans(text: Any) -> Iterator[tuple[Any, NDArray[np.void]]]:
    """Yield each span of a text (low level ``fz_text``), and its glyphs as ``_ITEM``."""
    span = text.head
    while span:
        memory = (ctypes.c_char * (span.len * _ITEM.itemsize)).from_address(address(span.items))
        yield span, np.frombuffer(memory, _ITEM)
        span = span.next


def draw_colours_directly(document: Any, fonts: Iterable[Resource]) -> None:
    """Draw the content of coloured glyphs of Type 3 fonts directly, like forms (ISO 32000-2, 9.6.4).

    Otherwise MuPDF caches them as pictures, in which content that leaves no mark or overprints knocks out
    what is below. MuPDF forgets this setting with the font, so it is applied again before a page is drawn.
    """
    for resource in fonts:
        if (
            name_of(get(resource.pdf_object, "Subtype")) != "Type3"
            or get(resource.pdf_object, "Resources") is None
        ):
            continue  # without resources, those that it would be loaded with are the page's
        with contextlib.suppress(mupdf.FzErrorBase):  # a broken one, which will be said when it is used
            font = mupdf.ll_pdf_load_font(document.m_internal, None, resource.pdf_object.m_internal)
            flags_array = (ctypes.c_uint16 * _GLYPHS).from_address(int(font.font.t3flags))
            flags = np.ctypeslib.as_array(flags_array)
            flags[flags & mupdf.FZ_DEVFLAG_COLOR != 0] |= mupdf.FZ_DEVFLAG_UNCACHEABLE
            mupdf.ll_pdf_drop_font(font)


def substituted(document: Any, fonts: Iterable[Resource], drawn: DrawnFonts) -> Iterator[str]:
    """Yield the names of fonts that are not embedded and with which texts were drawn."""
    for resource in fonts:
        font = resource.pdf_object
        described = (items(get(font, "DescendantFonts")) or [font])[0]
        descriptor = get(described, "FontDescriptor")
        if name_of(get(font, "Subtype")) == "Type3" or any(
            get(descriptor, key) is not None for key in ("FontFile", "FontFile2", "FontFile3")
        ):
            continue
        used = mupdf.ll_pdf_load_font(document.m_internal, None, font.m_internal).font
        if drawn.has(used):
            yield shown_name(name_of(get(font, "BaseFont")) or resource.name)


def _shown(letter: int) -> str:
    text = chr(letter) if 0 < letter < 0x110000 and not 0xD800 <= letter < 0xE000 else ""
    return repr(text) if text.isprintable() and text else f"code {letter}"
