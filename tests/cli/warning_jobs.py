"""Jobs and a press that have warnings, for tests of the commands that report them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from tests.pages.conftest import pdf_bytes, stream

if TYPE_CHECKING:
    from pathlib import Path


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
