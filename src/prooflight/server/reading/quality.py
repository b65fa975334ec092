"""What a quality manager asks of a run: is the promise kept, who overruled what, why was a sheet not inspected."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

from scipy import special

from prooflight.journal.words import FALSE_ALARM, UNKNOWN
from prooflight.server.reading.report import report
from prooflight.server.reading.runs import looked_at

if TYPE_CHECKING:
    from prooflight.journal.records import RunRow
    from prooflight.press.artefact import Press
    from prooflight.server.reading.incidents import RunIncidents, Told
    from prooflight.server.reading.reprints import Counted
    from prooflight.server.reading.runs import Reading
    from prooflight.server.reading.stations import Stations

Kept = Literal["suspended", "unknown", "more", "waiting", "kept"]
"""more: by chance so many would come once in twenty runs at most. waiting: it hangs on alarms that nobody answered."""

RARE: Final = 0.05
"""Chance below which more false alarms than promised are taken to be no chance. assumed: usual for such a test."""
BINS: Final = 48
"""Of a run, for the picture of its course."""
MOST_REASONS: Final = 8
_NUMBERS = re.compile(r"[-+]?\d+(?:[.,:]\d+)*")


@dataclass(frozen=True, slots=True, kw_only=True)
class Promise:
    """False alarms: what the detector promised of good sheets, and what came."""

    text: str
    """In the detector's words; empty: the press of the run is not known here."""
    rate: float | None
    """Good sheets that may alarm, of all good sheets [-]; None: it is not known as a number."""
    good: int
    """Sheets that were good, as far as people have said."""
    confirmed: int
    """Sheets whose alarm somebody called false."""
    unanswered: int
    """Misprints of which nobody said what they are."""
    suspended_from: int | None

    @property
    def expected(self) -> float | None:
        """False alarms that the promise allows on average, at most."""
        return None if self.rate is None else self.rate * self.good

    @property
    def state(self) -> Kept:
        """Whether it was kept, by the binomial chance of so many false alarms or more."""
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
    """Somebody said otherwise than the verdicts of an incident."""

    incident: int
    kind: str
    sheets: int
    """That the person saw."""
    by: str
    at_s: float
    note: str
    stands: bool
    """Whether it is the last word."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """A run report."""

    figures: dict[str, Any]
    """See ``report``."""
    promise: Promise
    overrides: tuple[Override, ...]
    reasons: dict[str, int]
    """Sheets that were not inspected by why, numbers left out."""
    course: tuple[dict[str, int], ...]
    """Misprints, sheets not inspected and late ones in equal parts of the run."""


def quality(
    reading: Reading, incidents: RunIncidents, stations: Stations, reprints: Counted, run: RunRow
) -> Quality:
    """A run report; JournalError."""
    figures = report(reading, incidents, stations, reprints, run)
    told = incidents.of(run)
    label_of = incidents.labels(run)
    reasons: Counter[str] = Counter()
    course = [{"misprint": 0, "not-inspected": 0, "late": 0} for _ in range(BINS)]
    last, unanswered = _last_sheet(reading, run), 0
    for page in looked_at(reading, run):
        verdict = page.verdict
        part = course[min(page.sheet * BINS // max(last + 1, 1), BINS - 1)]
        part["late"] += page.late
        if verdict.verdict == "good":
            continue
        part[verdict.verdict] += 1
        if verdict.verdict == "not-inspected":
            reasons[_NUMBERS.sub("…", verdict.reason)[:160]] += 1
        else:
            label = label_of(page.sheet)
            unanswered += label is None or label.word == UNKNOWN
    promise = Promise(
        text=figures["promised"] or "",
        rate=_rate(stations.press(run), run.facts.detector),
        good=run.pages - run.not_inspected - run.misprints + figures["false_alarms"],
        confirmed=figures["false_alarms"],
        unanswered=unanswered,
        suspended_from=run.promise_suspended_from,
    )
    overrides = (
        one for each in told for one in _overrides(each, incidents.sheets_of(run, each.incident.number))
    )
    found = tuple(sorted(overrides, key=lambda one: -one.at_s))
    return Quality(
        figures=figures,
        promise=promise,
        overrides=found,
        reasons=dict(reasons.most_common(MOST_REASONS)),
        course=tuple(course),
    )


def _overrides(told: Told, sheets: list[int]) -> list[Override]:
    """sheets: of the incident."""
    if not told.of_misprints:
        return []
    return [
        Override(
            incident=told.incident.number,
            kind=told.incident.kind,
            sheets=sum(map(word.covers, sheets)),
            by=word.by,
            at_s=word.at_s,
            note=word.note,
            stands=told.label is word,
        )
        for word in told.words
        if word.word == FALSE_ALARM
    ]


def _last_sheet(reading: Reading, run: RunRow) -> int:
    follower = reading.follower
    return -1 if follower is None else follower.last_sheet(run.id)


def _rate(press: Press | None, detector: str) -> float | None:
    """Of the promise as a number; None: the detector gives none, or its press is not known."""
    if press is None:
        return None
    if detector == "ours" and press.ours is not None:
        return press.ours.promise.rate
    return 1 / press.good_pages_per_false_alarm if detector == "chi-square" else None
