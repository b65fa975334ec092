"""Figures for Prometheus, and whether the console lives and is ready."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from packages.console.tests.consoles import Served, served, write_run
from packages.line.tests.journal.sample_rows import facts, good, misprint
from prometheus_client.parser import text_string_to_metric_families

from prooflight_console.accounts.roles import Role, Scope
from prooflight_line.job_queue.hot_folder import HotFolder
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from collections.abc import Iterator

DEPLOY = Path(__file__).resolve().parents[1] / "deploy"


@pytest.fixture
def metered(tmp_path: Path) -> Iterator[Served]:
    """A console with a hot folder, on a journal in which a run ended before it began."""
    folder = tmp_path / "jobs"
    folder.mkdir()
    HotFolder.open(folder)
    made = served(tmp_path, queue=folder)
    yield made
    made.close()


def token(console: Served, scope: Scope = Scope.READ) -> str:
    console.client(Role.VIEWER)
    return console.accounts.new_token("viewer", "prometheus", [scope], by="test")[1]


def scraped(console: Served) -> dict[str, float]:
    """Samples by name and labels, as Prometheus reads them."""
    client = console.client()
    answer = client.get("/metrics", headers={"Authorization": f"Bearer {token(console)}"})
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/plain; version=")
    return {
        sample.name + "".join(f"|{value}" for value in sample.labels.values()): sample.value
        for family in text_string_to_metric_families(answer.text)
        for sample in family.samples
    }


def test_what_passes_is_counted_once_and_in_bins(metered: Served) -> None:
    before = scraped(metered)
    assert before["prooflight_sheets_total|good"] == 0  # what passed before the console began is not counted
    assert before["prooflight_run_pages"] == 30
    assert before["prooflight_run_active"] == 0
    with Journal.open(str(metered.journal)) as journal:
        run = journal.begin_run(facts(job='a "job"\n', sheets=40))
        for sheet in range(8):
            journal.record(run, good(sheet, late=sheet == 2, faults=("lost-lines", "splice")[: sheet % 3]))
        journal.record(run, misprint(8, kind="streak"))
        journal.commit()
        for _ in range(2):
            after = scraped(metered)
            assert after["prooflight_sheets_total|good"] == 8
            assert after["prooflight_sheets_total|misprint"] == 1
            assert after["prooflight_misprints_total|streak"] == 1
            assert after["prooflight_late_total"] == 1
            assert after["prooflight_faults_total|lost-lines"] == 5
            assert after["prooflight_faults_total|splice"] == 2
            assert after["prooflight_inspection_seconds_bucket|0.05"] == 0
            assert after["prooflight_inspection_seconds_bucket|0.1"] == 8  # 80 ms each
            assert after["prooflight_inspection_seconds_bucket|+Inf"] == 9
            assert after["prooflight_inspection_seconds_sum"] == pytest.approx(8 * 0.08 + 0.11)
        assert after["prooflight_run_active"] == 1
        assert after['prooflight_run_info|matched_filter|a "job"\n|rig|2'] == 1
        assert after["prooflight_run_expected_sheets"] == 40
        assert after["prooflight_alarms_unlabelled"] == 1
        assert after["prooflight_false_alarms"] == after["prooflight_false_alarm_rate_realised"] == 0
        assert sum(value for name, value in after.items() if name.startswith("prooflight_state|")) == 1
        assert 0 < after["prooflight_disk_free_bytes"] <= after["prooflight_disk_bytes"]


def test_jobs_of_the_queue_are_counted_by_stage(metered: Served, tmp_path: Path) -> None:
    for stage, number in (("queued", 1), ("queued", 2), ("done", 3)):
        (tmp_path / "jobs" / stage / f"{number:06d}-0123456789ab").mkdir()
    figures = scraped(metered)
    stages = ("checking", "queued", "held", "printing", "done", "rejected")
    assert [figures[f"prooflight_queue_jobs|{stage}"] for stage in stages] == [0, 2, 0, 0, 1, 0]


def test_a_journal_that_cannot_be_read_leaves_the_console_alive_and_not_ready(tmp_path: Path) -> None:
    (tmp_path / "journal.sqlite").write_bytes(b"no journal" * 1000)
    console = served(tmp_path, run=False)
    try:
        client = console.client()
        assert client.get("/healthz").text == "ok\n"
        ready = client.get("/readyz")
        assert (ready.status_code, ready.text) == (503, "the journal cannot be read\n")
        figures = scraped(console)
        assert figures["prooflight_journal_readable"] == 0
        assert not any(name.startswith("prooflight_sheets") for name in figures)
    finally:
        console.close()


def test_a_journal_that_is_still_to_come_is_ready_and_counted_from_its_first_sheet(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    try:
        assert console.client().get("/readyz").status_code == 200
        assert scraped(console)["prooflight_sheets_total|good"] == 0
        write_run(console.journal, sheets=5, bad=(1,))
        assert scraped(console)["prooflight_sheets_total|good"] == 4
    finally:
        console.close()


def test_figures_are_for_those_who_may_read(metered: Served) -> None:
    client = metered.client()
    assert client.get("/metrics").status_code == 401
    other = {"Authorization": f"Bearer {token(metered, Scope.ZONES)}"}
    assert client.get("/metrics", headers=other).status_code == 403


def test_the_dashboard_asks_for_figures_that_there_are(metered: Served) -> None:
    panels = json.loads((DEPLOY / "grafana-dashboard.json").read_text(encoding="utf-8"))["panels"]
    queries = [target["expr"] for panel in panels for target in panel.get("targets", [])]
    asked = {name for query in queries for name in re.findall(r"\bprooflight_\w+", query)}
    write_run(metered.journal, bad=(1,))
    there = {name.partition("|")[0] for name in scraped(metered)} | {"prooflight_false_alarm_rate_nominal"}
    assert len(panels) >= 10
    cells = [
        (x, y)
        for at in (panel["gridPos"] for panel in panels)
        for x in range(at["x"], at["x"] + at["w"])
        for y in range(at["y"], at["y"] + at["h"])
    ]
    assert len(cells) == len(set(cells)), "panels overlap"
    assert asked <= there, asked - there  # the nominal rate needs the press of the run
