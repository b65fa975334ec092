"""What the journal keeps of runs and pages, and for how long."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

from prooflight.detectors.disposition import without_gate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.disposition import DecidedBy, Disposition
    from prooflight.detectors.verdict import Verdict

Ending = Literal["finished", "stopped", "fault"]
State = Literal["running", "interrupted", "finished", "stopped", "fault"]
SECONDS_A_DAY: Final = 86_400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFacts:
    """What is known of a run when it begins."""

    job: str
    job_digest: str
    """SHA-256 of what was to be printed, ``journal.content_digest``; "" where nobody took it."""
    press: str
    press_digest: str
    """``Press.digest``: with the evidence it makes every verdict again."""
    detector: str
    source: str
    """Where lines come from: drum:5, replay:scans/, ..."""
    started_s: float
    """Unix time. [s]"""
    sheets: int | None = None
    """How many are to be printed; None: nobody said."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Whatever else the run was started with; what JSON can hold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEnd:
    """How a run came to an end."""

    ended_s: float
    """Unix time. [s]"""
    ending: Ending
    detail: str = ""
    counts: Mapping[str, Any] = field(default_factory=dict)
    """The last status snapshot; what JSON can hold."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageRecord:
    """One sheet of a run."""

    sheet: int
    """Unique in its run: recorded again, it replaces what was there."""
    job_page: int | None
    """Index of the sheet of the job that it shows; None: none of them."""
    verdict: Verdict
    late: bool
    """Decided after its deadline."""
    first_line: int
    """The camera's own number of its first line."""
    time_s: float
    """When its last line was read, by the source's clock. [s]"""
    faults: tuple[str, ...] = ()
    nuisance: Mapping[str, float] = field(default_factory=dict)
    """What good prints do anyway, as estimated: ink gains, register, lamp, ..."""
    notes: tuple[str, ...] = ()
    """What the run as a whole said with this sheet: drifts, recommendations."""
    asked: float | None = None
    """A person is asked for a word on this sheet, which was drawn with this probability; None: nobody is."""
    gate: Disposition | None = None
    """What the gate's policy decided of the sheet; None: no gate did."""
    evidence: Mapping[str, NDArray[Any]] | None = None
    """``redeciding.kept_evidence``: what the verdict is made from again, and cuts for people. None: nothing kept."""

    @property
    def disposition(self) -> Disposition:
        """What becomes of the sheet."""
        return self._decided[0]

    @property
    def decided_by(self) -> DecidedBy:
        """By what rule that was decided."""
        return self._decided[1]

    @property
    def _decided(self) -> tuple[Disposition, DecidedBy]:
        return without_gate(self.verdict, self.faults) if self.gate is None else (self.gate, "gate")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRow:
    """A run as the journal knows it."""

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
    """That the journal could not keep while it could not write."""
    dropped_evidence: int
    """Pages whose evidence it gave up to keep their rows."""
    absent: int = 0
    """Rows of pages of the job that did not come, which ``pages`` and ``not_inspected`` count as well."""
    promise_suspended_from: int | None
    """Sheet from which on its pages were too unlike the press's own for the detector's promise; None: none was."""


COUNTED: Final = ("pages", "misprints", "not_inspected", "late", "faulty", "absent")
"""Of a ``RunRow``: what its pages come to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Retention:
    """How long a journal keeps what it holds; none of the run that is being written goes but its evidence."""

    days: float = math.inf
    """Since a run ended."""
    megabytes: float = math.inf
    """Of database and evidence together, 1e6 bytes each."""

    def __post_init__(self) -> None:
        for name in ("days", "megabytes"):
            if not getattr(self, name) > 0:  # nor NaN
                message = f"{name} must be above 0, got {getattr(self, name)}"
                raise ValueError(message)


@dataclass(slots=True, kw_only=True)
class Tidied:
    """What tidying did so far."""

    runs: list[int] = field(default_factory=list)
    """Removed."""
    packs: int = 0
    """Files of evidence that were removed."""
    pack_bytes: int = 0
    refused: list[str] = field(default_factory=list)
    """One line each: rows that cannot be believed and files that are not what a journal puts there; these stay."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JournalHealth:
    """Whether the journal keeps up; counts are since it was opened."""

    trouble: str | None
    """Why it cannot write; None: it can."""
    waiting: int
    """Pages recorded but not yet durable."""
    dropped_pages: int
    """Given up while it could not write."""
    dropped_evidence: int
    """Pages whose evidence was given up, then or because no file can hold it."""
    set_aside: int = 0
    """Pages that no row can hold, kept in the file beside it."""

    @property
    def unrecorded(self) -> int:
        """Pages that were told and are not in the journal, now."""
        return self.waiting + self.dropped_pages + self.set_aside
