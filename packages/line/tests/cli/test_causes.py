"""Commands that name causes, map the web, offer corrections, and make a job of what must be printed again."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
from packages.line.tests.causes.rows import region, rolled, row
from reportlab.pdfgen.canvas import Canvas
from tests.cli.calls import call

from prooflight.cli.show import people
from prooflight.files.content import content_digest
from prooflight.pages.pdf.rip import PdfJob
from prooflight.press.press_file import PressFile
from prooflight_line.job_queue.tickets.reading import read_ticket
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, RunEnd, RunFacts

PARTS = """
[[press.rollers]]
name = "fuser"
circumference_mm = 94.2
[[press.heads]]
name = "black bar"
first_nozzle_mm = 0.0
nozzle_pitch_um = 42.333
nozzles = 5000
"""


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(people, "width", 200)


@pytest.fixture
def plant(tmp_path: Path) -> Path:
    """A press file with a roller and a head."""
    text = resources.files("prooflight.press").joinpath("presets", "prototype.toml").read_text()
    path = tmp_path / "my.toml"
    path.write_text(text + PARTS)
    return path


def journal(path: Path, records: list[PageRecord], *, digest: str = "", job: str = "j.pdf") -> Path:
    facts = RunFacts(
        job=job,
        job_digest=digest,
        press="my",
        press_digest="",
        detector="matched_filter",
        source="drum:5",
        started_s=1.7e9,
        sheets=len(records),
        settings={"job_pages": len(records)},
    )
    with Journal.open(str(path)) as opened:
        number = opened.begin_run(facts)
        for record in records:
            opened.record(number, record)
        opened.end_run(number, RunEnd(ended_s=1.7e9 + 60, ending="finished"))
    return path


def test_causes_by_the_press_file(tmp_path: Path, plant: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = PressFile.read(plant)
    pitch = file.geometry(file.camera()).line_pitch_mm
    rows = [replace(one, first_line=round(one.first_line * 0.1 / pitch)) for one in rolled(94.2, sheets=6)]
    path = journal(tmp_path / "j.sqlite", rows)
    options = ("run", "causes", "--plant", plant, "--journal", path)
    code, out, _ = call(capsys, *options, "--json")
    assert code == 0
    (cause,) = json.loads(out)["causes"]
    assert (cause["kind"], cause["names"]) == ("roller", ["fuser"])
    assert cause["distance_mm"] == pytest.approx(94.2, abs=0.1)
    assert "fuser" in call(capsys, *options)[1]
    good = journal(tmp_path / "good.sqlite", [row(0), row(1)])
    assert "No defects" in call(capsys, "run", "causes", "--plant", plant, "--journal", good)[1]


def test_the_roll_map_goes_by_suffix(tmp_path: Path, plant: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = journal(tmp_path / "j.sqlite", [row(0), row(1, region(50, 80))])
    options = ("run", "roll-map", "--plant", plant, "--journal", path)
    (line,) = csv.DictReader(io.StringIO(call(capsys, *options)[1]))
    assert (line["sheet"], line["kind"]) == ("1", "spots-voids")
    for name, begins in (("map.csv", b"from_m"), ("map.xml", b"<?xml"), ("map.png", b"\x89PNG")):
        assert call(capsys, *options, "-o", tmp_path / name)[0] == 0
        assert (tmp_path / name).read_bytes().startswith(begins)
    code, _, error = call(capsys, *options, "-o", tmp_path / "map.doc")
    assert code == 2
    assert ".csv" in error
    assert not (tmp_path / "map.doc").exists()


def test_corrections_are_offered_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [row(at, nuisance={"gain-black": 0.05 + 0.02 * (at % 2)}) for at in range(12)]
    path, xjmf = journal(tmp_path / "j.sqlite", rows), tmp_path / "offer.xjmf"
    code, out, _ = call(capsys, "run", "corrections", "--journal", path, "--xjmf", xjmf, "--json")
    assert code == 0
    (offer,) = json.loads(out)["corrections"]
    assert offer["offset"] == pytest.approx(-0.03)
    assert b"offered for j.pdf, not applied: density of black: offset -3.000 %" in xjmf.read_bytes()
    assert call(capsys, "run", "corrections", "--journal", path, "--damping", "2")[0] == 2
    assert "Too few" in call(capsys, "run", "corrections", "--journal", path, "--since", 9)[1]


def made_job(path: Path) -> Path:
    """Four pages that differ by their width."""
    canvas = Canvas(str(path))
    for number in range(1, 5):
        canvas.setPageSize((300 + number, 400))
        canvas.drawString(20, 20, str(number))
        canvas.showPage()
    canvas.save()
    return path


def test_a_reprint_is_a_job_and_is_reconciled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    job, again = made_job(tmp_path / "job.pdf"), tmp_path / "again.pdf"
    rows: list[Any] = [row(0), row(1, region(50, 80)), row(2), row(3, region(50, 80))]
    path = journal(tmp_path / "j.sqlite", rows, digest=content_digest(job))
    options = ("run", "reprint-job", 1, "--journal", path, "--job")
    assert call(capsys, *options, job, "-o", again)[0] == 0
    with PdfJob(again) as pdf:
        assert [round(width / 25.4 * 72) for width, _ in pdf.page_sizes_mm] == [302, 304]
    assert read_ticket(again.with_suffix(".xjdf")).file == "again.pdf"
    listed = again.with_suffix(".json")
    journal(path, [row(0), row(1, region(9, 9))], digest=content_digest(again), job="again.pdf")
    code, out, _ = call(capsys, "run", "reprinted", listed, "--journal", path, "--json")
    assert code == 3
    assert [one["number"] for one in json.loads(out)["reprints"]] == [4]
    journal(path, [row(0), row(1)], digest=content_digest(again), job="again.pdf")
    code, out, _ = call(capsys, "run", "reprinted", listed, "--journal", path)
    assert code == 0
    assert "2 of 2 sheets of run 1" in out
    assert call(capsys, "run", "reprinted", listed, 1, "--journal", path)[0] == 2  # it printed the job itself
    other = made_job(tmp_path / "other.pdf")
    with other.open("ab") as file:
        file.write(b"\n")
    code, _, error = call(capsys, *options, other, "-o", tmp_path / "x.pdf")
    assert (code, "is not the job of run 1" in error) == (2, True)
    assert not (tmp_path / "x.pdf").exists()
    listed.write_text("{}")
    assert "is not a reprint job" in call(capsys, "run", "reprinted", listed, "--journal", path)[2]
    path = journal(tmp_path / "good.sqlite", [row(0)], digest=content_digest(job))
    assert call(capsys, *options[:3], "--journal", path, "--job", job, "-o", again)[0] == 2
