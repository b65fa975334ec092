"""Facts of a run's report, gathered from the journal in passes that hold no more than they show."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import ProoflightError
from prooflight.reporting.defect_text import shown_kind
from prooflight_line.journal.exporting import job_warnings
from prooflight_line.journal.labels import OF_GOOD, SEEN, Labels, LabelStore, run_key, standing
from prooflight_line.run.incidents import NO_MISPRINT
from prooflight_line.run.labelled_sheets import incidents_by_sheet
from prooflight_line.run_package.accounts import accounts_of
from prooflight_line.run_package.pictures import seen_pictures

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Region, Verdict
    from prooflight_line.journal.labels import Label
    from prooflight_line.journal.reading import JournalReader
    from prooflight_line.journal.records import PageRecord, RunRow
    from prooflight_line.plant.gate.reconciling import Reconciliation
    from prooflight_line.run.incidents import Incident
    from prooflight_line.run_package.pictures import SeenPicture

MOST_INCIDENTS: Final = 100
"""Greatest number of incidents that a report shows: twenty pages. assumed: nobody reads more on paper."""
MOST_SHEETS: Final = 400
"""Greatest number of sheets that a report lists: ten pages."""
MOST_TRIED: Final = 4
"""Number of an incident's sheets of which one may have a picture. assumed: evidence is kept of all or of none."""
BINS: Final = 60
"""Number of intervals of the timeline."""
SERIES: Final = ("misprint", "not-inspected", "late")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedIncident:
    """An incident with its picture and its label."""

    incident: Incident
    verdict: Verdict
    """Verdict of the sheet that is shown."""
    sheet: int
    picture: SeenPicture | None
    label: Label | None
    """The last label in force; None: nobody gave one."""
    of_sheets: tuple[Label, ...]
    """Labels in force of its single sheets."""

    @property
    def region(self) -> Region | None:
        """The strongest place of the sheet that is shown."""
        return self.verdict.regions[0] if self.verdict.regions else None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedSheet:
    """A sheet with an alarm."""

    record: PageRecord
    label: Label | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportFacts:
    """Content of a report."""

    run: RunRow
    warnings: tuple[str, ...]
    incidents: tuple[ReportedIncident, ...]
    incidents_left: int
    """Number of incidents of misprints that are not shown."""
    others: tuple[Incident, ...]
    """Incidents of sheets that were not inspected, or late."""
    labelled: int
    """Number of incidents of misprints with a label."""
    false_alarms: int
    """Number of sheets with an alarm that are labelled good."""
    kinds: dict[str, int]
    timeline: tuple[tuple[int, int, int], ...]
    """Number of misprints, sheets not inspected, and late ones, in equal parts of the run."""
    sheets: tuple[ReportedSheet, ...]
    sheets_left: int
    to_reprint: int | None
    """Number of sheets to print again; None: it cannot be counted."""
    gate: Reconciliation | None
    """Account of the sheets at the gate; None: the run had none, or its log cannot be read."""
    gate_trouble: str
    version: str

    @property
    def incident_count(self) -> int:
        """Number of incidents of misprints."""
        return len(self.incidents) + self.incidents_left


@dataclass(slots=True)
class _Sheets:
    """Counts over the sheets with an alarm."""

    kinds: Counter[str] = field(default_factory=Counter)
    timeline: list[list[int]] = field(default_factory=lambda: [[0, 0, 0] for _ in range(BINS)])
    listed: list[ReportedSheet] = field(default_factory=list)
    left: int = 0
    false_alarms: int = 0

    def add(self, page: PageRecord, label: Label | None, *, share: float) -> None:
        """Add a sheet. share: of the run that came before it."""
        verdict = page.verdict.verdict
        part = self.timeline[min(int(share * BINS), BINS - 1)]
        part[2] += page.late
        if verdict == "good":
            return
        part[SERIES.index(verdict)] += 1
        if verdict == "misprint":
            self.kinds[kind_of(page.verdict)] += 1
            self.false_alarms += label is not None and label.word in OF_GOOD
        if len(self.listed) < MOST_SHEETS:
            self.listed.append(ReportedSheet(record=page, label=label))
        else:
            self.left += 1


def kind_of(verdict: Verdict) -> str:
    """Return the kind by which a misprint is shown, as ``describe`` names it."""
    return shown_kind(verdict.kind, verdict.regions[0] if verdict.regions else None)


def report_facts(journal: JournalReader, run: RunRow) -> ReportFacts:
    """Gather the content of a run's report; JournalError."""
    labels = LabelStore(journal.path).of_run(run_key(run))
    incidents, of_sheet = incidents_by_sheet(journal.pages(run.id, passed=False))
    in_force = Labels(labels)
    last, sheets = max(of_sheet, default=0), _Sheets()
    last = max(last, run.pages - 1)
    of_sheets: dict[int, list[Label]] = {}
    for sheet in in_force.sheets:
        if (label := in_force.of(sheet)) is not None and sheet in of_sheet:
            of_sheets.setdefault(of_sheet[sheet], []).append(label)
    for page in journal.pages(run.id, passed=False):
        label = in_force.of(page.sheet, of_sheet.get(page.sheet))
        sheets.add(page, label, share=page.sheet / (last + 1))
    misprints = [one for one in incidents.values() if one.kind not in NO_MISPRINT]
    last_label = _last_labels(labels)
    to_reprint, gate, trouble = None, None, ""
    try:
        listed, gate = accounts_of(journal, run)
        to_reprint = len(listed)
    except ProoflightError as error:
        trouble = str(error)
    return ReportFacts(
        run=run,
        warnings=job_warnings(run),
        incidents=tuple(
            ReportedIncident(
                incident=one,
                **_example(journal, run, one),
                label=last_label.get(one.number),
                of_sheets=tuple(of_sheets.get(one.number, ())),
            )
            for one in misprints[:MOST_INCIDENTS]
        ),
        incidents_left=max(len(misprints) - MOST_INCIDENTS, 0),
        others=tuple(one for one in incidents.values() if one.kind in NO_MISPRINT),
        labelled=sum(one.number in last_label for one in misprints),
        false_alarms=sheets.false_alarms,
        kinds=dict(sheets.kinds.most_common()),
        timeline=tuple((one[0], one[1], one[2]) for one in sheets.timeline),
        sheets=tuple(sheets.listed),
        sheets_left=sheets.left,
        to_reprint=to_reprint,
        gate=gate,
        gate_trouble=trouble,
        version=journal.version,
    )


def _last_labels(labels: list[Label]) -> dict[int, Label]:
    """Return the last label in force by incident; an acknowledgement is none."""
    return {
        int(one.incident): one
        for one in standing(labels)
        if one.word != SEEN and one.incident is not None and one.incident.isdigit()
    }


def _example(journal: JournalReader, run: RunRow, incident: Incident) -> dict[str, Any]:
    """Return verdict, sheet and picture of an incident's first sheet of which a picture is stored."""
    first = None
    for sheet in incident.sheets[:MOST_TRIED]:
        page = journal.page(run.id, sheet)
        first = first or page
        if pictures := seen_pictures(page):
            return {"verdict": page.verdict, "sheet": sheet, "picture": pictures[0]}
    if first is None:
        return {"verdict": incident.last_verdict, "sheet": incident.last_sheet, "picture": None}
    return {"verdict": first.verdict, "sheet": first.sheet, "picture": None}
