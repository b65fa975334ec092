"""Verdicts of a detector on one page; what is done with its sheet is a ``disposition``.

A number that is not finite is neither above nor below a threshold: it decides nothing, and no page is good by
it (``Verdict.from_decision``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping  # the journal reads verdicts by their annotations
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal, Self

from prooflight.shown import Shown

if TYPE_CHECKING:
    from prooflight.detectors.cost import RunningCosts

VerdictName = Literal["good", "misprint", "not-inspected"]
NUMBERS: Final = {
    "score": "score",
    "threshold": "threshold",
    "p_value": "p-value",
    "probability": "probability",
}
"""Numbers of a verdict, and their names in messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """A place on the page that differs from what was expected."""

    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float
    score: float
    """Deviation of this place in standard deviations, of an 8 x 8 pixel mean or of the statistic that
    detected it."""
    kind: str
    ink: str = ""
    """Letter of the ink that is off; empty: it is not one ink, or the sensors do not distinguish it."""
    darker_percent: float | None = None
    """By how much the place is darker than expected: more of ``ink``, or less light where that is empty; below 0 it
    is lighter. None: this was not measured."""
    above_good_sd: float | None = None
    """By how much its deviation exceeds the one that 99 of 100 good sheets stay below, in standard deviations of
    good sheets; None: the detector does not know how good sheets vary."""

    @classmethod
    def rounded(
        cls,
        box_mm: tuple[float, float, float, float],
        *,
        score: float,
        kind: str,
        ink: str = "",
        darker_percent: float | None = None,
        above_good_sd: float | None = None,
    ) -> Self:
        """Return a region rounded for display: x, y, width and height to 0.01 mm, all other numbers to a tenth."""
        x, y, width, height = (round(extent, 2) for extent in box_mm)
        return cls(
            x_mm=x,
            y_mm=y,
            width_mm=width,
            height_mm=height,
            score=round(score, 1),
            kind=kind,
            ink=ink,
            darker_percent=None if darker_percent is None else round(darker_percent, 1) + 0.0,
            above_good_sd=None if above_good_sd is None else round(above_good_sd, 1),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Ink:
    """Measured state of one ink in one print."""

    gain_percent: float
    """Excess of ink over the planned amount, as a share of it."""
    dot_gain_percent: float
    """Ink area added at 50 %."""
    register_mm: tuple[float, float]
    """Displacement of its plane to the right of and below the print."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Code:
    """A bar code or matrix code of the page, and its reading in the scan."""

    symbology: str
    """Name of the symbology, such as QR Code, Code 128 or EAN-13."""
    text: str
    """Content on the page."""
    read: str | None
    """Content in the scan; None: nothing that can be read."""
    checked: bool
    """Whether the page is a misprint if it cannot be read; False where this camera is too coarse for it, or
    lost lines."""
    grade: float | None
    """Grade from 4, the best, to 0, in the manner of ISO/IEC 15416 and 15415 (``inspection.codes.reading``); None:
    there is no grading of its symbology."""
    weakest: str
    """Parameter with the lowest grade; empty: no grade, or nothing is wrong."""
    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float

    @property
    def failed(self) -> bool:
        """Whether it should be readable and is not."""
        return self.checked and self.read != self.text


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """Decision of a detector alone: evidence and threshold, without place or kind."""

    misprint: bool
    score: float
    """Evidence for a misprint; higher is worse. The statistic itself, because p-values underflow."""
    threshold: float
    p_value: float | None
    probability: float | None
    """Probability of a misprint, given the score [-]; None: this detector has none."""

    @property
    def verdict_name(self) -> VerdictName:
        """Verdict that it leads to."""
        if unsound(self):
            return "not-inspected"
        return "misprint" if self.misprint else "good"


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict(Shown):
    """Verdict on one page, with everything that a person or a program needs to know."""

    page: str
    verdict: VerdictName
    probability: float | None = None
    score: float | None = None
    threshold: float | None = None
    p_value: float | None = None
    kind: str | None = None
    regions: tuple[Region, ...] = ()
    shift_mm: tuple[float, float] | None = None
    """Position of the page minus the nominal one (x, y); None: this detector takes the page to be in its
    nominal place."""
    milliseconds: float = 0.0
    detector: str = ""
    """Name of the detector; empty: the page was not inspected."""
    family: str | None = None
    """Strongest family of evidence; None: the detector has only one number."""
    reason: str = ""
    """Reason in the user's words; empty: there is nothing to explain."""
    inks: Mapping[str, Ink] = field(default_factory=dict)
    """Measured state of each ink that the page has, by its letter; empty: this detector does not measure
    it."""
    expected_cost: Mapping[str, float] = field(default_factory=dict)
    """Expected cost of letting pass (``accept``) and of stopping (``stop``), at this probability. [cent]"""
    stopping_costs_more: bool = False
    """Whether stopping for this misprint is expected to cost more than letting it pass, by the press file's
    costs."""
    widened: float = 1.0
    """Factor by which this page's tolerances were wider than others', because it has more colours than the
    detector's fit follows."""
    codes: tuple[Code, ...] = ()
    """Bar codes and matrix codes of the page, from top to bottom; empty: it has none, or they were not
    read."""
    promise_suspended: bool = False
    """Whether the run's pages had shown, by this one, that the guaranteed false-alarm rate does not hold for
    them."""

    def __post_init__(self) -> None:
        """Replace a good verdict by ``not-inspected`` if a number of it is not finite.

        This applies to stored verdicts too.
        """
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
        always_stop: bool = False,
        **fields: Any,
    ) -> Self:
        """Return the verdict of a decision, ``not-inspected`` if one of its numbers is not finite.

        Parameters
        ----------
        page : name of the page.
        decision : decision of a detector.
        costs : costs of errors; None: they do not count against stopping.
        always_stop : whether a misprint stops the press whatever the costs.
        fields : all other fields of the verdict.
        """
        if why := unsound(decision):
            return cls.skipped(page, why, detector=fields.get("detector", ""))
        chance, pays = decision.probability, True
        if costs is not None and chance is not None:
            pays = costs.stopping_pays(chance)
            fields["expected_cost"] = costs.expected_cents(chance)
        return cls(
            page=page,
            verdict=decision.verdict_name,
            stopping_costs_more=decision.misprint and not (always_stop or pays),
            probability=chance,
            score=decision.score,
            threshold=decision.threshold,
            p_value=decision.p_value,
            **fields,
        )

    @classmethod
    def skipped(cls, page: str, reason: str = "", *, detector: str = "") -> Self:
        """Return the verdict on a page that was not inspected."""
        return cls(page=page, verdict="not-inspected", reason=reason, detector=detector)


def unsound(numbers: Decision | Verdict) -> str:
    """Return why nothing can be decided by these numbers; empty: something can."""
    for name, label in NUMBERS.items():
        value = getattr(numbers, name)
        if value is not None and not math.isfinite(value):
            return f"the page's {label} is not a finite number ({value}), so that nothing was decided"
    return ""
