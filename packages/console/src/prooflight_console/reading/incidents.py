"""Incidents of runs, as far as their journals have got, with the labels that people gave."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from prooflight_console.alarms.priority import Priority, priority, recent_sheets
from prooflight_console.alarms.statistics import Annunciation
from prooflight_console.problems import not_found
from prooflight_line.journal.following import PageQuery
from prooflight_line.journal.labels import FALSE_ALARM, SEEN, Labels, run_key, standing
from prooflight_line.run.incidents import NO_MISPRINT, Incident, Incidents
from prooflight_line.run.labelled_sheets import SampledSheet, sampled_sheets
from prooflight_line.run.tolerances import Proposal, proposals

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from prooflight_console.alarms.alarm_store import AlarmStore, Shelving
    from prooflight_console.reading.runs import Reading
    from prooflight_line.journal.labels import Label, LabelStore
    from prooflight_line.journal.records import RunRow

AT_ONCE: Final = 2000
"""Rows that are read at once."""
MOST_CACHED: Final = 16
"""Number of runs whose incidents are cached."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledIncident:
    """An incident and its labels."""

    incident: Incident
    labels: tuple[Label, ...]
    """All labels in order, including those that were undone and the entries that undid them."""
    recent: int = 0
    """Number of its sheets among the last ones of the run, by ``alarms.priority.recent_sheets``."""
    shelving: Shelving | None = None
    """The shelving in force; None if there is none."""
    clock_zero_s: float = 0.0
    """Unix time at which the source's clock stood at 0. [s]"""

    @property
    def since_s(self) -> float:
        """When its first sheet passed; Unix time. [s]"""
        return self.clock_zero_s + self.incident.since_s

    @property
    def last_s(self) -> float:
        """When its last sheet passed; Unix time. [s]"""
        return self.clock_zero_s + self.incident.last_s

    @property
    def priority(self) -> Priority:
        """Current priority."""
        return priority(self.incident, self.recent)

    @property
    def shelved(self) -> bool:
        """Whether it is shelved and not of a higher priority than it was then."""
        return self.shelving is not None and self.shelving.hides(self.priority)

    @property
    def needs_action(self) -> bool:
        """Whether it needs action, shelved or not.

        It does if nobody has seen it, if a label does not cover its last sheets, or if it is open and no
        false alarm.
        """
        if not self.seen or (self.label is not None and not self.answered):
            return True
        return self.incident.open and self.word != FALSE_ALARM

    @property
    def urgency(self) -> tuple[int, bool, bool, int]:
        """Key that sorts the most urgent first: by priority, then those that nobody has seen, then open ones."""
        incident = self.incident
        return self.priority.rank, self.seen, not incident.open, -incident.last_sheet

    @property
    def standing(self) -> tuple[Label, ...]:
        """Labels that were not undone, in order."""
        return tuple(standing(self.labels))

    @property
    def label(self) -> Label | None:
        """The last label other than `seen`; None if there is none, or the incident is of no misprints."""
        if not self.of_misprints:
            return None
        return next((label for label in reversed(self.standing) if label.word != SEEN), None)

    @property
    def word(self) -> str | None:
        """Text of the label."""
        return None if self.label is None else self.label.word

    @property
    def answered(self) -> bool:
        """Whether a label covers the incident's sheets up to the last one."""
        return self.label is not None and self.label.covers(self.incident.last_sheet)

    @property
    def seen(self) -> bool:
        """Whether a person has seen the incident since it last opened or came back."""
        return any(label.covers(self.incident.reopened_sheet) for label in self.standing)

    @property
    def of_misprints(self) -> bool:
        """Whether a defect was seen on its sheets; no label applies to others."""
        return self.incident.kind not in NO_MISPRINT

    @property
    def misprint(self) -> bool:
        """Whether its last sheets count as misprints: by the verdict, unless a label overrules it."""
        return self.of_misprints and not (self.answered and self.word == FALSE_ALARM)


def next_alarm(pending: Sequence[LabelledIncident], after: int | None = None) -> LabelledIncident | None:
    """Return the most urgent alarm that nobody has seen, else the most urgent; None if there is none.

    Parameters
    ----------
    pending
        Alarms that need action, the most urgent first.
    after
        Number of an incident that is shown already.
    """
    others = [one for one in pending if one.incident.number != after]
    return next((one for one in others if not one.seen), others[0] if others else None)


@dataclass(slots=True)
class _Tracked:
    tracker: Incidents = field(default_factory=Incidents)
    incidents: dict[int, Incident] = field(default_factory=dict)
    of_sheet: dict[int, int] = field(default_factory=dict)
    begun: list[tuple[int, float]] = field(default_factory=list)
    """Incident and time, by the source's clock, of each time that an incident opened or returned."""
    reached: dict[int, Priority] = field(default_factory=dict)
    """Highest priority that each incident reached."""
    last: int = -1
    ended: bool = False
    guard: threading.Lock = field(default_factory=threading.Lock)


