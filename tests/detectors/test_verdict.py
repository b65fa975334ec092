import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from prooflight.detectors.cost import RunningCosts
from prooflight.detectors.verdict import Decision, Region, Verdict

INFINITE = (np.nan, np.inf, -np.inf)


def test_a_verdict_says_everything_in_json() -> None:
    region = Region(x_mm=1.5, y_mm=2.0, width_mm=3.0, height_mm=4.0, score=9.5, kind="streak")
    verdict = Verdict(page="p0007", verdict="misprint", action="stop", regions=(region,), kind="streak")
    read = json.loads(json.dumps(asdict(verdict), allow_nan=False))
    assert read["page"] == "p0007"
    assert read["regions"] == [
        {"x_mm": 1.5, "y_mm": 2.0, "width_mm": 3.0, "height_mm": 4.0, "score": 9.5, "kind": "streak"}
    ]
    # the names that other tools rely on
    contract = "page verdict action probability score threshold p_value kind regions shift_mm milliseconds"
    assert set(contract.split()) <= set(read)


def test_a_verdict_does_not_change_after_it_was_given() -> None:
    verdict = Verdict(page="p", verdict="good", action="accept")
    with pytest.raises(AttributeError):
        verdict.action = "stop"  # type: ignore[misc]


@pytest.mark.parametrize("value", INFINITE)
@pytest.mark.parametrize("name", ["score", "threshold", "p_value", "probability"])
@pytest.mark.parametrize("misprint", [True, False])
def test_a_number_that_is_not_finite_decides_nothing(name: str, value: float, misprint: bool) -> None:
    sound = Decision(misprint=misprint, score=2.0, threshold=3.0, p_value=0.5, probability=0.01)
    decision = replace(sound, **{name: value})
    assert decision.word == "not-inspected"
    verdict = Verdict.from_decision("p0001", decision, costs=RunningCosts(), kind="streak", detector="ours")
    assert (verdict.verdict, verdict.action, verdict.detector) == ("not-inspected", "accept", "ours")
    assert name.replace("_", "-") in verdict.reason
    json.dumps(asdict(verdict), allow_nan=False)


@pytest.mark.parametrize("value", INFINITE)
def test_no_verdict_whoever_makes_it_is_good_by_such_a_number(value: float) -> None:
    verdict = Verdict(page="p0001", verdict="good", action="accept", score=value, threshold=1.0)
    assert (verdict.verdict, verdict.score, verdict.threshold) == ("not-inspected", None, None)
    assert "score is not a finite number" in verdict.reason
    good = Verdict(page="p0001", verdict="good", action="accept", score=0.5, threshold=1.0)
    assert replace(good, threshold=value).verdict == "not-inspected"


def test_a_misprint_stops_the_press_where_that_pays_or_where_it_is_sure() -> None:
    decision = Decision(misprint=True, score=2.0, threshold=1.0, p_value=None, probability=0.01)
    dear = RunningCosts(false_alarm_cents=1.0, missed_misprint_cents=1.0)
    actions = [
        Verdict.from_decision("p", decision, costs=dear).action,
        Verdict.from_decision("p", decision, costs=dear, surely=True).action,
        Verdict.from_decision("p", replace(decision, probability=None)).action,
    ]
    assert actions == ["accept", "stop", "stop"]
