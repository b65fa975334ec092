"""What another press, or another threshold, would have done with the sheets of the last runs.

A version that changes the threshold alone is compared by the recorded scores. Any other decides again from the stored
evidence, which is kept of misprints and of the sample: of the other sheets nothing is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.optional import Recalibrates
from prooflight.errors import RequestError
from prooflight.inspection.redeciding import decided_again
from prooflight_line.journal.labels import Labels, run_key
from prooflight_line.run.labelled_sheets import SampledSheet, incidents_by_sheet

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator

    from prooflight.detectors.cost import RunningCosts
    from prooflight.press.artefact import Press
    from prooflight_line.journal.labels import LabelStore
    from prooflight_line.journal.reading import JournalReader
    from prooflight_line.journal.records import PageRecord, RunRow

STEPS: Final = 6
"""Number of thresholds on either side of the present one."""
DAYS: Final = 7.0
"""Age of the runs that are looked at. [days]"""
LEAST_RUNS: Final = 5
"""Number of last runs that are looked at if fewer are so young."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JudgedSheet:
    """A sheet that a version of the press has judged by a score."""

    run: int
    record: PageRecord
    state: str
    """Label: good, misprint, unknown; "" for none."""
    same_scale: bool
    """Whether the version in question gives the same score."""

    @property
    def alarmed(self) -> bool:
        """Whether its score was above the threshold."""
        verdict = self.record.verdict
        assert verdict.score is not None
        assert verdict.threshold is not None
        return verdict.score > verdict.threshold

    @property
    def always_stops(self) -> bool:
        """Whether its alarm stopped the press although stopping cost more: no costs change that."""
        verdict, cents = self.record.verdict, self.record.verdict.expected_cost
        return bool(cents) and cents["stop"] >= cents["accept"] and not verdict.stopping_costs_more


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """Effect of a version or of a threshold on the sheets of the last runs."""

    runs: int
    sheets: int
    """Sheets that were judged by a score."""
    unknown: int
    """Those of them about which nothing is known, for want of evidence; they count as before."""
    alarms_before: int
    alarms: int
    more: int
    """Sheets that passed and would alarm, but for those labelled misprints."""
    fewer: int
    """Number of alarms that would go."""
    fewer_good: int
    """Number of alarms that would go and are labelled good."""
    misprints: int
    """Number of sheets that are labelled misprints."""
    missed: int
    """Number of sheets that are labelled misprints and would pass."""
    cost_cents: float
    """Cost of the alarms not labelled misprints, and of the labelled misprints that pass, by the press's costs.

    An alarm that is accepted, because stopping costs more, is no stop: its sheet passes.
    """
    cost_cents_before: float = 0.0
    """The same of what was done, by the costs of the version."""
    accepted_before: int = 0
    """Number of alarms that were accepted because stopping costs more."""
    accepted: int = 0
    """Number of alarms that would be accepted for this reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ThresholdEffect:
    """Effect of one threshold."""

    threshold: float
    present: bool
    effect: Effect


def recent_runs(runs: Iterable[RunRow], *, now_s: float) -> list[RunRow]:
    """Return the runs of the last seven days, or the last five if there are fewer. now_s: Unix time. [s]"""
    listed = list(runs)
    young = [run for run in listed if run.facts.started_s >= now_s - 86_400 * DAYS]
    return young if len(young) >= LEAST_RUNS else listed[-LEAST_RUNS:]


def judged_sheets(
    reader: JournalReader,
    label_store: LabelStore,
    runs: Iterable[RunRow],
    *,
    detector: str,
    same_scale: Collection[str],
    evidence: bool = False,
) -> Iterator[JudgedSheet]:
    """Yield the sheets of runs that were judged by a score of this detector, with their labels.

    Parameters
    ----------
    same_scale
        Digests of the presses whose scores are those of the version in question.
    evidence
        Whether to read the evidence of sheets of other presses.
    """
    for run in runs:
        labels = Labels(label_store.of_run(run_key(run)))
        _, incident_of = incidents_by_sheet(reader.pages(run.id, passed=False))
        same = run.facts.press_digest in same_scale
        with_evidence = reader.evidence_of_run(run.id) if evidence and not same else {}
        for page in reader.pages(run.id):
            verdict = page.verdict
            if verdict.detector != detector or verdict.score is None or verdict.threshold is None:
                continue
            record = reader.page(run.id, page.sheet) if page.sheet in with_evidence else page
            labelled = SampledSheet(record=page, label=labels.of(page.sheet, incident_of.get(page.sheet)))
            yield JudgedSheet(run=run.id, record=record, state=labelled.state, same_scale=same)


def of_version(sheets: Iterable[JudgedSheet], press: Press, detector: str) -> Effect:
    """Return what a version of the press would have done."""
    model = press.detectors[detector]

    def decide(one: JudgedSheet) -> _Decided | None:
        if one.same_scale and isinstance(model, Recalibrates):
            return _decided(one, model.threshold)
        if one.record.evidence is None:
            return None
        try:
            again = decided_again(one.record.evidence, press, detector)
        except RequestError:
            return None
        return _Decided(alarm=again.misprint, probability=again.probability)

    return _effect(sheets, decide, press.costs)


def of_thresholds(sheets: Iterable[JudgedSheet], press: Press, detector: str) -> list[ThresholdEffect]:
    """Return the effects of thresholds around the present one; empty: there is none, or no sheet has a score."""
    model = press.detectors.get(detector)
    scored = [one for one in sheets if one.same_scale]
    if not isinstance(model, Recalibrates) or not scored:
        return []
    scores = np.array([one.record.verdict.score for one in scored], np.float64)
    middle, high = np.quantile(scores, (0.5, 0.95))
    step = max(float(high - middle), 1e-6) / STEPS
    return [
        ThresholdEffect(
            threshold=threshold,
            present=at == 0,
            effect=_effect(scored, partial(_decided, threshold=threshold), press.costs),
        )
        for at in range(-STEPS, STEPS + 1)
        for threshold in (model.threshold + at * step,)
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Decided:
    alarm: bool
    probability: float | None
    """Probability of a misprint; None: not known, so that costs accept nothing. [-]"""


def _decided(one: JudgedSheet, threshold: float) -> _Decided:
    """Return the decision on a sheet at another threshold; the probability is that of its score."""
    verdict = one.record.verdict
    assert verdict.score is not None
    return _Decided(alarm=verdict.score > threshold, probability=verdict.probability)


def _effect(
    sheets: Iterable[JudgedSheet], decide: Callable[[JudgedSheet], _Decided | None], costs: RunningCosts
) -> Effect:
    runs = set[int]()
    counts = dict.fromkeys(
        (
            "sheets",
            "unknown",
            "alarms_before",
            "alarms",
            "more",
            "fewer",
            "fewer_good",
            "misprints",
            "missed",
            "accepted_before",
            "accepted",
        ),
        0,
    )
    cents = cents_before = 0.0
    for one in sheets:
        runs.add(one.run)
        known, before = decide(one), one.alarmed
        accepted_before = before and one.record.verdict.stopping_costs_more
        now, accepted = before, accepted_before
        if known is not None:
            chance, now = known.probability, known.alarm
            pays = chance is None or one.always_stops or costs.stopping_pays(chance)
            accepted = now and not pays
        is_misprint = one.state == "misprint"
        counts["sheets"] += 1
        counts["unknown"] += known is None
        counts["alarms_before"] += before
        counts["alarms"] += now
        counts["more"] += now and not before and not is_misprint
        counts["fewer"] += before and not now
        counts["fewer_good"] += before and not now and one.state == "good"
        counts["misprints"] += is_misprint
        counts["missed"] += is_misprint and (accepted or not now)
        counts["accepted_before"] += accepted_before
        counts["accepted"] += accepted
        cents += _cents(costs, stopped=now and not accepted, is_misprint=is_misprint)
        cents_before += _cents(costs, stopped=before and not accepted_before, is_misprint=is_misprint)
    return Effect(
        runs=len(runs), cost_cents=round(cents, 4), cost_cents_before=round(cents_before, 4), **counts
    )


def _cents(costs: RunningCosts, *, stopped: bool, is_misprint: bool) -> float:
    """Return the cost of what is done with a sheet, where a label says that it is wrong. [cent]"""
    if stopped:
        return 0.0 if is_misprint else costs.false_alarm_cents
    return costs.missed_misprint_cents if is_misprint else 0.0
