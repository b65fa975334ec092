"""A defect in words: what is wrong, where, on which sheets, and how clearly it was seen.

Terminal, report and console take their words from ``describe``, in English or in German. It invents nothing: an amount,
an ink or a comparison with good sheets is stated only where the detector measured it.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from prooflight.cmyk import NAME_OF_INK
from prooflight.reporting.defect_phrases import KINDS, TEXTS, Code
from prooflight.reporting.sentences import reason, reasons

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Ink, Region, Verdict

Size = tuple[float, float]
"""Width and height of a page. [mm]"""
Shape = Literal["page", "streak", "band", "area"]
"""Shape of a place: the whole page, long in print direction, long across it, or neither."""

ALL_OVER_SHARE: Final = 0.6
"""Share of the page's area above which a place counts as the whole page. assumed"""
FULL_SHARE: Final = 0.8
"""Share of the page's length or width above which a streak or a band has no ends worth naming. assumed"""
LONG: Final = 4.0
"""Least ratio of length to width of a streak or a band. assumed: a spot is rounder."""
LEAST_LONG_MM: Final = 20.0
"""Least length of a streak or a band. assumed: shorter ones are scratches and hairs, which have any direction."""
EDGE_MM: Final = 2.0
"""Distance from the page's edge within which a place is at the edge. assumed: cut and feed vary as much."""
SHAPED: Final = ("spots-voids", "streak", "banding")
"""Kinds that name a shape, so that the shape of the place decides between them."""
AMOUNT_SUFFICES: Final = (*SHAPED, "density", "missing-plane", "plane-register", "deviation", "unknown")
"""Kinds of which an amount states all: that ink is missing, say."""
IN_REASON: Final = ("wrong-page", "code", "exchanged-glyph", "missing-glyph")
"""Kinds whose reason says what no amount says: which letter, which code, how far off."""
PLACELESS: Final = ("plane-register", "swapped-planes", "density", "banding")
"""Kinds that change the print as a whole; a place of them says only where that is seen best."""
BROAD: Final = ("ghost-smear", "local-blur", "missing-content", "scum")
"""Kinds of areas, which may be long without being a streak or a band."""
OWN_SHARE: Final = 0.5
"""Least share of a plane's displacement that the others do not have, for it to be stated. assumed"""
LEAST_MISSING_PERCENT: Final = -60.0
"""Amount above which a place is too light, and no content of it is missing. assumed: what is lost is lost wholly."""
MISSING_PERCENT: Final = -90.0
"""Amount of an ink below which it is missing. assumed"""
LEAST_CLEAR_SD: Final = 0.5
"""Least excess over good sheets that is stated: rounded, less would be nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetSpan:
    """Sheets of a run that have the same defect."""

    first: int
    last: int
    count: int
    shown: int
    """Sheet that is described."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DefectText:
    """A defect in words; parts that are unknown are empty."""

    title: str
    """Kind of defect, as a heading."""
    what: str
    """What is wrong beyond the title: which ink, by how much."""
    where: str
    sheets: str
    certainty: str
    complete: bool = False
    """Whether ``what`` needs no title before it."""
    link: str = ": "
    """What stands between the title and the other parts."""

    @property
    def place(self) -> str:
        """What is wrong and where, to stand below the title."""
        return _capital(self._place)

    @property
    def detail(self) -> str:
        """All parts in one sentence without a full stop, to stand below the title."""
        return _capital(self._detail)

    @property
    def sentence(self) -> str:
        """All parts in one sentence without a full stop, to stand alone."""
        return self._alone(self._detail)

    @property
    def brief(self) -> str:
        """What is wrong and where, to stand alone."""
        return self._alone(self._place)

    @property
    def _place(self) -> str:
        return " ".join(filter(None, (self.what, self.where)))

    @property
    def _detail(self) -> str:
        return "; ".join(filter(None, (", ".join(filter(None, (self._place, self.sheets))), self.certainty)))

    def _alone(self, text: str) -> str:
        return _capital(text) if self.complete else self.link.join(filter(None, (self.title, text)))


