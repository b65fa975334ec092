"""Everything that counts sheets to print again counts the same, to the sheet, in runs in which much goes wrong."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from prooflight.cli import run
from prooflight_line.journal.journal import Journal
from prooflight_studies.gate.counts import Console, Press, collected, play_one

if TYPE_CHECKING:
    from pathlib import Path

SHEETS = 60


@pytest.mark.parametrize("seed", [0, 1])
def test_console_commands_and_trays_agree_to_the_sheet(
    seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the first the inspection is killed, and begins anew."""
    found, starts = play_one(tmp_path, seed=seed, sheets=SHEETS, failures=2)
    assert found == []
    assert [start.killed for start in starts] == ([True, False] if seed == 0 else [False])
    journal, trays = str(tmp_path / "runs.sqlite"), str(tmp_path / "trays.jsonl")
    for start in starts:
        assert start.good
        assert start.lacking
        given = [str(start.run), "--journal", journal, "--trays", trays, "--json"]
        assert run(["run", "reprint-list", *given]) == 0
        listed = json.loads(capsys.readouterr().out)
        assert [one["run_sheet"] for one in listed["reprints"]] == start.lacking
        run(["run", "reconcile", *given])
        reconciled = json.loads(capsys.readouterr().out)
        assert reconciled["to_print_again"] == listed["count"] == len(start.lacking)
        assert reconciled["counts"]["accepted"] == len(start.good)
        assert reconciled["trays_from"] == "file"


def test_without_the_controllers_log_no_sheet_is_forgotten_and_a_vouched_one_leaves_every_list(
    tmp_path: Path,
) -> None:
    _, starts = play_one(tmp_path, seed=2, sheets=SHEETS, failures=3)
    (start,) = starts
    journal, trays = tmp_path / "runs.sqlite", tmp_path / "trays.jsonl"
    assert set(collected(journal, start.run, None).listed) >= set(start.lacking)
    console = Console(journal, trays)
    listed = console.get(f"/runs/{start.run}/reprint")["sheets"]
    sheet = next(one["sheet"] for one in listed if one["sheet"] is not None and one["why"] == "a misprint")
    label = {"label": "false-alarm"}
    incident = next(one["incident"] for one in listed if one["sheet"] == sheet)
    console.client.post(
        f"/api/v1/runs/{start.run}/incidents/{incident}/labels", json=label
    ).raise_for_status()
    assert collected(journal, start.run, trays).counts == {len(start.lacking)}
    vouched = {"reason": "seen at the reject tray"}
    console.client.post(f"/api/v1/runs/{start.run}/sheets/{sheet}/release", json=vouched).raise_for_status()
    assert collected(journal, start.run, trays).counts == {len(start.lacking) - 1}
    console.close()


def test_while_the_run_goes_on_what_is_rejected_is_listed_and_what_is_delivered_is_not(
    tmp_path: Path,
) -> None:
    press = Press(tmp_path, seed=4, sheets=SHEETS)
    with Journal.open(str(press.journal)) as opened:
        walk = press.play(opened, killed=False, failures=1)
        played = next(walk)
        listed = set(collected(press.journal, played.run, press.trays).listed)
        at_gate = {played.pages[row.serial] for row in press.plc.rows if row.serial in played.pages}
        assert played.good
        assert at_gate - played.good
        assert listed & at_gate == at_gate - played.good
        walk.close()
        press.close()
