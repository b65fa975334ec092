"""The services that every endpoint works with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.errors import RequestError
from prooflight.inspection.sheets import came
from prooflight_line.journal.labels import SEEN, run_key

if TYPE_CHECKING:
    from prooflight_console.accounts.account_store import Accounts
    from prooflight_console.accounts.passwords import Tries
    from prooflight_console.accounts.provider import Provider
    from prooflight_console.accounts.roles import Who
    from prooflight_console.pictures.pictures import Pictures
    from prooflight_console.reading.gate import Gates
    from prooflight_console.reading.incidents import RunIncidents
    from prooflight_console.reading.live import Live
    from prooflight_console.reading.reprints import Reprints
    from prooflight_console.reading.runs import Reading
    from prooflight_console.reading.stations import Stations
    from prooflight_console.reading.trend import Trends
    from prooflight_console.settings import ConsoleSettings
    from prooflight_console.zones.rasters import Rasters
    from prooflight_console.zones.service import ZonesService
    from prooflight_console.zones.tolerances import Tolerances
    from prooflight_line.journal.labels import Label, LabelStore
    from prooflight_line.journal.records import RunRow


@dataclass(frozen=True, slots=True, kw_only=True)
class Console:
    """Services of the application, which endpoints get from ``request.app.state.console``."""

    settings: ConsoleSettings
    accounts: Accounts
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
    tolerances: Tolerances
    rasters: Rasters
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
                what = f"{incident} is of sheets that were not judged to be misprints, so that no label fits"
                remedy = "say `seen`; vouch for its sheets one by one, after a look at each"
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