def describe(
    verdict: Verdict,
    *,
    size_mm: Size | None = None,
    sheets: SheetSpan | None = None,
    language: Code = "en",
) -> DefectText:
    """Describe the first region of a misprint in words.

    Parameters
    ----------
    verdict : of one page; of a page that is no misprint only the reason is stated.
    size_mm : of the page; None: unknown, so that the right and the tail edge are not named.
    sheets : on which the defect was seen; None: this is not stated.
    language : of the words.

    Examples
    --------
    >>> from prooflight.detectors.verdict import Region, Verdict
    >>> streak = Region(x_mm=0.0, y_mm=0.0, width_mm=3.0, height_mm=297.0, score=221.4, kind="streak", ink="M",
    ...                 darker_percent=14.2, above_good_sd=9.1)
    >>> verdict = Verdict(page="p0001", verdict="misprint", kind="streak", regions=(streak,))
    >>> describe(verdict, size_mm=(210.0, 297.0), sheets=SheetSpan(first=48, last=60, count=13, shown=60)).sentence
    'Magenta 14 % too dark in a streak 3 mm wide along the left edge, on this and the last 12 sheets; seen 9 sigma \
above what 99 of 100 good sheets show'
    """
    say = _Phrasing(language)
    if verdict.verdict != "misprint":
        what = reason(verdict.reason, language)
        return DefectText(title="", what=what, where="", sheets="", certainty="", complete=True)
    region = verdict.regions[0] if verdict.regions else None
    kind = shown_kind(verdict.kind, region, size_mm)
    no_place = kind in ("unknown", "blank-sheet") or (
        verdict.kind in PLACELESS and shape_of(region, size_mm) == "area"
    )
    where = "" if no_place else say.place(region, size_mm, kind)
    what = say.what(verdict, kind, region)
    if spoken := kind != "blank-sheet" and _reason_speaks(verdict, language):
        what, where = reason(verdict.reason, language), ""
    elif len(verdict.regions) > 1 and where:
        where = f"{where}, {say.more(len(verdict.regions) - 1)}"
    return DefectText(
        title=KINDS[language].get(kind, kind),
        what=what,
        where=where,
        link=" " if where and not what and kind != "streak" else ": ",
        complete=spoken or (bool(what) and kind in AMOUNT_SUFFICES and not say.ink_alone(region, what)),
        sheets="" if sheets is None else say.sheets(sheets),
        certainty=say.certainty(verdict, region),
    )


def shown_kind(kind: str | None, region: Region | None, size_mm: Size | None = None) -> str:
    """Return the kind by which a region is shown: a long one is a streak or a band, however the kind was learned.

    A streak of which only a part stands out remains one.

    >>> from prooflight.detectors.verdict import Region
    >>> tall = Region(x_mm=82.0, y_mm=0.0, width_mm=3.4, height_mm=280.0, score=9.0, kind="spots-voids")
    >>> shown_kind("spots-voids", tall), shown_kind("scum", tall), shown_kind(None, tall), shown_kind(None, None)
    ('streak', 'scum', 'deviation', 'unknown')
    """
    shape = shape_of(region, size_mm)
    if kind == "missing-content" and region is None:  # of a sheet that shows no page, nothing is printed
        return "blank-sheet"
    if kind is None or kind == "unknown":
        return "unknown" if shape == "page" else "deviation"
    percent = None if region is None else region.darker_percent
    if kind == "missing-content" and percent is not None and percent > LEAST_MISSING_PERCENT:
        return "density"
    if kind not in SHAPED or shape == "page":
        return kind
    return {"streak": "streak", "band": "banding"}.get(shape, kind)


def shape_of(region: Region | None, size_mm: Size | None = None) -> Shape:
    """Return the shape of a place; None: the page as a whole."""
    if region is None or not all(map(math.isfinite, (region.x_mm, region.y_mm))):
        return "page"
    width, height = region.width_mm, region.height_mm
    if size_mm is not None and width * height > ALL_OVER_SHARE * size_mm[0] * size_mm[1]:
        return "page"
    if height >= max(LEAST_LONG_MM, LONG * width):
        return "streak"
    return "band" if width >= max(LEAST_LONG_MM, LONG * height) else "area"


def _reason_speaks(verdict: Verdict, language: Code) -> bool:
    """Return whether the detector's own reason says more than ``describe`` can, in a language that it has."""
    special = verdict.kind in IN_REASON or not verdict.regions
    return special and bool(verdict.reason) and (language == "en" or reasons().contains(verdict.reason))


def _of_all(inks: Mapping[str, Ink], worst: str) -> bool:
    """Return whether most of an ink's displacement is that of all inks, so that it is not certain which one is off."""
    right, down = inks[worst].register_mm
    common = [statistics.median(one.register_mm[axis] for one in inks.values()) for axis in (0, 1)]
    return math.hypot(right - common[0], down - common[1]) < OWN_SHARE * math.hypot(right, down)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


