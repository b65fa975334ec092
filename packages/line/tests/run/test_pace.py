"""Whether inspection keeps pace: an alarm of the run, once when it begins and once when it is over."""

from __future__ import annotations

import pytest
from packages.line.tests.run.test_incidents import GOOD, record

from prooflight.detectors.verdict import Verdict
from prooflight_line.run.pace import ALARM_FROM, OUT_OF_TIME, RECENT, Pace, overload


def slow(reason: str) -> Verdict:
    return Verdict.skipped("p0001", reason)


@pytest.mark.parametrize("reason", sorted(OUT_OF_TIME))
def test_it_is_said_once_when_it_begins_and_once_when_it_is_over(reason: str) -> None:
    pace = Pace()
    said = [pace.add(record(sheet, slow(reason))) for sheet in range(89)]
    [first] = [notice for notice in said if notice is not None]
    assert first is said[ALARM_FROM - 1]
    assert first.kind == "overloaded"
    assert first.text.startswith(
        f"inspection cannot keep up: {ALARM_FROM} of the last {ALARM_FROM} sheets not inspected"
    )
    for help_ in ("slower", "designs were not ready", "job prepare"):
        assert help_ in first.text
    assert pace.overloaded
    after = [pace.add(record(sheet, GOOD)) for sheet in range(89, 89 + RECENT)]
    assert [notice.kind for notice in after if notice is not None] == ["in-time"]
    assert after[-1] is not None
    assert not pace.overloaded


def test_what_is_not_inspected_for_another_reason_is_no_overload() -> None:
    records = [record(sheet, slow("the camera lost 300 lines of it")) for sheet in range(50)]
    pace = Pace()
    assert [pace.add(one) for one in records] == [None] * 50
    assert overload(records) is None


def test_the_last_hundred_sheets_count() -> None:
    late = [record(sheet, slow("too many sheets were waiting for inspection")) for sheet in range(89)]
    good = [record(sheet, GOOD) for sheet in range(89, 100)]
    assert overload(late + good) == (89, 100)
    assert overload([record(sheet, GOOD) for sheet in range(60)] + late[:40]) == (40, 100)
    assert overload(late[: ALARM_FROM - 1]) is None
