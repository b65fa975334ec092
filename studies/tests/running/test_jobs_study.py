"""The study of a hot folder sends what it says, and counts what ended elsewhere."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from prooflight.cli import run
from prooflight.rng import stream
from prooflight_line.job_queue.hot_folder import Entry
from prooflight_studies.jobs.study import PAIRS, SHARES, Delivery, JobsPlan, deliveries, right, run_jobs_study

PDF = b"%PDF-1.7 of somebody"


@pytest.fixture(scope="module")
def sent() -> list[Delivery]:
    return deliveries(1000, [PDF], stream(31, "hot-folder"))


def test_a_thousand_files_have_names_of_their_own(sent: list[Delivery]) -> None:
    names = [file.name for one in sent for file in one.files]
    assert len(names) == len(set(names)) == 1000
    assert Counter(one.kind for one in sent) == SHARES
    assert all(len(one.files) == 1 + (one.kind in PAIRS) for one in sent)
    assert any(one.files[0].name == one.job for one in sent if one.kind == "ticket")
    assert [one.given for one in sent if one.files[0].content == PDF and one.kind == "job"] == [True]


def test_only_copies_and_orders_share_a_content(sent: list[Delivery]) -> None:
    contents = Counter(file.content for one in sent for file in one.files)
    shared = {content for content, number in contents.items() if number > 1}
    kinds = {one.kind for one in sent for file in one.files if file.content in shared and one.kind != "cut"}
    assert kinds == {"job", "copy", "ticket", "ordered twice", "ordered again"}


def test_orders_of_what_was_ordered_before_come_last(sent: list[Delivery]) -> None:
    assert {one.kind for one in sent[-40:]} == {"ordered twice", "ordered again"}


def entry(number: int) -> Entry:
    return Entry(path=Path(str(number)), stage="queued", number=number, digest="")


def test_a_delivery_that_ends_elsewhere_is_wrong(sent: list[Delivery]) -> None:
    of = {one.kind: one for one in sent}
    job, cut, bad = of["job"], of["cut"], of["bad ticket"]
    assert right(job, "queued", Counter({job.origin: 1}), {})
    assert not right(job, "queued", Counter({job.origin: 2}), {}), "accepted twice"
    assert not right(job, "rejected", Counter(), {}), "accepted never"
    assert not right(job, "", Counter({job.origin: 1}), {}), "lost"
    assert not right(job, "checking", Counter({job.origin: 1}), {})
    assert right(cut, "rejected", Counter(), {})
    assert not right(cut, "done", Counter(), {})
    together = {file.name: entry(1) for file in bad.files}
    assert right(bad, "rejected", Counter(), together)
    assert not right(bad, "rejected", Counter(), together | {bad.job: entry(2)}), "without its ticket"
    assert not right(bad, "queued", Counter(), together)


def test_a_small_run_loses_nothing(tmp_path: Path) -> None:
    results = run_jobs_study(tmp_path, plan=JobsPlan(seed=31, files=25, kills=1))
    assert (results.kills, results.lost, results.twice, results.left) == (1, 0, 0, 0)
    assert sum(row.wrong for row in results.rows) == 0
    assert sum(row.queued + row.done + row.rejected for row in results.rows) == sum(
        row.deliveries for row in results.rows
    )
    assert (tmp_path / "jobs.md").is_file()


def test_causes_ask_for_a_press(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["study", "plant", "-o", str(tmp_path)]) == 2
    assert "causes need a press" in capsys.readouterr().err
