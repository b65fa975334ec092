"""Every sheet accounted for, whatever the controller's log holds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from packages.line.tests.plant.runs import FACTS

from prooflight.detectors.verdict import Verdict
from prooflight.errors import RequestError
from prooflight_line.cli.watch.running import recorder_of
from prooflight_line.journal.records import PageRecord
from prooflight_line.plant.gate.log import GateLog, LoggedDecisions, PlantError, log_path
from prooflight_line.plant.gate.reconciling import Tray, of_run, read_trays, reconciled

SETTINGS = {"tolerance_mm": 40.0, "policy": "reject", "plc": {"counts_per_mm": 10.0}}
SESSION = 5


def kept(*results: int, codes: tuple[int, ...] = (), places: bool = True, **began: Any) -> LoggedDecisions:
    """Sheets every 3000 counts; results 1 accept, 2 divert."""
    found = LoggedDecisions(began={"settings": SETTINGS | began}, sessions=[SESSION])
    for at, result in enumerate(results):
        found.decisions[at + 1] = {
            "tag": at + 1,
            "result": result,
            "code": codes[at] if codes else (1 if result == 1 else 2),
            "came": True,
            "job_page": at,
            "page": f"p{at}",
            "set": at,
            "position": 3000 * at if places else None,
        }
        if places:
            found.places[at + 1] = [3000 * at]
    return found


def page(sheet: int, verdict: str = "good") -> PageRecord:
    found = Verdict(page=f"p{sheet}", verdict=verdict)  # type: ignore[arg-type]
    return PageRecord(sheet=sheet, job_page=sheet, verdict=found, late=False, first_line=0, time_s=0.0)


def tray(tag: int, where: str, *, at: int | None = None, session: int = SESSION, why: str = "") -> Tray:
    """at: the encoder's count; None: where the sheet was expected."""
    return Tray(session=session, tag=tag, tray=where, count=3000 * (tag - 1) if at is None else at, why=why)


def accounts(*given: Any) -> list[str]:
    return [one.account for one in reconciled(*given).sheets]


def test_each_goes_where_it_was_sent() -> None:
    pages = [page(0), page(1, "misprint")]
    assert accounts(pages, kept(1, 2), [tray(1, "good"), tray(2, "reject")]) == ["accepted", "diverted"]


def test_a_misprint_in_the_good_tray_is_wrong_whoever_put_it_there() -> None:
    pages = [page(0, "misprint")]
    for result in (1, 2):
        assert accounts(pages, kept(result), [tray(1, "good")]) == ["wrong"]


def test_a_sheet_that_the_run_does_not_know_is_unseen_or_wrong() -> None:
    where = [tray(0, "reject", at=900_000), tray(1, "good")]
    assert sorted(accounts([page(0)], kept(1), where)) == ["accepted", "unseen"]
    where = [tray(0, "good", at=900_000), tray(1, "good")]
    assert sorted(accounts([page(0)], kept(1), where)) == ["accepted", "wrong"]
    assert sorted(accounts([page(0)], kept(1, policy="accept"), where)) == ["accepted", "unseen"]


def test_a_row_without_a_tag_is_of_the_sheet_that_was_expected_there() -> None:
    where = [
        tray(1, "good"),
        tray(0, "reject", at=3210, why="no signal from Prooflight"),
        tray(3, "good", at=6000),
    ]
    found = reconciled([page(0), page(1), page(2)], kept(1, 1, 1), where)
    assert [one.account for one in found.sheets] == ["accepted", "lost", "accepted"]
    assert found.lost_by == {"no signal from Prooflight": 1}


def test_sheets_between_two_that_are_known_are_counted_where_all_went_one_way() -> None:
    where = [tray(1, "good"), tray(0, "reject", at=7), tray(0, "reject", at=9), tray(4, "good", at=5)]
    log = kept(1, 1, 2, 1, places=False)
    found = reconciled([page(n) for n in range(4)], log, where)
    assert [one.account for one in found.sheets] == ["accepted", "lost", "diverted", "accepted"]
    mixed = [where[0], tray(0, "good", at=7), *where[2:]]
    found = reconciled([page(n) for n in range(4)], log, mixed)
    assert len(found.open) == 2
    assert len(found.wrong) == 1


def test_how_far_off_their_places_sheets_reached_the_gate() -> None:
    log = kept(1, 1)
    for tag, position in ((1, 3000), (2, 4_294_967_290)):
        log._add({"kind": "written", "tag": tag, "position": position})
    where = [tray(1, "good", at=3025), tray(2, "good", at=4), tray(0, "reject", at=90_000)]
    assert reconciled([page(0), page(1)], log, where).off_mm == (2.5, 1.0)


def test_what_sticks_below_a_good_sheet_in_the_good_tray_is_wrong() -> None:
    assert accounts([page(0)], kept(1), [tray(1, "good"), tray(1, "good")]) == ["accepted", "wrong"]


def test_a_sheet_killed_before_the_journal_had_it_is_known_by_the_gate_s_log() -> None:
    (one,) = reconciled([], kept(1), [tray(1, "good")]).sheets
    assert (one.account, one.in_journal) == ("accepted", False)


def test_a_sheet_that_nobody_saw_at_the_gate_is_open() -> None:
    found = reconciled([page(0), page(1)], kept(1, 1), [tray(1, "good")])
    assert [one.sheet for one in found.open] == [1]


def test_without_the_controller_s_log_what_it_said_over_the_wire_counts() -> None:
    log = kept(1, 1)
    log.trays[1] = {"tag": 1, "tray": "good", "session": SESSION}
    assert accounts([page(0), page(1)], log, None) == ["accepted", "not-at-gate"]


