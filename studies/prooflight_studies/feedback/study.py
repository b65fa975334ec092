"""Twenty weeks of a press that differs from the one it was trained on, recalibrated by a sample and by alarms alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.detectors.false_alarm_rate import conformal_threshold
from prooflight.detectors.weighted_conformal import LabelledPages, SampleCounts
from prooflight.errors import RequestError
from prooflight.rng import stream
from prooflight_studies.feedback.pool import BLACK_OF_FOUR, TARGET_RATE, TIMES, PoolPlan, printed_pool
from prooflight_studies.harness.page import write_page

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight_studies.feedback.pool import Pool

WEEKS: Final = 20
DAYS_A_WEEK: Final = 5
SHEETS_A_DAY: Final = 250
SAMPLE: Final = 0.02
"""Share of the passed sheets that are sampled for review."""
MISPRINT_RATE: Final = 0.01
LABELLED: Final = (100, 150, 200, 300)
"""Numbers of sampled good pages that are labelled before the press is recalibrated."""
HISTORIES: Final = 200
"""Number of simulated twenty weeks, each with other days to calibrate and to judge."""
GOAL_LABELLED: Final = 300
GOAL_FACTOR: Final = 1.5
MIDDLE: Final = 0.9
"""Share of histories between the stated bounds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """Rates of one threshold on days without labels."""

    realised: float
    """False-alarm rate: share of good sheets that alarm. [-]"""
    caught: float
    """Share of misprints that alarm. [-]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One method to set the threshold, over all histories."""

    way: str
    told: int | None
    """Number of sampled good pages; None: the method does not use these."""
    sheets: float
    """Mean number of sheets that had been printed by then."""
    threshold: float
    """Median of the threshold."""
    realised: float
    """Mean of the realised false-alarm rate, which the theorem bounds. [-]"""
    low: float
    """Lower end of the middle ``MIDDLE`` of histories; ``high`` is the upper. [-]"""
    high: float
    within: float
    """Share of histories whose realised rate is within ``GOAL_FACTOR`` of the target."""
    caught: float
    histories: int


@dataclass(frozen=True, slots=True, kw_only=True)
class FeedbackResults:
    """Results of the study, as the page shows them."""

    seed: int
    quick: bool
    promised: float
    times: float
    black_of_four: float
    pool_good: int
    pool_misprints: int
    pool_days: int
    minutes: float
    weeks: int
    days_a_week: int
    sheets_a_day: int
    sample: float
    misprint_rate: float
    histories: int
    goal_told: int
    goal_factor: float
    taught: str
    rows: list[Row]
    alone: Row
    """Calibration by the labels of alarms alone, at that moment."""
    goal: Row
    """Row at ``GOAL_LABELLED`` pages, or as many as there were."""
    refused_below: int
    """Number of sampled good pages below which the product refuses to recalibrate."""
    missed_covered: float
    """Share of histories in which the interval of the missed misprints contains their true number."""
    missed_true: float
    """Mean over histories of the true number."""
    missed_estimate: float
    rate_covered: float
    """The same share for the realised false-alarm rate of the sheets that passed the press."""


