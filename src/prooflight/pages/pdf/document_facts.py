"""Facts of a whole PDF: its output intent (PDF/X), its records (PDF/VT), the spectra of its spot inks (CxF/X-4).

Used only in the process that rips (``worker``): it needs PyMuPDF at import.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from pymupdf import mupdf

from prooflight.pages.pdf.resources import entries, get, items, name_of, shown_name

if TYPE_CHECKING:
    from collections.abc import Iterator

MOST_PARTS: Final = 2_000_000
"""Most nodes of a tree of document parts that are read."""
MOST_DEPTH: Final = 64
MOST_NAMED: Final = 1000
CXF_BYTES_MAX: Final = 4 * 2**20
"""Largest CxF of one ink, decompressed; one of 36 bands takes some 3 kB."""
CONDITION: Final = ("OutputConditionIdentifier", "OutputCondition", "Info")


def document_facts(document: Any) -> dict[str, Any]:
    """Return facts of a ``mupdf.PdfDocument`` in the form of JSON (``facts.DocumentFacts``)."""
    root = get(mupdf.pdf_trailer(document), "Root")
    intents = items(get(root, "OutputIntents"))[:MOST_NAMED]
    printing = next((one for one in intents if name_of(get(one, "S")) == "GTS_PDFX"), None)
    return {
        "condition": "" if printing is None else _condition(printing),
        "record_pages": _record_pages(document, get(root, "DPartRoot")),
        "spectra": dict(_spectra(document, intents)),
        "solidities": dict(_solidities(intents)),
    }


def _condition(intent: Any) -> str:
    """Return the printing condition that an output intent names (ISO 15930-7, 6.2.2)."""
    stated = (mupdf.pdf_to_text_string(one) for key in CONDITION if (one := get(intent, key)) is not None)
    return shown_name(next(filter(None, stated), ""))


def _record_pages(document: Any, root: Any) -> list[int]:
    """Return the number of pages of each record, in order; none: the file has no records.

    Records are the nodes of the tree of document parts at its ``RecordLevel``, counted from 0 at the root
    (ISO 16612-2, 6.5); leaves name their first and last page.
    """
    level_object = get(root, "RecordLevel")
    if level_object is None or not mupdf.pdf_is_int(level_object):
        return []
    level, pages, seen = mupdf.pdf_to_int(level_object), list[int](), set[int]()
    waiting = [(get(root, "DPartRootNode"), 0)]
    while waiting:
        node, depth = waiting.pop()
        number = 0 if node is None else mupdf.pdf_to_num(node)
        if node is None or depth > MOST_DEPTH or len(seen) > MOST_PARTS or (number and number in seen):
            return []
        seen.add(number or -len(seen) - 1)
        if depth == level:
            pages.append(0)
        first = get(node, "Start")
        if first is not None:
            if depth < level:  # pages outside all records
                return []
            last = get(node, "End")
            start = mupdf.pdf_lookup_page_number(document, first)
            end = start if last is None else mupdf.pdf_lookup_page_number(document, last)
            if start < 0 or end < start:
                return []
            pages[-1] += end - start + 1
        children = [child for row in items(get(node, "DParts")) for child in items(row)]
        waiting += [(child, depth + 1) for child in reversed(children)]
    return pages if all(pages) else []


def _spectra(document: Any, intents: list[Any]) -> Iterator[tuple[str, str]]:
    """Yield each spot ink for which an output intent holds spectral data, and its CxF as text (ISO 17972-4).

    ``SpectralData`` of PDF 2.0 (ISO 32000-2, 14.11.5) is a dictionary of streams by the names of colorants.
    """
    for intent in intents:
        for key, stream in entries(get(intent, "SpectralData")):
            if not mupdf.pdf_is_stream(stream):
                continue
            data = mupdf.pdf_load_stream(stream).fz_buffer_extract()
            if len(data) <= CXF_BYTES_MAX:
                yield shown_name(name_of(key)), bytes(data).decode("utf-8", "replace")


def _solidities(intents: list[Any]) -> Iterator[tuple[str, float]]:
    """Yield opacities, 0 to 1, of spot inks from the mixing hints of output intents (ISO 32000-2, table 73 and 401)."""
    for intent in intents:
        for key, value in entries(get(get(intent, "MixingHints"), "Solidities")):
            if mupdf.pdf_is_number(value) and 0 <= (solidity := float(mupdf.pdf_to_real(value))) <= 1:
                yield shown_name(name_of(key)), round(solidity, 6)  # MuPDF holds it in single precision
