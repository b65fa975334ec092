"""What no row can hold is set aside and told; all else is recorded, and what is not recorded is counted."""

from __future__ import annotations

import errno
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from packages.line.tests.journal.journals import facts, files_of, limit, record

from prooflight.detectors.verdict import Region, Verdict
from prooflight_line.journal import packs, rows
from prooflight_line.journal.aside import aside_file
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, RunEnd
from prooflight_line.journal.schema import JournalError
from prooflight_line.run import recording
from prooflight_line.run.recording import Recorder
from prooflight_line.run.status import Phase, Tally

BAD = Verdict(page="p0002", verdict="misprint", score=9.0, threshold=1.0, kind="streak")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.sqlite"


def sheets(path: Path, run: int = 1) -> list[int]:
    with Journal.open(str(path), read_only=True) as journal:
        return [page.sheet for page in journal.pages(run)]


def test_a_camera_count_that_no_row_can_hold_costs_one_page(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "COMMIT_S", 0.001)
    said: list[str] = []
    with Journal.open(str(path), announce=said.append) as journal:
        run = journal.begin_run(facts())
        with Recorder(journal, run) as recorder:
            for sheet in range(13):
                count = 2**63 + 5 if sheet == 4 else 3000 * sheet
                recorder.record(
                    record(sheet, first_line=count, verdict=BAD if sheet == 4 else record(0).verdict)
                )
                if sheet == 6:
                    recorder._due.set()
            recorder.end(Tally().snapshot(**status), stopped=False)
        assert recorder.durable == 12
        assert recorder.unrecorded == 1
        health = journal.health
        assert (health.trouble, health.waiting, health.dropped_pages, health.set_aside) == (None, 0, 0, 1)
        row = journal.run(run)
        assert (row.pages, row.dropped_pages, row.state) == (12, 1, "finished")
        assert row.end is not None
        assert row.end.counts["journalled"] == 12
    assert sheets(path) == [sheet for sheet in range(13) if sheet != 4]
    assert "sheet 4 of run 1 cannot be stored as a row (first_line: " in said[0]
    assert said[1].endswith(
        "1 of the reported pages are not recorded; 1 of them are in journal.sqlite.aside.jsonl"
    )
    (line,) = aside_file(path).read_text().splitlines()
    kept = json.loads(line)
    assert (kept["run"], kept["sheet"], kept["page"]["verdict"], kept["page"]["disposition"]) == (
        *(1, 4),
        *("misprint", "stop"),
    )


status: dict[str, Any] = {
    "queue_depth": 0,
    "ahead": 0,
    "journalled": 0,
    "elapsed_s": 1.0,
}


@pytest.mark.parametrize(
    ("changes", "column"),
    [
        ({"time_s": math.nan}, "time_s"),
        ({"time_s": math.inf}, "time_s"),
        ({"sheet": 2**63}, "sheet"),
        ({"sheet": -1}, "sheet"),
        ({"first_line": -(2**70)}, "first_line"),
        ({"first_line": None}, "TypeError"),
        ({"first_line": 2.5}, "TypeError"),
        ({"job_page": 2**64}, "job_page"),
        ({"verdict": replace(BAD, verdict="excellent")}, "whole_verdict"),
        ({"verdict": replace(BAD, probability=7.0)}, "probability"),
        ({"verdict": replace(BAD, score=10**400)}, "score"),
        ({"verdict": replace(BAD, reason=None)}, "reason"),
        ({"verdict": replace(BAD, shift_mm=(math.nan, 0.0))}, "shift_mm"),
        ({"verdict": object()}, "TypeError"),
        ({"nuisance": {"gain": "much"}}, "nuisance"),
        ({"nuisance": None}, "nuisance"),
    ],
)
def test_a_page_that_no_row_can_hold_is_kept_beside(path: Path, changes: Any, column: str) -> None:
    with Journal.open(str(path), announce=lambda _: None) as journal:
        run = journal.begin_run(facts())
        for page in (record(1), replace(record(2), **changes), record(3)):
            journal.record(run, page)
        assert journal.commit()
        assert journal.health.unrecorded == 1
    assert sheets(path) == [1, 3]
    (line,) = aside_file(path).read_text().splitlines()
    assert column in json.loads(line)["reason"]
    assert len(files_of(path)) == 1


