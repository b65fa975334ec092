import json
from dataclasses import asdict

import pytest

from prooflight.deciding.verdict import Region, Verdict


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
