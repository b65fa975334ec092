"""What the study of detectability finds on each page of a job."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from prooflight_studies.detectability.closed_form import Reach

PRINTS: Final = 4
"""Good prints of a page, one of which must pass."""
NAMES: Final = {"spot": "spots", "streak": "streaks", "patch": "pale patches", "ink": "pale inks"}
DEFECTS: Final = tuple(NAMES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Caught:
    """Of one defect on one page, printed as faint as should be caught at 99 %."""

    of: int
    caught: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageReach:
    """One page of the job."""

    name: str
    reach: Reach
    half: Reach
    """What is caught in every second print."""
    wanted: dict[str, tuple[float, float]]
    """By defect: strengths that are caught in every second print and in 99 of 100."""
    verified: dict[str, Caught]
    """By defect; ``none``: good prints that alarmed."""

    @property
    def picture(self) -> str:
        """Its file."""
        return f"detectability-{self.name}.png"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JobReach:
    """All pages."""

    pages: list[PageReach]
    prints: dict[str, int]
    """By defect: from which it was learned how strong it must be."""
    alarming: list[str]
    """Names of pages of which ``PRINTS`` good prints alarmed: whatever were wrong with them would drown."""
