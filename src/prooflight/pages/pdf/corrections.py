"""A document in memory, before a page is drawn: opened, in its state for printing, and corrected.

A file is refused if it is encrypted, truncated, or no PDF at all.

MuPDF hides layers (optional content, ISO 32000-2, 8.11) by a usage for printing although nothing requests that the
usage count, shows no layer that is printed only, evaluates no expressions, and takes most policies for others. The
state of each layer for printing is therefore computed here, and written into the document where MuPDF reads it. Other
places where MuPDF deviates from ISO 32000 are corrected likewise.

Imported late, by ``document`` only: it needs PyMuPDF at import.
"""

from __future__ import annotations

import io
import mmap
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Final

import pymupdf
from PIL import Image
from pymupdf import mupdf

from prooflight.errors import JobError
from prooflight.pages.pdf.resources import Resource, get, items, name_of, page_resources, shown_name
from prooflight.pages.pdf.tints import Tinted, TintSpaces

BLEND_MODES: Final = frozenset(
    [
        "Normal",
        "Compatible",
        "Multiply",
        "Screen",
        "Overlay",
        "Darken",
        "Lighten",
        "ColorDodge",
        "ColorBurn",
        "HardLight",
        "SoftLight",
        "Difference",
        "Exclusion",
        "Hue",
        "Saturation",
        "Color",
        "Luminosity",
    ]
)
LAB_RANGE: Final = (-100, 100, -100, 100)
"""Range of a* and b* for a space that states none (8.6.5.4)."""
_PRINTED: Final = 4
"""Flag of printed annotations (ISO 32000-2, 12.5.3)."""


@dataclass(slots=True, kw_only=True)
class PageContents:
    """Content of a page's resources that affects its print."""

    tinted: Tinted = field(default_factory=Tinted)
    fonts: list[Resource] = field(default_factory=list)
    images: list[Resource] = field(default_factory=list)
    transfers: list[str] = field(default_factory=list)
    """Names of graphics states with a transfer function."""
    text_knockout: bool = True
    """Whether glyphs knock each other out. False: a graphics state switches it off; MuPDF does not report
    for which texts."""


def correct_page(page: Any, tints: TintSpaces, layers: PrintedLayers) -> PageContents:
    """Correct a page (its dictionary, ``mupdf.PdfObj``), which must not have been loaded, and list what it uses."""
    for annotation in items(get(page, "Annots")):
        _let_links_print(annotation)
        layers.correct(get(annotation, "OC"))
    contents = PageContents()
    for resource in page_resources(page):
        pdf_object = resource.pdf_object
        if resource.category == "ColorSpace":
            tints.rename(pdf_object, contents.tinted)
        elif resource.category == "ExtGState":
            _choose_blend_mode(pdf_object)
            knockout = get(pdf_object, "TK")
            if knockout is not None and not mupdf.pdf_to_bool(knockout):
                contents.text_knockout = False
            if _has_transfer(pdf_object):
                contents.transfers.append(shown_name(resource.name))
        elif resource.category == "Properties":
            layers.correct(pdf_object)
        elif resource.category == "Shading":
            _drop_background(resource)
        elif resource.category == "Font":
            contents.fonts.append(resource)
        elif resource.category == "XObject" and name_of(get(pdf_object, "Subtype")) == "Image":
            _choose_alternate(resource)
            image = mupdf.pdf_dict_get(resource.holder, resource.key)
            filters = get(image, "Filter")
            if "JPXDecode" in [name_of(one) for one in items(filters) or [filters]]:
                _let_damage_show(image)
                _drop_unasked_alpha(image)
            _state_lab_decode(image)
            contents.images.append(resource)
    return contents


def _let_links_print(annotation: Any) -> None:
    """Make a link with an appearance an annotation like others (ISO 32000-2, 12.5.5), because MuPDF draws no links."""
    is_link = name_of(get(annotation, "Subtype")) == "Link" and get(get(annotation, "AP"), "N") is not None
    flags = get(annotation, "F")
    if is_link and flags is not None and mupdf.pdf_to_int(flags) & _PRINTED:
        mupdf.pdf_dict_puts(annotation, "Subtype", mupdf.pdf_new_name("Stamp"))


