"""Facts of a PDF and of its pages (``facts``).

Of the whole: its output intent (PDF/X), its records (PDF/VT), the spectra of its spot inks (CxF/X-4). Of a page: facts
from its resources and its drawing calls, and swatches of its spot colours.

Used only in the process that rips (``worker``): it needs PyMuPDF at import. Nothing is drawn from this document, so
that its names are those of its file.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from math import hypot
from pathlib import Path
from typing import Any, Final

from pymupdf import mupdf

from prooflight.pages.pdf.resources import entries, get, items, name_of, page_resources, shown_name
from prooflight.pages.pdf.rip import SWATCHES_A_PAGE
from prooflight.pages.pdf.tints import tint_arrays
from prooflight.pages.raster import POINTS_PER_INCH

PROCESS: Final = ("Cyan", "Magenta", "Yellow", "Black")
NO_INK: Final = ("All", "None")
MOST: Final = 1000
"""Most fonts, images, layers and spot colours of a page that are listed."""
SWATCH_POINTS: Final = 6.0
_FONT_FILES: Final = ("FontFile", "FontFile2", "FontFile3")
_COLOURED: Final = {"fill_path": 3, "stroke_path": 3, "fill_text": 2, "stroke_text": 3}
"""Drawing calls with a colour, and the index of the colour space among their arguments, before colour and
alpha."""


def page_facts(page: Any, box: str) -> dict[str, Any]:
    """Return facts of a ``mupdf.PdfPage`` whose ``box`` is printed, in the form of JSON (``facts.PageFacts``)."""
    drawn = DrawnFacts()
    mupdf.pdf_run_page_with_usage(page, drawn, mupdf.FzMatrix(), "Print", mupdf.FzCookie())
    mupdf.fz_close_device(drawn)
    layers, spots = dict[str, bool](), dict[str, None]()
    fonts = dict[tuple[Any, ...], dict[str, Any]]()
    for resource in page_resources(page.obj()):
        if resource.category == "Properties":
            layers |= _layers(page.doc(), resource.pdf_object)
        elif resource.category == "Font":
            font = _font(resource.pdf_object, resource.name)
            fonts[tuple(font.values())] = font
        elif resource.category == "ColorSpace":
            spots |= dict.fromkeys(_spots(resource.pdf_object))
    return {
        "box": box,
        "output_intent": _output_intent(page),
        "transparency": list(drawn.transparency),
        "overprint": list(drawn.overprint),
        "layers": [{"name": name, "printed": printed} for name, printed in layers.items()][:MOST],
        "fonts": list(fonts.values())[:MOST],
        "images": drawn.images[:MOST],
        "spots": [{"name": shown_name(name), "painted": name in drawn.colorants} for name in spots][:MOST],
    }


class DrawnFacts(mupdf.FzDevice2):  # type: ignore[misc]
    """Device that records what is drawn on a page, and paints nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.transparency: dict[str, None] = {}
        self.overprint: dict[str, None] = {}
        self.colorants: dict[str, None] = {}
        """Colorants of the Separation and DeviceN spaces in which anything is painted."""
        self.images: list[dict[str, Any]] = []
        for name in (*_COLOURED, "fill_shade", "fill_image", "fill_image_mask", "begin_mask", "begin_group"):
            getattr(self, f"use_virtual_{name}")()

    def fill_shade(self, _context: Any, shade: Any, _ctm: Any, alpha: float, parameters: Any) -> None:
        """Record a gradient."""
        self.take_in(shade.colorspace, alpha, parameters)

    def fill_image(self, _context: Any, image: Any, ctm: Any, alpha: float, parameters: Any) -> None:
        """Record an image."""
        self.take_in(image.colorspace, alpha, parameters)
        if image.mask:
            self.transparency["soft mask"] = None
        self._place(image, ctm)

    def fill_image_mask(
        self, _context: Any, image: Any, ctm: Any, space: Any, _colour: Any, alpha: float, parameters: Any
    ) -> None:
        """Record a stencil."""
        self.take_in(space, alpha, parameters)
        self._place(image, ctm)

    def begin_mask(self, _context: Any, *_: Any) -> None:
        """Record a soft mask."""
        self.transparency["soft mask"] = None

    def begin_group(
        self, _context: Any, _area: Any, _space: Any, _isolated: int, _knockout: int, mode: int, alpha: float
    ) -> None:
        """Record a transparency group."""
        if mode:
            self.transparency[f"blend mode {mupdf.fz_blendmode_name(mode)}"] = None
        self._translucent(alpha)

    def take_in(self, space: Any, alpha: float, parameters: Any) -> None:
        """Record the colour space (low level), opacity and overprint of whatever is painted."""
        self._translucent(alpha)
        if parameters.op:
            self.overprint[f"mode {parameters.opm}"] = None
        if space and mupdf.ll_fz_colorspace_is_indexed(space):
            space = mupdf.ll_fz_base_colorspace(space)
        if space and mupdf.ll_fz_colorspace_is_device_n(space):
            for i in range(space.n):
                with contextlib.suppress(UnicodeDecodeError):  # a name that is no text
                    self.colorants[mupdf.ll_fz_colorspace_colorant(space, i)] = None

    def _translucent(self, alpha: float) -> None:
        if alpha < 1:
            self.transparency["alpha"] = None

    def _place(self, image: Any, ctm: Any) -> None:
        across, along = hypot(ctm.a, ctm.b), hypot(ctm.c, ctm.d)
        space = image.colorspace
        self.images.append(
            {
                "width_px": image.w,
                "height_px": image.h,
                "bits": image.bpc,
                "colours": "stencil" if not space else _colours(space),
                "dpi": [
                    round(POINTS_PER_INCH * pixels / side, 1) if side > 0 else 0.0
                    for pixels, side in ((image.w, across), (image.h, along))
                ],
            }
        )


