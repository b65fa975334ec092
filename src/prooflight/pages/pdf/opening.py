"""Opening of a PDF, refused if it is encrypted, truncated, or no PDF at all.

Imported late, by ``document`` only: it needs PyMuPDF at import.
"""

from __future__ import annotations

import mmap
import re
from typing import TYPE_CHECKING, Any, BinaryIO, Final

import pymupdf

from prooflight.errors import JobError

if TYPE_CHECKING:
    from pathlib import Path

AGAIN: Final = "export or copy it again"
END: Final = b"%%EOF"
READ_BYTES: Final = 1024
"""Distance from the end of the file within which MuPDF looks for the end of a PDF."""
_FOR_CERTIFICATES: Final = re.compile(rb"/SubFilter\s*/adbe\.pkcs7\.s[345]\b")
"""Entry of an encryption dictionary, which is itself never encrypted (ISO 32000-2, 7.6.5)."""
_OBJECT: Final = re.compile(rb"[0-9]\s+[0-9]+\s+obj\b")


def open_document(path: Path, shown: str) -> Any:
    """Open a ``pymupdf.Document``; ``shown`` is its name in errors. JobError: encrypted or truncated."""
    with path.open("rb") as file:
        end = _end_of_pdf(file)
        try:
            if not end:
                document = pymupdf.Document(_name_for_mupdf(path, file), filetype="pdf")
            else:
                file.seek(0)
                document = pymupdf.Document(stream=file.read(end), filetype="pdf")
        except Exception:
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                if not _FOR_CERTIFICATES.search(data):
                    raise
            what = "the PDF is encrypted for the holders of certificates"
            raise JobError(shown, what, remedy="save it without encryption") from None
    if document.needs_pass:
        raise JobError(shown, "the PDF is encrypted", remedy="save it without a password")
    if document.is_repaired and end == 0:
        raise JobError(shown, "the PDF is truncated", remedy=AGAIN)
    return document


def _end_of_pdf(file: BinaryIO) -> int | None:
    """Return the end of a PDF that is followed by other bytes; None: at the end of its file; 0: it is truncated."""
    size = file.seek(0, 2)
    file.seek(max(0, size - READ_BYTES))
    if END in file.read():
        return None
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        end = data.rfind(END)
        return 0 if end < 0 or _OBJECT.search(data, end) else end + len(END)


def _name_for_mupdf(path: Path, file: BinaryIO) -> str:
    """Return a name that MuPDF can open: it takes names as UTF-8, which files need not have."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return f"/dev/fd/{file.fileno()}"
    return str(path)
