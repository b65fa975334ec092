"""One store of words: what the console, its API and the command line say is the same to all of them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from packages.console.tests.consoles import served
from packages.line.tests.journal.sample_rows import facts, good, misprint

from prooflight.cli import run
from prooflight_console.accounts.roles import Role
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from packages.console.tests.consoles import Served

ALARM, PASSED = 5, 8


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Served]:
    """A run of 40 sheets: one alarm, and every eighth of the others drawn with probability 1/8."""
    made = served(tmp_path, run=False)
    with Journal.open(str(made.console.settings.journal)) as journal:
        number = journal.begin_run(facts(settings={"sample": 0.125}))
        for sheet in range(40):
            page = misprint(sheet) if sheet == ALARM else good(sheet)
            asked = 1.0 if sheet == ALARM else 0.125 if sheet % 8 == 0 else None
            journal.record(number, replace(page, asked=asked))
        journal.commit()
        yield made
    made.close()


def test_a_word_of_the_command_line_stands_in_the_console_and_the_other_way(
    console: Served, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = str(console.console.settings.journal)
    operator = console.client(Role.OPERATOR)
    assert run(["run", "mark", "1", str(PASSED), "misprint", "--by", "Mei", "--journal", journal]) == 0
    (word,) = operator.get(f"/api/v1/runs/1/sheets/{PASSED}").json()["labels"]
    assert (word["label"], word["by"]) == ("misprint", "Mei")
    answer = operator.post(f"/api/v1/runs/1/sheets/{PASSED}/labels", json={"label": "good"})
    assert answer.status_code == 201
    operator.post("/api/v1/runs/1/incidents/1/labels", json={"label": "false-alarm"})
    capsys.readouterr()
    assert run(["run", "sampled", "1", "--all", "--journal", journal]) == 0
    told = capsys.readouterr().out
    assert "labelled: 1 of the sheets that passed and 1 of 1 alarm" in told
    sample = operator.get("/api/v1/runs/1/report").json()["sample"]
    assert (sample["sampled"], sample["sampled_labelled"], sample["alarms_labelled"]) == (5, 1, 1)
    assert sample["open"] == [0, 16, 24, 32]
    assert sample["false_alarms"]["value"] == pytest.approx(1 / 40)


def test_a_sheet_that_passed_is_told_by_a_tap(console: Served) -> None:
    operator = console.client(Role.OPERATOR)
    page = operator.get(f"/runs/1/sheets/{PASSED}").text
    assert "part of the random sample" in page
    assert "does not change the threshold" in operator.get("/runs/1/sheets/9").text
    report = operator.get("/report/1").text
    assert f'href="/runs/1/sheets/{PASSED}"' in report
    assert f'src="/runs/1/sheets/{PASSED}/thumbnail"' in report
    assert 'href="/runs/1/sheets/16"' in page, "the next that is asked"
    answer = operator.post(f"/runs/1/sheets/{PASSED}/label", data={"label": "good", "note": "<b>fine</b>"})
    assert answer.status_code == 200
    assert "&lt;b&gt;fine&lt;/b&gt;" in answer.text
    assert 'aria-pressed="true"' in answer.text
    assert f'href="/runs/1/sheets/{PASSED}"' not in operator.get("/report/1").text
    assert operator.post(f"/runs/1/sheets/{PASSED}/label", data={"label": "bad"}).status_code == 409
    viewer = console.client(Role.VIEWER)
    assert viewer.post(f"/runs/1/sheets/{PASSED}/label", data={"label": "good"}).status_code == 403
