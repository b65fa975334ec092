"""Schemas of requests and answers, for OpenAPI and for authors of clients."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from prooflight.detectors.disposition import DecidedBy, Disposition
from prooflight_console.accounts.roles import Role, Scope
from prooflight_console.alarms.alarm_store import LEAST_SHELVED_S, MOST_NOTE, MOST_REASON, MOST_SHELVED_S
from prooflight_console.alarms.priority import Priority
from prooflight_console.reading.now import State

Cursor = int | None


class Answer(BaseModel):
    """Answer of a console; later versions may add fields."""

    model_config = ConfigDict(extra="allow")


class RunAnswer(Answer):
    """A run."""

    id: int
    state: Literal["running", "interrupted", "finished", "stopped", "fault"]
    started: str
    ended: str | None
    job: str
    job_digest: str
    press: str
    press_digest: str
    detector: str
    source: str
    sheets: int | None
    pages: int
    misprints: int
    not_inspected: int
    late: int
    faulty: int
    absent: int
    dropped_pages: int
    dropped_evidence: int
    guarantee_suspended_from: int | None = Field(
        description="First sheet for which the guaranteed false-alarm rate does not apply; null: it applies to all."
    )
    detail: str


class RunsAnswer(Answer):
    """Runs, the latest first."""

    items: list[RunAnswer]
    next: Cursor
    damaged: int


class QueuedJobAnswer(Answer):
    """A job of the queue."""

    number: int
    key: str
    name: str
    stage: Literal["checking", "queued", "held", "printing", "done", "rejected"]
    first: bool
    reason: str
    ticket: dict[str, Any] | None
    examined: dict[str, Any]


class QueueAnswer(Answer):
    """The queue of jobs."""

    waiting: list[QueuedJobAnswer]
    ended: list[QueuedJobAnswer]
    arriving: list[str] = Field(description="Files that are not in the queue yet.")
    filled: bool = Field(description="Whether a process takes files into the queue.")


class SentAnswer(Answer):
    """A file that was sent into the queue."""

    name: str
    bytes: int


class SheetAnswer(Answer):
    """A sheet with its verdict."""

    run: int
    row: int
    sheet: int
    job_page: int | None
    page: str
    verdict: Literal["good", "misprint", "not-inspected"]
    disposition: Disposition
    decided_by: DecidedBy
    kind: str | None
    probability: float | None
    score: float | None
    threshold: float | None
    p_value: float | None
    reason: str
    regions: list[dict[str, Any]]
    late: bool
    faults: list[str]
    notes: list[str]
    nuisance: dict[str, float | None]
    sample_probability: float | None = Field(
        description="Probability with which the sheet was selected for review; null: it is not part of the sample."
    )


class SheetsAnswer(Answer):
    """A list of sheets."""

    items: list[SheetAnswer]
    next: Cursor
    damaged: int


class LabelAnswer(Answer):
    """A label that a person gave to a sheet or an incident."""

    id: int
    sheet: int | None
    incident: str | None
    label: str
    note: str
    by: str
    at_s: float
    upto: int | None = Field(
        description="On an incident, the last sheet that the person saw; null: all of them."
    )
    undoes: int | None = Field(description="For the label `undone`: the label that does not count any more.")


class WholeSheetAnswer(SheetAnswer):
    """A sheet, with its evidence and labels."""

    incident: int | None
    evidence: bool
    labels: list[LabelAnswer]


class EvidenceArray(Answer):
    """One array of the evidence."""

    name: str
    dtype: str
    shape: list[int]


class EvidenceAnswer(Answer):
    """Evidence of a sheet that is stored."""

    arrays: list[EvidenceArray]
    cuts: list[dict[str, Any]]


class ReplayAnswer(Answer):
    """A verdict that was recalculated from its evidence."""

    run: int
    sheet: int
    page: str
    same: bool
    guarantee_suspended: bool
    figures: dict[str, dict[str, float | str | None]]


class IncidentAnswer(Answer):
    """An incident: all alarms of one cause."""

    number: int
    kind: str
    scope: str
    where: str
    box_mm: list[float] | None
    first_sheet: int
    last_sheet: int
    reopened_sheet: int = Field(description="Sheet with which it last opened or recurred.")
    count: int
    sheets: list[int]
    pages: list[str]
    since_s: float
    last_s: float
    disposition: Disposition
    reason: str
    recurrences: int
    open: bool
    priority: Priority
    shelved_until_s: float | None = Field(
        description="Unix time until which a person shelved it; null: it is not shelved."
    )
    label: str | None
    labelled: bool = Field(description="Whether the label covers its sheets up to the last one.")
    seen: bool = Field(description="Whether a person has acknowledged it since it last opened or recurred.")
    labels: list[LabelAnswer]


class IncidentsAnswer(Answer):
    """Incidents of a run, by number."""

    items: list[IncidentAnswer]
    next: Cursor


class ReprintAnswer(Answer):
    """Sheets to print again, with reasons: those that the job needs and that are not in the good tray.

    A set is printed again as a whole. by: ``trays`` for a run with a gate; ``verdicts`` for sheets that were
    not judged good, without a label that they are false alarms, and that were not released manually.
    """

    count: int
    unprinted: int = Field(description="Of these, sheets that were not printed when the run ended.")
    trays_from: Literal["file", "wire"] | None = Field(
        description="The controller's log of its trays, or its reports over the connection; null: there is no gate."
    )
    released_manually: list[int] = Field(
        description="Sheets of the run that are delivered because a person released them."
    )
    disagreements: list[dict[str, Any]] = Field(
        description="Sheets for which the log and the connection name different trays; they are printed again."
    )
    sheets: list[dict[str, Any]]
    pages: dict[str, int]
    truncated: bool
    by: Literal["trays", "verdicts"]


class LabelRequest(BaseModel):
    """A label for a sheet or an incident; `good` on an alarm is a false alarm."""

    model_config = ConfigDict(extra="forbid")
    label: Literal["misprint", "good", "false-alarm", "unknown", "seen"]
    note: Annotated[str, Field(max_length=1000)] = ""
    upto: Annotated[int, Field(ge=0, lt=2**63)] | None = Field(
        default=None, description="On an incident, the last sheet that was seen; default its last one."
    )


class ReleaseRequest(BaseModel):
    """Reason for which a sheet is released manually."""

    model_config = ConfigDict(extra="forbid")
    reason: Annotated[str, Field(min_length=1, max_length=1000)]


class AcknowledgeRequest(BaseModel):
    """Acknowledgement of all incidents that the person saw."""

    model_config = ConfigDict(extra="forbid")
    upto: Annotated[int, Field(ge=0, lt=2**63)] = Field(
        description="Last sheet that the person saw: incidents that opened or recurred later are left out."
    )


class AcknowledgedAnswer(Answer):
    """Incidents that were acknowledged."""

    incidents: list[int]


class ShelveRequest(BaseModel):
    """Shelving of an alarm until an end, with a reason."""

    model_config = ConfigDict(extra="forbid")
    minutes: Annotated[float, Field(ge=LEAST_SHELVED_S / 60, le=MOST_SHELVED_S / 60)]
    reason: Annotated[str, Field(min_length=1, max_length=MOST_REASON)]
    priority: Priority = Field(
        description="Priority that the person saw: nothing is shelved if it is higher by now."
    )


class ShelvingAnswer(Answer):
    """A shelving. It hides its alarm only while that is not of a higher priority than `priority`."""

    id: int
    incident: int
    priority: Priority
    reason: str
    by: str
    at_s: float
    ends_s: float
    ended_by: str | None
    ended_s: float | None
    in_force: bool


class ShelvingsAnswer(Answer):
    """Shelvings of a run, the latest first."""

    items: list[ShelvingAnswer]


class StatisticsAnswer(Answer):
    """Alarm statistics of the last runs; see the page *Alarms* for the figures of ISA-18.2."""

    runs: int = Field(description="Number of runs that are counted.")
    truncated: bool = Field(description="Whether earlier runs of this time were left out.")
    hours: float = Field(description="Hours of operation.")
    alarms: int
    per_hour: float | None
    most_in_period: int = Field(description="Greatest number of alarms in any ten minutes.")
    periods_above: int = Field(description="Periods of ten minutes with more than 10 alarms.")
    flood_share: float
    floods: int
    hours_above_share: float = Field(description="Share of hours with more than 30 alarms.")
    most_frequent_share: float
    standing: int
    stale: int = Field(description="Number of alarms that have been standing for more than 24 hours.")
    unseen: int
    shelved: int
    response_s: float | None = Field(description="Median time until an alarm was acknowledged.")
    priorities: dict[str, int] = Field(description="Alarms by the highest priority that they reached.")
    kinds: dict[str, int]


class HandoverRequest(BaseModel):
    """A note for the next shift."""

    model_config = ConfigDict(extra="forbid")
    text: Annotated[str, Field(min_length=1, max_length=MOST_NOTE)]


class HandoverAnswer(Answer):
    """A note for the next shift, and the state of the alarms when it was written."""

    id: int
    at_s: float
    by: str
    text: str
    summary: dict[str, Any]


class HandoversAnswer(Answer):
    """Notes for the next shift, the latest first."""

    items: list[HandoverAnswer]
    next: Cursor


class DriftAnswer(Answer):
    """Measurements of good prints over a run, in bins of sheets."""

    sheets: list[int]
    channels: list[dict[str, Any]]


class HistogramAnswer(Answer):
    """Histogram of inspection times."""

    edges_ms: list[float]
    counts: list[int]
    median_ms: float | None
    p99_ms: float | None
    greatest_ms: float | None
    late: int


class FiguresAnswer(Answer):
    """Figures by which runs are compared; null if unknown."""

    pages: int
    misprints: int
    not_inspected: int
    late: int
    lost_lines: int
    sheets_per_s: float | None
    inspection_median_ms: float | None
    inspection_p99_ms: float | None
    verdict_median_ms: float | None = Field(description="From a sheet's last line to its verdict.")
    verdict_p99_ms: float | None
    verdict_p999_ms: float | None
    busy: float | None = Field(description="Mean number of inspectors at work.")


class ChannelAnswer(Answer):
    """A measurement of good prints over a run, in its bins; null if no sheet of the bin has it."""

    name: str
    what: str
    unit: str
    tolerance: float | None = Field(description="Beyond it, either way, a page is a misprint.")
    mean: list[float | None]
    least: list[float | None]
    greatest: list[float | None]


class ComparedRun(Answer):
    """One of two runs in a comparison."""

    run: RunAnswer
    figures: FiguresAnswer
    sheets: list[int] = Field(description="First sheet of each bin.")
    charts: dict[str, list[ChannelAnswer]]
    troubles: dict[str, list[int]] = Field(
        description="Sheets of each bin that lost lines, were late, or were not inspected."
    )
    latency: HistogramAnswer


class CompareAnswer(Answer):
    """Two runs side by side."""

    run: ComparedRun
    against: ComparedRun


class ReportAnswer(Answer):
    """A run in figures, for people who are responsible for its quality."""

    run: RunAnswer
    kinds: dict[str, int]
    incidents: int
    misprint_incidents: int = Field(description="Of these, incidents of misprints, which can be labelled.")
    labelled: int = Field(description="Incidents whose label covers all their sheets.")
    false_alarms: int = Field(description="Misprints by verdict that are labelled false alarms.")
    to_print_again: int | None = Field(description="As `runs/ID/reprint` counts; null: it cannot be counted.")
    unprinted: int
    guarantee: str | None = Field(description="Guaranteed false-alarm rate, in words; null: it is not known.")
    false_alarms_per_good_sheet: float | None
    sample: dict[str, Any] = Field(
        description="The random sample and the alarms: how many are labelled, and the error rates that follow."
    )
    tolerances: list[dict[str, Any]] = Field(
        description="Recurring false alarms at one location, with the cost of tolerating them; none is applied."
    )
    heat: dict[str, Any]
    labels_by_user: dict[str, dict[str, int]]
    layout_counts: dict[str, Any] | None
    """Counts of sheets and sets; None if every page is a sheet of its own, and belongs to no set."""


class NowAnswer(Answer):
    """Current state of the press."""

    state: State
    alarm: bool
    run: RunAnswer | None
    cause: int | None
    start: dict[str, Any] | None = Field(
        description="Stage of a start, its part, steps done and in total, and the seconds left; null: nothing starts."
    )
    stopping: str | None = Field(
        description="Person who requested the end of the run, which continues until then."
    )
    starter: dict[str, str] | None = Field(
        description="Process that starts jobs of `folder` on request: key of its `job`, empty while it waits, and "
        "`trouble`, why the last could not start; null: there is none."
    )
    overload: dict[str, int] | None
    """Late sheets, and how many of the last they are of (recent); None if inspection keeps pace."""
    incidents: list[dict[str, Any]] = Field(description="The most urgent of those that need action.")
    pending: int = Field(description="Number of incidents that need action and are not shelved.")
    unseen: int = Field(description="Number of them that are not acknowledged.")
    shelved: int = Field(description="Number of incidents that are shelved.")
    flood: bool = Field(
        description="Whether more than 10 alarms began within the last 10 minutes of the run."
    )
    to_print_again: int | None = Field(description="As `runs/ID/reprint` counts; null: it cannot be counted.")
    unprinted: int
    layout_counts: dict[str, Any] | None
    """Counts of sheets and sets by outcome; None if every page is a sheet of its own, without sets."""
    health: dict[str, Any]


class AboutAnswer(Answer):
    """Version and state of the console."""

    version: str
    journal: str
    journal_trouble: str
    journal_megabytes: float | None
    listeners: int
    up_s: float


class SessionAnswer(Answer):
    """The person who is signed in, or the token's owner."""

    name: str
    role: Role
    csrf: str
    ends_s: float
    scopes: list[Scope] | None


