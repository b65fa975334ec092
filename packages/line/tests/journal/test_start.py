"""How far a start has got is written beside the journal, and read only while whoever starts is alive."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from prooflight_line.journal.start import MOST_AGE_S, Start, StartFile


@pytest.fixture
def start_file(tmp_path: Path) -> StartFile:
    return StartFile(journal=tmp_path / "new" / "runs.sqlite")


def test_a_stage_is_read_as_it_was_written_until_it_is_over(start_file: StartFile) -> None:
    assert start_file.read() is None
    start = Start(stage="print", done=3, total=12, left_s=41.5)
    start_file.write(start)
    assert start_file.read() == start
    start_file.clear()
    start_file.clear()
    assert start_file.read() is None


def test_the_time_left_is_that_of_the_speed_so_far(tmp_path: Path) -> None:
    now_s, shown = [0.0], []
    start_file = StartFile(journal=tmp_path / "runs.sqlite", clock=lambda: now_s[0])
    for _ in start_file.noted(range(4), total=4, stage="press"):
        now_s[0] += 10.0
        shown.append(start_file.read())
    assert shown == [
        Start(stage="press", total=4),
        Start(stage="press", done=1, total=4, left_s=30.0),
        Start(stage="press", done=2, total=4, left_s=20.0),
        Start(stage="press", done=3, total=4, left_s=10.0),
    ]


@pytest.mark.parametrize(
    "facts",
    [
        {"pid": 2**22 + 1},
        {"pid": "x"},
        {"stage": "lunch"},
        {"done": -1},
        {"total": "many"},
        {"more": 1},
        {"left_s": float("nan")},
    ],
)
def test_a_file_of_a_dead_process_or_another_form_is_none(
    start_file: StartFile, facts: dict[str, object]
) -> None:
    start_file.write(Start(stage="job"))
    whole = json.loads(start_file.path.read_text())
    start_file.path.write_text(json.dumps(whole | facts))
    assert start_file.read() is None


def test_an_old_file_is_nothing(start_file: StartFile) -> None:
    start_file.write(Start(stage="job"))
    old_s = start_file.path.stat().st_mtime - 2 * MOST_AGE_S
    os.utime(start_file.path, (old_s, old_s))
    assert start_file.read() is None


def test_a_folder_that_cannot_be_written_is_no_reason_not_to_start(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    StartFile(journal=tmp_path / "file" / "runs.sqlite").write(Start(stage="job"))
