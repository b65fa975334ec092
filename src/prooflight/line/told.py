"""What people told of the sheets that they were asked about, and what it says of the run and of the press.

Only alarms and the random sample count here: words on other sheets are kept and shown, but whoever chose those sheets
had a reason, and nobody knows with which probability.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.weighted_conformal import SampleCounts, ToldPages
from prooflight.errors import RequestError
from prooflight.journal.records import SECONDS_A_DAY
from prooflight.journal.words import MISPRINT, OF_GOOD, UNKNOWN, Labels, run_key
from prooflight.line.incidents import Incidents

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from prooflight.journal.reading import JournalReader
    from prooflight.journal.records import PageRecord, RunRow
    from prooflight.journal.words import Word, Words
    from prooflight.line.incidents import Incident

OURS: Final = "ours"
"""The detector whose scores words calibrate."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AskedSheet:
    """A sheet about which people are asked, and what they said."""

    record: PageRecord
    """Its ``asked`` is no None."""
    word: Word | None
    """The label that counts (``journal.words.Labels``); None: nobody has said anything."""

    @property
    def alarm(self) -> bool:
        """Whether it is a misprint by its verdict; the others are of the sample of those that passed."""
        return self.record.verdict.verdict == "misprint"

    @property
    def good(self) -> bool:
        """Whether people said that it is."""
        return self.word is not None and self.word.word in OF_GOOD

    @property
    def misprint(self) -> bool:
        """Whether people said that it is one."""
        return self.word is not None and self.word.word == MISPRINT

    @property
    def state(self) -> str:
        """good, misprint, unknown, or "" where nobody has said anything."""
        if self.word is None:
            return ""
        return "good" if self.good else MISPRINT if self.misprint else UNKNOWN


def asked_sheets(
    records: Iterable[PageRecord], words: Sequence[Word], incident_of: Mapping[int, int]
) -> list[AskedSheet]:
    """Sheets of one run about which people are asked, with what they said. incident_of: by sheet."""
    labels = Labels(words)
    return [
        AskedSheet(record=record, word=labels.of(record.sheet, incident_of.get(record.sheet)))
        for record in records
        if record.asked is not None
    ]


def incidents_by_sheet(records: Iterable[PageRecord]) -> tuple[dict[int, Incident], dict[int, int]]:
    """Incidents of a run by number, and the number of each sheet's own; records: those to look at, in order."""
    tracker = Incidents()
    found: dict[int, Incident] = {}
    of_sheet: dict[int, int] = {}
    for record in records:
        for change in tracker.add(record):
            found[change.incident.number] = change.incident
            if change.incident.last_sheet == record.sheet and change.what != "ended":
                of_sheet[record.sheet] = change.incident.number
    return found, of_sheet


def asked_of_run(reader: JournalReader, words: Words, run: RunRow) -> list[AskedSheet]:
    """The same from a journal; JournalError."""
    said = words.of_run(run_key(run))
    in_incidents = any(word.incident is not None for word in said)
    of_sheet = incidents_by_sheet(reader.pages(run.id, passed=False))[1] if in_incidents else {}
    return asked_sheets(reader.asked_pages(run.id), said, of_sheet)


def counts_of(run: RunRow, asked: Sequence[AskedSheet]) -> SampleCounts:
    """What was asked and told of a run's sheets."""
    alarms, sample = [one for one in asked if one.alarm], [one for one in asked if not one.alarm]
    return SampleCounts(
        alarms=len(alarms),
        alarms_good=sum(one.good for one in alarms),
        alarms_misprints=sum(one.misprint for one in alarms),
        passed=run.pages - run.misprints - run.not_inspected,
        passed_good=sum(one.good for one in sample),
        passed_misprints=sum(one.misprint for one in sample),
    )