class SignInRequest(BaseModel):
    """Name and password."""

    model_config = ConfigDict(extra="forbid")
    name: Annotated[str, Field(min_length=1, max_length=120)]
    password: Annotated[str, Field(min_length=1, max_length=400)]


class PersonAnswer(Answer):
    """A user account."""

    id: int
    name: str
    role: Role
    locked: bool
    ready: bool
    created_s: float
    issuer: str | None = None
    """OpenID provider at which they sign in; null if here."""


class PeopleAnswer(Answer):
    """All user accounts."""

    items: list[PersonAnswer]


class NewPerson(BaseModel):
    """A person to add."""

    model_config = ConfigDict(extra="forbid")
    name: Annotated[str, Field(min_length=1, max_length=120)]
    role: Role


class PersonChange(BaseModel):
    """Changes of a person; a field that is left out stays as it is."""

    model_config = ConfigDict(extra="forbid")
    role: Role | None = None
    locked: bool | None = None


class LinkAnswer(Answer):
    """A link by which a person chooses a password; it works once, for a day."""

    name: str
    link: str


class TokenAnswer(Answer):
    """A token, without its secret."""

    id: int
    name: str
    owner: str
    scopes: list[Scope]
    created_s: float
    ends_s: float
    revoked_s: float | None


class TokensAnswer(Answer):
    """A list of tokens."""

    items: list[TokenAnswer]


