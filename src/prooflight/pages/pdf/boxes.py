"""Places of a PDF page: its printed part (ISO 32000-2, 14.11.2), and what is marked on it.

Boxes, turn and unit are refused if they are invalid: MuPDF takes 612 x 792 points where a MediaBox is, and a page of
another size would be inspected as if it were sound. Marked are its BleedBox, the extent of each layer, and its
annotations, in points from the top-left corner of the printed part; they may reach beyond it.

Imported late, by ``document`` only: it needs PyMuPDF at import.
"""

from __future__ import annotations

import math
from typing import Any, Final

import pymupdf
from pymupdf import mupdf

EXTENT_MAX: Final = 1e6
"""Largest coordinate; beyond, MuPDF's single precision is off by a sixteenth of a point. [points]"""
Box = tuple[float, float, float, float]


class BoxError(ValueError):
    """A page does not define its printed part; the message states why."""


def printed_box(page: Any) -> tuple[Any, list[str]]:
    """Return the printed part of a page (``mupdf.PdfPage``) as a ``mupdf.FzRect``, and warnings.

    It is the TrimBox, else the CropBox, else the MediaBox; one of the first two without any area is ignored.
    BoxError: one of them, or the page's turn or unit, is invalid.
    """
    media = _box(page, "MediaBox", inherited=True)
    if media is None:
        raise BoxError("has no MediaBox")
    if _is_empty(media):
        raise BoxError(f"has a MediaBox of {media[2] - media[0]:g} x {media[3] - media[1]:g} points")
    passed_over = []
    for name, following in (("CropBox", "MediaBox"), ("TrimBox", "CropBox")):
        box = _box(page, name, inherited=name == "CropBox")
        if box is None:
            continue
        if _is_empty(box):
            instead = _get(page, following, inherited=True)
            if mupdf.pdf_is_null(instead):
                instead = _get(page, "MediaBox", inherited=True)
            mupdf.pdf_dict_puts(page.obj(), name, instead)
            passed_over.append(f"its {name} has no area, and the next larger box is printed: set the {name}")
        elif not _overlap(box, media):
            raise BoxError(f"has a {name} outside its MediaBox")
    turn = mupdf.pdf_dict_gets_inheritable(page.obj(), "Rotate")
    degrees = 0.0 if mupdf.pdf_is_null(turn) else _number(turn, "Rotate")
    if degrees % 90:
        raise BoxError(f"is to be turned by {degrees:g} degrees: Rotate is a multiple of 90")
    unit = mupdf.pdf_dict_gets(page.obj(), "UserUnit")
    scale = 1.0 if mupdf.pdf_is_null(unit) else _number(unit, "UserUnit")
    if not 0 < scale <= EXTENT_MAX:
        raise BoxError(f"has a UserUnit of {scale:g}")
    trim = mupdf.pdf_bound_page(page, mupdf.FZ_TRIM_BOX)
    if not (0 < trim.x1 - trim.x0 <= EXTENT_MAX and 0 < trim.y1 - trim.y0 <= EXTENT_MAX):
        raise BoxError(f"is {trim.x1 - trim.x0:g} x {trim.y1 - trim.y0:g} points large")
    return trim, passed_over


def deciding_box(page: Any) -> str:
    """Name the box that ``printed_box`` will return: the first that has an area."""
    for name in ("TrimBox", "CropBox"):
        array = mupdf.pdf_dict_gets(page.obj(), name)
        if name == "CropBox":
            array = mupdf.pdf_dict_gets_inheritable(page.obj(), name)
        x0, y0, x1, y1 = (mupdf.pdf_to_real(mupdf.pdf_array_get(array, i)) for i in range(4))
        if x0 != x1 and y0 != y1:
            return name
    return "MediaBox"


def _box(page: Any, name: str, *, inherited: bool) -> Box | None:
    """Return a box with its corners in order; None if the page has none."""
    array = _get(page, name, inherited=inherited)
    if mupdf.pdf_is_null(array):
        return None
    if not mupdf.pdf_is_array(array) or mupdf.pdf_array_len(array) != 4:
        raise BoxError(f"has a {name} that is not of four numbers")
    x0, y0, x1, y1 = (_number(mupdf.pdf_array_get(array, i), name) for i in range(4))
    return min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)


def _get(page: Any, name: str, *, inherited: bool) -> Any:
    return (mupdf.pdf_dict_gets_inheritable if inherited else mupdf.pdf_dict_gets)(page.obj(), name)


def _is_empty(box: Box) -> bool:
    return box[0] >= box[2] or box[1] >= box[3]


def _number(pdf_object: Any, name: str) -> float:
    if not mupdf.pdf_is_number(pdf_object):
        raise BoxError(f"has a {name} that is not of numbers")
    value = float(mupdf.pdf_to_real(pdf_object))
    if not math.isfinite(value) or abs(value) > EXTENT_MAX:
        raise BoxError(f"has a {name} of {value:g}: at most {EXTENT_MAX:g}")
    return value


def _overlap(one: Box, other: Box) -> bool:
    return all(max(one[i], other[i]) < min(one[i + 2], other[i + 2]) for i in (0, 1))


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