def _choose_blend_mode(state: Any) -> None:
    """Choose the first known mode in a list of blend modes (11.3.5), or Normal if none is known."""
    modes = get(state, "BM")
    if modes is not None and mupdf.pdf_is_array(modes):
        mode = next((mode for mode in map(name_of, items(modes)) if mode in BLEND_MODES), "Normal")
        mupdf.pdf_dict_puts(state, "BM", mupdf.pdf_new_name(mode))


def _has_transfer(state: Any) -> bool:
    """Return whether a graphics state has a transfer function other than the identity or the device's own (8.4.5)."""
    transfer = get(state, "TR2") or get(state, "TR")
    return transfer is not None and any(
        name_of(one) not in ("Identity", "Default") for one in items(transfer) or [transfer]
    )


def _drop_background(gradient: Resource) -> None:
    """Drop the background of a gradient that is painted by itself, because it applies only in a pattern (8.7.4.3)."""
    if get(gradient.pdf_object, "Background") is not None and not mupdf.pdf_is_stream(gradient.pdf_object):
        own = mupdf.pdf_copy_dict(gradient.pdf_object)  # a pattern may use the same gradient
        mupdf.pdf_dict_dels(own, "Background")
        gradient.replace(own)


def _choose_alternate(image: Resource) -> None:
    """Replace an image by the alternate that is made for printing (8.9.5.4)."""
    for alternate in items(get(image.pdf_object, "Alternates")):
        chosen, default = get(alternate, "Image"), get(alternate, "DefaultForPrinting")
        if chosen is not None and default is not None and mupdf.pdf_to_bool(default):
            image.replace(chosen)
            return


def _state_lab_decode(image: Any) -> None:
    """State that samples of a Lab image span the range of its space (8.9.5.2, table 88); MuPDF takes -128 to 127."""
    space = get(image, "ColorSpace")
    if space is None or name_of(mupdf.pdf_array_get(space, 0)) != "Lab" or get(image, "Decode") is not None:
        return
    stated = items(get(mupdf.pdf_array_get(space, 1), "Range")) or [mupdf.pdf_new_int(v) for v in LAB_RANGE]
    decode = mupdf.pdf_new_array(mupdf.pdf_get_bound_document(image), 6)
    for end in (mupdf.pdf_new_int(0), mupdf.pdf_new_int(100), *stated):
        mupdf.pdf_array_push(decode, end)
    mupdf.pdf_dict_puts(image, "Decode", decode)


def _let_damage_show(image: Any) -> None:
    """Change the kind of a JPEG 2000 image that MuPDF cannot open, so that it is not omitted but drawn as damaged."""
    try:
        mupdf.pdf_load_image(mupdf.pdf_get_bound_document(image), image)
    except mupdf.FzErrorBase:
        mupdf.pdf_dict_puts(image, "Filter", mupdf.pdf_new_name("DCTDecode"))
        mupdf.pdf_dict_dels(image, "DecodeParms")
        for key, usual in (
            ("Width", mupdf.pdf_new_int(1)),
            ("Height", mupdf.pdf_new_int(1)),
            ("BitsPerComponent", mupdf.pdf_new_int(8)),
            ("ColorSpace", mupdf.pdf_new_name("DeviceGray")),
        ):
            if get(image, key) is None:
                mupdf.pdf_dict_puts(image, key, usual)


def _drop_unasked_alpha(image: Any) -> None:
    """Drop the opacity of a JPEG 2000 image unless SMaskInData requests it (8.9.5.1)."""
    smask_in_data = get(image, "SMaskInData")
    if smask_in_data is not None and mupdf.pdf_to_int(smask_in_data):
        return
    try:
        data = bytes(mupdf.fz_buffer_extract_copy(mupdf.pdf_load_stream(image)))
        with Image.open(io.BytesIO(data), formats=["JPEG2000"]) as opened:
            if opened.mode not in ("LA", "RGBA"):
                return
            opaque = opened.convert("RGBA" if opened.mode == "RGBA" else "LA")
            bands = opaque.split()[:-1]
    except (OSError, ValueError, mupdf.FzErrorBase):
        return  # MuPDF will say that it cannot be decoded
    samples = Image.merge("RGB", bands) if len(bands) > 1 else bands[0]
    for key in ("Filter", "DecodeParms"):
        mupdf.pdf_dict_dels(image, key)
    if get(image, "ColorSpace") is None:
        space = "DeviceRGB" if len(bands) > 1 else "DeviceGray"
        mupdf.pdf_dict_puts(image, "ColorSpace", mupdf.pdf_new_name(space))
    mupdf.pdf_dict_puts(image, "BitsPerComponent", mupdf.pdf_new_int(8))
    mupdf.pdf_update_stream(
        mupdf.pdf_get_bound_document(image), image, mupdf.fz_new_buffer_from_copied_data(samples.tobytes()), 0
    )


