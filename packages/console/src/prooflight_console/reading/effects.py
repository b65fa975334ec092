"""Effects of an incident's labels: sheets to print again, false alarms beside the guarantee, and the threshold."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from prooflight_console.reading.quality import FalseAlarms
from prooflight_line.journal.labels import OF_GOOD, UNKNOWN

if TYPE_CHECKING:
    from prooflight_console.reading.incidents import LabelledIncident, RunIncidents
    from prooflight_console.reading.reprints import Reprints
    from prooflight_console.reading.stations import Stations
    from prooflight_line.journal.records import RunRow


@dataclass(frozen=True, slots=True, kw_only=True)
class Effects:
    """State of what labels change, and the state before the last label where it is known."""

    to_print_again: int | None
    """Number of sheets to print again; None if they cannot be counted."""
    false_alarms: FalseAlarms
    sampled: int
    """Number of the incident's sheets that are of the sample: their labels count in the next calibration."""
    labelled: int
    """Number of sheets of the run's sample that are labelled good, alarms included."""
    before: Effects | None = None

    @property
    def needed(self) -> int | None:
        """Number of such sheets that a calibration needs to keep the guaranteed rate; None: it is not known.

        The guarantee of one false alarm in N good sheets needs N - 1 of them (decision 30).
        """
        rate = self.false_alarms.rate
        return math.ceil(1 / rate) - 1 if rate else None

    def since(self, before: Effects) -> Effects:
        """Return these effects together with the state before."""
        return replace(self, before=before)


def effects(
    incidents: RunIncidents, reprints: Reprints, stations: Stations, run: RunRow, labelled: LabelledIncident
) -> Effects:
    """Return what labels of a run have changed so far, and what those of this incident can change."""
    label_of = incidents.labels(run)
    misprints = {one.incident.number for one in incidents.of(run) if one.of_misprints}
    in_force = [
        None if (label := label_of(sheet)) is None else label.word
        for sheet, number in incidents.incident_by_sheet(run).items()
        if number in misprints
    ]
    sampled = incidents.sampled(run)
    of_incident = set(incidents.sheets_of(run, labelled.incident.number))
    return Effects(
        to_print_again=reprints.count(run).count,
        false_alarms=FalseAlarms.of(
            run,
            stations.press(run),
            confirmed=sum(label in OF_GOOD for label in in_force),
            unanswered=sum(label is None or label == UNKNOWN for label in in_force),
        ),
        sampled=sum(one.record.sheet in of_incident for one in sampled),
        labelled=sum(one.good for one in sampled),
    )
