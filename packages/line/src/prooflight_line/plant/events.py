"""The stream of events that the plant receives, as JSON of one schema, docs/reference/events.schema.json.

Every event carries the identifier of its stream and its number in that stream, from 1 without a gap; a stream
begins when a process does. Where events were lost on their way to a consumer, one event of the kind
``events-lost`` takes their place. It has the number of the last of them, so that the next one follows without
a gap.

Numbers that are not finite are absent, because JSON has none. Fields may be added to an event; none changes
its meaning.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, get_args

from pydantic import ConfigDict, Field, TypeAdapter

from prooflight.detectors.disposition import DecidedBy, Disposition
from prooflight.detectors.verdict import VerdictName
from prooflight_line.journal.schema import finite

if TYPE_CHECKING:
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight_line.journal.records import RunFacts
    from prooflight_line.run.incidents import Incident, Trend
    from prooflight_line.run.notices import Notice
    from prooflight_line.run.outcomes import Outcome

SCHEMA_ID: Final = "urn:prooflight:events:2"
"""Identifier of the schema. The 2 becomes 3 when a field changes its meaning or is removed."""
TrayName = Literal["good", "reject", "unconfirmed"]
GateCode = Literal[
    "good",
    "misprint",
    "not-inspected",
    "lost-lines",
    "unknown-sheet",
    "out-of-place",
    "set-spoiled",
    "until-clean-break",
    "too-late",
    "place-unknown",
]
"""Names of the codes in the gate's registers."""
Scope = Literal["place", "column", "sheet", "run"]
Direction = Literal["grows", "steady", "shrinks", "unknown"]


