"""The study of RIPs: ours is right on every case, and the page says so."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from prooflight.errors import RequestError
from prooflight_studies.rip.cases import CASES, case_pdf
from prooflight_studies.rip.handed import HANDED, handed_rows
from prooflight_studies.rip.study import difference, is_right, middle_of_prooflight, page_row, run_rip_study

HANDED_PDFS = Path(__file__).resolve().parents[3] / ".." / "shared" / "pdf_cases"
needs_ghostscript = pytest.mark.skipif(shutil.which("gs") is None, reason="Ghostscript is not installed")


def test_ours_prints_what_the_specification_says(tmp_path: Path) -> None:
    for case in CASES:
        pdf = tmp_path / "case.pdf"
        pdf.write_bytes(case_pdf(case))
        assert is_right(middle_of_prooflight(pdf), case.inks), case.name


@needs_ghostscript
def test_the_page_names_each_case(tmp_path: Path) -> None:
    found = run_rip_study(tmp_path, most=3)
    assert [row.name for row in found.rows] == [case.name for case in CASES[:3]]
    assert found.ours_right == found.ghostscript_right == 3
    page = (tmp_path / "rip.md").read_text()
    assert all(f"| {row.name} |" in page for row in found.rows)
    assert "**Our RIP renders 3 of 3 pages correctly, Ghostscript 3**" in page


@pytest.mark.skipif(not HANDED_PDFS.is_dir(), reason="needs the PDFs in ../shared/pdf_cases")
def test_handed_cases_print_right() -> None:
    rows = handed_rows(HANDED_PDFS, None)
    assert [row.number for row in rows] == [case.number for case in HANDED]
    wrong = [row for row in rows if not row.is_right]
    assert {row.number for row in wrong} <= {"07"}  # its value is that of Ghostscript's own profile


def test_a_handed_case_that_prints_wrong_is_seen(tmp_path: Path) -> None:
    (tmp_path / "01a_other.pdf").write_bytes(case_pdf(CASES[0]))
    (tmp_path / "03a_sound.pdf").write_bytes(case_pdf(CASES[0]))
    (tmp_path / "04a_refused.pdf").write_bytes(b"%PDF-1.7 of no use")
    rows = {row.number: row for row in handed_rows(tmp_path, None)}
    assert not any(row.is_right for row in rows.values())
    assert rows["01a"].after == "51 102 153 204"
    assert rows["04a"].after == "page-refused"


def test_a_folder_without_handed_cases_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="no PDF of a known case"):
        handed_rows(tmp_path, None)


def test_what_differs_away_from_edges() -> None:
    ours = np.zeros((50, 50, 4), np.uint8)
    ours[:, 25:] = 200
    theirs = ours.copy()
    theirs[:, 25] = 0  # an edge half a pixel away
    shares, even, largest = difference(ours, theirs)
    assert shares == pytest.approx((2.0,) * 4)
    assert (even, largest) == (0.0, (0, 0, 0, 0))
    theirs[:, 40:, 1] = 180
    shares, even, largest = difference(ours, theirs)
    assert shares[1] == pytest.approx(22.0)
    assert even == pytest.approx(19.5, abs=0.1)  # 8 of 41 columns, without those beside the edges
    assert largest == (0, 20, 0, 0)


@needs_ghostscript
def test_a_public_page_by_both_engines(tmp_path: Path) -> None:
    path = tmp_path / "page.pdf"
    path.write_bytes(case_pdf(CASES[0]))
    row = page_row(path, None)
    assert (row.even_differ_percent, row.refused) == (0.0, "")
    assert max(row.differ_percent) < 2.0  # half a pixel at the page's own edge
    path.write_bytes(b"%PDF-1.7 of no use")
    assert page_row(path, None).refused.startswith("mupdf: ")
