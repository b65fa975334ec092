"""Effect of zones on prints of one page, each inspected without zones and with them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.reporting.pictures import encoded
from prooflight.reporting.zones_picture import zones_picture

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.detectors.verdict import VerdictName
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zone import Zone


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectedSheet:
    """Verdicts of one print."""

    what: str
    """Description of the print."""
    before: VerdictName
    """Verdict without zones."""
    after: VerdictName
    """Verdict with zones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ZonesAtWork:
    """A page with its zones, and the verdicts of prints of it."""

    page: str
    picture: bytes
    """The page with its zones, as WebP."""
    inspected: tuple[InspectedSheet, ...]
    prints: int
    """Number of good prints by which the zones were priced."""
    alarmed_before: int
    alarmed_after: int
    """Number of counted good prints that alarmed with zones; ``alarmed_before`` without."""
    counted: int


def page_with_zones(page: Page, zones: Sequence[Zone]) -> bytes:
    """Draw a page with its zones, as WebP."""
    return encoded(zones_picture(page, zones))
