"""Resources that a PDF page is drawn with: those of its contents and of all that these draw (ISO 32000-2, 7.8.3).

Imported late, by ``document`` and what it uses only: it needs PyMuPDF at import.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from pymupdf import mupdf

CATEGORIES: Final = ("ColorSpace", "ExtGState", "Font", "Pattern", "Properties", "Shading", "XObject")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Resource:
    """One object that a page uses, and its position in the document."""

    category: str
    """One of ``CATEGORIES``; colour spaces of images, groups and shadings count as well."""
    name: str
    """Name by which it is used; if it has no name of its own, that of its user."""
    pdf_object: Any
    """The object, a ``mupdf.PdfObj``."""
    holder: Any
    """The dictionary that contains it."""
    key: Any
    """Its key in the dictionary (``mupdf.PdfObj``); names are bytes, and not all are text."""

    def replace(self, pdf_object: Any) -> None:
        """Replace the object by another, in memory."""
        mupdf.pdf_dict_put(self.holder, self.key, pdf_object)


def page_resources(page: Any) -> Iterator[Resource]:
    """Yield all that a page (its dictionary, ``mupdf.PdfObj``) and its drawing use, each indirect object once.

    A yielded object may be replaced before the next is requested; the replacement is then followed.
    """
    seen = set[int]()
    waiting = [get(page, "Resources", inherited=True)]
    waiting += [entry for annotation in items(get(page, "Annots")) for entry in _appearances(annotation)]
    yield from _stands_in(get(page, "Group"), "CS", "ColorSpace", "Group")
    while waiting:
        resources = waiting.pop()
        if resources is None or _again(resources, seen):
            continue
        for category in CATEGORIES:
            holder = get(resources, category)
            for key, pdf_object in entries(holder):
                if _again(pdf_object, seen):
                    continue
                name = name_of(key)
                yield Resource(category=category, name=name, pdf_object=pdf_object, holder=holder, key=key)
                pdf_object = mupdf.pdf_dict_get(holder, key)
                for used in _used_by(category, name, pdf_object):
                    if not _again(used.pdf_object, seen):
                        yield used
                waiting += _own_resources(category, pdf_object)


def _used_by(category: str, name: str, pdf_object: Any) -> Iterator[Resource]:
    """Yield colour spaces, masks and layers that a resource itself contains."""
    if category in ("XObject", "Pattern", "Shading"):
        for holder, key, what in (
            (pdf_object, "ColorSpace", "ColorSpace"),
            (get(pdf_object, "Shading"), "ColorSpace", "ColorSpace"),
            (get(pdf_object, "Group"), "CS", "ColorSpace"),
            (pdf_object, "SMask", "XObject"),
            (pdf_object, "OC", "Properties"),
            (pdf_object, "ExtGState", "ExtGState"),
        ):
            yield from _stands_in(holder, key, what, name)
    elif category == "ExtGState":
        yield from _stands_in(get(get(get(pdf_object, "SMask"), "G"), "Group"), "CS", "ColorSpace", name)


def _stands_in(holder: Any, key: str, category: str, name: str) -> Iterator[Resource]:
    pdf_object = get(holder, key)
    if pdf_object is not None:
        yield Resource(
            category=category, name=name, pdf_object=pdf_object, holder=holder, key=mupdf.pdf_new_name(key)
        )


def _own_resources(category: str, pdf_object: Any) -> list[Any]:
    """Return the resources of the content of a form, a pattern, a soft mask or a Type 3 font."""
    content = get(get(pdf_object, "SMask"), "G") if category == "ExtGState" else pdf_object
    return [get(content, "Resources")] if category in ("XObject", "Pattern", "ExtGState", "Font") else []


def _appearances(annotation: Any) -> list[Any]:
    """Return the resources of all normal appearances of an annotation."""
    normal = get(get(annotation, "AP"), "N")
    states = [value for _, value in entries(normal)]
    return [get(normal, "Resources"), *(get(state, "Resources") for state in states)]


def get(holder: Any, key: str, *, inherited: bool = False) -> Any:
    """Return an entry of a dictionary, or of a page with its parents; None if there is none, or it is no dictionary."""
    if holder is None or not mupdf.pdf_is_dict(holder):
        return None
    value = (mupdf.pdf_dict_gets_inheritable if inherited else mupdf.pdf_dict_gets)(holder, key)
    return None if mupdf.pdf_is_null(value) else value


def entries(holder: Any) -> list[tuple[Any, Any]]:
    """Return keys and values of a dictionary; none if it is no dictionary."""
    if holder is None or not mupdf.pdf_is_dict(holder):
        return []
    count = mupdf.pdf_dict_len(holder)
    return [(mupdf.pdf_dict_get_key(holder, i), mupdf.pdf_dict_get_val(holder, i)) for i in range(count)]


def items(array: Any) -> list[Any]:
    """Return the elements of an array; none if it is no array."""
    if array is None or not mupdf.pdf_is_array(array):
        return []
    return [mupdf.pdf_array_get(array, i) for i in range(mupdf.pdf_array_len(array))]


def name_of(pdf_object: Any) -> str:
    """Return a name as text, empty if it is no name; bytes that are no UTF-8 are surrogates."""
    return (
        str(mupdf.pdf_to_name(pdf_object)) if pdf_object is not None and mupdf.pdf_is_name(pdf_object) else ""
    )


def shown_name(name: str) -> str:
    """Return a name as it can be printed, in one line."""
    text = name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _again(pdf_object: Any, seen: set[int]) -> bool:
    """Return whether an indirect object has been seen before, and mark it as seen."""
    number = mupdf.pdf_to_num(pdf_object)
    if number in seen:
        return True
    if number:
        seen.add(number)
    return False
