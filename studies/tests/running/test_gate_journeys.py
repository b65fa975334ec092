"""The controller that was written from the registers' page alone, and the counts that a browser shows beside it."""

from __future__ import annotations

import io
import json
import time
from pathlib import Path
from typing import Any

import pytest

from prooflight_line.plant.gate.registers import MAP_ID, Result, packed, unpacked_of_plc
from prooflight_studies.gate import independent_plc
from prooflight_studies.gate.independent_plc import Controller
from prooflight_studies.gate.journeys import CHROMIUM, journeys

SHEET = {"serial": 1, "front_mm": 0.0, "slip_mm": 0.0, "under": 0}
FIRST, DISTANCE_MM = 2**32 - 100, 1000.0
AT_GATE = (FIRST + 10_000) % 2**32
RESULT = {
    "status": 0b111, "heartbeat": 1, "session": 9, "policy": 0, "fault": 0, "sheet_at_camera": 1,
    "result_number": 1, "tag": 70_000, "result": int(Result.ACCEPT), "code": 1, "position": AT_GATE, "tolerance": 400,
}  # fmt: skip


def controller(log: io.StringIO, **belt: Any) -> Controller:
    given = {
        "began_s": time.monotonic(),
        "speed_mm_s": 1e-3,
        "distance_mm": DISTANCE_MM,
        "first_count": FIRST,
        "watchdog_s": 0.5,
    }
    return Controller({**given, "sheets": [SHEET], "faults": [], **belt}, log)


def sorted_after(told: list[dict[str, int]], **belt: Any) -> tuple[dict[str, Any], Controller]:
    """The sheet's row, when the controller has scanned each of these states of what Prooflight writes."""
    log = io.StringIO()
    made = controller(log, **belt)
    for words in told:
        made.written = packed(words)
        made.scan()
    made._belt["began_s"] -= 2 * DISTANCE_MM / made._belt["speed_mm_s"]
    made.scan()
    return json.loads(log.getvalue()), made


def test_it_imports_nothing_of_what_it_checks() -> None:
    assert "import prooflight" not in (text := Path(independent_plc.__file__).read_text())
    assert "from prooflight" not in text


def test_a_result_within_its_tolerance_opens_the_gate_and_is_shown_by_the_register_map() -> None:
    row, made = sorted_after([RESULT])
    assert (row["tray"], row["tag"], row["session"], row["count"]) == ("good", 70_000, 9, AT_GATE)
    shown = unpacked_of_plc(made.shown())
    assert (shown["map_id"], shown["session_taken"], shown["result_taken"]) == (MAP_ID, 9, 1)
    assert (shown["last_tag"], shown["last_tray"], shown["in_good"], shown["in_reject"]) == (70_000, 1, 1, 0)
    assert shown["sheets_at_gate"] == 1


@pytest.mark.parametrize(
    "told",
    [
        [],
        [RESULT | {"result": int(Result.DIVERT)}],
        [RESULT | {"position": AT_GATE + 401}],
        [RESULT | {"status": 0b1}],
        [RESULT, RESULT | {"heartbeat": 2, "result_number": 2, "tag": 3}],
        [RESULT, RESULT | {"heartbeat": 2, "session": 10, "status": 0b1}],
    ],
    ids=["nothing", "divert", "another place", "no result", "two results", "another session"],
)
def test_whatever_is_no_single_result_of_this_session_for_this_place_is_rejected(
    told: list[dict[str, int]],
) -> None:
    assert sorted_after(told)[0]["tray"] == "reject"


def test_what_was_told_is_forgotten_where_the_heartbeat_stands_still_or_the_power_goes() -> None:
    log = io.StringIO()
    made = controller(log)
    made.written = packed(RESULT)
    made.scan()
    made.memory.heard_s -= 1
    made.scan()
    assert (made.memory.session_taken, made.memory.store) == (0, [])
    made.written = packed(RESULT | {"heartbeat": 2})
    made.scan()
    assert made.memory.session_taken == 0  # the session that was dropped is not taken again
    made._belt["faults"] = [{"kind": "power", "at_s": time.monotonic(), "lasts_s": 1e9}]
    made.scan()
    assert made.written == [0] * 15


def test_every_count_is_that_of_the_trays_in_a_run_with_faults(tmp_path: Path) -> None:
    pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    if not CHROMIUM.exists():
        pytest.skip(f"no {CHROMIUM}: apt install chromium")
    rows = list(journeys(tmp_path, seeds=[3], sheets=40, progress=lambda _text: None))
    assert [row["killed"] for row in rows] == [True, False]
    assert [line for row in rows for line in row["differs"]] == []
    assert all(row["needed"] == 40 for row in rows)
    assert sum(row["vouched"] for row in rows)
