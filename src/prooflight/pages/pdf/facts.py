"""Facts of a PDF and its pages that determine its print, for people who check a job before it is printed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self


@dataclass(frozen=True, slots=True, kw_only=True)
class DocumentFacts:
    """Facts of a whole PDF."""

    condition: str
    """Printing condition of its PDF/X output intent, such as FOGRA51; empty: it states none."""
    record_pages: tuple[int, ...]
    """Pages of each record of a PDF/VT, in order; empty: the file has no records."""
    spectra: Mapping[str, str]
    """CxF/X-4 of spot inks as text, by the names of the inks."""
    solidities: Mapping[str, float] = field(default_factory=dict)
    """Opacities, 0 to 1, of spot inks by their names (MixingHints of an output intent)."""

    @property
    def pages_a_record(self) -> int | None:
        """Pages of each record; None: there are no records, or they are not of one length."""
        lengths = set(self.record_pages)
        return lengths.pop() if len(lengths) == 1 else None

    @property
    def records_text(self) -> str:
        """The records in a few words; empty: there are none."""
        if not self.record_pages:
            return ""
        least, most = min(self.record_pages), max(self.record_pages)
        of = f"{least}" if least == most else f"{least} to {most}"
        return f"{len(self.record_pages)} records of {of} page" + ("" if most == 1 else "s")

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> Self:
        """Return the facts from their form in JSON (``document_facts.document_facts``)."""
        return cls(
            condition=plain["condition"],
            record_pages=tuple(plain["record_pages"]),
            spectra=dict(plain["spectra"]),
            solidities=dict(plain["solidities"]),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Layer:
    """An optional-content group that the page uses."""

    name: str
    printed: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Font:
    """A font of the page's resources."""

    name: str
    kind: str
    """Subtype of the font, such as Type1 or TrueType."""
    embedded: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedImage:
    """An image as it is painted once."""

    width_px: int
    height_px: int
    bits: int
    """Bits of a component."""
    colours: str
    """Colour space of the image; a stencil has none."""
    dpi: tuple[float, float]
    """Resolution across and along on paper. [pixels/inch]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spot:
    """A colorant of the page's resources that is no process ink."""

    name: str
    painted: bool
    """Whether anything is painted in its space."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageFacts:
    """Facts of one page."""

    box: str
    """The box that is printed: TrimBox, CropBox or MediaBox."""
    output_intent: str
    """Name and colours of the printing condition that the file states; empty: it states none."""
    transparency: tuple[str, ...]
    """Kinds of transparency in use: alpha, soft mask, or a blend mode by its name."""
    overprint: tuple[str, ...]
    """Overprint modes in use, such as ``mode 1``."""
    layers: tuple[Layer, ...]
    fonts: tuple[Font, ...]
    images: tuple[PlacedImage, ...]
    spots: tuple[Spot, ...]

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> Self:
        """Return the facts from their form in JSON (``page_facts.page_facts``)."""
        return cls(
            box=plain["box"],
            output_intent=plain["output_intent"],
            transparency=tuple(plain["transparency"]),
            overprint=tuple(plain["overprint"]),
            layers=tuple(Layer(**one) for one in plain["layers"]),
            fonts=tuple(Font(**one) for one in plain["fonts"]),
            images=tuple(PlacedImage(**one | {"dpi": tuple(one["dpi"])}) for one in plain["images"]),
            spots=tuple(Spot(**one) for one in plain["spots"]),
        )