def run_feedback_study(
    out: Path,
    *,
    cache: Path,
    plan: PoolPlan,
    quick: bool = False,
    processes: int | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> FeedbackResults:
    """Print the pool, simulate the weeks, and write feedback.md."""
    pool = printed_pool(plan, cache, processes=processes, progress=progress)
    histories = 20 if quick else HISTORIES
    lived = []
    for number in range(histories):
        if number % 20 == 0:
            progress(f"history {number} of {histories}")
        lived.append(history(pool, stream(plan.seed, "feedback-weeks", number)))
    results = _results(pool, lived, plan=plan, quick=quick)
    write_page(out / "feedback.md", "feedback", results)
    return results


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """One simulation of twenty weeks."""

    before: Judged
    by_labelled: dict[int, tuple[float, int, Judged]]
    """Threshold, sheets printed by then, and its rates, for each of ``LABELLED`` that was reached."""
    alone: dict[int, tuple[float, int, Judged]]
    """The same at the same moments, by the confirmed false alarms alone."""
    naive: list[tuple[float, Judged]]
    """Threshold and rates after each week, from the false alarms of that week at the threshold then in force."""
    every: tuple[float, Judged]
    """Threshold and rates if every good print of those days were labelled, each design once: a bound for any sample."""
    missed: tuple[float, float, float, float]
    """True number of misprints that passed in all weeks, the estimate, and its interval."""
    rate: tuple[float, float, float, float]
    """The same for the share of good sheets that alarmed."""


def history(pool: Pool, rng: np.random.Generator) -> History:
    """Draw days and reviewed sheets once, and judge on days of the pool that take no part in the calibration."""
    days = rng.permutation(np.unique(pool.day))
    lives, judges = days[: len(days) // 2], days[len(days) // 2 :]
    judge = _judge(pool, np.isin(pool.day, judges))
    drawn = np.concatenate([_sheets(pool, rng.choice(lives), rng) for _ in range(WEEKS * DAYS_A_WEEK)])
    score, good = pool.score[drawn], pool.good[drawn]
    alarm = score > pool.threshold
    reviewed = alarm | (rng.random(drawn.size) < SAMPLE)
    sampled = np.cumsum(reviewed & ~alarm & good)
    by_labelled, alone = {}, {}
    for labelled in LABELLED:
        if sampled[-1] < labelled:
            continue
        upto = int(np.searchsorted(sampled, labelled)) + 1
        by_labelled[labelled] = _recalibrated(
            pool, score[:upto], (reviewed & good)[:upto], alarm[:upto], judge
        )
        confirmed = score[:upto][alarm[:upto] & good[:upto]]
        threshold = _by_count(confirmed) if confirmed.size else pool.threshold
        alone[labelled] = (threshold, upto, judge(threshold))
    counts = SampleCounts(
        alarms=int(alarm.sum()),
        alarms_good=int((alarm & good).sum()),
        alarms_misprints=int((alarm & ~good).sum()),
        passed=int((~alarm).sum()),
        passed_good=int((reviewed & ~alarm & good).sum()),
        passed_misprints=int((reviewed & ~alarm & ~good).sum()),
    )
    missed, rate = counts.missed, counts.false_alarms
    assert missed is not None
    assert rate is not None
    return History(
        before=judge(pool.threshold),
        by_labelled=by_labelled,
        alone=alone,
        naive=_naive(pool, score, good, judge),
        every=_every(pool.score[np.isin(pool.day, lives) & pool.good], judge),
        missed=(float((~alarm & ~good).sum()), missed.value, missed.low, missed.high),
        rate=(float(alarm[good].mean()), rate.value, rate.low, rate.high),
    )


def _judge(pool: Pool, here: NDArray[np.bool_]) -> Callable[[float], Judged]:
    good, wrong = pool.score[here & pool.good], pool.score[here & ~pool.good]
    return lambda threshold: Judged(
        realised=float((good > threshold).mean()), caught=float((wrong > threshold).mean())
    )


def _sheets(pool: Pool, day: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Draw a day's sheets: its good prints repeatedly, and misprints of that day at their rate."""
    here = pool.day == day
    good, wrong = np.flatnonzero(here & pool.good), np.flatnonzero(here & ~pool.good)
    drawn = rng.choice(good, SHEETS_A_DAY)
    bad = rng.random(SHEETS_A_DAY) < MISPRINT_RATE
    if wrong.size:
        drawn[bad] = rng.choice(wrong, int(bad.sum()))
    return drawn


def _recalibrated(
    pool: Pool,
    score: NDArray[np.float64],
    labelled: NDArray[np.bool_],
    alarm: NDArray[np.bool_],
    judge: Callable[[float], Judged],
) -> tuple[float, int, Judged]:
    """Recalibrate as `press recalibrate` does, with every question answered."""
    which = np.flatnonzero(labelled)
    passed = ~alarm[which]
    pages = LabelledPages(
        score=score[which],
        weight=np.where(passed, 1 / SAMPLE, 1.0),
        run=np.ones(which.size, np.int64),
        sheet=which,
        passed=passed,
        rate=TARGET_RATE,
        passed_weight=1 / SAMPLE,
        alarms_from=pool.threshold,
        replaces="",
    )
    return pages.threshold, score.size, judge(pages.threshold)


def _every(score: NDArray[np.float64], judge: Callable[[float], Judged]) -> tuple[float, Judged]:
    threshold = _by_count(score)
    return threshold, judge(threshold)


def _by_count(score: NDArray[np.float64]) -> float:
    """Return the split-conformal threshold, all weights equal.

    With too few scores it is that of the lowest rate that they can support.
    """
    rate = max(TARGET_RATE, 1 / (score.size + 1))
    return conformal_threshold(score, np.arange(score.size), false_alarm_rate=rate)


def _naive(
    pool: Pool, score: NDArray[np.float64], good: NDArray[np.bool_], judge: Callable[[float], Judged]
) -> list[tuple[float, Judged]]:
    """Return the split-conformal threshold after each week, from that week's confirmed false alarms alone.

    With too few of them the threshold stays.
    """
    threshold, thresholds = pool.threshold, []
    for week in range(WEEKS):
        at = slice(week * DAYS_A_WEEK * SHEETS_A_DAY, (week + 1) * DAYS_A_WEEK * SHEETS_A_DAY)
        confirmed = score[at][good[at] & (score[at] > threshold)]
        try:
            each = np.arange(confirmed.size)
            threshold = conformal_threshold(confirmed, each, false_alarm_rate=TARGET_RATE)
        except ValueError:
            pass  # as who calibrates by hand: wait for more alarms
        thresholds.append((threshold, judge(threshold)))
    return thresholds


def _results(pool: Pool, lived: list[History], *, plan: PoolPlan, quick: bool) -> FeedbackResults:
    rows = [_row("as trained", None, [(pool.threshold, 0, one.before) for one in lived])]
    for labelled in LABELLED:
        reached = [one.by_labelled[labelled] for one in lived if labelled in one.by_labelled]
        if reached:
            rows.append(_row("sample and alarms, weighted", labelled, reached))
    rows.append(_row("all good prints labelled", None, [(one.every[0], 0, one.every[1]) for one in lived]))
    for labelled in LABELLED:
        if came := [one.alone[labelled] for one in lived if labelled in one.alone]:
            rows.append(_row("labels of alarms only", None, came))
    for week in (1, WEEKS):
        of_week = [(*one.naive[week - 1], week) for one in lived]
        sheets = week * DAYS_A_WEEK * SHEETS_A_DAY
        way = f"alarms of one week only, after week {week}"
        rows.append(_row(way, None, [(threshold, sheets, judged) for threshold, judged, _ in of_week]))
    missed, rate = (np.array([getattr(one, name) for one in lived]) for name in ("missed", "rate"))
    return FeedbackResults(
        seed=plan.seed,
        quick=quick,
        promised=TARGET_RATE,
        times=TIMES,
        black_of_four=BLACK_OF_FOUR,
        pool_good=int(pool.good.sum()),
        pool_misprints=int((~pool.good).sum()),
        pool_days=int(np.unique(pool.day).size),
        minutes=pool.minutes,
        weeks=WEEKS,
        days_a_week=DAYS_A_WEEK,
        sheets_a_day=SHEETS_A_DAY,
        sample=SAMPLE,
        misprint_rate=MISPRINT_RATE,
        histories=len(lived),
        goal_told=GOAL_LABELLED,
        goal_factor=GOAL_FACTOR,
        taught=pool.guarantee,
        rows=rows,
        goal=[row for row in rows if row.told][-1] if any(row.told for row in rows) else rows[0],
        alone=[row for row in rows if row.way == "labels of alarms only"][-1],
        refused_below=_least(),
        missed_covered=_covered(missed),
        missed_true=float(missed[:, 0].mean()),
        missed_estimate=float(missed[:, 1].mean()),
        rate_covered=_covered(rate),
    )


def _row(way: str, labelled: int | None, outcomes: list[tuple[float, int, Judged]]) -> Row:
    realised = np.array([judged.realised for _, _, judged in outcomes])
    low, high = np.quantile(realised, [(1 - MIDDLE) / 2, (1 + MIDDLE) / 2])
    ratio = realised / TARGET_RATE
    return Row(
        way=way,
        told=labelled,
        sheets=float(np.mean([sheets for _, sheets, _ in outcomes])),
        threshold=float(np.median([threshold for threshold, _, _ in outcomes])),
        realised=float(realised.mean()),
        low=float(low),
        high=float(high),
        within=float(((ratio >= 1 / GOAL_FACTOR) & (ratio <= GOAL_FACTOR)).mean()),
        caught=float(np.mean([judged.caught for _, _, judged in outcomes])),
        histories=len(outcomes),
    )


def _covered(rows: NDArray[Any]) -> float:
    return float(((rows[:, 2] <= rows[:, 0]) & (rows[:, 0] <= rows[:, 3])).mean())


def _least() -> int:
    """Return the least number of sampled good pages that the product accepts; it refuses one fewer."""
    count = 1
    while True:
        pages = LabelledPages(
            score=np.arange(float(count)),
            weight=np.full(count, 1 / SAMPLE),
            run=np.ones(count, np.int64),
            sheet=np.arange(count),
            passed=np.ones(count, bool),
            rate=TARGET_RATE,
            passed_weight=1 / SAMPLE,
            alarms_from=float(count),
            replaces="",
        )
        try:
            _ = pages.threshold
        except RequestError as error:
            count += max(pages.missing, 1)
            if count > 1e6:
                raise RuntimeError("no count supports the rate") from error
            continue
        return count
