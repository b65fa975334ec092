"""Repeated false alarms at one place, each a tolerance that a person may grant, with its price; and its acceptance.

A proposal is advice: nothing here changes a verdict. Its price is what would no longer be detected there: the
labelled misprints of the same kind at that place, and the strength up to which a new one would pass.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError
from prooflight.inspection.common_cause import NEAR_MM
from prooflight.pages.zones.zones_file import ZoneEntry
from prooflight_line.journal.labels import FALSE_ALARM, OF_GOOD, Labels, run_key
from prooflight_line.run.incidents import causes_of
from prooflight_line.run.labelled_sheets import incidents_by_sheet
from prooflight_line.run.places import around, gap_mm, place_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from prooflight.pages.zones.zones_file import JobZones
    from prooflight_line.journal.labels import LabelStore
    from prooflight_line.journal.reading import JournalReader
    from prooflight_line.journal.records import PageRecord, RunRow
    from prooflight_line.run.incidents import Cause
    from prooflight_line.run.places import Box

LEAST_SHEETS: Final = 5
"""Least number of false alarms of one kind at one place. assumed: fewer are chance, and no sheet is spoilt by
waiting for more."""
MOST_PAGES: Final = 8
"""Greatest number of the job's pages that are named."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """A tolerance that a person may grant."""

    kind: str
    box_mm: Box
    """x, y, width and height on the page as printed: the bounding box of its false alarms."""
    where: str
    """Description of the place."""
    pages: tuple[str, ...]
    """Names of its pages of the job, ``MOST_PAGES`` at most."""
    runs: tuple[int, ...]
    sheets: int
    """Number of false alarms that it would have suppressed."""
    up_to_score: float
    """Greatest score of the place among them: anything weaker would pass. [standard deviations]"""
    misprints_lost: int
    """Number of sheets labelled as a misprint of this kind at this place that it would have let pass."""
    misprints_kept: int
    """Number of such sheets whose defects are stronger, or lie elsewhere on the sheet too."""
    untold: int
    """Unlabelled alarms of this kind at this place that would pass too."""

    @property
    def sentences(self) -> tuple[str, ...]:
        """Description of the proposal, in lines."""
        x, y, width, height = self.box_mm
        return (
            f"{self.sheets} false alarms in runs {', '.join(map(str, self.runs))}",
            f"would tolerate {self.kind} within {width:.1f} x {height:.1f} mm at {x:.1f}, {y:.1f} mm, "
            f"weaker than {self.up_to_score:.1f} standard deviations",
            f"price: {self.misprints_lost} labelled misprints there would have passed, "
            f"{self.misprints_kept} would still alarm; {self.untold} unlabelled alarms there would pass",
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Alarm:
    run: int
    record: PageRecord
    cause: Cause
    label: str


def proposals(reader: JournalReader, label_store: LabelStore, runs: Sequence[RunRow]) -> list[Proposal]:
    """Return the proposals from these runs, those with most false alarms first; JournalError."""
    alarms = [one for run in runs for one in _alarms(reader, label_store, run)]
    grouped: list[list[_Alarm]] = []
    for one in alarms:
        if one.label != FALSE_ALARM:
            continue
        near = next((group for group in grouped if _same_place(group[0].cause, one.cause)), None)
        if near is None:
            grouped.append([one])
        else:
            near.append(one)
    proposed = [_proposal(group, alarms) for group in grouped if len(group) >= LEAST_SHEETS]
    return sorted(proposed, key=lambda one: -one.sheets)


def _alarms(reader: JournalReader, label_store: LabelStore, run: RunRow) -> Iterator[_Alarm]:
    """Yield the misprints at a place, each with its label: "" for none."""
    labelled = label_store.of_run(run_key(run))
    if not labelled:
        return
    records = list(reader.pages(run.id, passed=False, damaged=lambda _: None))
    labels = Labels(labelled)
    _, incident_of = incidents_by_sheet(records)
    for record in records:
        if record.verdict.verdict != "misprint":
            continue
        causes = causes_of(record)
        if not causes or causes[0].box_mm is None or causes[0].score is None:
            continue
        in_force = labels.of(record.sheet, incident_of.get(record.sheet))
        label = "" if in_force is None else FALSE_ALARM if in_force.word in OF_GOOD else in_force.word
        yield _Alarm(run=run.id, record=record, cause=causes[0], label=label)


def _same_place(one: Cause, other: Cause) -> bool:
    if one.group != other.group or one.box_mm is None or other.box_mm is None:
        return False
    return gap_mm(one.box_mm, other.box_mm, column=one.scope == "column") <= NEAR_MM


def _proposal(group: list[_Alarm], alarms: Sequence[_Alarm]) -> Proposal:
    box: Box | None = None
    for one in group:
        assert one.cause.box_mm is not None
        box = one.cause.box_mm if box is None else around(box, one.cause.box_mm)
    assert box is not None
    cause = group[0].cause
    up_to = max(abs(one.cause.score or 0.0) for one in group)
    here = [one for one in alarms if _same_place(cause, one.cause)]
    misprints = [one for one in here if one.label == "misprint"]
    lost = [one for one in misprints if _would_pass(one, up_to)]
    pages = dict.fromkeys(one.record.verdict.page for one in group)
    return Proposal(
        kind=cause.kind,
        box_mm=tuple(round(value, 2) for value in box),  # type: ignore[arg-type]
        where=place_text(box, column=cause.scope == "column", size_mm=None),
        pages=tuple(pages)[:MOST_PAGES],
        runs=tuple(sorted({one.run for one in group})),
        sheets=len(group),
        up_to_score=up_to,
        misprints_lost=len(lost),
        misprints_kept=len(misprints) - len(lost),
        untold=sum(not one.label and _would_pass(one, up_to) for one in here),
    )


def _would_pass(alarm: _Alarm, up_to: float) -> bool:
    """Return whether a sheet has no other defect than the tolerated one."""
    score = abs(alarm.cause.score or math.inf)
    return score <= up_to and len(alarm.record.verdict.regions) == 1


# --- acceptance: a proposal becomes an ignored zone ---

MARGIN_MM: Final = 1.0
"""Margin around the false alarms. assumed: the largest displacement of a page, and of a place within it."""
NAME: Final = "tolerance"
PAGE: Final = re.compile(r"p([0-9]{4,})(?:-[0-9]+)?")


def granted(proposal: Proposal, sizes_mm: Sequence[tuple[float, float]]) -> ZoneEntry:
    """Return the zone of a proposal, on the pages that it names.

    Zones have neither kind nor amount: everything printed there is ignored, which is more than was proposed.
    RequestError: a page is not one of the job's, or the place is on none of its pages.
    """
    numbers = sorted({_number(name, len(sizes_mm)) for name in proposal.pages})
    width_mm, height_mm = (min(sizes_mm[number - 1][axis] for number in numbers) for axis in (0, 1))
    x, y, width, height = proposal.box_mm
    left, top = max(x - MARGIN_MM, 0.0), max(y - MARGIN_MM, 0.0)
    right, bottom = min(x + width + MARGIN_MM, width_mm), min(y + height + MARGIN_MM, height_mm)
    if right <= left or bottom <= top:
        what = f"its place, {x:.1f}, {y:.1f} mm, is on no page of this job"
        raise RequestError(NAME, what, remedy="give the job that was printed")
    return ZoneEntry(
        name=f"{NAME}: {proposal.kind} at {x:.0f}, {y:.0f} mm",
        kind="ignore",
        pages=",".join(map(str, numbers)),
        rectangle_mm=(round(left, 2), round(top, 2), round(right - left, 2), round(bottom - top, 2)),
    )


def with_zone(job_zones: JobZones | None, entry: ZoneEntry) -> tuple[ZoneEntry, ...]:
    """Return the zones of a file and one more; RequestError: a zone of that name is there already."""
    before = () if job_zones is None else job_zones.document.zones
    if any(one.name == entry.name for one in before):
        raise RequestError(NAME, f"{entry.name!r} was granted already", remedy="remove it first")
    return (*before, entry)


def _number(name: str, pages: int) -> int:
    match = PAGE.fullmatch(name)
    if match is None or not 1 <= int(match[1]) <= pages:
        raise RequestError(NAME, f"{name} is not a page of this job", remedy="give the job that was printed")
    return int(match[1])
