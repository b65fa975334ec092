"""``prooflight watch`` reports warnings of a job, and records them."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import pytest
from tests.cli.calls import call
from tests.cli.warning_jobs import rows_of, two_pages

from prooflight.pages import check
from prooflight.simulation import ring
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from pathlib import Path


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