def test_rows_of_other_runs_are_left_out() -> None:
    rows = [
        tray(1, "good", session=4),
        tray(0, "reject", session=0, at=1),
        tray(1, "good"),
        tray(0, "reject", session=0, at=2),
        tray(1, "good", session=6),
    ]
    assert of_run(rows, [SESSION]) == rows[2:4]
    assert of_run(rows, [4]) == rows[:2]
    assert of_run(rows, [9]) == []
    assert of_run(rows[1:], [SESSION]) == rows[1:4]  # the first run of a log has what came before it


def test_rows_of_another_run_with_the_same_session_number_say_nothing_of_this_one() -> None:
    """A session is a number of 16 bits: in the log of a year, each comes many times."""
    log = kept(1, 1, 1)
    of_another = [tray(1, "good", at=2**31), tray(2, "good", at=2**31 + 3000), tray(7, "reject", session=9)]
    rows = [tray(1, "reject"), tray(3, "good")]
    pages = [page(0), page(1), page(2)]
    assert accounts(pages, log, [*of_another, *rows]) == ["lost", "not-at-gate", "accepted"]
    assert accounts(pages, log, [*rows, *of_another]) == ["lost", "not-at-gate", "accepted"]


def test_rows_of_another_session_are_never_taken_for_sheets_of_the_run() -> None:
    log = kept(1, 1, 1, places=False)
    rows = [tray(1, "good"), tray(2, "good", session=9), tray(3, "good")]
    assert accounts([page(0), page(1), page(2)], log, rows) == ["accepted", "not-at-gate", "accepted"]


def test_a_sheet_that_came_after_the_controller_lost_its_power_is_where_its_new_count_says() -> None:
    log = kept(1)
    log._add({"kind": "written", "tag": 1, "position": 500, "session": SESSION})
    assert accounts([page(0)], log, [tray(1, "good", at=510)]) == ["accepted"]


def test_a_sheet_of_which_the_log_names_two_trays_is_contested() -> None:
    found = reconciled([page(0), page(1)], kept(1, 1), [tray(1, "good"), tray(1, "reject"), tray(2, "good")])
    assert [one.contested for one in found.sheets if one.sheet is not None] == [True, False]


def test_logs_are_json_lines_or_csv(tmp_path: Path) -> None:
    wanted = [Tray(session=5, tag=1, tray="good", count=77)]
    lines, table = tmp_path / "trays.jsonl", tmp_path / "trays.csv"
    lines.write_text('{"session": 5, "tag": 1, "tray": "good", "count": 77, "more": 1}\n')
    table.write_text("tag,session,tray,count\n1,5,good,77\n")
    assert read_trays(lines) == wanted
    assert read_trays(table) == wanted


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("tag,session\n1,5\n", "row 1: 'tray'"),
        ("tag,session,tray,count\n1,5,left,7\n", "row 1: tray is 'left'"),
        ("tag,session,tray,count\n1,x,good,7\n", "row 1: invalid literal"),
        ('{"tag": \n', "is not JSON"),
    ],
)
def test_a_log_that_is_none_is_refused_in_one_line(text: str, what: str, tmp_path: Path) -> None:
    (tmp_path / "trays").write_text(text)
    with pytest.raises(RequestError) as refusal:
        read_trays(tmp_path / "trays")
    assert what in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_log_that_cannot_be_written_is_said_once_and_stops_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with GateLog(Path("/dev/full")) as log:
        for tag in range(3):
            log.add("written", tag=tag)
        assert log.dropped == 3
    assert [one.message for one in caplog.records] == [
        "the gate's log cannot be written (No space left on device); sheets continue to the gate"
    ]


def test_the_gate_s_log_is_read_as_it_was_written_and_a_torn_end_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite.gate" / "run000001.jsonl"
    with GateLog(path) as log:
        log.add("run", run=1, job_pages=4, settings=SETTINGS)
        log.add("session", session=5)
        log.add("written", tag=3, position=40, ms=1.5)
    path.write_text(path.read_text() + '{"kind": "tray", "ta')
    found = LoggedDecisions.read(path)
    assert found.sessions == [5]
    assert found.written[3]["ms"] == 1.5
    path.write_text(json.dumps({"kind": "written"}) + "\n")
    with pytest.raises(PlantError, match="a line lacks 'tag'"):
        LoggedDecisions.read(path)
    path.write_text(json.dumps({"kind": "decision", "tag": 1, "came": True, "result": 1, "code": 1}) + "\n")
    with pytest.raises(PlantError, match="a line lacks 'job_page'"):
        LoggedDecisions.read(path)
    path.write_text("nonsense\n{}\n")
    with pytest.raises(PlantError, match="line 1 is not JSON"):
        LoggedDecisions.read(path)
    with pytest.raises(PlantError, match="cannot be read"):
        LoggedDecisions.read(tmp_path / "none")


def test_a_log_of_a_journal_that_lay_here_before_is_put_aside_when_a_run_begins(tmp_path: Path) -> None:
    """Its sheets were accepted; those of the new run are others."""
    journal = tmp_path / "runs.sqlite"
    for _ in range(2):
        journal.unlink(missing_ok=True)
        with GateLog(log_path(journal, 1)) as log:
            log.add("run", run=1)
        with recorder_of(str(journal), FACTS) as recorder:
            assert recorder is not None
            assert recorder.run_id == 1
            assert not log_path(journal, 1).exists()
    assert len(list(log_path(journal, 1).parent.iterdir())) == 2
