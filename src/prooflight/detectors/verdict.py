"""What a detector says of one page; what becomes of its sheet is a ``disposition``.

A number that is not finite lies neither above nor below a threshold: nothing is decided by it, and nobody calls such a
page good (``Verdict.from_decision``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping  # the journal reads verdicts by their annotations
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal, Self

from prooflight.shown import Shown

if TYPE_CHECKING:
    from prooflight.detectors.cost import RunningCosts

Word = Literal["good", "misprint", "not-inspected"]
NUMBERS: Final = {
    "score": "score",
    "threshold": "threshold",
    "p_value": "p-value",
    "probability": "probability",
}
"""On which a verdict rests, and what people call them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """A place on the page that differs from what was expected."""

    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float
    score: float
    """How far this place is off, in standard deviations: of an 8 x 8 pixel mean, or of the statistic that found it."""
    kind: str

    @classmethod
    def rounded(cls, box_mm: tuple[float, float, float, float], *, score: float, kind: str) -> Self:
        """As people read it: x, y, width and height to 0.01 mm, the score to a tenth."""
        x, y, width, height = (round(extent, 2) for extent in box_mm)
        return cls(x_mm=x, y_mm=y, width_mm=width, height_mm=height, score=round(score, 1), kind=kind)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ink:
    """What one print was found to do with one ink."""

    gain_percent: float
    """How much more of it there is than planned, as a share of it."""
    dot_gain_percent: float
    """Ink area added at 50 %."""
    register_mm: tuple[float, float]
    """How far its plane lies too far right and down of the print."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Code:
    """A bar code or matrix code of the page, as it reads in the scan."""

    symbology: str
    """QR Code, Code 128, EAN-13, ..."""
    text: str
    """What the page has."""
    read: str | None
    """What the scan has; None: nothing that can be read."""
    checked: bool
    """Whether the page is a misprint if it does not read; not where this camera is too coarse for it, or lost lines."""
    grade: float | None
    """From 4, the best, to 0, in the manner of ISO/IEC 15416 and 15415 (``inspection.codes.grading``); None: of a
    symbology for which there is none here."""
    weakest: str
    """What the grade is for; empty: no grade, or nothing is wrong."""
    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float

    @property
    def failed(self) -> bool:
        """Whether it should read and does not."""
        return self.checked and self.read != self.text


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """What a detector alone can say: evidence and threshold, without place or kind."""

    misprint: bool
    score: float
    """Evidence for a misprint; higher is worse. The statistic itself: p-values underflow."""
    threshold: float
    p_value: float | None
    probability: float | None
    """Of a misprint, given the score [-]; None: this detector knows none."""

    @property
    def word(self) -> Word:
        """What it comes to."""
        if unsound(self):
            return "not-inspected"
        return "misprint" if self.misprint else "good"


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict(Shown):
    """One page's verdict, with everything a person or a program asks of it."""

    page: str
    verdict: Word
    probability: float | None = None
    score: float | None = None
    threshold: float | None = None
    p_value: float | None = None
    kind: str | None = None
    regions: tuple[Region, ...] = ()
    shift_mm: tuple[float, float] | None = None
    """Where the page lies minus where it should (x, y); None: this detector takes the page to lie where it should."""
    milliseconds: float = 0.0
    detector: str = ""
    """Who says so; empty: nobody looked."""
    family: str | None = None
    """Which family of evidence says most; None: the detector has but one number."""
    reason: str = ""
    """Why, in the user's words; empty: there is nothing to explain."""
    inks: Mapping[str, Ink] = field(default_factory=dict)
    """What was found of each ink that the page has, by its letter; empty: this detector does not look."""
    expected_cost: Mapping[str, float] = field(default_factory=dict)
    """Of letting pass (``accept``) and of stopping (``stop``), at this probability. [cent]"""
    stopping_costs_more: bool = False
    """Whether stopping for this misprint is expected to cost more than letting it pass, by the press file's costs."""
    widened: float = 1.0
    """How many times more widely than others this page was judged, because it has more colours than the detector's fit
    follows."""
    codes: tuple[Code, ...] = ()
    """Bar codes and matrix codes of the page, from top to bottom; empty: it has none, or nobody read them."""
    promise_suspended: bool = False
    """Whether the run's pages had shown, by this one, that the promised false-alarm rate does not hold for them."""

    def __post_init__(self) -> None:
        """Whoever makes or reads it: nothing is good by a number that is not finite."""
        if self.verdict == "good" and (why := unsound(self)):
            changed = dict.fromkeys(NUMBERS) | {"verdict": "not-inspected", "reason": why}
            for name, value in changed.items():
                object.__setattr__(self, name, value)

    @classmethod
    def from_decision(
        cls,
        page: str,
        decision: Decision,
        *,
        costs: RunningCosts | None = None,
        surely: bool = False,
        **told: Any,
    ) -> Self:
        """The verdict that a decision comes to, ``not-inspected`` if a number of it is not finite.

        costs: None, nobody says that stopping costs more. surely: nor for this misprint. told: all else.
        """
        if why := unsound(decision):
            return cls.skipped(page, why, detector=told.get("detector", ""))
        chance, pays = decision.probability, True
        if costs is not None and chance is not None:
            pays = costs.stopping_pays(chance)
            told["expected_cost"] = costs.expected_cents(chance)
        return cls(
            page=page,
            verdict=decision.word,
            stopping_costs_more=decision.misprint and not (surely or pays),
            probability=chance,
            score=decision.score,
            threshold=decision.threshold,
            p_value=decision.p_value,
            **told,
        )

    @classmethod
    def skipped(cls, page: str, reason: str = "", *, detector: str = "") -> Self:
        """Of a page that was not inspected."""
        return cls(page=page, verdict="not-inspected", reason=reason, detector=detector)


def unsound(numbers: Decision | Verdict) -> str:
    """Why nothing can be decided by these numbers; empty: something can."""
    for name, word in NUMBERS.items():
        value = getattr(numbers, name)
        if value is not None and not math.isfinite(value):
            return f"the page's {word} is not a finite number ({value}), so that nothing was decided"
    return ""