class NewToken(BaseModel):
    """A token to add."""

    model_config = ConfigDict(extra="forbid")
    name: Annotated[str, Field(min_length=1, max_length=120)]
    scopes: Annotated[list[Scope], Field(min_length=1, max_length=len(Scope))]
    days: Annotated[float, Field(gt=0, le=3660)] = 365.0


class NewTokenAnswer(TokenAnswer):
    """A new token with its secret, which is shown this once."""

    secret: str


class AuditAnswer(Answer):
    """Entries of the audit, the latest first."""

    items: list[dict[str, Any]]
    next: Cursor


class ChainAnswer(Answer):
    """Result of verifying the audit."""

    whole: bool
    entries: int
    head: str
    broken_at: int | None
    why: str


class PictureAnswer(Answer):
    """Size of a sheet's pictures and of their tiles."""

    width: int
    height: int
    tile: int
    levels: int
    width_mm: float
    height_mm: float
    layers: list[str]
    regions: list[dict[str, Any]]
    cuts: list[dict[str, Any]]
    whole: bool = Field(description="Whether the whole scan is stored, not only sections of it.")
    note: str


class CameraAnswer(Answer):
    """Current view of a run's camera; a program requests it every second, which keeps the view coming."""

    seen: dict[str, Any] | None = Field(
        description="Per sensor: profiles along the line, saturation, black, noise, focus; lines/s, lost lines. "
        "Null: no process watches with this journal, or it has not responded yet."
    )
