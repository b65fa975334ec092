"""What a plant of 100 presses and a million designs needs, computed from measured figures, and what breaks first."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

PRESSES: Final = 100
DESIGNS: Final = 1_000_000
NIGHT_H: Final = 8.0
"""Time in which the designs are to be prepared; assumed: the shift without production."""
SHEETS_PER_S: Final = 5.0
"""Rate of a press, as in the study of records."""
LINK_BYTES_PER_S: Final = 1.25e8
"""Rate of a network of 1 Gbit/s; assumed: the least that machines of a plant have."""
DISK_BYTES: Final = 8e12
"""Disk of the head; assumed: one of the largest that fit into a desktop machine."""
MEMORY_BYTES: Final = 16e9
"""Memory of the head; assumed: a desktop machine's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """Figures of this study and of the study of records on which the plant rests."""

    design_s: float
    """Processor time of a worker for one design."""
    head_s: float
    """Processor time of the head for one design."""
    design_bytes: float
    head_bytes: float
    """Memory of the head at the end of a long job."""
    growth_bytes: float
    """Growth of the head's memory from one design to the next of a long job; 0: none was seen."""
    search_s: float
    """Time for which one design is looked for among those that are stored."""
    shipped_rows_per_s: float
    """Rows that shippers brought into the database while presses ran; more were not tried."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Need:
    """What the plant needs of one resource."""

    what: str
    need: float
    has: float
    """What there is of it."""
    unit: str
    basis: str
    """What the figures rest on."""

    @property
    def share(self) -> float:
        """Need over what there is. [-]"""
        return self.need / self.has


def needs(one: Measured) -> list[Need]:
    """Return the needs of what cannot be had by more workers, the scarcest first."""
    night_s = 3600 * NIGHT_H
    rows_per_s = PRESSES * SHEETS_PER_S
    each = (
        Need(
            what="processor of the head",
            need=DESIGNS * one.head_s / night_s,
            has=1.0,
            unit="cores",
            basis=f"{1000 * one.head_s:.1f} ms per design, in one thread",
        ),
        Need(
            what="network into the head",
            need=DESIGNS * one.design_bytes / night_s / 1e6,
            has=LINK_BYTES_PER_S / 1e6,
            unit="MB/s",
            basis=f"{one.design_bytes / 1e6:.2f} MB per design; assumed: 1 Gbit/s",
        ),
        Need(
            what="disk of the head",
            need=DESIGNS * one.design_bytes / 1e12,
            has=DISK_BYTES / 1e12,
            unit="TB",
            basis=f"{one.design_bytes / 1e6:.2f} MB per design; assumed: one disk",
        ),
        Need(
            what="memory of the head",
            need=(one.head_bytes + DESIGNS * one.growth_bytes) / 1e9,
            has=MEMORY_BYTES / 1e9,
            unit="GB",
            basis=f"{one.growth_bytes:.0f} bytes per design beyond {one.head_bytes / 1e6:.0f} MB; assumed: 16 GB",
        ),
        Need(
            what="the initial search for stored designs",
            need=DESIGNS * one.search_s / 60,
            has=NIGHT_H * 60,
            unit="min",
            basis=f"{1e6 * one.search_s:.0f} us per design, within the night",
        ),
        Need(
            what="rows written to the database while all presses print",
            need=rows_per_s,
            has=one.shipped_rows_per_s,
            unit="rows/s",
            basis="the highest rate in the study of records while presses ran; higher rates were not tested",
        ),
    )
    return sorted(each, key=lambda need: need.share, reverse=True)


def processors(one: Measured) -> dict[str, float]:
    """Return the processors that prepare the designs, by how soon they must be ready."""
    return {
        f"in a night of {NIGHT_H:.0f} h": DESIGNS * one.design_s / (3600 * NIGHT_H),
        "as fast as all presses print them": PRESSES * SHEETS_PER_S * one.design_s,
    }


def shipped_rows_per_s(results: Path) -> float:
    """Return the rows a second that the study of records shipped while presses ran.

    InputError: ``results`` has no results of that study.
    """
    path = results / "records.json"
    try:
        shipping = json.loads(path.read_text(encoding="utf-8"))["shipping"]
        return float(shipping["presses"] * shipping["sheets_per_s"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        remedy = "run `prooflight study records` first"
        raise InputError(path, "has no rates of rows", remedy=remedy) from error