def test_what_a_row_can_hold_in_another_form_is_recorded(path: Path) -> None:
    """Names that are no UTF-8, texts of megabytes, numbers of NumPy and those that are not finite."""
    odd = Region(x_mm=1.0, y_mm=2.0, width_mm=3.0, height_mm=4.0, score=math.nan, kind="k")
    verdict = replace(
        BAD, page="pag\udce9.tif", reason="x" * 3_000_000, score=np.float32(2.5), regions=(odd,)
    )
    page = record(
        np.int64(2), verdict=verdict, first_line=np.int32(7), time_s=np.float32(0.5), late=np.bool_(True)
    )
    page = replace(page, faults=("\ud800",), nuisance={"a": np.float32(np.inf)}, job_page=np.uint16(3))
    with Journal.open(str(path)) as journal:
        run = journal.begin_run(facts(job="pag\udce9.pdf", settings={"seed": 10**30, "by": Phase.FAULT}))
        journal.record(run, page)
        journal.end_run(
            run, RunEnd(ended_s=1.0, ending="fault", detail="\udce9" * 100_000, counts={"a": math.nan})
        )
        assert journal.commit()
        assert journal.health.unrecorded == 0
        (read,) = journal.pages(run)
        row = journal.run(run)
    assert read.verdict.page == "pag\\udce9.tif"
    assert 10_000 < len(read.verdict.reason) <= 20_000
    assert (read.sheet, read.job_page, read.first_line, read.late, read.verdict.score) == (2, 3, 7, True, 2.5)
    assert row.facts.job == "pag\\udce9.pdf"
    assert row.state == "fault"


@pytest.mark.parametrize(
    "evidence",
    [
        {"values": np.array([None, "x"], object)},
        {"values": np.array(["x"])},
        {"values": np.zeros(3, np.complex128)},
        {"../x": np.zeros(3)},
        {"values": np.zeros(9_000_000)},
        {"values": "not an array"},
    ],
    ids=["objects", "texts", "complex", "name", "size", "type"],
)
def test_evidence_that_no_file_can_hold_is_given_up_and_its_row_kept(path: Path, evidence: Any) -> None:
    said: list[str] = []
    with Journal.open(str(path), announce=said.append) as journal:
        run = journal.begin_run(facts())
        journal.record(run, record(1))
        journal.record(run, replace(record(2), evidence=evidence))
        assert journal.commit()
        assert [journal.page(run, sheet).evidence is None for sheet in (1, 2)] == [False, True]
        assert (journal.health.dropped_evidence, journal.health.unrecorded) == (1, 0)
        assert journal.run(run).dropped_evidence == 1
    assert len(said) == 1
    assert "the evidence of sheet 2 of run 1" in said[0]


