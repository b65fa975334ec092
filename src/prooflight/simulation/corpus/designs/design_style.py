"""Style of one design: inks, colours, words, and the setting of its running text."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from prooflight.simulation.corpus.designs import photographs
from prooflight.simulation.corpus.designs.chance import pick, some
from prooflight.simulation.corpus.designs.inks import Ink, Palette, Separation
from prooflight.simulation.corpus.designs.setting import Style, fitted_pt
from prooflight.simulation.corpus.designs.vocabulary import Voice

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from prooflight.simulation.corpus.designs.sheet import Sheet


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignStyle:
    """Style of one design."""

    separation: Separation
    palette: Palette
    voice: Voice
    body: Style

    @classmethod
    def draw(cls, rng: np.random.Generator, *, black_alone: bool) -> DesignStyle:
        """Draw a style at random; black_alone: every colour is a tint of black."""
        separation = Separation(
            black_alone=black_alone, replaced=some(rng, 0.5, 0.95), from_grey=some(rng, 0.1, 0.45)
        )
        palette = Palette.draw(rng, separation)
        voice = Voice.draw(rng)
        body = Style(
            face=voice.face,
            size_pt=round(some(rng, 8.5, 11.5) * 2) / 2,
            leading=some(rng, 1.2, 1.55),
            ink=palette.text,
            align=pick(rng, ("left", "justified", "justified")),
            indent_em=pick(rng, (0.0, 1.2, 2.0)),
            from_right=voice.from_right,
        )
        return cls(separation=separation, palette=palette, voice=voice, body=body)

    def text(self, size_pt: float | None = None, ink: Ink | None = None, **changes: object) -> Style:
        """Return the running text's style with another size, colour or whatever else is given."""
        size = self.body.size_pt if size_pt is None else size_pt
        colour = self.body.ink if ink is None else ink
        return replace(self.body, size_pt=size, ink=colour, **changes)  # type: ignore[arg-type]

    def paragraphs(self, rng: np.random.Generator, words: int, each: int = 70) -> list[list[str]]:
        """Draw about ``words`` words of prose in all, in paragraphs of about ``each``."""
        drawn, left = [], words
        while left > 0:
            number = min(round(each * some(rng, 0.4, 1.8)) + 3, left)
            drawn.append(self.voice.prose(rng, number))
            left -= number
        return drawn

    def photograph(self, rng: np.random.Generator, width_mm: float, height_mm: float) -> NDArray[np.uint8]:
        """Draw a picture separated into this design's inks, (rows, columns, 4)."""
        return self.separation.inks(photographs.photograph(rng, width_mm, height_mm))

    def heading(
        self,
        sheet: Sheet,
        x: float,
        y: float,
        width: float,
        text: str,
        most_pt: float,
        ink: Ink | None = None,
        *,
        align: str = "left",
    ) -> float:
        """Draw one line of bold type as large as fits, its top at y, and return its lower edge. [mm]"""
        size = fitted_pt(text, self.voice.bold, width, most_pt)
        colour = self.palette.strong if ink is None else ink
        if align == "left" and self.voice.from_right:
            align = "right"
        at = {"left": x, "centre": x + width / 2, "right": x + width}[align]
        sheet.draw_text(at, y + 0.31 * size, text, self.voice.bold, size, colour, align=align)
        return y + 0.42 * size


class Frame(NamedTuple):
    """Box of a design's sheet, and all that is needed to draw something into it."""

    sheet: Sheet
    rng: np.random.Generator
    design: DesignStyle
    x: float
    """Left and upper edge, width and height. [mm]"""
    y: float
    width: float
    height: float
