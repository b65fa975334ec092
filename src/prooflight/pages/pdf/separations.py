"""One PDF page to CMYK with MuPDF: overprint, spot colours, output intent and exact process values.

Imported late, by ``rip`` only: it needs PyMuPDF at import (``pip install "prooflight[pdf]"``).

MuPDF's own CMYK pixmap is not what a press prints: it ignores overprint and spot colours, and it truncates
colours to bytes (0.5 becomes 127). So every page is drawn with a separations object, which switches overprint on
and gives each spot colour a plate of its own, through ``PressDevice``, which rounds. The spot plates are then
merged: each is sent through its tint transform and added to the process plates, at most full ink. Adding is how
Ghostscript's ``tiffsep`` composite and MuPDF's overprint simulation merge plates; the standard leaves it open.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import ImageCms
from pymupdf import _mupdf, mupdf

from prooflight.pages.pdf.colour_management import Inks, fine_link
from prooflight.pages.pdf.device import INKS_MAX, PressDevice
from prooflight.pages.pdf.images import Raster

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

SPOTS_MAX = INKS_MAX - 4  # beside the process inks
BAND_ROWS = 64  # plates are merged in bands: that of an A4 page at 600 dpi stays in the processor's cache


class PlateError(ValueError):
    """A broken output profile, or more spot colours than MuPDF holds."""


def output_intent(page: Any) -> bytes:
    """The profile of the page's or else the document's output intent (ISO 32000-2, 14.11.5); empty: none."""
    document = mupdf.pdf_dict_gets(mupdf.pdf_trailer(page.doc()), "Root")
    for holder in (page.obj(), document):
        intents = mupdf.pdf_dict_gets(holder, "OutputIntents")
        for i in range(mupdf.pdf_array_len(intents)):
            profile = mupdf.pdf_dict_gets(mupdf.pdf_array_get(intents, i), "DestOutputProfile")
            if mupdf.pdf_is_stream(profile):
                return bytes(mupdf.fz_buffer_extract_copy(mupdf.pdf_load_stream(profile)))
    return b""


def icc_space(profile: bytes) -> Any:
    """A MuPDF colour space of an RGB or CMYK profile; PlateError if the profile cannot be used."""
    is_ink = profile[16:20] == b"CMYK"
    kind = mupdf.fz_device_cmyk() if is_ink else mupdf.fz_device_rgb()
    try:
        if is_ink:
            fine_link(None, profile, mode="LAB", intent=1, black_point=True)
        data = mupdf.fz_new_buffer_from_copied_data(profile)
        return mupdf.fz_new_icc_colorspace(kind.m_internal.type, 0, "output", data)
    except (mupdf.FzErrorBase, ImageCms.PyCMSError):
        raise PlateError("the profile of its output intent is damaged") from None


def tint_curves(page: Any, names: list[str], separations: Any, inks: Inks) -> NDArray[np.uint8]:
    """CMYK of every tint of each spot colour, (spots, 256, 4), by its tint transform.

    A colorant of a DeviceN space without a Separation of its own gets that space's transform with the others at 0.
    """
    found: dict[str, tuple[Any, Any, int]] = {}
    for array in _tint_spaces(page.obj()):
        space = _loaded(array)
        for i in range(0 if space is None else mupdf.fz_colorspace_n(space)):
            name = mupdf.fz_colorspace_colorant(space, i)
            if name not in found or mupdf.fz_colorspace_n(space) < mupdf.fz_colorspace_n(found[name][0]):
                found[name] = space, array, i
    curves = np.zeros((len(names), 256, 4), dtype=np.uint8)
    for spot, name in enumerate(names):
        if name in found:
            amounts = _tint_curve(*found[name], inks)
        else:
            parameters, no_proof = mupdf.FzColorParams(), mupdf.FzColorspace()
            full = mupdf.fz_separation_equivalent(separations, spot, inks.space, no_proof, parameters)
            amounts = np.linspace(0.0, 1.0, 256)[:, None] * np.asarray(full)[:4]
        curves[spot] = np.rint(255 * amounts.clip(0, 1))
    return curves


def _loaded(array: Any) -> Any:
    """The colour space of an array; None if it is broken: then nothing is painted in it."""
    try:
        return mupdf.pdf_load_colorspace(array)
    except Exception:  # beside MuPDF's errors, UnicodeDecodeError or TypeError, where their text is not UTF-8
        return None


def _tint_curve(space: Any, array: Any, colorant: int, inks: Inks) -> NDArray[np.float64]:
    """Ink amounts (256, 4) of the tints of one colorant of a Separation or DeviceN space, and the array that it is."""
    # In two steps: MuPDF alone would convert native CMYK of the alternate space to the profile. The tint transform is
    # evaluated here, because MuPDF converts to no Lab.
    alternate = mupdf.pdf_load_colorspace(mupdf.pdf_array_get(array, 2))
    inputs, outputs = mupdf.fz_colorspace_n(space), mupdf.fz_colorspace_n(alternate)
    transform = mupdf.pdf_load_function(mupdf.pdf_array_get(array, 3), inputs, outputs)
    colour, out, parameters = mupdf.new_floats(INKS_MAX), mupdf.new_floats(INKS_MAX), mupdf.FzColorParams()
    for i in range(inputs):
        mupdf.floats_setitem(colour, i, 0.0)
    alternates, converted = [], []
    for tint in range(256):
        mupdf.floats_setitem(colour, colorant, tint / 255)
        # Not mupdf's: there, the result has room for one number.
        _mupdf.ll_pdf_eval_function(transform.m_internal, colour, inputs, out, outputs)
        alternates.append([mupdf.floats_getitem(out, i) for i in range(outputs)])
        converted.append(mupdf.fz_convert_color(space, colour, inks.space, mupdf.FzColorspace(), parameters))
    mupdf.delete_floats(colour)
    mupdf.delete_floats(out)
    own = inks.convert(alternate.m_internal, alternates, parameters.internal())
    return np.asarray(converted) if own is None else own


def _tint_spaces(thing: Any) -> Iterator[Any]:
    """Every Separation and DeviceN array that can be reached from a page, its parents left out."""
    seen, waiting = set[int](), [thing]
    while waiting:
        thing = waiting.pop()
        number = mupdf.pdf_to_num(thing)
        if number in seen:
            continue
        if number:
            seen.add(number)
        if mupdf.pdf_is_array(thing):
            if _name(mupdf.pdf_array_get(thing, 0)) in (b"Separation", b"DeviceN"):
                yield thing
            waiting += [mupdf.pdf_array_get(thing, i) for i in reversed(range(mupdf.pdf_array_len(thing)))]
        elif mupdf.pdf_is_dict(thing):
            waiting += [
                mupdf.pdf_dict_get_val(thing, i)
                for i in reversed(range(mupdf.pdf_dict_len(thing)))
                if _name(mupdf.pdf_dict_get_key(thing, i)) not in (b"Parent", b"P", b"Dest", b"A")
            ]


def _name(thing: Any) -> bytes:
    """A PDF name, which is of bytes."""
    return str(mupdf.pdf_to_name(thing)).encode("utf-8", "surrogateescape")


def merge_plates(plates: NDArray[np.uint8], curves: NDArray[np.uint8], cmyk: NDArray[np.uint8]) -> None:
    """Process and spot plates (rows, columns, 4 + spots) added up, at most full ink, into ``cmyk`` (rows, columns, 4).

    curves: (spots, 256, 4) as from ``tint_curves``.
    """
    for top in range(0, len(plates), BAND_ROWS):
        band = cmyk[top : top + BAND_ROWS]
        band[:] = plates[top : top + BAND_ROWS, :, :4]
        for spot, curve in enumerate(curves):
            tint = plates[top : top + BAND_ROWS, :, 4 + spot]
            printed = tint > 0
            if printed.any():
                sums = band[printed].astype(np.uint16) + curve[tint[printed]]
                band[printed] = np.minimum(sums, 255)


def draw(page: Any, ctm: Any, cmyk: NDArray[np.uint8], profile: bytes | None) -> list[str]:
    """Draw a page (``mupdf.PdfPage``) without anti-aliasing into ``cmyk``, (rows, columns, 4) without ink yet.

    Returns what could not be drawn. ctm: page space to pixels. profile: the CMYK profile to convert RGB, ICC grey and
    Lab with, before the output intent; native CMYK is not touched. PlateError: see there. mupdf.FzErrorBase: MuPDF
    cannot go on.
    """
    mupdf.fz_enable_icc()
    intent = output_intent(page)
    if profile is None and intent[16:20] == b"CMYK":
        profile = intent
    inks = Inks(icc_space(profile) if profile else mupdf.fz_device_cmyk())
    rgb = icc_space(intent) if intent[16:20] == b"RGB " else mupdf.fz_device_rgb()
    separations, names = _spots(page)
    rows, columns = cmyk.shape[:2]
    plates = np.zeros((rows, columns, 4 + len(names)), dtype=np.uint8) if names else cmyk
    pixmap = mupdf.fz_new_pixmap_with_data(
        inks.space, columns, rows, separations, 0, plates.strides[0], mupdf.python_mutable_buffer_data(plates)
    )
    levels = mupdf.fz_graphics_aa_level(), mupdf.fz_text_aa_level()
    mupdf.fz_set_aa_level(0)
    try:
        drawing = mupdf.fz_new_draw_device(ctm, pixmap)
        raster = Raster(rows=rows, columns=columns, scale=ctm.a, shift=(ctm.e, ctm.f))
        device = PressDevice(drawing, inks, rgb, page.doc(), raster)
        mupdf.pdf_run_page_with_usage(page, device, mupdf.FzMatrix(), "Print", mupdf.FzCookie())
        device.close()
        mupdf.fz_close_device(drawing)
    finally:
        mupdf.fz_set_graphics_aa_level(levels[0])
        mupdf.fz_set_text_aa_level(levels[1])
    if names:
        merge_plates(plates, tint_curves(page, names, separations, inks), cmyk)
    return device.troubles + inks.troubles


def _spots(page: Any) -> tuple[Any, list[str]]:
    """The page's separations, each to be drawn on a plate of its own, and their names."""
    separations = mupdf.fz_page_separations(page.super())
    if not separations.m_internal:
        return mupdf.fz_new_separations(0), []  # an empty one still switches overprint on
    names = [mupdf.fz_separation_name(separations, i) for i in range(mupdf.fz_count_separations(separations))]
    if len(names) > SPOTS_MAX:
        raise PlateError(f"it has {len(names)} spot colours, at most {SPOTS_MAX} can be ripped")
    for i in range(len(names)):
        mupdf.fz_set_separation_behavior(separations, i, mupdf.FZ_SEPARATION_SPOT)
    return separations, names