DEPTH_MAX = 32
"""Deepest nesting of expressions of visibility."""


class PrintedLayers:
    """Layers of a document, with whether each is printed."""

    def __init__(self, document: Any) -> None:
        """Read ``document``, a ``mupdf.PdfDocument``, whose default configuration becomes that for printing."""
        properties = get(get(mupdf.pdf_trailer(document), "Root"), "OCProperties")
        groups, default = items(get(properties, "OCGs")), get(properties, "D")
        self._printed = dict.fromkeys(
            map(mupdf.pdf_to_num, groups), name_of(get(default, "BaseState")) != "OFF"
        )
        for key, printed in (("ON", True), ("OFF", False)):
            self._printed |= dict.fromkeys(map(mupdf.pdf_to_num, items(get(default, key))), printed)
        self._apply_usage(default)
        for group in groups:
            if not self._has_intent(group, default):
                self._printed[mupdf.pdf_to_num(group)] = True
        if groups and default is not None:
            self._write(document, default, groups)

    def correct(self, membership: Any) -> None:
        """Simplify a membership dictionary (8.11.2.2) to whether its content is printed."""
        if name_of(get(membership, "Type")) != "OCMD":
            return
        expression, given = get(membership, "VE"), get(membership, "OCGs")
        if expression is not None:
            printed = self._value(expression, DEPTH_MAX)
        else:
            states = [self._value(group, 1) for group in items(given) or [given] if group is not None]
            policy = name_of(get(membership, "P")) or "AnyOn"
            wanted = [state == policy.endswith("On") for state in states]
            printed = not states or (all(wanted) if policy.startswith("All") else any(wanted))
        for key in ("VE", "OCGs"):
            mupdf.pdf_dict_dels(membership, key)
        # Without groups, all of them are on, and not all of them are off.
        mupdf.pdf_dict_puts(membership, "P", mupdf.pdf_new_name("AnyOn" if printed else "AllOff"))

    def _apply_usage(self, default: Any) -> None:
        """Apply usage where an application dictionary names it for the event of printing (8.11.4.4)."""
        for asked in items(get(default, "AS")):
            if name_of(get(asked, "Event")) != "Print":
                continue
            for group in items(get(asked, "OCGs")):
                states = set[str]()
                for category in map(name_of, items(get(asked, "Category"))):
                    states.add(name_of(get(get(get(group, "Usage"), category), f"{category}State")))
                if states & {"ON", "OFF"}:
                    self._printed[mupdf.pdf_to_num(group)] = "OFF" not in states

    @staticmethod
    def _has_intent(group: Any, default: Any) -> bool:
        """Return whether a layer's state counts: one of its intents is one of the configuration's (8.11.2.1)."""

        def intents(holder: Any) -> set[str]:
            given = get(holder, "Intent")
            return {"View"} if given is None else {name_of(given), *map(name_of, items(given))} - {""}

        return "All" in intents(default) or bool(intents(group) & intents(default))

    def _write(self, document: Any, default: Any, groups: list[Any]) -> None:
        hidden = mupdf.pdf_new_array(document, len(groups))
        for group in groups:
            for key in ("Usage", "Intent"):
                mupdf.pdf_dict_dels(group, key)
            if not self._printed[mupdf.pdf_to_num(group)]:
                mupdf.pdf_array_push(hidden, group)
        for key in ("BaseState", "ON", "AS", "Intent"):
            mupdf.pdf_dict_dels(default, key)
        mupdf.pdf_dict_puts(default, "OFF", hidden)
        mupdf.pdf_select_layer_config(document, -1)  # it may have been read before

    def _value(self, expression: Any, depth: int) -> bool:
        """Return the value of an expression of visibility (8.11.2.2); a layer that is not listed is visible."""
        operands = items(expression)
        if not operands or not depth:
            return self._printed.get(mupdf.pdf_to_num(expression), True)
        values = [self._value(one, depth - 1) for one in operands[1:]]
        operator = name_of(operands[0])
        if operator == "Not":
            return not any(values)
        return any(values) if operator == "Or" else all(values)


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