@dataclass(frozen=True, slots=True)
class _Phrasing:
    """Phrases of one language."""

    language: Code

    def text(self, key: str, **values: str) -> str:
        return TEXTS[self.language][key].format(**values)

    def number(self, value: float, digits: int = 0) -> str:
        shown = f"{value:.{digits}f}"
        return shown.replace(".", ",") if self.language == "de" else shown

    def mm(self, value: float) -> str:
        """Return millimetres as text: a tenth below ten, and no tenth that is 0."""
        shown = self.number(value, 1 if value < 9.95 else 0)
        return shown[:-2] if shown.endswith((".0", ",0")) else shown

    def ink(self, letter: str) -> str:
        return self.text(f"ink.{letter}") if letter in NAME_OF_INK else self.text("ink")

    def ink_alone(self, region: Region | None, what: str) -> bool:
        """Return whether what is wrong is stated as an ink without an amount."""
        return region is not None and what == self.ink(region.ink)

    def what(self, verdict: Verdict, kind: str, region: Region | None) -> str:
        if kind == "plane-register":
            return self.register(verdict.inks, region)
        if region is None or kind == "missing-content":  # the kind says that all is missing
            return ""
        return self.amount(region) or (self.ink(region.ink) if region.ink else "")

    def amount(self, region: Region) -> str:
        percent = region.darker_percent
        if percent is None or not math.isfinite(percent):
            return ""
        ink = f"{self.ink(region.ink)} " if region.ink else ""
        if region.ink and percent <= MISSING_PERCENT:
            return self.text("missing", ink=ink)
        way = "dark" if percent > 0 else "light"
        size = abs(percent)
        if size > 100:
            return self.text(f"much.{way}", ink=ink)
        shown = self.text("below-1") if size < 1 else self.number(size)
        return self.text(way, ink=ink, percent=shown)

    def register(self, inks: Mapping[str, Ink], region: Region | None) -> str:
        if not inks:
            return ""
        named = region.ink if region is not None else ""
        worst = (
            named if named in inks else max(inks, key=lambda letter: math.hypot(*inks[letter].register_mm))
        )
        right, down = inks[worst].register_mm
        if len(inks) > 2 and _of_all(inks, worst):
            return ""
        ink = self.ink(worst if named or len(inks) == 1 else "")
        ways = [
            self.text("right" if right > 0 else "left", mm=self.number(abs(right), 2)),
            self.text("down" if down > 0 else "up", mm=self.number(abs(down), 2)),
        ]
        which = [way for way, mm in zip(ways, (right, down), strict=True) if abs(mm) >= 0.005]
        both = f" ({', '.join(which)})" if which else ""
        return self.text("register", ink=ink, mm=self.number(math.hypot(right, down), 2)) + both

    def place(self, region: Region | None, size_mm: Size | None, kind: str) -> str:
        shape = shape_of(region, size_mm)
        if region is None or shape == "page":
            return self.text("where.page")
        across = self.side(region.x_mm, region.width_mm, size_mm and size_mm[0], "left", "right")
        down = self.side(region.y_mm, region.height_mm, size_mm and size_mm[1], "lead", "tail")
        if shape == "streak" and kind not in BROAD:
            ends = self.ends(region.y_mm, region.height_mm, size_mm and size_mm[1], "ends.down")
            return self.text("where.streak", mm=self.mm(region.width_mm), at=across) + ends
        if shape == "band" and kind not in BROAD:
            ends = self.ends(region.x_mm, region.width_mm, size_mm and size_mm[0], "ends.across")
            return self.text("where.band", mm=self.mm(region.height_mm), at=down) + ends
        text = "where.part" if kind == "streak" else "where.area"
        size = f"{self.mm(region.width_mm)} × {self.mm(region.height_mm)} mm"
        return self.text(text, size=size, across=across, down=down.lstrip(", "))

    def side(self, begin_mm: float, extent_mm: float, of_mm: float | None, first: str, last: str) -> str:
        """Position along one axis, with what separates it: at an edge of the page, or its distance from the first."""
        if begin_mm <= EDGE_MM:
            return self.text(f"at.{first}")
        if of_mm is not None and of_mm - begin_mm - extent_mm <= EDGE_MM:
            return self.text(f"at.{last}")
        return self.text(f"from.{first}", mm=self.number(begin_mm + extent_mm / 2))

    def ends(self, begin_mm: float, extent_mm: float, of_mm: float | None, key: str) -> str:
        if of_mm is None or extent_mm > FULL_SHARE * of_mm:
            return ""
        first, last = max(begin_mm, 0.0), min(begin_mm + extent_mm, of_mm)
        return self.text(key, first=self.number(first), last=self.number(last))

    def more(self, places: int) -> str:
        return self.text("more.one" if places == 1 else "more", n=str(places))

    def sheets(self, span: SheetSpan) -> str:
        reach = span.last - span.first + 1
        count = str(span.count)
        if span.shown != span.last:
            return self.text("sheets.past", n=count, first=str(span.first), last=str(span.last))
        if span.count <= 1:
            return self.text("sheets.this")
        if span.count < reach:
            return self.text("sheets.some", n=count, reach=str(reach))
        return self.text("sheets.two" if reach == 2 else "sheets.all", n=str(reach - 1))

    def certainty(self, verdict: Verdict, region: Region | None) -> str:
        above = None if region is None else region.above_good_sd
        if above is not None and math.isfinite(above) and above >= LEAST_CLEAR_SD:
            return self.text("clear", sd=self.number(above, 1 if above < 3 else 0))
        if verdict.score is None or verdict.threshold is None:
            return ""
        digits = 1 if max(abs(verdict.score), abs(verdict.threshold)) < 100 else 0
        score, threshold = (self.number(one, digits) for one in (verdict.score, verdict.threshold))
        return self.text("score", score=score, threshold=threshold)
