"""Records of runs and pages in the journal, and their retention."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

from prooflight.detectors.disposition import without_gate
from prooflight_line.journal.retention_rules import customers_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.disposition import DecidedBy, Disposition
    from prooflight.detectors.verdict import Verdict
    from prooflight_line.journal.retention_rules import Class, Rules

Ending = Literal["finished", "stopped", "fault"]
State = Literal["running", "interrupted", "finished", "stopped", "fault"]
SECONDS_A_DAY: Final = 86_400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFacts:
    """Facts of a run that are known when it begins."""

    job: str
    job_digest: str
    """SHA-256 of what was to be printed, by ``files.content.content_digest``; "" if it was not computed."""
    press: str
    press_digest: str
    """``Press.digest``: with the evidence, this press reproduces every verdict."""
    detector: str
    source: str
    """Source of the lines, such as drum:5 or replay:scans/."""
    started_s: float
    """Unix time. [s]"""
    sheets: int | None = None
    """Number of sheets to be printed; None: unknown."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Other settings of the run, which JSON can represent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEnd:
    """The end of a run."""

    ended_s: float
    """Unix time. [s]"""
    ending: Ending
    detail: str = ""
    counts: Mapping[str, Any] = field(default_factory=dict)
    """The last status snapshot, which JSON can represent."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageRecord:
    """One sheet of a run."""

    sheet: int
    """Number of the sheet, unique in its run: recorded again, it replaces the earlier record."""
    job_page: int | None
    """Index of the page of the job that it shows; None: none of them."""
    verdict: Verdict
    late: bool
    """Whether it was decided after its deadline."""
    first_line: int
    """The camera's own number of its first line."""
    time_s: float
    """Time at which its last line was read, by the source's clock. [s]"""
    faults: tuple[str, ...] = ()
    nuisance: Mapping[str, float] = field(default_factory=dict)
    """Estimated nuisance amounts, which vary among good prints: ink gains, register, lamp, ..."""
    notes: tuple[str, ...] = ()
    """Notes of the run's monitors at this sheet: drifts, recommendations."""
    asked: float | None = None
    """Probability with which the sheet was sampled for review; None: it was not."""
    gate: Disposition | None = None
    """Disposition by the gate's policy; None: no gate decided."""
    evidence: Mapping[str, NDArray[Any]] | None = None
    """Evidence by ``redeciding.evidence_to_store``, which reproduces the verdict, and image sections for people;
    None: none was kept."""

    @property
    def disposition(self) -> Disposition:
        """Disposition of the sheet."""
        return self._decided[0]

    @property
    def decided_by(self) -> DecidedBy:
        """Rule that decided the disposition."""
        return self._decided[1]

    @property
    def _decided(self) -> tuple[Disposition, DecidedBy]:
        return without_gate(self.verdict, self.faults) if self.gate is None else (self.gate, "gate")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRow:
    """A run as stored in the journal."""

    id: int
    facts: RunFacts
    end: RunEnd | None
    state: State
    pages: int
    misprints: int
    not_inspected: int
    late: int
    faulty: int
    """Pages with a fault of the paper path or of the camera's lines."""
    dropped_pages: int
    """Pages that were lost while the journal could not write."""
    dropped_evidence: int
    """Pages whose evidence was dropped to keep their rows."""
    absent: int = 0
    """Pages of the job that did not come, which ``pages`` and ``not_inspected`` count as well."""
    promise_suspended_from: int | None
    """Sheet from which on the false-alarm rate was shown not to hold, as pages were too unlike the press's
    own; None: it was not."""


COUNTED: Final = ("pages", "misprints", "not_inspected", "late", "faulty", "absent")
"""Fields of a ``RunRow`` that count its pages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Retention:
    """Limits of a journal's contents; of the run that is being written, only evidence is ever removed."""

    days: float = math.inf
    """Days since a run ended."""
    megabytes: float = math.inf
    """Size of database and evidence together, 1e6 bytes each."""
    rules: Rules | None = None
    """Rules by customer and class, in place of ``days``; None: there are none."""

    def __post_init__(self) -> None:
        for name in ("days", "megabytes"):
            if not getattr(self, name) > 0:  # nor NaN
                message = f"{name} must be above 0, got {getattr(self, name)}"
                raise ValueError(message)
        if self.rules is not None and min(self.days, self.megabytes) < math.inf:
            raise ValueError("rules say how long everything is stored: another limit would break them")

    def over(self, settings: Mapping[str, Any], days: float) -> tuple[Class, ...]:
        """Return what is no longer stored of a run with these settings so many days after its end."""
        if self.rules is not None:
            return self.rules.of(customers_of(settings)).over(days)
        return ("verdicts",) if days > self.days else ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Due:
    """What retention removes of a run."""

    run: int
    job: str
    customers: tuple[str, ...]
    days: float
    """Days since its end."""
    classes: tuple[Class, ...]
    """Verdicts include all that is the run's."""
    packs: int
    """Number of files of evidence that are removed, or written again without some arrays."""
    bytes: int
    """Size of what is removed of them."""


@dataclass(slots=True, kw_only=True)
class Tidied:
    """Results of tidying so far."""

    runs: list[int] = field(default_factory=list)
    packs: int = 0
    """Number of files of evidence removed."""
    pack_bytes: int = 0
    """Size of what was removed of evidence."""
    thinned: int = 0
    """Number of files of evidence written again without pictures or scans."""
    on_hold: list[int] = field(default_factory=list)
    """Numbers of the runs on legal hold, of which nothing was removed."""
    refused: list[str] = field(default_factory=list)
    """Messages on rows that are invalid and files that a journal did not write, one line each; these stay."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalHealth:
    """State of the journal's writing; counts are since it was opened."""

    trouble: str | None
    """Reason for which it cannot write; None: it can."""
    waiting: int
    """Pages recorded but not yet durable."""
    dropped_pages: int
    """Pages dropped while it could not write."""
    dropped_evidence: int
    """Pages whose evidence was dropped, then or because no file can store it."""
    set_aside: int = 0
    """Pages that no row can store, kept in the file next to it."""

    @property
    def unrecorded(self) -> int:
        """Number of pages passed to the journal that are not stored in it, now."""
        return self.waiting + self.dropped_pages + self.set_aside
