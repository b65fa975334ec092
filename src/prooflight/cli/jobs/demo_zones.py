"""Zones of the sample job's letter, priced and in use: a stamp that may come, and a name that must be right."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from prooflight.commissioning.zones.defects import areas_of, with_defect
from prooflight.commissioning.zones.price import ZonePrints, careful_share, price_of, pricing_of
from prooflight.pages.zones.zones_file import JobZones, ZoneEntry
from prooflight.reporting.zones_at_work import InspectedSheet, ZonesAtWork, page_with_zones
from prooflight.rng import stream
from prooflight.scans.scan import Scan

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.commissioning.zones.price import Shown
    from prooflight.detectors.base import PreparedPage
    from prooflight.detectors.verdict import VerdictName
    from prooflight.pages.job import JobSource
    from prooflight.press.artefact import Press

LETTER: Final = "Letter"
"""Title of the page of the sample job that gets zones."""
ADDRESS_MM: Final = (18.0, 56.0, 52.0, 27.0)
"""Rectangle of its address."""
STAMP_MM: Final = (115.0, 228.0, 70.0, 45.0)
"""Rectangle where the recipient will stamp it; it is printed blank."""
BLOT_MM: Final = 6.0
SPOTS_MM: Final = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0)
"""Diameters of spots in the address, tried until one is caught with zones."""


def zones_of_letter(number: int, sizes_mm: Sequence[tuple[float, float]]) -> JobZones:
    """Return zones of page ``number``, from 1, of a job with pages of these sizes."""
    return JobZones.create(
        [
            ZoneEntry(name="address", kind="careful", pages=str(number), rectangle_mm=ADDRESS_MM),
            ZoneEntry(name="stamp", kind="ignore", pages=str(number), rectangle_mm=STAMP_MM),
        ],
        sizes_mm,
    )


def zones_at_work(
    job: JobSource,
    press: Press,
    zones: JobZones,
    *,
    number: int,
    seed: int,
    shown: Shown,
    processes: int | None = None,
) -> ZonesAtWork:
    """Price the zones of page ``number`` by as few prints as possible, and inspect three prints of it.

    Errors as ``price_of``.
    """
    prints = pricing_of(press)[1].fewest_prints(careful_share(zones))
    price = price_of(job, press, zones, prints=prints, trials=0, seed=seed, processes=processes, shown=shown)
    work = ZonePrints(job=job, press=press, zones=zones.priced(price.entry), numbers=(number,), seed=seed)
    page, bare, zoned = work.ready(number)
    on_page = work.zones.page(page)
    assert on_page is not None
    assert bare is not None
    address, stamp = areas_of(on_page)[:2]
    scan = work.printed(page, stream(seed, "zones-trial", 0))
    shift = zoned.inspect(scan).verdict.shift_mm or (0.0, 0.0)
    inspected = [_inspected("a good print", scan, bare, zoned)]
    for at, (where, sizes) in enumerate(((stamp, (BLOT_MM,)), (address, SPOTS_MM)), start=1):
        for size in sizes:
            defective = with_defect(
                scan.dn, "spot", size, where, page=page, press=press, shift_mm=shift,
                rng=stream(seed, "zones-trial", at),  # every size at the same place
            )  # fmt: skip
            assert defective is not None
            what = f"a spot of {size:g} mm in the zone {where.name}"
            one = _inspected(what, Scan(dn=defective, name=scan.name), bare, zoned)
            if one.after == "misprint":
                break
        inspected.append(one)
    return ZonesAtWork(
        page=page.name,
        picture=page_with_zones(page, on_page.zones),
        inspected=tuple(inspected),
        prints=prints,
        alarmed_before=price.alarmed_before,
        alarmed_after=price.alarmed_after,
        counted=price.good,
    )


def _inspected(what: str, scan: Scan, bare: PreparedPage, zoned: PreparedPage) -> InspectedSheet:
    before: VerdictName = bare.inspect(scan).verdict.verdict
    return InspectedSheet(what=what, before=before, after=zoned.inspect(scan).verdict.verdict)
