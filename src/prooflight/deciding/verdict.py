"""What a detector says of one page."""

from __future__ import annotations

from collections.abc import Mapping  # the journal reads verdicts by their annotations
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol

if TYPE_CHECKING:
    from prooflight.comparing.evidence import Evidence

Word = Literal["good", "misprint", "not-inspected"]
Action = Literal["accept", "reprint", "stop"]


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
class Judgement:
    """What a detector alone can say: evidence and threshold, without place or kind."""

    misprint: bool
    score: float
    """Evidence for a misprint; higher is worse. The statistic itself: p-values underflow."""
    threshold: float
    p_value: float | None
    probability: float
    """Of a misprint, given the score. [-]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """One page's verdict, with everything a person or a program asks of it."""

    page: str
    verdict: Word
    action: Action
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


class Detector(Protocol):
    """Evidence in, judgement out; what a good page may do stands in the detector, what errors cost in the costs."""

    @property
    def name(self) -> str:
        """Name by which users ask for it."""
        ...

    def judge(self, evidence: Evidence) -> Judgement:
        """Weigh one page's evidence. Does not change it."""
        ...