class Part:
    """Base class of all parts of events."""

    __slots__ = ()
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(use_attribute_docstrings=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Box(Part):
    """A rectangle on the sheet, measured from its top-left corner as printed. [mm]"""

    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Place(Part):
    """One region of a misprint."""

    kind: str
    box: Box
    score: float | None
    """Deviation of the region, in standard deviations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InkFound(Part):
    """Gain and registration of one ink on one print."""

    ink: str
    """Letter of the ink: C, M, Y or K."""
    gain_percent: float | None
    register_x_mm: float | None
    register_y_mm: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Growth(Part):
    """Trend of one quantity of an incident."""

    now: float | None
    a_sheet: float | None
    direction: Direction


@dataclass(frozen=True, slots=True, kw_only=True)
class IncidentFacts(Part):
    """State of an incident so far (``run.incidents``)."""

    number: int
    kind: str
    """Kind of the misprint, or missing-page, lost-lines, camera-gone, not-inspected, late."""
    scope: Scope
    """How the cause is located: by a place, a column of the web, the sheet as a whole, or (run) nothing on
    the sheet."""
    where: str
    """Position in words; empty: the incident has no position on the sheet."""
    box: Box | None
    """Bounding box of all its regions."""
    first_sheet: int
    last_sheet: int
    count: int
    """Number of sheets that belong to the incident."""
    sheets: tuple[int, ...]
    """Numbers of the first and the last of its sheets."""
    pages: tuple[str, ...]
    """Pages of the job that the incident has affected."""
    since_s: float
    """Time at which its first sheet came, by the source's clock."""
    last_s: float
    """Time at which its last sheet came, by the source's clock."""
    score: Growth | None
    """Deviation of the region, in standard deviations."""
    size_mm2: Growth | None
    """Area of the bounding box."""
    disposition: Disposition
    """The most severe disposition of its sheets."""
    reason: str
    """Reason given for its last sheet."""
    returned: int
    """Number of times that the incident came back after it had ended."""
    ended_with: int | None
    """The sheet with which the incident ended; None: it is open."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStarted(Part):
    """A run begins."""

    event: Literal["run-started"] = "run-started"
    job: str
    """Name of the job."""
    press: str
    """Name of the press."""
    detector: str
    """Name of the detector that inspects the sheets."""
    source: str
    """Source of the camera lines."""
    simulated: bool
    """Whether the press is the simulated one, so that no sheet is of paper."""
    sheets: int | None
    """Number of sheets to be printed; None: not stated."""
    width_mm: float | None
    """Width of a sheet, across the travel; None: not known."""
    height_mm: float | None
    """Height of a sheet, along the travel; None: not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEnded(Part):
    """A run is over."""

    event: Literal["run-ended"] = "run-ended"
    ending: Literal["finished", "stopped", "fault"]
    """How the run ended. stopped: by a person, before all sheets had come."""
    detail: str
    """Reason why the run is incomplete, in one line; empty if it is complete."""
    counts: Mapping[str, int]
    """Counts of sheets (good, misprint, not-inspected, late) and of alarms (incidents)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OnSheet(Part):
    """The side and the sheet that passed, in a run whose job is imposed on sheets or has sets."""

    sheet: int
    """Number of the sheet in the run, counting front and back as one sheet, from 0."""
    side: Literal["front", "back"] | None
    """Side that passed; None: the sheets of this run have one side only."""
    name: str
    """Name of the sheet in the job."""
    copy: int
    """Copy of the job, from 1."""
    set: int | None
    """Number of the set in the run, from 0; None: the job has no sets."""
    pages: tuple[int, ...]
    """Numbers of the job's pages on this side, from 1; an empty list: the side should be blank."""
    last_side: bool
    """Whether it is the last side of its sheet to pass."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetJudged(Part):
    """A sheet has its verdict, or a page did not come."""

    event: Literal["sheet-judged"] = "sheet-judged"
    sheet: int
    """Number in the run, from 0."""
    came: bool
    """Whether a sheet came. False: the event reports a page that did not come."""
    job_page: int | None
    """Position in the run's pages that the sheet shows, from 0; None: none of them."""
    page: str
    """Name of the page in the job."""
    verdict: VerdictName
    disposition: Disposition
    """Action for the sheet. accept: it goes to the good sheets. hold: it is not released before a person
    has seen it. divert: it is taken out of the good sheets. stop: it is taken out, and the press is
    stopped."""
    decided_by: DecidedBy
    """Rule that chose the disposition. gate: the policy of the press file. costs: the costs of the press
    file, by which stopping for this misprint is expected to cost more. default: neither of these."""
    kind: str | None
    """Kind of the misprint; None: the sheet is no misprint."""
    reason: str
    """Reason for the verdict, in one line."""
    detector: str
    """Name of the detector that gave the verdict; empty: the sheet was not inspected."""
    score: float | None
    """Evidence for a misprint."""
    threshold: float | None
    """Score above which a sheet is a misprint."""
    probability: float | None
    """Probability of a misprint, given the score; None: this detector computes none."""
    places: tuple[Place, ...]
    """Regions of the misprint, the most significant first."""
    shift_x_mm: float | None
    """Measured minus expected position of the page, positive to the right."""
    shift_y_mm: float | None
    """Measured minus expected position of the page, positive downwards."""
    inks: tuple[InkFound, ...]
    """Measurements of each ink that the page has."""
    late: bool
    """Whether the verdict came after its deadline."""
    latency_ms: float | None
    """Time from the sheet's last line to its verdict."""
    time_s: float
    """Time at which its last line was read, by the source's clock."""
    faults: tuple[str, ...]
    """Faults of the paper path and of the camera's lines."""
    notes: tuple[str, ...]
    """Notes of the run as a whole that were issued with this sheet."""
    promise_suspended: bool
    """Whether the run had shown that the nominal false-alarm rate does not hold."""
    incident: int | None
    """Number of the incident to which the sheet belongs; None: the sheet is no alarm."""
    on_sheet: OnSheet | None = None
    """The sheet of which this passing is a side; None: every page is a sheet of its own, or its position
    is not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetAtGate(Part):
    """A sheet has passed the gate. In a run with a gate there is one such event for every sheet that came."""

    event: Literal["sheet-at-gate"] = "sheet-at-gate"
    sheet: int
    """Number of the sheet in the run, as in ``sheet-judged``; for two sides, the number of the last one."""
    page: str
    """Name, in the job, of the page that the sheet shows."""
    disposition: Disposition
    """Decision of Prooflight: accept, divert or stop."""
    code: GateCode
    """Reason for the decision."""
    in_time: bool
    """Whether the controller had the decision before the sheet came. False: the gate did what it does
    without a result."""
    tray: TrayName
    """Tray that the controller reported for the sheet; unconfirmed: it reported none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IncidentOpened(Part):
    """Sheets begin to alarm for a new cause."""

    event: Literal["incident-opened"] = "incident-opened"
    incident: IncidentFacts


@dataclass(frozen=True, slots=True, kw_only=True)
class IncidentChanged(Part):
    """An incident has doubled its sheets, has begun to grow or to shrink, or has come back after its end."""

    event: Literal["incident-changed"] = "incident-changed"
    returned: bool
    """Whether the incident has come back after its end."""
    incident: IncidentFacts


@dataclass(frozen=True, slots=True, kw_only=True)
class IncidentEnded(Part):
    """An incident is over, because enough good sheets have passed or because the run has ended."""

    event: Literal["incident-ended"] = "incident-ended"
    incident: IncidentFacts


@dataclass(frozen=True, slots=True, kw_only=True)
class StateChanged(Part):
    """The state of press, camera, inspection or gate has changed."""

    event: Literal["state-changed"] = "state-changed"
    of: Literal["press", "camera", "inspection", "gate"]
    state: str
    """Name of the new state. press: waiting, preparing, inspecting, draining, stopped, fault. camera:
    delivering, silent, away. inspection: in-time, overloaded. gate: as the gate reports it."""
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Noticed(Part):
    """A notice that belongs to no particular sheet."""

    event: Literal["notice"] = "notice"
    kind: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EventsLost(Part):
    """Events that this outlet dropped, because its queue was full or because the receiver refused them."""

    event: Literal["events-lost"] = "events-lost"
    count: int
    first: int
    """Number of the first dropped event."""
    last: int


Body = (
    RunStarted
    | RunEnded
    | SheetJudged
    | SheetAtGate
    | IncidentOpened
    | IncidentChanged
    | IncidentEnded
    | StateChanged
    | Noticed
    | EventsLost
)
BODIES: Final[tuple[Any, ...]] = get_args(Body)
KINDS: Final = tuple(str(fields(body)[0].default) for body in BODIES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Event(Part):
    """One message of the stream."""

    stream: str
    """Identifier of the stream of one process; another process numbers its events from 1 again."""
    number: int
    """Number in the stream, from 1."""
    time_s: float
    """Time at which the event was published, in seconds of Unix time."""
    press: str
    """Name of the press."""
    run: int | None
    """Number of the run in the journal; None: there is no run, or it is in no journal."""
    body: Annotated[Body, Field(discriminator="event")]
    """Content of the event."""

    @property
    def key(self) -> str:
        """Key by which a receiver recognises an event that is delivered twice."""
        return f"{self.stream}-{self.number}"

    @property
    def kind(self) -> str:
        """Kind of the event, which is that of its body."""
        return self.body.event

    def json(self) -> str:
        """Return the event as it is sent: one line of JSON, with names in a fixed order."""
        return json.dumps(finite(asdict(self)), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


@cache
def _adapter() -> TypeAdapter[Event]:
    return TypeAdapter(Event)


def parsed(text: str | bytes) -> Event:
    """Parse an event from its JSON; ValueError if the text is not an event."""
    return _adapter().validate_json(text)


def schema() -> dict[str, Any]:
    """Return the JSON schema (2020-12) of an event."""
    document = _adapter().json_schema(mode="serialization")
    for part in (document, *document["$defs"].values()):
        part["required"] = list(part["properties"])  # every field is always sent
        for field_schema in part["properties"].values():
            field_schema.pop("title", None)
            if "description" in field_schema:
                field_schema["description"] = " ".join(
                    field_schema["description"].replace("None:", "null:").split()
                )
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": SCHEMA_ID,
        "title": "Event of Prooflight",
    }
    return head | {name: value for name, value in document.items() if name != "title"}


# --- from what the run says ---


def run_started(facts: RunFacts, size_mm: tuple[float, float] | None) -> RunStarted:
    """Return the event of a run that begins; ``size_mm`` is the width and height of a sheet."""
    width_mm, height_mm = (None, None) if size_mm is None else size_mm
    return RunStarted(
        job=facts.job,
        press=facts.press,
        detector=facts.detector,
        source=facts.source,
        simulated=facts.source.partition(":")[0] == "drum",
        sheets=facts.sheets,
        width_mm=width_mm,
        height_mm=height_mm,
    )


def sheet_judged(outcome: Outcome, *, incident: int | None, plan: SheetPlan | None = None) -> SheetJudged:
    """Return the event of a sheet, or of a page that did not come.

    ``plan`` describes a job that is imposed on sheets; the passings are then the sides of these sheets.
    """
    record, verdict = outcome.record, outcome.record.verdict
    shift = (None, None) if verdict.shift_mm is None else verdict.shift_mm
    return SheetJudged(
        sheet=record.sheet,
        came=outcome.came,
        job_page=record.job_page,
        page=verdict.page,
        verdict=verdict.verdict,
        disposition=record.disposition,
        decided_by=record.decided_by,
        kind=verdict.kind,
        reason=verdict.reason,
        detector=verdict.detector,
        score=_number(verdict.score),
        threshold=_number(verdict.threshold),
        probability=_number(verdict.probability),
        places=tuple(
            Place(
                kind=region.kind,
                box=box((region.x_mm, region.y_mm, region.width_mm, region.height_mm)),
                score=_number(region.score),
            )
            for region in verdict.regions
            if all(map(math.isfinite, (region.x_mm, region.y_mm, region.width_mm, region.height_mm)))
        ),
        shift_x_mm=_number(shift[0]),
        shift_y_mm=_number(shift[1]),
        inks=tuple(
            InkFound(
                ink=letter,
                gain_percent=_number(ink.gain_percent),
                register_x_mm=_number(ink.register_mm[0]),
                register_y_mm=_number(ink.register_mm[1]),
            )
            for letter, ink in verdict.inks.items()
        ),
        late=record.late,
        latency_ms=None if outcome.latency_s is None else round(1e3 * outcome.latency_s, 1),
        time_s=record.time_s,
        faults=record.faults,
        notes=record.notes,
        promise_suspended=verdict.promise_suspended,
        incident=incident,
        on_sheet=None if plan is None else on_sheet(plan, record.job_page),
    )


def on_sheet(plan: SheetPlan, position: int | None) -> OnSheet | None:
    """Return the sheet and side at a position of the run; None if the position is not known."""
    if position is None or not 0 <= position < plan.passings:
        return None
    sheet, back = plan.sheet_at(position)
    shown = dict.fromkeys(plan.layout.pages_on(plan.number_at(position)))
    return OnSheet(
        sheet=sheet,
        side=None if plan.layout.sides == 1 else "back" if back else "front",
        name=plan.name(sheet),
        copy=sheet // plan.sheets_a_job + 1,
        set=plan.set_of(sheet),
        pages=tuple(page for page in shown if page is not None),
        last_side=position == max(plan.positions(sheet)),
    )


def incident_facts(incident: Incident) -> IncidentFacts:
    """Return the current state of an incident."""
    return IncidentFacts(
        number=incident.number,
        kind=incident.kind,
        scope=incident.scope,
        where=incident.where,
        box=None if incident.box_mm is None else box(incident.box_mm),
        first_sheet=incident.first_sheet,
        last_sheet=incident.last_sheet,
        count=incident.count,
        sheets=incident.sheets,
        pages=incident.pages,
        since_s=incident.since_s,
        last_s=incident.last_s,
        score=_growth(incident.score),
        size_mm2=_growth(incident.size_mm2),
        disposition=incident.disposition,
        reason=incident.reason,
        returned=incident.returned,
        ended_with=incident.ended_with,
    )


def noticed(notice: Notice) -> Noticed:
    """Return the event of a notice that belongs to no sheet."""
    return Noticed(kind=notice.kind, text=notice.text)


def box(box_mm: tuple[float, float, float, float]) -> Box:
    """Return the box of x, y, width and height. [mm]"""
    x_mm, y_mm, width_mm, height_mm = (round(extent, 2) for extent in box_mm)
    return Box(x_mm=x_mm, y_mm=y_mm, width_mm=width_mm, height_mm=height_mm)


def _growth(trend: Trend | None) -> Growth | None:
    if trend is None:
        return None
    return Growth(now=_number(trend.now), a_sheet=_number(trend.a_sheet), direction=trend.direction)


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