def told_pages(
    runs: Sequence[tuple[RunRow, Sequence[AskedSheet]]],
    *,
    digests: Collection[str],
    replaces: str,
    rate: float,
    now_s: float,
    journals: Sequence[str] = (),
    half_life_days: float | None = None,
) -> ToldPages:
    """The good pages by which a press is calibrated anew: those of runs that one of ``digests`` judged by our detector.

    A sheet stands for 1 / probability others, and for those of its run that were asked about and not answered: alarms
    for alarms, passed ones for passed ones. now_s: Unix time. [s] RequestError: no run is of this press, or scores
    of one are on another scale.
    """
    scores: list[float] = []
    weights: list[float] = []
    numbers: list[tuple[int, int, bool]] = []
    designs: dict[tuple[str, str], int] = {}
    of_design: list[int] = []
    zones: set[str] = set()
    passed_weight, alarms_from = 1.0, -math.inf
    for run, asked in runs:
        if run.facts.press_digest not in digests or run.facts.detector != OURS:
            continue
        if asked:
            _refuse_other_scale(run)
        days = max(now_s - run.facts.started_s, 0.0) / SECONDS_A_DAY
        zones.add(str(run.facts.settings.get("zones_alone", "")))
        recent = 1.0 if half_life_days is None else 0.5 ** (days / half_life_days)
        for alarm in (False, True):
            of_kind = [one for one in asked if one.alarm == alarm and _scored(one.record)]
            told = sum(one.good or one.misprint for one in of_kind)
            for one in of_kind:
                verdict, probability = one.record.verdict, one.record.asked
                assert verdict.score is not None
                assert verdict.threshold is not None
                assert probability is not None
                alarms_from = max(alarms_from, verdict.threshold)
                if not one.good:
                    continue
                weight = len(of_kind) / told / probability
                if not alarm:
                    passed_weight = max(passed_weight, weight)
                scores.append(verdict.score)
                weights.append(weight * recent)
                numbers.append((run.id, one.record.sheet, not alarm))
                key = run.facts.job_digest or run.facts.job, verdict.page
                of_design.append(designs.setdefault(key, len(designs)))
    if not math.isfinite(alarms_from):
        what = "no sheet that people were asked about was judged by this press's own detector"
        raise RequestError(
            "recalibrate", what, remedy="watch runs with --sample, and say what the sheets were"
        )
    held = np.array(numbers, np.int64).reshape(-1, 3)
    return ToldPages(
        score=np.array(scores, np.float64),
        weight=np.array(weights, np.float64),
        run=held[:, 0],
        sheet=held[:, 1],
        passed=held[:, 2].astype(bool),
        rate=rate,
        passed_weight=passed_weight,
        alarms_from=alarms_from,
        replaces=replaces,
        journals=tuple(journals),
        half_life_days=half_life_days,
        design=np.array(of_design, np.int64),
        zones=tuple(sorted(zones)) if any(zones) else (),
    )


def _refuse_other_scale(run: RunRow) -> None:
    """Runs say of zones what they were without their price since there is one score for all pages (decision 38)."""
    if "zones" in run.facts.settings and "zones_alone" not in run.facts.settings:
        what = "it judged pages with zones by an older Prooflight, whose scores are on another scale"
        remedy = (
            "calibrate by runs watched since: give --journal of these, or remove older ones with `run tidy`"
        )
        raise RequestError(f"run {run.id}", what, remedy=remedy)


def _scored(record: PageRecord) -> bool:
    score, threshold = record.verdict.score, record.verdict.threshold
    return score is not None and threshold is not None and math.isfinite(score) and math.isfinite(threshold)


@dataclass(frozen=True, slots=True, kw_only=True)
class Replayed:
    """What another threshold would have made of a run."""

    run: int
    sheets: int
    """That have a score."""
    alarms: int
    """That it gave."""
    gone: tuple[int, ...]
    """Sheets whose alarm would go ..."""
    gone_told: Mapping[str, int]
    """... by what people said of them: good, misprint, unknown, or "" for nothing."""
    come: tuple[int, ...]
    """Sheets that passed and would alarm."""


def replayed_run(
    run: RunRow, records: Iterable[PageRecord], asked: Sequence[AskedSheet], *, threshold: float
) -> Replayed:
    """The verdicts of a run made again at another threshold; alarms that no score gave stay."""
    told = {one.record.sheet: one.state for one in asked}
    sheets, alarms = 0, 0
    gone: list[int] = []
    come: list[int] = []
    for record in records:
        verdict = record.verdict
        if verdict.detector != OURS or not _scored(record):
            continue
        assert verdict.score is not None
        assert verdict.threshold is not None
        sheets += 1
        was, now = verdict.score > verdict.threshold, verdict.score > threshold
        alarms += verdict.verdict == "misprint"
        if was and not now and verdict.verdict == "misprint":
            gone.append(record.sheet)
        if now and not was and verdict.verdict == "good":
            come.append(record.sheet)
    said = [told.get(sheet, "") for sheet in gone]
    return Replayed(
        run=run.id,
        sheets=sheets,
        alarms=alarms,
        gone=tuple(gone),
        gone_told={word: said.count(word) for word in sorted(set(said))},
        come=tuple(come),
    )