def _painting(place: int) -> Any:
    def paint(self: DrawnFacts, _context: Any, *arguments: Any) -> None:
        self.take_in(arguments[place], arguments[place + 2], arguments[-1])

    return paint


for _name, _place in _COLOURED.items():
    setattr(DrawnFacts, _name, _painting(_place))


def _colours(space: Any) -> str:
    with contextlib.suppress(UnicodeDecodeError):
        return shown_name(str(mupdf.ll_fz_colorspace_name(space)))
    return f"{space.n} colorants"


def _output_intent(page: Any) -> str:
    """Return the first intent with a profile of inks, of the page or else of its document; else the first of all."""
    root = get(mupdf.pdf_trailer(page.doc()), "Root")
    stated = [intent for holder in (page.obj(), root) for intent in items(get(holder, "OutputIntents"))]
    ordered = sorted(stated, key=lambda intent: _profile_colours(intent) != 4)
    for intent in ordered:
        texts = (mupdf.pdf_to_text_string(one) for key in _CONDITION if (one := get(intent, key)) is not None)
        name = next(filter(None, texts), name_of(get(intent, "S")))
        colours = {1: "grey", 3: "RGB", 4: "CMYK"}.get(_profile_colours(intent), "no profile")
        return f"{shown_name(name)} ({colours})"
    return ""


_CONDITION: Final = ("OutputConditionIdentifier", "OutputCondition", "Info")


def _profile_colours(intent: Any) -> int:
    """Return the number of colorants of an output intent's profile; 0 if it has none."""
    profile = get(intent, "DestOutputProfile")
    return mupdf.pdf_to_int(get(profile, "N")) if profile is not None else 0


def _layers(document: Any, pdf_object: Any) -> Iterator[tuple[str, bool]]:
    """Yield names of optional-content groups that a property list represents, and whether they are printed."""
    groups = [pdf_object] if name_of(get(pdf_object, "Type")) == "OCG" else items(get(pdf_object, "OCGs"))
    groups = groups or [one for one in (get(pdf_object, "OCGs"),) if one is not None]
    for group in groups:
        name = get(group, "Name")
        if name is not None:
            yield shown_name(mupdf.pdf_to_text_string(name)), _printed(document, group)


def _printed(document: Any, group: Any) -> bool:
    """Return whether a layer is printed (ISO 32000-2, 8.11.4.3): its state, unless an event of printing
    changes that.
    """
    root = get(mupdf.pdf_trailer(document), "Root")
    config = get(get(root, "OCProperties"), "D")
    number = mupdf.pdf_to_num(group)

    def among(array: Any) -> bool:
        return any(mupdf.pdf_to_num(one) == number for one in items(array))

    printed = name_of(get(config, "BaseState")) != "OFF"
    printed = (printed or among(get(config, "ON"))) and not among(get(config, "OFF"))
    for event in items(get(config, "AS")):
        categories = [name_of(one) for one in items(get(event, "Category"))]
        if name_of(get(event, "Event")) == "Print" and "Print" in categories and among(get(event, "OCGs")):
            state = name_of(get(get(get(group, "Usage"), "Print"), "PrintState"))
            printed = state == "ON" if state else printed
    return printed


