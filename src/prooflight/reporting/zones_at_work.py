"""What zones do, by prints of one page: each looked at without zones and with them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.reporting.pictures import encoded
from prooflight.reporting.zones_picture import zones_picture

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.detectors.verdict import Word
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zone import Zone


@dataclass(frozen=True, slots=True, kw_only=True)
class Looked:
    """One print."""

    what: str
    """What was printed, in words."""
    before: Word
    """The verdict without zones ..."""
    after: Word
    """... and with them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ZonesAtWork:
    """A page with its zones, and what became of prints of it."""

    page: str
    picture: bytes
    """WebP: the page with its zones."""
    looked: tuple[Looked, ...]
    prints: int
    """Good ones, by which the zones were priced."""
    alarmed_before: int
    alarmed_after: int
    """Of those that count, good prints that alarmed."""
    counted: int


def page_with_zones(page: Page, zones: Sequence[Zone]) -> bytes:
    """WebP."""
    return encoded(zones_picture(page, zones))
