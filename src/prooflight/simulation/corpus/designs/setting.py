"""Setting text: lines, paragraphs, columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.simulation.corpus.designs.inks import BLACK, Ink
from prooflight.simulation.corpus.designs.sheet import MM_PER_PT, Sheet

if TYPE_CHECKING:
    from prooflight.simulation.corpus.designs.faces import Face

_WIDEST_SPACE = 3.0
"""Greatest space of a justified line, in normal spaces; a line that would need more is left ragged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """Style of running text."""

    face: Face
    size_pt: float
    leading: float = 1.35
    """Distance of baselines over the type size."""
    ink: Ink = BLACK
    align: str = "left"
    """``left``, ``right``, ``centre`` or ``justified``."""
    indent_em: float = 0.0
    from_right: bool = False
    """Whether words follow one another from right to left."""

    @property
    def line_mm(self) -> float:
        """Return the distance of baselines. [mm]"""
        return self.size_pt * MM_PER_PT * self.leading


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """Words of one line and their lengths without spaces. [em]"""

    words: Sequence[str]
    widths_em: Sequence[float]
    indent_em: float
    last: bool


def width_em(text: str, face: Face) -> float:
    """Return the length of a line of type over its size."""
    return sum(map(face.advance, text))


def broken(words: Iterable[str], style: Style, width_mm: float) -> list[Line]:
    """Break words into lines as full as they will go."""
    room = width_mm / (style.size_pt * MM_PER_PT)
    space = style.face.advance(" ")
    lines: list[Line] = []
    pending: list[str] = []
    widths: list[float] = []
    indent, used = style.indent_em, style.indent_em
    for word in words:
        wide = width_em(word, style.face)
        if pending and used + wide > room:
            lines.append(Line(words=pending, widths_em=widths, indent_em=indent, last=False))
            pending, widths, indent, used = [], [], 0.0, 0.0
        pending.append(word)
        widths.append(wide)
        used += wide + space
    if pending:
        lines.append(Line(words=pending, widths_em=widths, indent_em=indent, last=True))
    return lines


def set_paragraph(
    sheet: Sheet,
    x: float,
    y: float,
    width: float,
    words: Iterable[str],
    style: Style,
    *,
    bottom: float | None = None,
) -> float:
    """Set words from the top edge y down, as far as ``bottom`` or the page's end; return the lower edge. [mm]"""
    bottom = sheet.height_mm if bottom is None else bottom
    for line in broken(words, style, width):
        if y + style.line_mm > bottom:
            break
        _set_line(sheet, x, y + 0.78 * style.line_mm, width, line, style)
        y += style.line_mm
    return y


def _set_line(sheet: Sheet, x: float, y: float, width: float, line: Line, style: Style) -> None:
    em = style.size_pt * MM_PER_PT
    space = natural = em * style.face.advance(" ")
    taken = em * (sum(line.widths_em) + line.indent_em)
    gaps = len(line.words) - 1
    if (
        style.align == "justified"
        and gaps
        and not line.last
        and (width - taken) / gaps < _WIDEST_SPACE * natural
    ):
        space = (width - taken) / gaps
    length = taken + gaps * space
    align = style.align
    if style.from_right and align in ("left", "justified"):
        align = "right"
    pen = x + em * line.indent_em * (not style.from_right)
    pen += {"right": width - length, "centre": (width - length) / 2}.get(align, 0.0)
    words = list(zip(line.words, line.widths_em, strict=True))
    for word, wide in reversed(words) if style.from_right else words:
        sheet.draw_text(pen, y, word, style.face, style.size_pt, style.ink)
        pen += em * wide + space


def set_columns(
    sheet: Sheet,
    x: float,
    y: float,
    width: float,
    height: float,
    paragraphs: Iterable[Sequence[str]],
    style: Style,
    *,
    columns: int = 1,
    gap: float = 6.0,
    rules: Ink | None = None,
) -> None:
    """Set paragraphs that flow through columns until they are full; ``rules``: lines between the columns."""
    each = (width - gap * (columns - 1)) / columns
    order = range(columns - 1, -1, -1) if style.from_right else range(columns)
    lines = (line for words in paragraphs for line in broken(words, style, each))
    for column in order:
        left, down = x + column * (each + gap), y
        if rules is not None and column:
            sheet.upright(left - gap / 2, y, height, rules, 0.4)
        while down + style.line_mm <= y + height:
            line = next(lines, None)
            if line is None:
                return
            _set_line(sheet, left, down + 0.78 * style.line_mm, each, line, style)
            down += style.line_mm


def cut(text: str, face: Face, size_pt: float, width_mm: float) -> str:
    """Return as many letters of a line of type as fit."""
    room = width_mm / (size_pt * MM_PER_PT)
    for letters, letter in enumerate(text):
        room -= face.advance(letter)
        if room < 0:
            return text[:letters]
    return text


def fitted_pt(text: str, face: Face, width_mm: float, most_pt: float) -> float:
    """Return the size at which a line just fits, at most ``most_pt``. [pt]"""
    return min(most_pt, width_mm / (MM_PER_PT * max(width_em(text, face), 0.1)))
