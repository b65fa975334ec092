"""The study of RIPs: ours is right on every case, and the page says so."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from prooflight_studies.rip.cases import CASES, case_pdf
from prooflight_studies.rip.study import is_right, middle_of_ours, run_rip_study

if TYPE_CHECKING:
    from pathlib import Path


def test_ours_prints_what_the_specification_says(tmp_path: Path) -> None:
    for case in CASES:
        pdf = tmp_path / "case.pdf"
        pdf.write_bytes(case_pdf(case))
        assert is_right(middle_of_ours(pdf), case.inks), case.name


@pytest.mark.skipif(shutil.which("gs") is None, reason="Ghostscript is not installed")
def test_the_page_names_each_case(tmp_path: Path) -> None:
    found = run_rip_study(tmp_path, most=3)
    assert [row.name for row in found.rows] == [case.name for case in CASES[:3]]
    assert found.ours_right == found.ghostscript_right == 3
    page = (tmp_path / "rip.md").read_text()
    assert all(f"| {row.name} |" in page for row in found.rows)
    assert "**Ours prints 3 of 3 right, Ghostscript 3**" in page
