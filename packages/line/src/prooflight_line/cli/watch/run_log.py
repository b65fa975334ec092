"""Events of a run in the log for programs: its begin and end, its phases, each sheet and each notice."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Self

from prooflight.cli import event_log
from prooflight_line.journal.labels import key_of, sheet_id

if TYPE_CHECKING:
    from prooflight_line.journal.records import Ending, RunFacts
    from prooflight_line.run.notices import Notice
    from prooflight_line.run.outcomes import Outcome
    from prooflight_line.run.status import Status


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLog:
    """Events of one run; nothing is written where the log is for people."""

    press: str = ""
    run: int | None = None
    """Number of the run in the journal; None: there is none yet."""
    key: str | None = None
    """Key of the run, by ``labels.key_of``."""

    @classmethod
    def of(cls, facts: RunFacts, run: int | None) -> Self:
        """Return the log of a run; run: its number in the journal, None: it is in none."""
        return cls(press=facts.press, run=run, key=None if run is None else key_of(run, facts.started_s))

    def began(self, facts: RunFacts) -> None:
        """Log that the run begins."""
        self._write(
            "run-begun", job=facts.job, detector=facts.detector, source=facts.source, sheets=facts.sheets
        )

    def phase(self, phase: str, detail: str) -> None:
        """Log the phase that the run is in."""
        self._write("phase", phase=phase, detail=detail)

    def sheet(self, outcome: Outcome) -> None:
        """Log a sheet with its verdict; one that is not good is a warning."""
        if not event_log.is_on():
            return
        record = outcome.record
        verdict = record.verdict
        self._write(
            "sheet",
            level=logging.INFO if verdict.verdict == "good" else logging.WARNING,
            sheet=record.sheet,
            id=None if self.key is None else sheet_id(self.key, record.sheet),
            page=verdict.page,
            verdict=verdict.verdict,
            kind=verdict.kind,
            reason=verdict.reason,
            disposition=record.disposition,
            decided_by=record.decided_by,
            score=verdict.score,
            late=record.late,
            latency_ms=None if outcome.latency_s is None else round(1e3 * outcome.latency_s, 1),
            faults=record.faults,
        )

    def notice(self, notice: Notice) -> None:
        """Log a notice that belongs to no sheet."""
        self._write("notice", level=logging.WARNING, kind=notice.kind, text=notice.text)

    def ended(self, status: Status, ending: Ending) -> None:
        """Log that the run has ended, and its counts."""
        self._write("run-ended", ending=ending, counts=asdict(status))

    def _write(self, event: str, *, level: int = logging.INFO, **fields: Any) -> None:
        event_log.write(event, level=level, press=self.press, run=self.run, **fields)
