"""Incidents of runs, as far as their journals have got, with the labels that people gave."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from prooflight_console.problems import not_found
from prooflight_line.journal.following import PageQuery
from prooflight_line.journal.labels import FALSE_ALARM, SEEN, Labels, run_key, standing
from prooflight_line.run.incidents import NO_MISPRINT, Incident, Incidents
from prooflight_line.run.labelled_sheets import SampledSheet, sampled_sheets
from prooflight_line.run.tolerances import Proposal, proposals

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

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


@dataclass(slots=True)
class _Tracked:
    tracker: Incidents = field(default_factory=Incidents)
    incidents: dict[int, Incident] = field(default_factory=dict)
    of_sheet: dict[int, int] = field(default_factory=dict)
    last: int = -1
    ended: bool = False
    guard: threading.Lock = field(default_factory=threading.Lock)


class RunIncidents:
    """Incidents of runs, each updated from the last row that was read."""

    def __init__(self, reading: Reading, label_store: LabelStore) -> None:
        self._reading, self._label_store = reading, label_store
        self._runs: OrderedDict[str, _Tracked] = OrderedDict()
        self._guard = threading.Lock()

    def of(self, run: RunRow) -> list[LabelledIncident]:
        """Return the incidents of a run, by number."""
        tracked = self._read(run)
        labels: dict[str, list[Label]] = {}
        for label in self._label_store.of_run(run_key(run)):
            if label.incident is not None:
                labels.setdefault(label.incident, []).append(label)
        with tracked.guard:
            incidents = [tracked.incidents[number] for number in sorted(tracked.incidents)]
        return [
            LabelledIncident(incident=one, labels=tuple(labels.get(str(one.number), ()))) for one in incidents
        ]

    def one(self, run: RunRow, number: int) -> LabelledIncident:
        """Return an incident by its number; raises ``Problem`` 404."""
        for labelled in self.of(run):
            if labelled.incident.number == number:
                return labelled
        raise not_found(f"run {run.id} has no incident {number}")

    def of_sheet(self, run: RunRow, sheet: int) -> int | None:
        """Return the incident that a sheet belongs to; None if there is none."""
        tracked = self._read(run)
        with tracked.guard:
            return tracked.of_sheet.get(sheet)

    def labels(self, run: RunRow) -> Callable[[int], Label | None]:
        """Return a function that gives the label in force for a sheet of the run."""
        tracked = self._read(run)
        with tracked.guard:
            of_sheet = dict(tracked.of_sheet)
        labels = Labels(self._label_store.of_run(run_key(run)))
        return lambda sheet: labels.of(sheet, of_sheet.get(sheet))

    def sheets_of(self, run: RunRow, number: int) -> list[int]:
        """Return the sheets of an incident, in order."""
        tracked = self._read(run)
        with tracked.guard:
            return [sheet for sheet, incident in tracked.of_sheet.items() if incident == number]

    def sampled(self, run: RunRow) -> list[SampledSheet]:
        """Return the sheets of a run that were sampled for review, with their labels."""
        follower = self._reading.follower
        if follower is None:
            return []
        tracked = self._read(run)
        with tracked.guard:
            of_sheet = dict(tracked.of_sheet)
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
                        tracked.incidents[change.incident.number] = change.incident
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
