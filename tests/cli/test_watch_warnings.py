"""``prooflight watch`` reports warnings of a job, and records them."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest
from tests.pages.conftest import pdf_bytes, stream

from prooflight.cli import run
from prooflight.journal.journal import Journal
from prooflight.pages import check
from prooflight.pages.pdf.engine import RipEngine
from prooflight.simulation import ring

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.artefact import Press


PAGE = "/MediaBox[0 0 102 85]"
"""36 x 30 mm, as wide as the small press sees."""


TEXT = "0 0 0 1 k 20 20 60 40 re f"


FRONT_END = """
import sys
from pathlib import Path
from prooflight.pages.files import write_tiff
from prooflight.pages.pdf.rip import PdfJob
pdf, number, dpi, out = Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), Path(sys.argv[4])
with PdfJob(pdf) as job:
    write_tiff(job.page(number, dpi), out)
if number == 2:
    print("toner is low")
"""


def call(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    capsys.readouterr()
    code = run([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def rows_of(out: str) -> list[dict[str, Any]]:
    """Without the phases that ``watch`` tells between them."""
    return [row for row in map(json.loads, out.splitlines()) if "phase" not in row]


def two_pages(path: Path) -> Path:
    """A PDF of two pages."""
    pages = [f"<</Type/Page/Parent 2 0 R{PAGE}/Contents {number} 0 R>>".encode() for number in (5, 6)]
    tree = b"<</Type/Pages/Kids[3 0 R 4 0 R]/Count 2>>"
    path.write_bytes(
        pdf_bytes([b"<</Type/Catalog/Pages 2 0 R>>", tree, *pages, *[stream(TEXT.encode())] * 2])
    )
    return path


@pytest.fixture(scope="module")
def warning_press(press: Press, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small press, whose front end says something of every second page."""
    folder = tmp_path_factory.mktemp("front-end")
    script = folder / "front-end.py"
    script.write_text(FRONT_END)
    command = (sys.executable, str(script), "{pdf}", "{page}", "{dpi}", "{out}")
    replace(press, rip_engine=RipEngine(name="command", command=command)).save(folder / "front-end.press")
    return folder / "front-end.press"


@pytest.mark.parametrize("looked_through", [True, False])
def test_watch_tells_warnings_keeps_them_and_goes_on_to_tell(
    tmp_path: Path,
    warning_press: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    looked_through: bool,
) -> None:
    """Before the first sheet; those of pages that nobody looked through, when these are made ready."""
    monkeypatch.setattr(ring, "LEAST_PRINTS", 3)
    if not looked_through:
        monkeypatch.setattr(check, "early_warnings", partial(check.early_warnings, seconds=0.0))
    job, journal = two_pages(tmp_path / "job.pdf"), tmp_path / "runs.sqlite"
    code, out, said = call(
        capsys, "watch", job, "--press", warning_press, "--source", "drum", "--world", "ideal",
        "--sheets", 4, "--journal", journal, "--json",
    )  # fmt: skip
    rows = rows_of(out)
    told = [at for at, row in enumerate(rows) if "warning" in row or row.get("notice") == "page-warning"]
    assert len(told) == 1, (code, said)
    assert ("warning" in rows[told[0]]) == looked_through
    with Journal.open(str(journal), read_only=True) as opened:
        (kept,) = opened.runs()
        notes = [note for page in opened.pages(kept.id) for note in page.notes]
    if looked_through:
        assert told == [0]
        assert kept.facts.settings["warnings"] == [rows[0]["warning"]]
    else:
        assert any("toner is low" in note for note in notes)
    assert call(capsys, "run", "show", "--journal", journal)[0] == 0
