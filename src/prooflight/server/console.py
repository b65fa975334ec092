"""What every endpoint works with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.errors import RequestError
from prooflight.inspection.sheets import came
from prooflight.journal.words import SEEN, run_key

if TYPE_CHECKING:
    from prooflight.journal.records import RunRow
    from prooflight.journal.words import Word, Words
    from prooflight.server.accounts.book import Accounts
    from prooflight.server.accounts.passwords import Tries
    from prooflight.server.accounts.provider import Provider
    from prooflight.server.accounts.roles import Who
    from prooflight.server.pictures.pictures import Pictures
    from prooflight.server.reading.course import Courses
    from prooflight.server.reading.gate import Gates
    from prooflight.server.reading.incidents import RunIncidents
    from prooflight.server.reading.live import Live
    from prooflight.server.reading.reprints import Reprints
    from prooflight.server.reading.runs import Reading
    from prooflight.server.reading.stations import Stations
    from prooflight.server.settings import ConsoleSettings
    from prooflight.server.zones.desk import ZonesDesk
    from prooflight.server.zones.rasters import Rasters
    from prooflight.server.zones.tolerances import Tolerances


@dataclass(frozen=True, slots=True, kw_only=True)
class Console:
    """What every endpoint is given: ``request.app.state.console``."""

    settings: ConsoleSettings
    accounts: Accounts
    words: Words
    """What people say of sheets; they lie beside the journal, where the command line adds to them too."""
    tries: Tries
    reading: Reading
    incidents: RunIncidents
    live: Live
    courses: Courses
    gates: Gates
    reprints: Reprints
    stations: Stations
    pictures: Pictures
    zones: ZonesDesk
    tolerances: Tolerances
    rasters: Rasters
    began_s: float
    """Unix time. [s]"""
    provider: Provider | None = None
    """At which people may sign in as well as here."""

    def say(
        self,
        who: Who,
        word: str,
        run: RunRow,
        *,
        sheet: int | None = None,
        incident: int | None = None,
        note: str = "",
        upto: int | None = None,
    ) -> Word:
        """What somebody says of a sheet or an incident; it is added, nothing is replaced, and the audit has it.

        upto: of the incident, the last sheet that they saw; None: its last one now. RequestError: the incident is of
        sheets of which no label says what they are.
        """
        if incident is not None:
            told = self.incidents.one(run, incident)
            if word != SEEN and not told.of_misprints:
                what = f"{incident} is of sheets that were not judged to be misprints, so that no label fits"
                remedy = "say `seen`; vouch for its sheets one by one, after a look at each"
                raise RequestError("incident", what, remedy=remedy)
            last = told.incident.last_sheet
            upto = last if upto is None else min(upto, last)
        said = self.words.say(
            word,
            run=run_key(run),
            by=who.name,
            at_s=self.accounts.clock(),
            sheet=sheet,
            incident=None if incident is None else str(incident),
            note=note,
            upto=None if incident is None else upto,
        )
        return self._audited("words.say", said, word=word, note=said.note, upto=said.upto)

    def vouch(self, who: Who, run: RunRow, sheet: int, *, reason: str) -> Word:
        """Somebody has this one sheet in hand, and it is good. RequestError: it never came, or no reason is given."""
        if not came(self.reading.sheet(run.id, sheet)):
            remedy = "print it again"
            raise RequestError("sheet", f"{sheet} of run {run.id} did not come", remedy=remedy)
        at_s = self.accounts.clock()
        said = self.words.vouch(run=run_key(run), sheet=sheet, by=who.name, at_s=at_s, reason=reason)
        return self._audited("words.vouch", said, reason=said.note)

    def undo(self, who: Who, run: RunRow, number: int) -> Word:
        """A word does not count any more. RequestError: no such word stands."""
        said = self.words.undo(number, run=run_key(run), by=who.name, at_s=self.accounts.clock())
        return self._audited("words.undo", said, undoes=number)

    def _audited(self, what: str, said: Word, **after: object) -> Word:
        target = f"sheet {said.sheet}" if said.incident is None else f"incident {said.incident}"
        self.accounts.note(said.by, what, f"run {said.run}, {target}", after=after)
        return said
