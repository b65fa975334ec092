"""Marked places of a PDF page: its BleedBox, the extent of each layer, and its annotations.

Imported late, by ``document`` only: it needs PyMuPDF at import. Rectangles are in points from the top-left
corner of the printed part, and may reach beyond it.
"""

from __future__ import annotations

from typing import Any, Final

import pymupdf
from pymupdf import mupdf

MOST: Final = 1000
"""Most layers, and annotations, of one page that are listed."""
NAMES: Final = ("NM", "T", "Subj")
"""Entries of an annotation with its names (ISO 32000-2, 12.5.2 and 12.5.6.2)."""
NOT_PRINTED: Final = 2 | 32
"""Flags of annotations that are not printed: hidden, no view."""


def page_marks(page: Any, corner: tuple[float, float]) -> dict[str, Any]:
    """Return the marked places of a ``mupdf.PdfPage``, for JSON; ``corner`` is x, y of the printed part."""
    return {
        "bleed": _bleed(page, corner),
        "layers": [[name, _from(corner, box)] for name, box in _layers(page).items()][:MOST],
        "annotations": [[names, _from(corner, box)] for names, box in _annotations(page)][:MOST],
    }


def _from(corner: tuple[float, float], box: Any) -> list[float]:
    x, y = corner
    return [float(box[0] - x), float(box[1] - y), float(box[2] - x), float(box[3] - y)]


def _bleed(page: Any, corner: tuple[float, float]) -> list[float] | None:
    if mupdf.pdf_is_null(mupdf.pdf_dict_gets(page.obj(), "BleedBox")):
        return None
    box = mupdf.pdf_bound_page(page, mupdf.FZ_BLEED_BOX)
    return _from(corner, (box.x0, box.y0, box.x1, box.y1))


def _layers(page: Any) -> dict[str, list[float]]:
    """Return the bounding box of all that each layer draws, by its name."""
    boxes: dict[str, list[float]] = {}
    seen: list[Any] = []
    device = pymupdf.JM_new_bbox_device(seen, True)
    mupdf.fz_run_page(mupdf.FzPage(page), device, mupdf.FzMatrix(), mupdf.FzCookie())
    mupdf.fz_close_device(device)
    for _, box, name in seen:
        if not name or box[0] >= box[2] or box[1] >= box[3]:
            continue
        had = boxes.setdefault(str(name), list(box))
        had[:] = min(had[0], box[0]), min(had[1], box[1]), max(had[2], box[2]), max(had[3], box[3])
    return boxes


def _annotations(page: Any) -> list[tuple[list[str], list[float]]]:
    boxes: list[tuple[list[str], list[float]]] = []
    for first, following in (
        (mupdf.pdf_first_annot, mupdf.pdf_next_annot),
        (mupdf.pdf_first_widget, mupdf.pdf_next_widget),
    ):
        annotation = first(page)
        while annotation.m_internal and len(boxes) < MOST:
            if not mupdf.pdf_annot_flags(annotation) & NOT_PRINTED:
                box = mupdf.pdf_bound_annot(annotation)
                boxes.append((_names(annotation), [box.x0, box.y0, box.x1, box.y1]))
            annotation = following(annotation)
    return boxes


def _names(annotation: Any) -> list[str]:
    sort = mupdf.pdf_string_from_annot_type(mupdf.pdf_annot_type(annotation))
    annotation_object = mupdf.pdf_annot_obj(annotation)
    names = [mupdf.pdf_to_text_string(mupdf.pdf_dict_gets(annotation_object, key)) for key in NAMES]
    return list(dict.fromkeys(name for name in (str(sort), *names) if name))