class RunIncidents:
    """Incidents of runs, each updated from the last row that was read."""

    def __init__(self, reading: Reading, label_store: LabelStore, alarm_store: AlarmStore) -> None:
        self._reading, self._label_store, self._alarm_store = reading, label_store, alarm_store
        self._runs: OrderedDict[str, _Tracked] = OrderedDict()
        self._guard = threading.Lock()

    def of(self, run: RunRow) -> list[LabelledIncident]:
        """Return the incidents of a run, by number."""
        tracked = self._read(run)
        labels: dict[str, list[Label]] = {}
        for label in self._label_store.of_run(run_key(run)):
            if label.incident is not None:
                labels.setdefault(label.incident, []).append(label)
        shelvings = self._alarm_store.in_force(run_key(run))
        zero_s = self._reading.clock_zero_s(run)
        with tracked.guard:
            incidents, newest = (
                [tracked.incidents[number] for number in sorted(tracked.incidents)],
                tracked.last,
            )
        return [
            LabelledIncident(
                incident=one,
                labels=tuple(labels.get(str(one.number), ())),
                recent=recent_sheets(one, newest) if one.open else 0,
                shelving=shelvings.get(one.number),
                clock_zero_s=zero_s,
            )
            for one in incidents
        ]

    def one(self, run: RunRow, number: int) -> LabelledIncident:
        """Return an incident by its number; raises ``Problem`` 404."""
        for labelled in self.of(run):
            if labelled.incident.number == number:
                return labelled
        raise not_found(f"run {run.id} has no incident {number}")

    def incident_by_sheet(self, run: RunRow) -> dict[int, int]:
        """Return the incident that each sheet with an alarm belongs to, in order."""
        tracked = self._read(run)
        with tracked.guard:
            return dict(tracked.of_sheet)

    def begun_s(self, run: RunRow) -> list[float]:
        """Return when alarms began or returned, in order, by the source's clock. [s]"""
        tracked = self._read(run)
        with tracked.guard:
            return [at_s for _, at_s in tracked.begun]

    def annunciations(self, run: RunRow) -> list[Annunciation]:
        """Return each time that an alarm of the run began or returned, in order."""
        tracked = self._read(run)
        labelled = {one.incident.number: one for one in self.of(run)}
        zero_s = self._reading.clock_zero_s(run)
        with tracked.guard:
            begun, reached = list(tracked.begun), dict(tracked.reached)
        annunciations: list[Annunciation] = []
        next_s: dict[int, float] = {}
        for number, time_s in reversed(begun):
            at_s = zero_s + time_s
            until_s, next_s[number] = next_s.get(number, math.inf), at_s
            labels_s = [label.at_s for label in labelled[number].standing if at_s <= label.at_s < until_s]
            annunciations.append(
                Annunciation(
                    run=run.id,
                    incident=number,
                    kind=labelled[number].incident.kind,
                    priority=reached[number],
                    at_s=at_s,
                    acknowledged_s=min(labels_s) - at_s if labels_s else None,
                )
            )
        return annunciations[::-1]

    def of_sheet(self, run: RunRow, sheet: int) -> int | None:
        """Return the incident that a sheet belongs to; None if there is none."""
        tracked = self._read(run)
        with tracked.guard:
            return tracked.of_sheet.get(sheet)

    def labels(self, run: RunRow) -> Callable[[int], Label | None]:
        """Return a function that gives the label in force for a sheet of the run."""
        of_sheet = self.incident_by_sheet(run)
        labels = Labels(self._label_store.of_run(run_key(run)))
        return lambda sheet: labels.of(sheet, of_sheet.get(sheet))

    def sheets_of(self, run: RunRow, number: int) -> list[int]:
        """Return the sheets of an incident, in order."""
        return [sheet for sheet, incident in self.incident_by_sheet(run).items() if incident == number]

    def sampled(self, run: RunRow) -> list[SampledSheet]:
        """Return the sheets of a run that were sampled for review, with their labels."""
        follower = self._reading.follower
        if follower is None:
            return []
        of_sheet = self.incident_by_sheet(run)
        records = follower.sampled_pages(run.id, damaged=lambda _: None)
        return sampled_sheets(records, self._label_store.of_run(run_key(run)), of_sheet)

    def proposals(self, runs: Sequence[RunRow]) -> list[Proposal]:
        """Return the tolerances that false alarms of these runs propose in aggregate."""
        follower = self._reading.follower
        return [] if follower is None else proposals(follower, self._label_store, runs)

    def labels_of(self, run: RunRow, sheet: int) -> list[Label]:
        """Return the labels of one sheet itself, in order."""
        return [label for label in self._label_store.of_run(run_key(run)) if label.sheet == sheet]

    def _read(self, run: RunRow) -> _Tracked:
        key = run_key(run)
        with self._guard:
            tracked = self._runs.setdefault(key, _Tracked())
            self._runs.move_to_end(key)
            while len(self._runs) > MOST_CACHED:
                self._runs.popitem(last=False)
        with tracked.guard:
            if not tracked.ended:
                self._read_on(run, tracked)
        return tracked

    def _read_on(self, run: RunRow, tracked: _Tracked) -> None:
        follower = self._reading.follower
        if follower is None:
            return
        upto = follower.last_sheet(run.id)
        if upto > tracked.last:
            while True:
                query = PageQuery(run_id=run.id, to_review=True, last_sheet=upto)
                rows = follower.sheets(query, after=tracked.last, limit=AT_ONCE, damaged=lambda _: None)
                for row in rows:
                    tracked.last = row.page.sheet
                    for change in tracked.tracker.add(row.page):
                        incident = tracked.incidents[change.incident.number] = change.incident
                        if change.what in ("opened", "returned"):
                            tracked.begun.append((incident.number, row.page.time_s))
                        level = priority(incident, recent_sheets(incident, row.page.sheet))
                        before = tracked.reached.get(incident.number, level)
                        tracked.reached[incident.number] = min(level, before, key=lambda one: one.rank)
                        if change.incident.last_sheet == row.page.sheet and change.what != "ended":
                            tracked.of_sheet[row.page.sheet] = change.incident.number
                if len(rows) < AT_ONCE:
                    break
            tracked.last = upto
            changes = tracked.tracker.passed(upto)
            tracked.incidents |= {change.incident.number: change.incident for change in changes}
        if run.end is not None:
            changes = tracked.tracker.finish(upto)
            tracked.incidents |= {change.incident.number: change.incident for change in changes}
            tracked.ended = True
