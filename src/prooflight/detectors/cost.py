"""Cost of decision errors (paper, section 5, equations 6 and 7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

from pydantic import Field

from prooflight.files.fields import LEAST, NO_OTHER_FIELDS, Positive

FLOOR_SHARE: Final = 0.1
"""Difference from the expected light of a flat place, as a share of paper white, that is always a misprint.
(assumed: a person sees it at once over 0.1 mm2)"""
FLOOR_AREA_MM2: Final = 0.1
"""Minimum area of a difference beyond the floor: a spot of 0.36 mm. One more pixel is required, because a
region's outline may be anywhere within its pixels: the darkest specks of good paper reach two pixels of 0.25
mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunningCosts:
    """The three numbers of the press owner."""

    __pydantic_config__: ClassVar = NO_OTHER_FIELDS

    misprint_rate: Annotated[float, Field(strict=True, ge=LEAST, lt=1)] = 0.01
    """Share of pages that are misprints, r (paper, section 5.2). [-]"""
    false_alarm_cents: Positive = 0.01
    """Cost of stopping for a good page, c_f (paper, section 5.2). [cent]"""
    missed_misprint_cents: Positive = 0.1
    """Cost of letting a misprint pass, c_m (paper, section 5.2). [cent]"""

    def __post_init__(self) -> None:
        if not 0 < self.misprint_rate < 1:
            message = f"misprint_rate must be between 0 and 1, got {self.misprint_rate}"
            raise ValueError(message)
        for field in ("false_alarm_cents", "missed_misprint_cents"):
            if not getattr(self, field) > 0:
                message = f"{field} must be above 0, got {getattr(self, field)}"
                raise ValueError(message)

    @property
    def alpha(self) -> float:
        """Relative cost of a miss, r c_m / ((1 - r) c_f) (paper, below equation 7). [-]"""
        rate = self.misprint_rate
        return rate * self.missed_misprint_cents / ((1 - rate) * self.false_alarm_cents)

    def normalised(self, *, false_alarms: float, misses: float) -> float:
        """Return c = F + alpha M (paper, equation 7), from the rates of false alarms and of misses. [-]"""
        return false_alarms + self.alpha * misses

    def cents_per_page(self, normalised: float) -> float:
        """Return C = (1 - r) c_f c, the expected cost of a page (paper, equation 6). [cent]"""
        return (1 - self.misprint_rate) * self.false_alarm_cents * normalised

    @property
    def stopping_probability(self) -> float:
        """Probability of a misprint from which stopping pays: c_f / (c_f + c_m). [-]"""
        return self.false_alarm_cents / (self.false_alarm_cents + self.missed_misprint_cents)

    def expected_cents(self, probability: float) -> dict[str, float]:
        """Return the expected cost of letting pass and of stopping, at a probability of a misprint. [cent]"""
        return {
            "accept": probability * self.missed_misprint_cents,
            "stop": (1 - probability) * self.false_alarm_cents,
        }

    def stopping_pays(self, probability: float) -> bool:
        """Return whether stopping costs less than letting pass, at this probability of a misprint."""
        cents = self.expected_cents(probability)
        return cents["stop"] < cents["accept"]


def floor_text(floor_share: float) -> str:
    """Return a description of what is always a misprint; empty: there is no floor."""
    if not floor_share:
        return ""
    return (
        f"A flat place over {FLOOR_AREA_MM2:g} mm² that differs by more than {100 * floor_share:g} % of paper white is "
        "always a misprint, whatever was learned, unless it is no more than a benign speck of the paper."
    )
