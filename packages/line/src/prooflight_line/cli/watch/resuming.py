"""``watch --resume``: the run that broke off, and whether this command continues it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

from prooflight.errors import RequestError
from prooflight.files.lock import writer_lives
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.opening import default_journal, journal_path
from prooflight_line.plant.gate.log import LoggedDecisions, log_path
from prooflight_line.plant.gate.resuming import cut_torn_line, refuse_other_gate, unrecorded
from prooflight_line.run.resuming import Past

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.press.gate import GateSettings
    from prooflight_line.journal.records import PageRecord, RunFacts, RunRow

NEW_RUN: Final = "leave out --resume to begin a new run"
OPEN_SIDES: Final = 4096
"""Number of last rows among which sides may wait for the other side of their sheet: more than a roll that is printed
on its front first has sheets on their way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Resumption:
    """A run that broke off, and what is known of it."""

    run_id: int
    started_s: float
    """Start of the run, which stays that of its name in logs and traces; Unix time. [s]"""
    past: Past
    """Recorded part of the run, with the rows of ``lost``."""
    lost: tuple[PageRecord, ...]
    """Rows of sheets that the gate decided and that the journal lacks."""
    gate: LoggedDecisions | None
    """Gate's log of the run; None: it has no gate."""
    open_sides: tuple[PageRecord, ...]
    """Rows of sides whose sheets the gate has not decided."""

    @classmethod
    def last_of(
        cls,
        journal: str | None,
        facts: RunFacts,
        *,
        gate: GateSettings | None,
        plan: SheetPlan | None,
        press_file: Path | None,
        progress: Callable[[str], None],
    ) -> Self:
        """Return the last run of the journal, if it broke off and is of the same job, press and settings.

        Nothing is written. RequestError: there is nothing to resume, something differs, or the run is still watched.
        PlantError: the gate differs.
        """
        if journal == "none":
            raise RequestError("--resume", "a run is resumed from its journal", remedy="give --journal")
        path = journal_path(journal or str(default_journal()))
        if writer_lives(path):
            raise RequestError(path, "another process still watches its run", remedy="end that process first")
        with Journal.open(str(path), read_only=True) as opened:
            run = opened.last_run()
            _refuse_other(path, run, facts)
            progress(f"reading the {run.pages:,} sheets of run {run.id}")
            past = Past.of(opened.pages(run.id))
            log = log_path(path, run.id)
            if log.exists() != (gate is not None):
                had = "had a gate" if gate is None else "had no gate"
                remedy = f"resume {'with' if gate is None else 'without'} --plant, or {NEW_RUN}"
                raise RequestError(path, f"run {run.id} {had}", remedy=remedy)
            if gate is None:
                return cls(
                    run_id=run.id,
                    started_s=run.facts.started_s,
                    past=past,
                    lost=(),
                    gate=None,
                    open_sides=(),
                )
            gate_log = LoggedDecisions.read(log)
            refuse_other_gate(gate_log, gate, where=press_file)
            lost = unrecorded(gate_log, past.first_sheet, plan, time_s=past.time_s or 0.0)
            recent = (row for row in opened.pages(run.id) if row.sheet >= past.first_sheet - OPEN_SIDES)
            open_sides = _undecided(recent, gate_log) if plan is not None and plan.layout.sides > 1 else ()
        for record in lost:
            past.add(record)
        return cls(
            run_id=run.id,
            started_s=run.facts.started_s,
            past=past,
            lost=tuple(lost),
            gate=gate_log,
            open_sides=tuple(open_sides),
        )

    def take_over(self, journal: Journal) -> None:
        """Record what the journal lacks, once this process writes it; RequestError: another one went on with it."""
        last = journal.last_run()
        if last.id != self.run_id or last.end is not None:
            raise RequestError(journal.path, f"run {self.run_id} was resumed meanwhile", remedy=NEW_RUN)
        if self.gate is not None:
            cut_torn_line(log_path(journal.path, self.run_id))
        for record in self.lost:
            journal.record(self.run_id, record)
        journal.commit()

    @property
    def message(self) -> str:
        """Message for people, in one line."""
        text = f"run {self.run_id}, which was interrupted, continues at sheet {self.past.first_sheet}"
        return f"{text}; {len(self.lost)} verdicts before it were lost" if self.lost else text


def _undecided(records: Iterable[PageRecord], gate_log: LoggedDecisions) -> list[PageRecord]:
    """Return the rows that belong to no decision."""
    decided = {number for row in gate_log.decisions.values() for number in row.get("rows", ())}
    return [record for record in records if record.sheet not in decided]


def _refuse_other(journal: Path, run: RunRow, facts: RunFacts) -> None:
    """Raise RequestError if a run has ended, or is not the one that this command describes."""
    if run.end is not None:
        what = f"its last run, {run.id}, has ended ({run.end.ending}), so there is nothing to resume"
        raise RequestError(journal, what, remedy=NEW_RUN)
    before, now = run.facts, facts
    names = ("layout", "zones", "press_file")
    same = {
        "the job": before.job_digest == now.job_digest,
        "the press": before.press_digest == now.press_digest,
        "the detector": before.detector == now.detector,
        "the number of sheets": before.sheets == now.sheets,
        **{
            f"the {name.replace('_', ' ')}": before.settings.get(name) == now.settings.get(name)
            for name in names
        },
    }
    if others := [name for name, is_same in same.items() if not is_same]:
        what = f"run {run.id} was started with another: {', '.join(others)}"
        remedy = f"give the command of that run (job {before.job}, press {before.press}), or {NEW_RUN}"
        raise RequestError(journal, what, remedy=remedy)
