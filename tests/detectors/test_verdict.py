import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from prooflight.detectors.cost import RunningCosts
from prooflight.detectors.disposition import without_gate
from prooflight.detectors.verdict import Decision, Region, Verdict

INFINITE = (np.nan, np.inf, -np.inf)


def test_a_verdict_says_everything_in_json() -> None:
    region = Region(x_mm=1.5, y_mm=2.0, width_mm=3.0, height_mm=4.0, score=9.5, kind="streak")
    verdict = Verdict(page="p0007", verdict="misprint", regions=(region,), kind="streak")
    read = json.loads(json.dumps(asdict(verdict), allow_nan=False))
    assert read["page"] == "p0007"
    place = {"x_mm": 1.5, "y_mm": 2.0, "width_mm": 3.0, "height_mm": 4.0}
    amount = {"ink": "", "darker_percent": None, "above_good_sd": None}
    assert read["regions"] == [{**place, "score": 9.5, "kind": "streak", **amount}]
    # the names that other tools rely on
    contract = "page verdict probability score threshold p_value kind regions shift_mm milliseconds"
    assert set(contract.split()) <= set(read)


def test_a_verdict_does_not_change_after_it_was_given() -> None:
    verdict = Verdict(page="p", verdict="good")
    with pytest.raises(AttributeError):
        verdict.verdict = "misprint"  # type: ignore[misc]


@pytest.mark.parametrize("value", INFINITE)
@pytest.mark.parametrize("name", ["score", "threshold", "p_value", "probability"])
@pytest.mark.parametrize("misprint", [True, False])
def test_a_number_that_is_not_finite_decides_nothing(name: str, value: float, misprint: bool) -> None:
    sound = Decision(misprint=misprint, score=2.0, threshold=3.0, p_value=0.5, probability=0.01)
    decision = replace(sound, **{name: value})
    assert decision.verdict_name == "not-inspected"
    verdict = Verdict.from_decision(
        "p0001", decision, costs=RunningCosts(), kind="streak", detector="matched_filter"
    )
    assert (verdict.verdict, without_gate(verdict)[0], verdict.detector) == (
        "not-inspected",
        "hold",
        "matched_filter",
    )
    assert name.replace("_", "-") in verdict.reason
    json.dumps(asdict(verdict), allow_nan=False)


@pytest.mark.parametrize("value", INFINITE)
def test_no_verdict_whoever_makes_it_is_good_by_such_a_number(value: float) -> None:
    verdict = Verdict(page="p0001", verdict="good", score=value, threshold=1.0)
    assert (verdict.verdict, verdict.score, verdict.threshold) == ("not-inspected", None, None)
    assert "score is not a finite number" in verdict.reason
    good = Verdict(page="p0001", verdict="good", score=0.5, threshold=1.0)
    assert replace(good, threshold=value).verdict == "not-inspected"


def test_a_misprint_stops_the_press_where_that_pays_or_where_it_is_sure() -> None:
    decision = Decision(misprint=True, score=2.0, threshold=1.0, p_value=None, probability=0.01)
    dear = RunningCosts(false_alarm_cents=1.0, missed_misprint_cents=1.0)
    found = [
        without_gate(Verdict.from_decision("p", decision, costs=dear)),
        without_gate(Verdict.from_decision("p", decision, costs=dear, always_stop=True)),
        without_gate(Verdict.from_decision("p", replace(decision, probability=None))),
    ]
    assert found == [("accept", "costs"), ("stop", "default"), ("stop", "default")]


@pytest.mark.parametrize(("misprint", "word"), [(False, "good"), (True, "misprint")])
def test_a_verdict_says_what_was_decided(misprint: bool, word: str) -> None:
    decision = Decision(misprint=misprint, score=2.0, threshold=1.5, p_value=0.25, probability=0.5)
    assert decision.verdict_name == word
    verdict = Verdict.from_decision("p0001", decision, costs=RunningCosts(), kind="streak", milliseconds=7.0)
    assert asdict(verdict) == asdict(
        Verdict(
            page="p0001",
            verdict=word,  # type: ignore[arg-type]
            probability=0.5,
            score=2.0,
            threshold=1.5,
            p_value=0.25,
            kind="streak",
            milliseconds=7.0,
            expected_cost={"accept": 0.05, "stop": 0.005},
        )
    )


def test_a_good_page_is_accepted_however_sure_a_misprint_would_be() -> None:
    decision = Decision(misprint=False, score=0.0, threshold=1.0, p_value=None, probability=0.9)
    verdict = Verdict.from_decision("p", decision, costs=RunningCosts(), always_stop=True)
    assert without_gate(verdict) == ("accept", "default")


def test_a_misprint_that_is_sure_without_numbers_stays_one() -> None:
    told = Verdict(page="p0001", verdict="misprint", score=np.nan, reason="it lies far off")
    assert (told.verdict, without_gate(told)[0], told.reason) == ("misprint", "stop", "it lies far off")


def test_a_page_that_nobody_judged_is_held() -> None:
    told = Verdict.skipped("p0001", "too late")
    assert (told.verdict, without_gate(told), told.reason) == (
        "not-inspected",
        ("hold", "default"),
        "too late",
    )
    assert (told.milliseconds, told.score, told.detector) == (0.0, None, "")