def test_a_page_of_which_the_database_wants_nothing_does_not_keep_the_others(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever it is: here a run that is not in the journal, and a value that no check foresaw."""
    page_row = rows.page_row

    def unforeseen(run_id: int, page: PageRecord, pack_id: int | None = None) -> dict[str, Any]:
        row = page_row(run_id, page, pack_id)
        return row | {"first_line": 2**63} if page.sheet == 3 else row

    monkeypatch.setattr(rows, "page_row", unforeseen)
    with Journal.open(str(path), announce=lambda _: None) as journal:
        run = journal.begin_run(facts())
        journal.record(77, record(1))
        for sheet in (2, 3, 4):
            journal.record(run, record(sheet))
        journal.end_run(run, RunEnd(ended_s=2000.0, ending="finished"))
        assert journal.commit()
        assert journal.health.set_aside == 2
        assert journal.run(run).dropped_pages == 1
        assert journal.run(run).state == "finished"
        assert [page.sheet for page in journal.pages(run)] == [2, 4]
        assert journal.page(run, 2).evidence is not None
    Journal.open(str(path), announce=pytest.fail).close()  # and no evidence was left without a row


def test_evidence_that_cannot_be_put_where_it_belongs_does_not_cost_the_row(
    path: Path, tmp_path: Path
) -> None:
    with Journal.open(str(path), announce=lambda _: None) as journal:
        run = journal.begin_run(facts())
        (tmp_path / "mine").mkdir()
        packs.evidence_folder(path).symlink_to(tmp_path / "mine")
        journal.record(run, record(1))
        assert journal.commit()
        assert journal.health.dropped_evidence == 1
    assert sheets(path) == [1]
    assert not list((tmp_path / "mine").iterdir())


def test_the_thread_that_commits_survives_whatever_happens(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "COMMIT_S", 0.001)
    with Journal.open(str(path)) as journal:
        run, commit, calls = journal.begin_run(facts()), journal.commit, []

        def failing() -> bool:
            calls.append(1)
            if len(calls) < 4:
                raise RuntimeError("nobody thought of it")
            return commit()

        monkeypatch.setattr(journal, "commit", failing)
        with Recorder(journal, run) as recorder:
            recorder.record(record(1))
            while journal.health.waiting:
                pass
        assert recorder.unrecorded == 0
    assert sheets(path) == [1]


def test_a_disk_that_stays_full_is_told_at_the_end(path: Path) -> None:
    said: list[str] = []
    journal = Journal.open(str(path), announce=said.append)
    run = journal.begin_run(facts())
    limit(journal, 3)
    with Recorder(journal, run) as recorder:
        for sheet in range(100):
            recorder.record(record(sheet, verdict=replace(BAD, reason="x" * 900)))
            if sheet % 10 == 9:
                journal.commit()
        recorder.end(Tally().snapshot(**status), stopped=False)
    journal.close()
    written = len(sheets(path))
    assert 0 <= written < 100
    assert journal.health.unrecorded == recorder.unrecorded == 100 - written
    assert recorder.durable == written
    assert f"{100 - written} of the reported pages are not recorded" in said[-1]


def test_a_file_beside_that_is_a_link_or_on_a_full_disk_costs_nothing_else(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = tmp_path / "mine"
    mine.write_text("mine")
    aside_file(path).symlink_to(mine)
    said: list[str] = []
    with Journal.open(str(path), announce=said.append) as journal:
        run = journal.begin_run(facts())
        journal.record(run, record(1, first_line=2**63))
        journal.record(run, record(2))
        assert journal.commit()
    assert mine.read_text() == "mine"
    assert "cannot store it either" in said[0]
    assert sheets(path) == [2]


@pytest.mark.parametrize(
    "changes", [{"started_s": math.nan}, {"started_s": 1e300}, {"sheets": 2**63}, {"job": 5}]
)
def test_a_run_that_no_row_can_hold_is_refused_before_it_begins(path: Path, changes: Any) -> None:
    with Journal.open(str(path)) as journal:
        with pytest.raises(JournalError, match="run 1 cannot be recorded") as refusal:
            journal.begin_run(facts(**changes))
        assert "\n" not in str(refusal.value)
        assert journal.begin_run(facts()) == 1


def test_an_error_of_the_disk_is_no_reason_to_set_a_page_aside(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    with Journal.open(str(path), announce=lambda _: None) as journal:
        run = journal.begin_run(facts())
        with monkeypatch.context() as patched:
            patched.setattr(packs, "write_pack", full)
            for sheet, count in ((1, 0), (2, 2**63), (3, 0)):
                journal.record(run, record(sheet, first_line=count))
            for _ in range(3):  # what is set aside is set aside once
                assert not journal.commit()
        assert (journal.health.waiting, journal.health.set_aside) == (2, 1)
        assert journal.commit()
        assert journal.run(run).dropped_pages == 1
    assert sheets(path) == [1, 3]
    assert len(aside_file(path).read_text().splitlines()) == 1
