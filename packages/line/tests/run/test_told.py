"""Which sheets are asked about, and what words on them say of a run and of a press."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from packages.line.tests.journal.journals import facts, record

from prooflight.detectors.verdict import Region, Verdict
from prooflight.errors import RequestError
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import LabelStore, run_key
from prooflight_line.journal.records import PageRecord
from prooflight_line.run.labelled_sheets import counts_of, labelled_pages, replayed_run, sample_of_run
from prooflight_line.run.sheet_inspector import Sampling
from prooflight_line.run.tolerances import LEAST_SHEETS, proposals

GOOD = Verdict(page="p0001", verdict="good", score=0.5, threshold=1.0)
SPOT = Region(x_mm=50.0, y_mm=60.0, width_mm=2.0, height_mm=2.0, score=6.0, kind="spots-voids")
WRONG = Verdict(
    page="p0001",
    verdict="misprint",
    kind="spots-voids",
    score=2.0,
    threshold=1.0,
    regions=(SPOT,),
    detector="matched_filter",
)
SKIPPED = Verdict.skipped("p0001", "no time")
SAMPLE = 0.25


def asked(sheet: int, verdict: Verdict, probability: float | None) -> PageRecord:
    page = record(sheet, kept=False, verdict=replace(verdict, detector="matched_filter"))
    return replace(page, asked=probability)


def test_who_is_asked_hangs_on_seed_and_sheet_alone() -> None:
    one, again, other = (
        Sampling(sample=0.1, seed=3),
        Sampling(sample=0.1, seed=3),
        Sampling(sample=0.1, seed=4),
    )
    drawn = [one.probability(GOOD, sheet) for sheet in range(5000)]
    assert drawn[::-1] == [again.probability(GOOD, sheet) for sheet in reversed(range(5000))]
    assert drawn != [other.probability(GOOD, sheet) for sheet in range(5000)]
    assert {value for value in drawn if value is not None} == {0.1}
    count = sum(value is not None for value in drawn)
    assert abs(count - 500) < 4 * math.sqrt(5000 * 0.1 * 0.9)  # four standard deviations, seed 3


def test_every_alarm_is_asked_about_and_nothing_that_was_not_inspected() -> None:
    for sample in (0.0, 0.02, 1.0):
        asking = Sampling(sample=sample, seed=1)
        assert asking.probability(WRONG, 7) == 1.0
        assert asking.probability(SKIPPED, 7) is None
    assert Sampling().probability(GOOD, 7) is None
    assert Sampling(sample=1.0).probability(GOOD, 7) == 1.0
    with pytest.raises(ValueError, match="0 to 1"):
        Sampling(sample=1.5)


def test_words_on_a_journal_become_figures_and_pages_to_calibrate_by(tmp_path: Path) -> None:
    """400 sheets, 8 alarms in one incident told false; every fourth passed one asked about, one of these a misprint."""
    path = tmp_path / "j.sqlite"
    with Journal.open(str(path)) as journal:
        run_id = journal.begin_run(facts())
        for sheet in range(400):
            alarm = sheet < 8
            verdict = WRONG if alarm else replace(GOOD, score=sheet / 1000)
            probability = 1.0 if alarm else SAMPLE if sheet % 4 == 0 else None
            journal.record(run_id, asked(sheet, verdict, probability))
        journal.commit()
        run, words = journal.run(run_id), LabelStore(path)
        for sheet in range(8, 400, 4):
            word = "misprint" if sheet == 8 else "unknown" if sheet == 12 else "good"
            words.say(word, run=run_key(run), sheet=sheet, by="Mei", at_s=1.0)
        words.say("misprint", run=run_key(run), sheet=9, by="Mei", at_s=1.0)  # nobody asked
        words.say("false-alarm", run=run_key(run), incident="1", by="Mei", at_s=1.0)
        sheets = sample_of_run(journal, words, run)
        counts = counts_of(run, sheets)
        assert (counts.alarms, counts.alarms_good, counts.passed) == (8, 8, 392)
        assert (counts.passed_good, counts.passed_misprints) == (96, 1)
        assert counts.missed is not None
        assert counts.missed.value == pytest.approx(392 / 97)
        digest = run.facts.press_digest
        told = labelled_pages([(run, sheets)], replaces=digest, rate=0.02, now_s=1000.0)
        assert int(told.passed.sum()) == 96
        assert told.weight[told.passed] == pytest.approx(98 / 97 / SAMPLE)  # one did not know
        assert told.weight[~told.passed] == pytest.approx(1.0)
        assert told.threshold == pytest.approx(
            2.0
        )  # 8 of 400 alarm, and 2 % may: a little less than all of them
        aged = labelled_pages(
            [(run, sheets)],
            replaces=digest,
            rate=0.02,
            now_s=1000.0 + 10 * 86_400,
            half_life_days=10.0,
        )
        assert aged.weight[aged.passed] == pytest.approx(98 / 97 / SAMPLE / 2)
        replay = replayed_run(run, journal.pages(run_id), sheets, threshold=0.39)
        assert (replay.gone, len(replay.come)) == ((), 9)  # 0.391 to 0.399
        replay = replayed_run(run, journal.pages(run_id), sheets, threshold=2.0)
        assert (len(replay.gone), replay.gone_told, replay.come) == (8, {"good": 8}, ())
        with pytest.raises(RequestError, match="--sample"):
            labelled_pages([], replaces=digest, rate=0.02, now_s=1000.0)


@pytest.mark.parametrize("judged_by", ["this press", "another press", "nobody asked"])
def test_a_run_with_zones_from_before_there_was_one_scale_is_refused(tmp_path: Path, judged_by: str) -> None:
    path, old, new = tmp_path / "j.sqlite", {"zones": "d" * 64}, {"zones": "d" * 64, "zones_alone": "a" * 64}
    with Journal.open(str(path)) as journal:
        for settings in ({}, old, new):
            other = {"press_digest": "q" * 64} if settings is old and judged_by == "another press" else {}
            run_id = journal.begin_run(facts(settings=settings, **other))
            for sheet in range(5):
                sampled = None if settings is old and judged_by == "nobody asked" else SAMPLE
                journal.record(run_id, asked(sheet, GOOD, sampled))
        journal.commit()
        words = LabelStore(path)
        runs = [(run, sample_of_run(journal, words, run)) for run in journal.runs()]
        runs = [one for one in runs if one[0].facts.press_digest == facts().press_digest]
    how = {"replaces": facts().press_digest, "rate": 0.02, "now_s": 1000.0}
    if judged_by == "this press":
        with pytest.raises(
            RequestError, match=r"^run 2: .*older Prooflight.*; calibrate by runs watched since"
        ):
            labelled_pages(runs, **how)
    else:
        assert labelled_pages(runs, **how).zones == ("", "a" * 64)


def test_a_false_alarm_that_comes_again_is_proposed_with_its_price(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    with Journal.open(str(path)) as journal:
        run_id = journal.begin_run(facts())
        weak, strong = replace(SPOT, score=4.0), replace(SPOT, score=9.0)
        told: list[tuple[Region, str]] = [(SPOT, "good")] * LEAST_SHEETS
        told += [(weak, "misprint"), (strong, "misprint"), (weak, "")]
        for sheet, (region, _) in enumerate(told):
            journal.record(run_id, asked(sheet, replace(WRONG, regions=(region,)), 1.0))
        journal.commit()
        run, words = journal.run(run_id), LabelStore(path)
        for sheet, (_, word) in enumerate(told):
            if word:
                words.say(word, run=run_key(run), sheet=sheet, by="Mei", at_s=1.0)
        (found,) = proposals(journal, words, [run])
        assert (found.kind, found.sheets, found.up_to_score) == ("spots-voids", LEAST_SHEETS, 6.0)
        assert found.box_mm == (50.0, 60.0, 2.0, 2.0)
        assert (found.misprints_lost, found.misprints_kept, found.untold) == (1, 1, 1)
        words.say("misprint", run=run_key(run), sheet=0, by="Jan", at_s=2.0)  # one fewer: too few
        assert proposals(journal, words, [run]) == []
