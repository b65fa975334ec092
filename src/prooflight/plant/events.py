"""What the plant is told: one stream of events, as JSON of one published schema, docs/reference/events.schema.json.

Every event carries the stream it is of and its number there, from 1 without a gap; a stream begins when a process does.
Where events were lost on their way to somebody, one of the kind ``events-lost`` stands in their place and has the
number of the last of them, so that the next one follows without a gap.

Numbers that are not finite are absent: JSON has none. Fields may be added to an event; none changes what it means.
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
from prooflight.detectors.verdict import Word

if TYPE_CHECKING:
    from prooflight.journal.records import RunFacts
    from prooflight.line.incidents import Incident, Trend
    from prooflight.line.notices import Notice
    from prooflight.line.outcomes import Outcome
    from prooflight.pages.layout.plan import SheetPlan

SCHEMA_ID: Final = "urn:prooflight:events:2"
"""The 2 becomes 3 when a field changes its meaning or goes."""
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
"""The codes of the gate's registers, by name."""
Scope = Literal["place", "column", "sheet", "run"]
Direction = Literal["grows", "steady", "shrinks", "unknown"]


class Part:
    """What events are made of."""

    __slots__ = ()
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(use_attribute_docstrings=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Box(Part):
    """A place on the sheet, from its top-left corner as printed. [mm]"""

    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Place(Part):
    """One place of a misprint."""

    kind: str
    box: Box
    score: float | None
    """How far it is off, in standard deviations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InkFound(Part):
    """What one print does with one ink."""

    ink: str
    """C, M, Y or K."""
    gain_percent: float | None
    register_x_mm: float | None
    register_y_mm: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Growth(Part):
    """How a number of an incident goes."""

    now: float | None
    a_sheet: float | None
    direction: Direction


@dataclass(frozen=True, slots=True, kw_only=True)
class IncidentFacts(Part):
    """An incident as far as it has come (``line.incidents``)."""

    number: int
    kind: str
    """Of the misprint, or missing-page, lost-lines, camera-gone, not-inspected, late."""
    scope: Scope
    """What of its cause says where it is."""
    where: str
    """In words; empty: nowhere on the sheet."""
    box: Box | None
    """Around all its places."""
    first_sheet: int
    last_sheet: int
    count: int
    """Sheets that belong to it."""
    sheets: tuple[int, ...]
    """Numbers of the first and the last of them."""
    pages: tuple[str, ...]
    """Of the job, that it has touched."""
    since_s: float
    """When its first sheet came, by the source's clock."""
    last_s: float
    """When its last did."""
    score: Growth | None
    """Of the place, in standard deviations."""
    size_mm2: Growth | None
    """Of the box."""
    disposition: Disposition
    """The gravest of its sheets."""
    reason: str
    """Of its last sheet."""
    returned: int
    """How often it came again after it had ended."""
    ended_with: int | None
    """The sheet with which it ended; None: it is open."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStarted(Part):
    """A run begins."""

    event: Literal["run-started"] = "run-started"
    job: str
    """By its name."""
    press: str
    """By its name."""
    detector: str
    """That judges."""
    source: str
    """Where lines come from."""
    simulated: bool
    """Whether the press is the simulated one, so that no sheet is of paper."""
    sheets: int | None
    """To be printed; None: nobody said."""
    width_mm: float | None
    """Of a sheet, across; None: not known."""
    height_mm: float | None
    """Along the travel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEnded(Part):
    """A run is over."""

    event: Literal["run-ended"] = "run-ended"
    ending: Literal["finished", "stopped", "fault"]
    """stopped: by a person, before all sheets had come."""
    detail: str
    """What it lacks, in one line."""
    counts: Mapping[str, int]
    """Sheets: good, misprint, not-inspected, late; and alarms: incidents."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OnSheet(Part):
    """Which side of which sheet passed, in a run whose job lies on sheets or has sets."""

    sheet: int
    """Of the run, front and back together, from 0."""
    side: Literal["front", "back"] | None
    """None: its sheets have but one."""
    name: str
    """Of the sheet in the job."""
    copy: int
    """Of the job, from 1."""
    set: int | None
    """In the run, from 0; None: the job has no sets."""
    pages: tuple[int, ...]
    """Numbers of the job's pages on this side, from 1; none: it should be blank."""
    last_side: bool
    """Whether it is the last of its sheet to pass."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetJudged(Part):
    """A sheet has its verdict, or a page did not come."""

    event: Literal["sheet-judged"] = "sheet-judged"
    sheet: int
    """In the run, from 0."""
    came: bool
    """False: no sheet, but a page that did not come."""
    job_page: int | None
    """Place in the run's pages that it shows, from 0; None: none of them."""
    page: str
    """Its name in the job."""
    verdict: Word
    disposition: Disposition
    """What becomes of the sheet. accept: it goes to the good sheets. hold: it is released to nobody before a person has
    seen it. divert: it goes out of the good sheets. stop: so it does, and the press is stopped."""
    decided_by: DecidedBy
    """By what rule. gate: the policy of the press file. costs: its costs, by which stopping for this misprint is
    expected to cost more. default: none of these."""
    kind: str | None
    """Of the misprint; None: it is none."""
    reason: str
    """Why, in one line."""
    detector: str
    """Who says so; empty: nobody looked."""
    score: float | None
    """Evidence for a misprint."""
    threshold: float | None
    """Above which it is one."""
    probability: float | None
    """Of a misprint, given the score; None: this detector knows none."""
    places: tuple[Place, ...]
    """Most telling first."""
    shift_x_mm: float | None
    """Where the page lies minus where it should, to the right."""
    shift_y_mm: float | None
    """Down."""
    inks: tuple[InkFound, ...]
    """Of each ink that the page has."""
    late: bool
    """Decided after its deadline."""
    latency_ms: float | None
    """From its last line to its verdict."""
    time_s: float
    """When its last line was read, by the source's clock."""
    faults: tuple[str, ...]
    """Of the paper path and of the camera's lines."""
    notes: tuple[str, ...]
    """What the run as a whole said with it."""
    promise_suspended: bool
    """Whether the run had shown that the promised false-alarm rate does not hold."""
    incident: int | None
    """That it belongs to; None: it is no alarm."""
    on_sheet: OnSheet | None = None
    """Of which sheet what passed is a side; None: every page is a sheet of its own, or nobody can place it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetAtGate(Part):
    """A sheet has passed the gate; one event for every sheet that came, in a run with a gate."""

    event: Literal["sheet-at-gate"] = "sheet-at-gate"
    sheet: int
    """Its number in the run, as in ``sheet-judged``; of two sides that of the last."""
    page: str
    """Name of what it shows in the job."""
    disposition: Disposition
    """What Prooflight decided: accept, divert or stop."""
    code: GateCode
    """Why."""
    in_time: bool
    """Whether the controller had that before the sheet came; False: the gate has done what it does without a result."""
    tray: TrayName
    """Where the controller says that the sheet went; unconfirmed: it did not say."""


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
    """After its end."""
    incident: IncidentFacts


@dataclass(frozen=True, slots=True, kw_only=True)
class IncidentEnded(Part):
    """So many good sheets have passed that an incident is over, or the run is."""

    event: Literal["incident-ended"] = "incident-ended"
    incident: IncidentFacts


@dataclass(frozen=True, slots=True, kw_only=True)
class StateChanged(Part):
    """Press, camera, inspection or gate are in another state than before."""

    event: Literal["state-changed"] = "state-changed"
    of: Literal["press", "camera", "inspection", "gate"]
    state: str
    """press: waiting, preparing, inspecting, draining, stopped, fault. camera: delivering, silent, away. inspection:
    in-time, overloaded. gate: as the gate says."""
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Noticed(Part):
    """Something that is of no sheet."""

    event: Literal["notice"] = "notice"
    kind: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EventsLost(Part):
    """Events that this outlet gave up, because its queue was full or because the other end refused them."""

    event: Literal["events-lost"] = "events-lost"
    count: int
    first: int
    """Number of the first of them."""
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
    """Of one process; events of another are numbered anew."""
    number: int
    """In the stream, from 1."""
    time_s: float
    """When it was told, Unix time."""
    press: str
    """By its name."""
    run: int | None
    """In the journal; None: it is kept in none, or there is no run."""
    body: Annotated[Body, Field(discriminator="event")]
    """What is told."""

    @property
    def key(self) -> str:
        """By which whoever is told twice knows it."""
        return f"{self.stream}-{self.number}"

    @property
    def kind(self) -> str:
        """Of its body."""
        return self.body.event

    def json(self) -> str:
        """As it is sent: one line, names in a fixed order."""
        return json.dumps(finite(asdict(self)), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


@cache
def _adapter() -> TypeAdapter[Event]:
    return TypeAdapter(Event)


def parsed(text: str | bytes) -> Event:
    """An event from its JSON. ValueError: it is none."""
    return _adapter().validate_json(text)


def schema() -> dict[str, Any]:
    """JSON schema (2020-12) of an event."""
    found = _adapter().json_schema(mode="serialization")
    for part in (found, *found["$defs"].values()):
        part["required"] = list(part["properties"])  # every field is always sent
        for told in part["properties"].values():
            told.pop("title", None)
            if "description" in told:
                told["description"] = " ".join(told["description"].replace("None:", "null:").split())
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": SCHEMA_ID,
        "title": "Event of Prooflight",
    }
    return head | {name: value for name, value in found.items() if name != "title"}


def finite(value: Any) -> Any:
    """The same with None for every number that is not finite, and lists for tuples."""
    match value:
        case float():
            return value if math.isfinite(value) else None
        case dict():
            return {str(name): finite(inner) for name, inner in value.items()}
        case list() | tuple():
            return [finite(inner) for inner in value]
    return value


# --- from what the run says ---


def run_started(facts: RunFacts, size_mm: tuple[float, float] | None) -> RunStarted:
    """Of a run that begins; size_mm: of a sheet, width and height."""
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
    """Of a sheet, or of a page that did not come. plan: of a job that lies on sheets, whose sides these are."""
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
    """Of what passes at a position of the run; None: nobody can place it."""
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
    """Of an incident as it is now."""
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
    """Of what is of no sheet."""
    return Noticed(kind=notice.kind, text=notice.text)


def box(box_mm: tuple[float, float, float, float]) -> Box:
    """x, y, width and height. [mm]"""
    x_mm, y_mm, width_mm, height_mm = (round(extent, 2) for extent in box_mm)
    return Box(x_mm=x_mm, y_mm=y_mm, width_mm=width_mm, height_mm=height_mm)


def _growth(trend: Trend | None) -> Growth | None:
    if trend is None:
        return None
    return Growth(now=_number(trend.now), a_sheet=_number(trend.a_sheet), direction=trend.direction)


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
