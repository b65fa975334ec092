"""``prooflight study tables``, as a user calls it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from tests.cli.calls import call

from prooflight.pages.files import write_tiff
from prooflight.press.press_file import PressFile

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import pytest

    from prooflight.pages.raster import Page


def test_study_tables_gives_its_rows(
    tmp_path: Path, make_page: Callable[..., Page], capsys: pytest.CaptureFixture[str]
) -> None:
    text = PressFile.prototype().text.replace("pixels = 2048 ", "pixels = 400 ")
    (tmp_path / "small.toml").write_text(text)
    write_tiff(make_page(3), tmp_path / "job" / "p0001.tif")
    given = ("--press-file", tmp_path / "small.toml", "--job", tmp_path / "job", "-o", tmp_path, "--json")
    code, out, _ = call(capsys, "study", "tables", *given)
    assert code == 0
    rows = json.loads(out)
    assert [row["colours"] for row in rows] == ["random and ramps", "job"]
    assert max(row["rms_sigma"] for row in rows) <= 0.10
    assert (tmp_path / "tables.md").is_file()