def _font(font: Any, name: str) -> dict[str, Any]:
    kind = name_of(get(font, "Subtype"))
    described = (items(get(font, "DescendantFonts")) or [font])[0]
    descriptor = get(described, "FontDescriptor")
    embedded = kind == "Type3" or any(get(descriptor, key) is not None for key in _FONT_FILES)
    return {"name": shown_name(name_of(get(font, "BaseFont")) or name), "kind": kind, "embedded": embedded}


def _spots(space: Any) -> Iterator[str]:
    """Yield the colorants of a colour space that are no process inks."""
    for array in tint_arrays(space):
        for name in _colorants(array):
            if name and name not in (*PROCESS, *NO_INK):
                yield name


def _colorants(array: Any) -> list[str]:
    """Return the names of a Separation or DeviceN array."""
    given = mupdf.pdf_array_get(array, 1)
    return [name_of(one) for one in items(given)] or [name_of(given)]


def write_swatches(page: Any, path: Path) -> list[str]:
    """Write a PDF of swatches, one a spot colour of a page, and return their names in order.

    Each swatch is full, with the other colorants of its space at 0. They are in rows, ``SWATCHES_A_PAGE`` on
    a page. The print of the swatches by the RIP is the print of these colours.
    """
    spots = dict(list(_spot_spaces(page).items())[:MOST])
    document = mupdf.pdf_create_document()
    copied = mupdf.pdf_new_graft_map(document)
    root = get(mupdf.pdf_trailer(page.doc()), "Root")
    _copy_intents(root, get(mupdf.pdf_trailer(document), "Root"), copied)
    spaces = list(spots.values())
    for first in range(0, len(spaces), SWATCHES_A_PAGE):
        listed = mupdf.pdf_new_dict(document, SWATCHES_A_PAGE)
        paints = []
        for number, (array, inputs, place) in enumerate(spaces[first : first + SWATCHES_A_PAGE]):
            key = f"S{number}"
            mupdf.pdf_dict_put(listed, mupdf.pdf_new_name(key), mupdf.pdf_graft_mapped_object(copied, array))
            tints = " ".join("1" if i == place else "0" for i in range(inputs))
            side = f"{SWATCH_POINTS:g}"
            paints.append(f"/{key} cs {tints} scn {number * SWATCH_POINTS:g} 0 {side} {side} re f")
        resources = mupdf.pdf_new_dict(document, 1)
        mupdf.pdf_dict_put(resources, mupdf.pdf_new_name("ColorSpace"), listed)
        box = mupdf.FzRect(0, 0, SWATCHES_A_PAGE * SWATCH_POINTS, SWATCH_POINTS)
        content = mupdf.fz_new_buffer_from_copied_data("\n".join(paints).encode())
        added_page = mupdf.pdf_add_page(document, box, 0, resources, content)
        _copy_intents(page.obj(), added_page, copied)
        mupdf.pdf_insert_page(document, -1, added_page)
    mupdf.pdf_save_document(document, str(path), mupdf.PdfWriteOptions())
    return [shown_name(name) for name in spots]


def _spot_spaces(page: Any) -> dict[str, tuple[Any, int, int]]:
    """Return for each spot colour the space of fewest colorants, their number, and its index among them."""
    spots: dict[str, tuple[Any, int, int]] = {}
    for resource in page_resources(page.obj()):
        if resource.category == "ColorSpace":
            for array in tint_arrays(resource.pdf_object):
                names = _colorants(array)
                for place, name in enumerate(names):
                    better = name not in spots or len(names) < spots[name][1]
                    if better and name and name not in (*PROCESS, *NO_INK):
                        spots[name] = array, len(names), place
    return spots


def _copy_intents(holder: Any, target: Any, copied: Any) -> None:
    intents = get(holder, "OutputIntents")
    if intents is not None:
        key = mupdf.pdf_new_name("OutputIntents")
        mupdf.pdf_dict_put(target, key, mupdf.pdf_graft_mapped_object(copied, intents))


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
