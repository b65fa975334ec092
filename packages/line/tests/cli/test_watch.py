"""`prooflight watch` as a user calls it."""

from __future__ import annotations

import contextlib
import io
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.cli.strange import StrangeFrom

from prooflight.cli import run
from prooflight.cli.show import people
from prooflight.detectors.verdict import Verdict
from prooflight.inspection.guarantee import GuaranteeMonitor
from prooflight.pages import parallel
from prooflight.pages.files import write_tiff
from prooflight.pages.raster import Page
from prooflight.scans.lines import LineBlock
from prooflight.scans.raw import write_block
from prooflight.scans.recorded import recorded_scans
from prooflight.simulation import ring
from prooflight_line.cli.watch import sources
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import run_key
from prooflight_line.journal.records import PageRecord
from prooflight_line.run.decided_first import DecidedFirst
from prooflight_line.run.monitor.run import PageEvidence
from prooflight_line.run.outcomes import Outcome, skipped
from prooflight_line.run.pace import TOO_LATE
from prooflight_line.run.runner import Running

if TYPE_CHECKING:
    from prooflight.press.artefact import Press
    from prooflight_line.run.queues import Sheet

HEIGHT_MM = 30.0
PHASE = '"phase": '
"""In lines that say how far the preparation is."""


@pytest.fixture(autouse=True)
def _few_prints(monkeypatch: pytest.MonkeyPatch) -> None:
    """The drum plays three prints over and over: too few to start processes for."""
    monkeypatch.setattr(ring, "LEAST_PRINTS", 3)


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three pages of 36 x 30 mm."""
    folder, rng = tmp_path_factory.mktemp("job"), np.random.default_rng(7)
    rows = round(HEIGHT_MM / 25.4 * 500)
    for number in range(1, 4):
        cmyk = np.zeros((rows, 708, 4), np.uint8)
        for line in range(60, rows - 60, 40):
            for word in range(60, 640, 90):
                cmyk[line : line + 20, word : word + int(rng.integers(20, 80)), 3] = 255
        cmyk[100:300, 400:600, number % 3] = 40 * number
        write_tiff(
            Page(cmyk=cmyk, dpi=500.0, name=f"p{number:04d}", number=number), folder / f"p{number:04d}.tif"
        )
    return folder


@pytest.fixture(scope="module")
def trigger(press: Press) -> int:
    """Lines from page to page on a drum: with them, pages lie where they should in their scans."""
    return press.geometry.lines(round(HEIGHT_MM / 25.4 * 500) / 500 * 25.4)


def watch(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, list[dict[str, Any]], str]:
    code = run(["watch", *(str(argument) for argument in arguments)])
    captured = capsys.readouterr()
    return (
        code,
        [
            json.loads(line)
            for line in captured.out.splitlines()
            if line.startswith("{") and PHASE not in line
        ],
        captured.err,
    )


def test_the_drum_is_watched_and_journalled(
    press_file: Path, job: Path, trigger: int, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    journal = tmp_path / "runs.sqlite"
    code, rows, _ = watch(
        capsys, job, "--press", press_file, "--source", "drum", "--world", "ideal", "--sheets", 9,
        "--trigger", trigger, "--journal", journal, "--json",
    )  # fmt: skip
    assert code == 0
    assert [row["page"] for row in rows] == ["p0001", "p0002", "p0003"] * 3
    assert [row["job_page"] for row in rows] == list(range(9))
    assert {row["verdict"] for row in rows} == {"good"}
    assert {row["late"] for row in rows} == {False}
    with Journal.open(str(journal), read_only=True) as opened:
        (facts,) = opened.runs()
        assert (facts.state, facts.pages, facts.misprints) == ("finished", 9, 0)
        assert facts.end is not None
        assert facts.end.counts["good"] == 9
        assert [page.sheet for page in opened.pages(facts.id)] == list(range(9))


def test_a_drum_that_starts_at_once_prints_on_and_waits_for_designs(
    press_file: Path,
    job: Path,
    trigger: int,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sources, "FIRST_PRINTS", 1)
    monkeypatch.setattr(
        parallel, "FEWEST_FOR_PROCESSES", 1
    )  # prints all the same in a thread of this process
    monkeypatch.setattr(sources.os, "cpu_count", lambda: 2)
    code, rows, _ = watch(
        capsys, job, "--press", press_file, "--source", "drum:50", "--world", "ideal", "--sheets", 6,
        "--trigger", trigger, "--journal", "none", "--start-at-once", "--json",
    )  # fmt: skip
    assert code == 0
    assert [(row["page"], row["verdict"], row["late"]) for row in rows] == [
        (f"p000{sheet % 3 + 1}", "good", False) for sheet in range(6)
    ]


def test_the_log_for_programs_names_each_sheet_and_leaves_standard_output_alone(
    press_file: Path, job: Path, trigger: int, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    journal = tmp_path / "runs.sqlite"
    code, rows, log = watch(
        capsys, job, "--press", press_file, "--source", "drum", "--world", "ideal", "--sheets", 4,
        "--trigger", trigger, "--journal", journal, "--misprint", "streak:1", "--every", 3, "--log", "json",
    )  # fmt: skip
    assert code == 1
    assert rows == []
    events = [json.loads(line) for line in log.splitlines()]
    assert [one["event"] for one in events if one["event"] != "phase"] == [
        "run-begun", *["sheet"] * 4, "run-ended",
    ]  # fmt: skip
    with Journal.open(str(journal), read_only=True) as opened:
        (run,) = opened.runs()
    sheets = [one for one in events if one["event"] == "sheet"]
    assert [one["id"] for one in sheets] == [f"{run_key(run)}/{sheet}" for sheet in range(4)]
    assert {(one["press"], one["run"]) for one in sheets} == {(run.facts.press, run.id)}
    assert [one["level"] for one in sheets].count("warning") == run.misprints > 0
    assert all(one["time"].endswith("+00:00") for one in events)
    assert not people.quiet


def test_a_program_hears_at_once_that_the_run_is_prepared_and_then_that_it_inspects(
    press_file: Path, job: Path, trigger: int, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [
        "watch", job, "--press", press_file, "--source", "drum", "--world", "ideal", "--sheets", 3,
        "--trigger", trigger, "--journal", "none", "--json",
    ]  # fmt: skip
    assert run([str(one) for one in given]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert rows[0] == {"phase": "preparing", "detail": "reading the job"}
    phases = [row["phase"] for row in rows if "phase" in row]
    assert phases == sorted(phases, key=["preparing", "inspecting"].index)
    sheets = [at for at, row in enumerate(rows) if "verdict" in row]
    assert rows.index({"phase": "preparing", "detail": "printing for the drum: 0 of 3"}) < sheets[0]


def undecided(verdict: Verdict) -> Outcome:
    record = PageRecord(sheet=0, job_page=0, verdict=verdict, late=False, first_line=0, time_s=0.0)
    return Outcome(record=record, evidence=PageEvidence())


@pytest.mark.parametrize("fails", [False, True])
def test_the_gate_decides_a_sheet_before_it_is_told_and_one_that_it_fails_to_decide_is_held(
    fails: bool,
) -> None:
    def decide(outcome: Outcome) -> Outcome:
        if fails:
            raise OSError("the log is full")
        return replace(outcome, record=replace(outcome.record, gate="divert"))

    told: list[Outcome] = []
    tell = DecidedFirst(decide=decide, tell=told.append)
    with pytest.raises(OSError, match="full") if fails else contextlib.nullcontext():
        tell(undecided(Verdict(page="p0001", verdict="good")))
    [one] = told
    assert (one.record.disposition, one.record.decided_by) == ("hold" if fails else "divert", "gate")
    assert one.record.verdict.verdict == "good"


def test_the_gate_decides_a_misprint_once_before_it_is_explained() -> None:
    asked: list[str | None] = []

    def decide(outcome: Outcome) -> Outcome:
        asked.append(outcome.record.verdict.kind)
        return replace(outcome, record=replace(outcome.record, gate="divert"))

    unexplained = undecided(Verdict(page="p0001", verdict="misprint"))
    explained = replace(unexplained.record, verdict=replace(unexplained.record.verdict, kind="streak"))
    told: list[Outcome] = []
    tell = DecidedFirst(decide=decide, tell=told.append)
    tell.early(unexplained)
    assert told == []
    tell(replace(unexplained, record=explained))
    [one] = told
    assert asked == [None]
    assert (one.record.gate, one.record.verdict.kind) == ("divert", "streak")


def test_inspection_that_does_not_keep_pace_is_said_first_and_ends_with_exit_code_5(
    press_file: Path,
    job: Path,
    trigger: int,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """Every sheet comes too late, as on a machine that is too slow."""

    def late(self: Running, sheet: Sheet, _on_decision: object) -> Outcome:
        return skipped(sheet.number, sheet.seen, TOO_LATE, name=self._name(sheet.job_page))

    monkeypatch.setattr(Running, "_inspect", late)
    journal = tmp_path / "runs.sqlite"
    code, rows, said = watch(
        capsys, job, "--press", press_file, "--source", "drum", "--world", "ideal", "--sheets", 9,
        "--trigger", trigger, "--journal", journal, "--json",
    )  # fmt: skip
    assert code == 5
    [notice] = [row for row in rows if row.get("notice") == "overloaded"]
    assert notice["text"].startswith("inspection cannot keep up: 5 of the last 5 sheets not inspected")
    sheets = [row for row in rows if "verdict" in row]
    assert {(row["verdict"], row["disposition"], row["decided_by"]) for row in sheets} == {
        ("not-inspected", "hold", "default")
    }
    last = said.splitlines()[-1]
    assert last.startswith("prooflight: inspection could not keep up with the press, and 9 sheets passed")
    for help_ in ("slower", "designs were not ready", "job prepare"):
        assert help_ in last
    with Journal.open(str(journal), read_only=True) as opened:
        [facts] = opened.runs()
        assert facts.end is not None
        assert facts.end.counts["out_of_time"] == 9
        assert [page.disposition for page in opened.pages(facts.id)] == ["hold"] * 9


def test_a_press_that_does_what_it_was_not_taught_is_said_everywhere(
    press_file: Path,
    job: Path,
    trigger: int,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Line by line, at the end, in the journal, and in what is shown of the run."""
    monkeypatch.setattr(GuaranteeMonitor, "of", lambda _detector, seed: GuaranteeMonitor(test=StrangeFrom(3)))
    monkeypatch.setattr("prooflight_line.run.monitor.evidence.summary_of", lambda _inspection: np.zeros(1))
    journal = tmp_path / "runs.sqlite"
    code, rows, said = watch(
        capsys, job, "--press", press_file, "--source", "drum", "--world", "ideal", "--sheets", 6,
        "--trigger", trigger, "--journal", journal, "--json",
    )  # fmt: skip
    assert code == 0
    (notice,) = (row for row in rows if "notice" in row)
    assert notice["notice"] == "promise-suspended"
    assert [row["promise_suspended"] for row in rows if "page" in row] == [False] * 2 + [True] * 4
    told = said.splitlines()
    assert "(most of all: lines along the travel): the promised false-alarm rate does not hold" in told[0]
    assert told[1:] == [
        "prooflight: promise suspended: the promised false-alarm rate does not hold for the last 4 sheets"
    ]
    monkeypatch.setattr(people, "width", 400)
    assert run(["run", "show", "--journal", str(journal)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "suspended from sheet 2 on" in shown
    assert "promise suspended; this press's good pages differ from those" in shown  # the note of sheet 2
    assert run(["runs", "--journal", str(journal), "--json"]) == 0
    (facts,) = json.loads(capsys.readouterr().out)
    assert (facts["promise_suspended_from"], facts["counts"]["promise_suspended"]) == (2, 4)


def test_a_fault_is_named_and_a_page_that_did_not_come_ends_with_exit_code_3(
    press_file: Path, job: Path, trigger: int, capsys: pytest.CaptureFixture[str]
) -> None:
    code, rows, said = watch(
        capsys, job, "--press", press_file, "--source", "drum", "--world", "ideal", "--sheets", 12,
        "--misprint", "streak:0.9", "--every", 3, "--fault-every", 5, "--trigger", trigger,
        "--journal", "none", "--json",
    )  # fmt: skip
    assert code == 3
    assert said == "prooflight: 1 of 12 sheets did not come\n"
    assert [row["verdict"] for row in rows[:3]] == ["good", "good", "misprint"]
    assert rows[5]["faults"] == ["blank"]
    assert rows[5]["kind"] == "missing-content"
    assert [(row["job_page"], row["faults"]) for row in rows[6:8]] == [(5, ["missing"]), (6, [])]


def test_people_get_the_last_view(
    press_file: Path, job: Path, trigger: int, capsys: pytest.CaptureFixture[str]
) -> None:
    code = run(
        ["watch", str(job), "--press", str(press_file), "--source", "drum", "--world", "ideal",
         "--sheets", "3", "--trigger", str(trigger), "--journal", "none"]
    )  # fmt: skip
    shown = capsys.readouterr().out
    assert code == 0
    assert "STOPPED" in shown
    assert "not inspected" in shown


def test_recorded_scans_and_a_pipe_say_the_same(
    press_file: Path,
    press: Press,
    job: Path,
    trigger: int,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert run(["simulate", str(job), "--press", str(press_file), "-o", str(tmp_path), "--json"]) == 0
    capsys.readouterr()
    pipe, first = io.BytesIO(), 0
    for scan in recorded_scans(tmp_path, sensors=1):
        lines = scan.read()
        write_block(pipe, LineBlock(first_line=first, lines=lines, time_s=0.0))
        first += lines.shape[1]
    pipe.seek(0)

    class Standard:
        buffer = pipe

    common = (job, "--press", press_file, "--trigger", trigger, "--journal", "none", "--json")
    _, replayed, _ = watch(capsys, *common, "--source", f"replay:{tmp_path}")
    monkeypatch.setattr(sys, "stdin", Standard)
    _, piped, _ = watch(capsys, *common, "--source", "raw:-", "--framed")
    assert len(replayed) == 3
    for one, other in zip(replayed, piped, strict=True):
        assert [one[key] for key in ("page", "verdict", "score", "shift_mm")] == [
            other[key] for key in ("page", "verdict", "score", "shift_mm")
        ]


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (("--source", "camera"), "drum[:PAGES_PER_S]"),
        (("--source", "drum:fast"), "drum:5"),
        (("--source", "replay:/nowhere"), "/nowhere"),
        (("--source", "drum", "--keep", "some"), "misprints"),
        (("--source", "drum", "--misprint", "smudge"), "smudge"),
        (("--source", "drum", "--detector", "eyes"), "eyes"),
    ],
)
def test_bad_input_is_one_line(
    arguments: tuple[str, ...], names: str, press_file: Path, job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, rows, said = watch(capsys, job, "--press", press_file, "--journal", "none", "--json", *arguments)
    assert (code, rows) == (2, [])
    assert names in said
    assert said.count("\n") == 1


def test_a_pipe_that_breaks_off_keeps_what_came_and_ends_with_3(
    press_file: Path,
    job: Path,
    trigger: int,
    press: Press,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Standard:
        buffer = io.BytesIO(b"\0" * (2 * press.geometry.pixels * trigger + 7))

    monkeypatch.setattr(sys, "stdin", Standard)
    code, rows, said = watch(
        capsys, job, "--press", press_file, "--source", "raw:-", "--trigger", trigger, "--journal", "none", "--json"
    )  # fmt: skip
    assert code == 3
    assert [row["verdict"] for row in rows] == ["misprint", "not-inspected"]  # darkness is no page of the job
    assert rows[1]["reason"] == "a sheet that is no page of the job came instead of the page"
    assert "whole lines" in said
    assert "3 of 3 sheets did not come" in said
    assert said.count("\n") == 1


def test_a_pipe_of_which_nothing_can_be_used_ends_with_2(
    press_file: Path, job: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Standard:
        buffer = io.BytesIO(b"no lines")

    monkeypatch.setattr(sys, "stdin", Standard)
    code, rows, said = watch(
        capsys, job, "--press", press_file, "--source", "raw:-", "--journal", "none", "--json"
    )
    assert (code, rows) == (2, [])
    assert "whole lines" in said
    assert said.count("\n") == 1
