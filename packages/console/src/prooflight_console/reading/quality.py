"""Quality figures of a run: realised false alarms, overruled verdicts, and sheets not inspected."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, Self

from scipy import special

from prooflight.detectors.registry import detector as detector_of
from prooflight.errors import RequestError
from prooflight_console.reading.report import report
from prooflight_console.reading.runs import pages_to_review
from prooflight_line.journal.labels import FALSE_ALARM, UNKNOWN

if TYPE_CHECKING:
    from prooflight.press.artefact import Press
    from prooflight_console.reading.incidents import LabelledIncident, RunIncidents
    from prooflight_console.reading.reprints import Counted
    from prooflight_console.reading.runs import Reading
    from prooflight_console.reading.stations import Stations
    from prooflight_line.journal.records import RunRow

RateResult = Literal["suspended", "unknown", "more", "waiting", "kept"]
"""Result of comparing false alarms with the promised rate.

more: so many would come by chance once in twenty runs at most. waiting: the result depends on unanswered
alarms.
"""

RARE: Final = 0.05
"""Significance level of the test for too many false alarms. assumed: usual for such a test."""
BINS: Final = 48
"""Number of parts into which a run is divided for its chart."""
MOST_REASONS: Final = 8
_NUMBERS = re.compile(r"[-+]?\d+(?:[.,:]\d+)*")


@dataclass(frozen=True, slots=True, kw_only=True)
class FalseAlarms:
    """Promised and realised false alarms."""

    text: str
    """Text of the detector's promise; empty if the press of the run is not known here."""
    rate: float | None
    """Promised false-alarm rate of good sheets [-]; None if it is not known as a number."""
    good: int
    """Number of sheets that were good, as far as they are labelled."""
    confirmed: int
    """Number of sheets with an alarm labelled as false."""
    unanswered: int
    """Number of misprints without a label that says what they are."""
    suspended_from: int | None

    @classmethod
    def of(cls, run: RunRow, press: Press | None, *, confirmed: int, unanswered: int, text: str = "") -> Self:
        """Return the false alarms of a run; press: its own, if it is known here."""
        return cls(
            text=text,
            rate=_guaranteed_rate(press, run.facts.detector),
            good=run.pages - run.not_inspected - run.misprints + confirmed,
            confirmed=confirmed,
            unanswered=unanswered,
            suspended_from=run.promise_suspended_from,
        )

    @property
    def expected(self) -> float | None:
        """Greatest expected number of false alarms by the promised rate."""
        return None if self.rate is None else self.rate * self.good

    @property
    def state(self) -> RateResult:
        """Result of the test, by the binomial probability of so many false alarms or more."""
        if self.suspended_from is not None:
            return "suspended"
        if self.rate is None:
            return "unknown"
        if self._chance(self.confirmed) < RARE:
            return "more"
        return "waiting" if self._chance(self.confirmed + self.unanswered) < RARE else "kept"

    def _chance(self, alarms: int) -> float:
        return float(special.bdtrc(alarms - 1, max(self.good, alarms), self.rate)) if alarms else 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Override:
    """A label that overrules the verdicts of an incident."""

    incident: int
    kind: str
    sheets: int
    """Number of sheets that the person saw."""
    by: str
    at_s: float
    note: str
    stands: bool
    """Whether it is the label in force."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """Quality report of a run."""

    figures: dict[str, Any]
    """Figures of the run; see ``report``."""
    false_alarms: FalseAlarms
    overrides: tuple[Override, ...]
    reasons: dict[str, int]
    """Number of sheets that were not inspected by reason, with the numbers removed from the reasons."""
    trend: tuple[dict[str, int], ...]
    """Counts of misprints, sheets not inspected and late ones in equal parts of the run."""


def quality(
    reading: Reading, incidents: RunIncidents, stations: Stations, reprints: Counted, run: RunRow
) -> Quality:
    """Return the quality report of a run; raises JournalError."""
    figures = report(reading, incidents, stations, reprints, run)
    labelled = incidents.of(run)
    label_of = incidents.labels(run)
    reasons: Counter[str] = Counter()
    parts = [{"misprint": 0, "not-inspected": 0, "late": 0} for _ in range(BINS)]
    last, unanswered = _last_sheet(reading, run), 0
    for page in pages_to_review(reading, run):
        verdict = page.verdict
        part = parts[min(page.sheet * BINS // max(last + 1, 1), BINS - 1)]
        part["late"] += page.late
        if verdict.verdict == "good":
            continue
        part[verdict.verdict] += 1
        if verdict.verdict == "not-inspected":
            reasons[_NUMBERS.sub("…", verdict.reason)[:1000]] += 1
        else:
            label = label_of(page.sheet)
            unanswered += label is None or label.word == UNKNOWN
    false_alarms = FalseAlarms.of(
        run,
        stations.press(run),
        confirmed=figures["false_alarms"],
        unanswered=unanswered,
        text=figures["guarantee"] or "",
    )
    overrides = (
        one for each in labelled for one in _overrides(each, incidents.sheets_of(run, each.incident.number))
    )
    sorted_overrides = tuple(sorted(overrides, key=lambda one: -one.at_s))
    return Quality(
        figures=figures,
        false_alarms=false_alarms,
        overrides=sorted_overrides,
        reasons=dict(reasons.most_common(MOST_REASONS)),
        trend=tuple(parts),
    )


def _overrides(labelled: LabelledIncident, sheets: list[int]) -> list[Override]:
    """Return the labels that call an incident a false alarm; sheets: those of the incident."""
    if not labelled.of_misprints:
        return []
    return [
        Override(
            incident=labelled.incident.number,
            kind=labelled.incident.kind,
            sheets=sum(map(label.covers, sheets)),
            by=label.by,
            at_s=label.at_s,
            note=label.note,
            stands=labelled.label is label,
        )
        for label in labelled.labels
        if label.word == FALSE_ALARM
    ]


def _last_sheet(reading: Reading, run: RunRow) -> int:
    follower = reading.follower
    return -1 if follower is None else follower.last_sheet(run.id)


def _guaranteed_rate(press: Press | None, detector: str) -> float | None:
    """Return the promised false-alarm rate; None if the detector gives none, or its press is not known."""
    if press is None:
        return None
    try:
        return detector_of(detector, press).false_alarm_rate
    except RequestError:  # another press's, or one that is not installed here
        return None
