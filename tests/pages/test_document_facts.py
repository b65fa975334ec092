"""What a PDF says of itself as a whole: its printing condition (PDF/X), its records (PDF/VT), spectra of its inks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from prooflight.pages.job import open_job
from prooflight.press.print_condition import PrintCondition, condition_warnings

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.pages.pdf.facts import DocumentFacts


def pdf(path: Path, *, pages: int, catalogue: str = "", objects: dict[int, str] | None = None) -> Path:
    """Write a PDF of empty pages, which are objects 10, 11, ...; further objects have other numbers."""
    kids = " ".join(f"{10 + number} 0 R" for number in range(pages))
    every = {
        1: f"<< /Type /Catalog /Pages 2 0 R {catalogue} >>",
        2: f"<< /Type /Pages /Kids [{kids}] /Count {pages} >>",
        **{10 + number: "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 72 72] >>" for number in range(pages)},
        **(objects or {}),
    }
    data = b"%PDF-1.7\n"
    for number, text in every.items():
        data += f"{number} 0 obj\n{text}\nendobj\n".encode()
    path.write_bytes(data + b"trailer\n<< /Root 1 0 R >>\n%%EOF\n")
    return path


def facts(path: Path) -> DocumentFacts:
    with open_job(path, dpi=72) as job:
        found = job.document_facts()
    assert found is not None
    return found


INTENT = """/OutputIntents [
    << /Type /OutputIntent /S /GTS_PDFA1 /OutputConditionIdentifier (sRGB) >>
    << /Type /OutputIntent /S /GTS_PDFX /OutputConditionIdentifier (FOGRA51) /SpectralData << /Orange#20021 50 0 R >> >>
]"""


def test_the_condition_of_pdf_x_and_spectra_are_read(tmp_path: Path) -> None:
    cxf = "<CxF/>"
    stream = f"<< /Length {len(cxf)} >>\nstream\n{cxf}\nendstream"
    found = facts(pdf(tmp_path / "a.pdf", pages=1, catalogue=INTENT, objects={50: stream}))
    assert found.condition == "FOGRA51"
    assert found.spectra == {"Orange 021": "<CxF/>"}
    assert found.record_pages == ()
    plain = facts(pdf(tmp_path / "b.pdf", pages=1))
    assert (plain.condition, plain.spectra, plain.records_text) == ("", {}, "")


def tree(*records: tuple[int, int], level: str = "/RecordLevel 1") -> tuple[str, dict[int, str]]:
    """Return the parts of records, each from a first to a last page, from 0: entries of a file."""
    leaves = {
        40 + number: f"<< /Type /DPart /Parent 31 0 R /Start {10 + first} 0 R /End {10 + last} 0 R >>"
        for number, (first, last) in enumerate(records)
    }
    listed = " ".join(f"{number} 0 R" for number in leaves)
    root = f"<< /Type /DPartRoot /DPartRootNode 31 0 R {level} >>"
    return "/DPartRoot 30 0 R", {30: root, 31: f"<< /Type /DPart /DParts [[{listed}]] >>", **leaves}


def test_records_of_pdf_vt_are_counted(tmp_path: Path) -> None:
    catalogue, objects = tree((0, 1), (2, 3), (4, 5))
    even = facts(pdf(tmp_path / "even.pdf", pages=6, catalogue=catalogue, objects=objects))
    assert even.record_pages == (2, 2, 2)
    assert (even.pages_a_record, even.records_text) == (2, "3 records of 2 pages")
    catalogue, objects = tree((0, 0), (1, 5))
    uneven = facts(pdf(tmp_path / "uneven.pdf", pages=6, catalogue=catalogue, objects=objects))
    assert uneven.record_pages == (1, 5)
    assert (uneven.pages_a_record, uneven.records_text) == (None, "2 records of 1 to 5 pages")


def test_a_record_has_the_pages_of_all_its_parts(tmp_path: Path) -> None:
    objects = {
        30: "<< /DPartRootNode 31 0 R /RecordLevel 1 >>",
        31: "<< /DParts [[32 0 R 33 0 R]] >>",
        32: "<< /DParts [[41 0 R] [42 0 R]] >>",  # a cover of one page, and two more
        33: "<< /Start 13 0 R >>",
        41: "<< /Start 10 0 R >>",
        42: "<< /Start 11 0 R /End 12 0 R >>",
    }
    found = facts(pdf(tmp_path / "a.pdf", pages=4, catalogue="/DPartRoot 30 0 R", objects=objects))
    assert found.record_pages == (3, 1)


@pytest.mark.parametrize(
    "objects",
    [
        tree((0, 1), level="")[1],  # which level is of records is not said
        tree((0, 1), level="/RecordLevel 0")[1] | {31: "<< /DParts [[31 0 R]] >>"},  # a part of itself
        tree((1, 0))[1],  # it ends before it begins
        tree((0, 30))[1],  # its last page is none
        tree((0, 1), level="/RecordLevel 7")[1],
    ],
)
def test_parts_that_make_no_records_are_none(tmp_path: Path, objects: dict[int, str]) -> None:
    path = pdf(tmp_path / "a.pdf", pages=2, catalogue="/DPartRoot 30 0 R", objects=objects)
    assert facts(path).record_pages == ()


def test_only_what_both_state_is_compared() -> None:
    press = PrintCondition(name="FOGRA51", brand="Gloss Art", weight_gsm=135.0)
    assert list(press.differences(PrintCondition())) == []
    assert list(press.differences(PrintCondition(name="Fogra 51", brand="gloss-art", weight_gsm=130.0))) == []
    assert list(PrintCondition().differences(press)) == []
    other = list(press.differences(PrintCondition(name="FOGRA39", brand="Plain", weight_gsm=80.0)))
    assert [each.partition(":")[0] for each in other] == [
        "the job is made for FOGRA39, and this press is characterised for FOGRA51",
        "the ticket asks for Plain, and this press is characterised on Gloss Art",
        "the ticket asks for 80 g/m2, and this press is characterised on 135 g/m2",
    ]
    assert PrintCondition.of_origin(press.facts) == press


def test_a_job_for_another_condition_is_warned_of(tmp_path: Path) -> None:
    path = pdf(tmp_path / "a.pdf", pages=1, catalogue=INTENT)
    with open_job(path, dpi=72) as job:
        (warning,) = condition_warnings(job, PrintCondition(name="FOGRA52"))
    assert (warning.page, warning.kind) == (-1, "print-condition")
    assert "made for FOGRA51" in warning.message
