"""People's labels of alarms and sampled sheets, and what they show about the run and the press.

Only alarms and the random sample count here: labels of other sheets are stored and shown, but those sheets were
chosen for a reason, with an unknown probability.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from prooflight.detectors.weighted_conformal import LabelledPages, SampleCounts
from prooflight.errors import RequestError
from prooflight_line.journal.labels import MISPRINT, OF_GOOD, UNKNOWN, Labels, run_key
from prooflight_line.journal.records import SECONDS_A_DAY
from prooflight_line.run.incidents import Incidents

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from prooflight_line.journal.labels import Label, LabelStore
    from prooflight_line.journal.reading import JournalReader
    from prooflight_line.journal.records import PageRecord, RunRow
    from prooflight_line.run.incidents import Incident


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledSheet:
    """A sheet up for review, as an alarm or as one of the random sample, and its label."""

    record: PageRecord
    """The sheet's record; its ``sampled`` is not None."""
    label: Label | None
    """The label in force (``journal.labels.Labels``); None: it has none."""

    @property
    def alarm(self) -> bool:
        """Whether it is a misprint by its verdict; the others belong to the sample of those that passed."""
        return self.record.verdict.verdict == "misprint"

    @property
    def good(self) -> bool:
        """Whether it is labelled good."""
        return self.label is not None and self.label.word in OF_GOOD

    @property
    def misprint(self) -> bool:
        """Whether it is labelled a misprint."""
        return self.label is not None and self.label.word == MISPRINT

    @property
    def state(self) -> str:
        """Label as good, misprint or unknown; "" for none."""
        if self.label is None:
            return ""
        return "good" if self.good else MISPRINT if self.misprint else UNKNOWN


def sampled_sheets(
    records: Iterable[PageRecord], label_store: Sequence[Label], incident_of: Mapping[int, int]
) -> list[SampledSheet]:
    """Return the sheets of one run that are up for review, with their labels. incident_of: by sheet."""
    labels = Labels(label_store)
    return [
        SampledSheet(record=record, label=labels.of(record.sheet, incident_of.get(record.sheet)))
        for record in records
        if record.asked is not None
    ]


def incidents_by_sheet(records: Iterable[PageRecord]) -> tuple[dict[int, Incident], dict[int, int]]:
    """Return a run's incidents by number, and the number of each sheet's own incident.

    records: those worth reviewing, in the order of the run.
    """
    tracker = Incidents()
    incidents: dict[int, Incident] = {}
    of_sheet: dict[int, int] = {}
    for record in records:
        for change in tracker.add(record):
            incidents[change.incident.number] = change.incident
            if change.incident.last_sheet == record.sheet and change.what != "ended":
                of_sheet[record.sheet] = change.incident.number
    return incidents, of_sheet


def sample_of_run(reader: JournalReader, label_store: LabelStore, run: RunRow) -> list[SampledSheet]:
    """Return a run's sheets up for review, with their labels, from a journal; JournalError."""
    labels = label_store.of_run(run_key(run))
    in_incidents = any(label.incident is not None for label in labels)
    of_sheet = incidents_by_sheet(reader.pages(run.id, passed=False))[1] if in_incidents else {}
    return sampled_sheets(reader.sampled_pages(run.id), labels, of_sheet)


def counts_of(run: RunRow, sampled: Sequence[SampledSheet]) -> SampleCounts:
    """Return the numbers of alarms and sampled sheets of a run, and of their labels."""
    alarms, sample = [one for one in sampled if one.alarm], [one for one in sampled if not one.alarm]
    return SampleCounts(
        alarms=len(alarms),
        alarms_good=sum(one.good for one in alarms),
        alarms_misprints=sum(one.misprint for one in alarms),
        passed=run.pages - run.misprints - run.not_inspected,
        passed_good=sum(one.good for one in sample),
        passed_misprints=sum(one.misprint for one in sample),
    )


