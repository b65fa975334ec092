"""What every endpoint works with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.journal.words import run_key

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
    ) -> Word:
        """What somebody says of a sheet or an incident; it is added, nothing is replaced, and the audit has it."""
        said = self.words.say(
            word,
            run=run_key(run),
            by=who.name,
            at_s=self.accounts.clock(),
            sheet=sheet,
            incident=None if incident is None else str(incident),
            note=note,
        )
        target = f"run {said.run}, " + (f"sheet {sheet}" if incident is None else f"incident {incident}")
        self.accounts.note(who.name, "words.say", target, after={"word": word, "note": said.note})
        return said
