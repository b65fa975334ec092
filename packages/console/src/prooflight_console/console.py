"""The services that every endpoint works with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.errors import RequestError
from prooflight.inspection.sheets import came
from prooflight_console.accounts.roles import Role
from prooflight_console.alarms.priority import Priority
from prooflight_console.problems import Problem
from prooflight_console.reading.alarms import handover_summary
from prooflight_line.journal.labels import FALSE_ALARM, GOOD, SEEN, run_key

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from prooflight_console.accounts.account_store import Accounts
    from prooflight_console.accounts.passwords import Tries
    from prooflight_console.accounts.provider import Provider
    from prooflight_console.accounts.roles import Who
    from prooflight_console.alarms.alarm_store import AlarmStore, Handover, Shelving
    from prooflight_console.engineering.notes import ChartNotes
    from prooflight_console.engineering.work import Work
    from prooflight_console.pictures.pictures import Pictures
    from prooflight_console.quality.index import SearchIndex
    from prooflight_console.quality.saved import SavedSearches
    from prooflight_console.reading.gate import Gates
    from prooflight_console.reading.incidents import LabelledIncident, RunIncidents
    from prooflight_console.reading.live import Live
    from prooflight_console.reading.metrics import Metrics
    from prooflight_console.reading.queue import Move, Queue
    from prooflight_console.reading.reprints import Reprints
    from prooflight_console.reading.runs import Reading
    from prooflight_console.reading.stations import Stations
    from prooflight_console.reading.trend import Trends
    from prooflight_console.settings import ConsoleSettings
    from prooflight_console.zones.rasters import Rasters
    from prooflight_console.zones.service import ZonesService
    from prooflight_line.job_queue.listing import Listed
    from prooflight_line.journal.labels import Label, LabelStore
    from prooflight_line.journal.records import RunRow


@dataclass(frozen=True, slots=True, kw_only=True)
class Console:
    """Services of the application, which endpoints get from ``request.app.state.console``."""

    settings: ConsoleSettings
    accounts: Accounts
    alarm_store: AlarmStore
    label_store: LabelStore
    """Labels that people give to sheets, in a file beside the journal to which the command line adds too."""
    tries: Tries
    reading: Reading
    incidents: RunIncidents
    live: Live
    trends: Trends
    gates: Gates
    reprints: Reprints
    stations: Stations
    pictures: Pictures
    zones: ZonesService
    rasters: Rasters
    metrics: Metrics
    chart_notes: ChartNotes
    work: Work
    """Steps that make versions of the first press."""
    index: SearchIndex
    """Index of sheets and defects over all runs."""
    saved: SavedSearches
    queue: Queue
    began_s: float
    """Unix time at which the console started. [s]"""
    provider: Provider | None = None
    """OpenID provider for sign-in, in addition to the console's own accounts."""

    def say(
        self,
        who: Who,
        label: str,
        run: RunRow,
        *,
        sheet: int | None = None,
        incident: int | None = None,
        note: str = "",
        upto: int | None = None,
    ) -> Label:
        """Add a label of a sheet or an incident; nothing is replaced, and the audit records it.

        Parameters
        ----------
        upto
            Last sheet of the incident that the person saw; None for its last one now.

        Raises
        ------
        RequestError
            If the incident is of sheets that were not judged to be misprints, to which no label applies.
        """
        if incident is not None:
            incident_record = self.incidents.one(run, incident)
            if label != SEEN and not incident_record.of_misprints:
                what = f"{incident} contains sheets without a misprint verdict, to which no label applies"
                remedy = "use `seen`; examine its sheets one by one, and release manually those that are good"
                raise RequestError("incident", what, remedy=remedy)
            last = incident_record.incident.last_sheet
            upto = last if upto is None else min(upto, last)
        record = self.label_store.say(
            label,
            run=run_key(run),
            by=who.name,
            at_s=self.accounts.clock(),
            sheet=sheet,
            incident=None if incident is None else str(incident),
            note=note,
            upto=None if incident is None else upto,
        )
        return self._audited("words.say", record, word=label, note=record.note, upto=record.upto)

    def label_sheets(
        self, who: Who, label: str, sheets: Sequence[tuple[int, int]], *, note: str = ""
    ) -> tuple[list[Label], int]:
        """Label many sheets at once, each for itself; return the labels and the number of sheets left out.

        Sheets that were not inspected are left out, since only a person with the sheet in hand can release it, one at
        a time. On a sheet that was judged good, `false-alarm` is `good`.

        Parameters
        ----------
        sheets
            Run and number of each sheet.
        """
        by_label: dict[str, dict[str, list[int]]] = {}
        left_out = 0
        for run_id, number in sheets:
            verdict = self.reading.written(run_id, number).page.verdict.verdict
            if verdict == "not-inspected":
                left_out += 1
                continue
            given = GOOD if label == FALSE_ALARM and verdict == "good" else label
            key = run_key(self.reading.run(run_id))
            by_label.setdefault(given, {}).setdefault(key, []).append(number)
        labels = self.label_store.say_of_sheets(by_label, by=who.name, at_s=self.accounts.clock(), note=note)
        if labels:
            after = {"word": label, "sheets": len(labels), "first": labels[0].id, "last": labels[-1].id}
            runs = {one.run for one in labels}
            self.accounts.note(
                who.name, "words.say", f"{len(labels)} sheets of {len(runs)} runs", after=after
            )
        return labels, left_out

    def undo_labels(self, who: Who, first: int, last: int) -> list[Label]:
        """Undo the labels of one ``label_sheets``; raises RequestError if none of them is in force."""
        undone = self.label_store.undo_between(first, last, by=who.name, at_s=self.accounts.clock())
        after = {"sheets": len(undone), "first": first, "last": last}
        self.accounts.note(who.name, "words.undo", f"{len(undone)} sheets", after=after)
        return undone

    def acknowledge_all(
        self,
        who: Who,
        run: RunRow,
        *,
        upto: int,
        shown: Callable[[LabelledIncident], bool] = lambda _one: True,
    ) -> list[int]:
        """Mark all incidents as seen that opened or came back up to a sheet, and return their numbers.

        shown: whether the person's list shows an incident; no other is marked.
        """
        seen = {
            one.incident.number: min(upto, one.incident.last_sheet)
            for one in self.incidents.of(run)
            if not one.seen and not one.shelved and one.incident.reopened_sheet <= upto and shown(one)
        }
        if seen:
            at_s = self.accounts.clock()
            self.label_store.say_of_incidents(SEEN, run=run_key(run), by=who.name, at_s=at_s, upto=seen)
            after = {"word": SEEN, "upto": upto, "incidents": len(seen)}
            self.accounts.note(who.name, "words.say", f"run {run_key(run)}, all incidents", after=after)
        return sorted(seen)

    def shelve(
        self, who: Who, run: RunRow, incident: int, *, priority: Priority, seconds: float, reason: str
    ) -> Shelving:
        """Shelve an alarm. priority: the one that the person saw.

        Raises RequestError if the alarm is of a higher priority by now, if the time is not allowed, or if no
        reason is given; ``Problem`` 403 if it is of high priority and the person is no engineer.
        """
        current = self.incidents.one(run, incident).priority
        if current.rank < priority.rank:
            what = f"the priority of incident {incident} is now {current}"
            raise RequestError("priority", what, remedy="check the incident, then shelve it again")
        if current is Priority.HIGH and not who.role.may(Role.ENGINEER):
            what = f"this requires the role {Role.ENGINEER}, as the alarm is of high priority; your role is {who.role}"
            raise Problem(403, "role", what)
        return self.alarm_store.shelve(
            run=run_key(run), incident=incident, priority=current, seconds=seconds, reason=reason, by=who.name
        )

    def unshelve(self, who: Who, run: RunRow, number: int) -> Shelving:
        """End a shelving before its time; raises RequestError if no such shelving is in force."""
        return self.alarm_store.unshelve(number, run=run_key(run), by=who.name)

    def hand_over(self, who: Who, text: str) -> Handover:
        """Add a note for the next shift, with the state of the alarms; raises RequestError if it is empty."""
        summary = handover_summary(self.live.now, self.incidents, now_s=self.accounts.clock())
        return self.alarm_store.hand_over(text, summary=summary, by=who.name)

    def move_job(self, who: Who, key: str, move: Move) -> Listed:
        """Move a job of the queue; raises RequestError if it is not where that can be done any more."""
        job = self.queue.move(key, move, by=who.name)
        self.accounts.note(who.name, f"queue.{move}", f"job {job.number}, {job.name}")
        return job

    def stop_run(self, who: Who, run: RunRow) -> None:
        """Ask for the end of a run: what has passed is still inspected, as after one Ctrl-C.

        Raises RequestError if no process watches it, ``Problem`` 503 if the request cannot be written.
        """
        if run.state != "running":
            raise RequestError("run", f"{run.id} has ended already", remedy="see its report")
        try:
            self.queue.control.stop(run_key(run), by=who.name)
        except OSError as error:
            what = f"the end could not be requested ({error.strerror})"
            raise Problem(503, "storage", what) from error
        self.accounts.note(who.name, "run.stop", f"run {run_key(run)}, {run.facts.job}")

    def vouch(self, who: Who, run: RunRow, sheet: int, *, reason: str) -> Label:
        """Record that a person has this one sheet in hand and that it is good.

        Raises RequestError if the sheet never came, or no reason is given.
        """
        if not came(self.reading.sheet(run.id, sheet)):
            remedy = "print it again"
            raise RequestError("sheet", f"{sheet} of run {run.id} did not come", remedy=remedy)
        at_s = self.accounts.clock()
        record = self.label_store.vouch(run=run_key(run), sheet=sheet, by=who.name, at_s=at_s, reason=reason)
        return self._audited("words.vouch", record, reason=record.note)

    def undo(self, who: Who, run: RunRow, number: int) -> Label:
        """Undo a label; raises RequestError if there is no such label in force."""
        record = self.label_store.undo(number, run=run_key(run), by=who.name, at_s=self.accounts.clock())
        return self._audited("words.undo", record, undoes=number)

    def _audited(self, what: str, record: Label, **after: object) -> Label:
        target = f"sheet {record.sheet}" if record.incident is None else f"incident {record.incident}"
        self.accounts.note(record.by, what, f"run {record.run}, {target}", after=after)
        return record