def labelled_pages(
    runs: Sequence[tuple[RunRow, Sequence[SampledSheet]]],
    *,
    replaces: str,
    rate: float,
    now_s: float,
    journals: Sequence[str] = (),
    half_life_days: float | None = None,
) -> LabelledPages:
    """Return the good pages from which a press is recalibrated.

    runs: those that the press judged by the detector. A sheet represents 1 / probability others, and those of
    its run that were up for review and are not labelled: alarms represent alarms, passed sheets represent passed
    ones. now_s: Unix time. [s] RequestError: no run is of this
    press, or scores of one are on another scale.
    """
    scores: list[float] = []
    weights: list[float] = []
    numbers: list[tuple[int, int, bool]] = []
    designs: dict[tuple[str, str], int] = {}
    of_design: list[int] = []
    zones: set[str] = set()
    passed_weight, alarms_from = 1.0, -math.inf
    for run, sampled in runs:
        if sampled:
            _refuse_other_scale(run)
        days = max(now_s - run.facts.started_s, 0.0) / SECONDS_A_DAY
        zones.add(str(run.facts.settings.get("zones_alone", "")))
        recent = 1.0 if half_life_days is None else 0.5 ** (days / half_life_days)
        for alarm in (False, True):
            group = [one for one in sampled if one.alarm == alarm and _scored(one.record)]
            labelled = sum(one.good or one.misprint for one in group)
            for one in group:
                verdict, probability = one.record.verdict, one.record.asked
                assert verdict.score is not None
                assert verdict.threshold is not None
                assert probability is not None
                alarms_from = max(alarms_from, verdict.threshold)
                if not one.good:
                    continue
                weight = len(group) / labelled / probability
                if not alarm:
                    passed_weight = max(passed_weight, weight)
                scores.append(verdict.score)
                weights.append(weight * recent)
                numbers.append((run.id, one.record.sheet, not alarm))
                key = run.facts.job_digest or run.facts.job, verdict.page
                of_design.append(designs.setdefault(key, len(designs)))
    if not math.isfinite(alarms_from):
        what = "no sheet sampled for review was judged by this press's own detector"
        raise RequestError("recalibrate", what, remedy="watch runs with --sample, and label the sheets")
    table = np.array(numbers, np.int64).reshape(-1, 3)
    return LabelledPages(
        score=np.array(scores, np.float64),
        weight=np.array(weights, np.float64),
        run=table[:, 0],
        sheet=table[:, 1],
        passed=table[:, 2].astype(bool),
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
    """Refuse a run with zones whose scores are from before there was one score for all pages (decision 38).

    Since then, a run's settings record its zones without their price.
    """
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
    """Effect of another threshold on a run."""

    run: int
    sheets: int
    alarms: int
    gone: tuple[int, ...]
    """Sheets whose alarm would be withdrawn."""
    gone_told: Mapping[str, int]
    """Number of these sheets by label: good, misprint, unknown, or "" for none."""
    come: tuple[int, ...]
    """Sheets that passed and would alarm."""


def replayed_run(
    run: RunRow, records: Iterable[PageRecord], sampled: Sequence[SampledSheet], *, threshold: float
) -> Replayed:
    """Decide a run again at another threshold; alarms that are not from a score stay."""
    state_of = {one.record.sheet: one.state for one in sampled}
    sheets, alarms = 0, 0
    withdrawn: list[int] = []
    added: list[int] = []
    for record in records:
        verdict = record.verdict
        if verdict.detector != run.facts.detector or not _scored(record):
            continue
        assert verdict.score is not None
        assert verdict.threshold is not None
        sheets += 1
        was, now = verdict.score > verdict.threshold, verdict.score > threshold
        alarms += verdict.verdict == "misprint"
        if was and not now and verdict.verdict == "misprint":
            withdrawn.append(record.sheet)
        if now and not was and verdict.verdict == "good":
            added.append(record.sheet)
    states = [state_of.get(sheet, "") for sheet in withdrawn]
    return Replayed(
        run=run.id,
        sheets=sheets,
        alarms=alarms,
        gone=tuple(withdrawn),
        gone_told={label: states.count(label) for label in sorted(set(states))},
        come=tuple(added),
    )
