"""PDFs written by hand, so that a test says every operator and object that it depends on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


def pdf_bytes(objects: list[bytes], *, trailer: bytes = b"") -> bytes:
    """A PDF 1.7 file of numbered objects; the first is the catalogue."""
    out, offsets = bytearray(b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n"), []
    for number, body in enumerate(objects, 1):
        offsets.append(len(out))
        out += b"%d 0 obj\n" % number + body + b"\nendobj\n"
    start = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % offset for offset in offsets)
    out += b"trailer<</Size %d/Root 1 0 R%s>>\n" % (len(objects) + 1, trailer)
    return bytes(out) + b"startxref\n%d\n%%%%EOF\n" % start


def stream(data: bytes, entries: bytes = b"") -> bytes:
    return b"<<%s/Length %d>>stream\n" % (entries, len(data)) + data + b"\nendstream"


def one_page(
    content: str,
    *,
    resources: str = "",
    page: str = "/MediaBox[0 0 100 100]",
    catalogue: str = "",
    more: Any = (),
) -> bytes:
    """A PDF of one page, 100 by 100 points unless ``page`` says otherwise; ``more`` objects start at number 5."""
    return pdf_bytes(
        [
            f"<</Type/Catalog/Pages 2 0 R{catalogue}>>".encode(),
            b"<</Type/Pages/Kids[3 0 R]/Count 1>>",
            f"<</Type/Page/Parent 2 0 R/Contents 4 0 R/Resources<<{resources}>>{page}>>".encode(),
            stream(content.encode()),
            *more,
        ]
    )


@pytest.fixture
def write_pdf(tmp_path: Path) -> Callable[..., Path]:
    """Write a one-page PDF (arguments as ``one_page``) and return its path."""

    def write(content: str, **parts: Any) -> Path:
        path = tmp_path / "job.pdf"
        path.write_bytes(one_page(content, **parts))
        return path

    return write
