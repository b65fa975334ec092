"""One PDF page to CMYK with MuPDF: overprint, spot colours, output intent and exact process values.

Imported late, by ``document`` only: it needs PyMuPDF at import (``pip install "prooflight[pdf]"``).

MuPDF's own CMYK pixmap is not what a press prints: it ignores overprint and spot colours, and it truncates
colours to bytes (0.5 becomes 127). So every page is drawn with a separations object, which switches overprint on
and gives each spot colour a plate of its own (``tints``), through ``PressDevice``, which rounds. Spot plates are then
merged: each is sent through its tint transform and added to the process plates, at most full ink. Adding is how
Ghostscript's ``tiffsep`` composite and MuPDF's overprint simulation merge plates; the standard leaves it open.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import ImageCms
from pymupdf import mupdf

from prooflight.pages.pdf.colour_management import Inks, fine_link
from prooflight.pages.pdf.device import NO_SAMPLES, Observed, PressDevice, Samples
from prooflight.pages.pdf.images import ConvertedImages, Raster
from prooflight.pages.pdf.resources import get, items, name_of
from prooflight.pages.pdf.tints import COLOURS_MAX, Tinted, TintSpaces
from prooflight.pages.raster import MM_PER_INCH

if TYPE_CHECKING:
    from prooflight.pages.pdf.rip_model import RipModel

PLATES_MAX = COLOURS_MAX - 4
"""Most plates that are drawn at once, in addition to the process inks."""
Edges = dict[str, float]
SHARP: Edges = {"hscale": 1, "vscale": 1, "scale": 0xFF00, "bits": 1, "text_bits": 0, "min_line_width": 1.0}
"""Fields of ``fz_aa_context``: samples of a pixel in either direction, the weight of one of them (of
0xFF00), bits of coverage of paths (0 would choose level 0) and of glyphs, and the width of the thinnest
line. [pixels]"""
_BY_AREA: Edges = {"hscale": 17, "vscale": 15, "scale": 256, "bits": 8, "text_bits": 8}
"""What the rule of areas changes, as ``fz_set_aa_level`` sets it for level 8: 255 samples of a pixel."""
BAND_ROWS = 64  # plates are merged in bands: that of an A4 page at 600 dpi stays in the processor's cache


class PlateError(ValueError):
    """A broken output profile, or more spot colours than MuPDF holds."""


def output_intent(page: Any) -> bytes:
    """Return the profile of the page's or else the document's output intent (ISO 32000-2, 14.11.5); empty: none.

    Of several, that of PDF/X states what the file was made for (ISO 15930-7, 6.2.2), then any that is of
    CMYK.
    """
    for holder in (page.obj(), get(mupdf.pdf_trailer(page.doc()), "Root")):
        profiles = []
        for intent in items(get(holder, "OutputIntents")):
            stream = get(intent, "DestOutputProfile")
            if stream is not None and mupdf.pdf_is_stream(stream):
                profile = bytes(mupdf.fz_buffer_extract_copy(mupdf.pdf_load_stream(stream)))
                profiles.append((name_of(get(intent, "S")) != "GTS_PDFX", profile[16:20] != b"CMYK", profile))
        if profiles:
            return min(profiles, key=lambda one: one[:2])[2]
    return b""


def icc_space(profile: bytes) -> Any:
    """Return a MuPDF colour space of an RGB or CMYK profile; PlateError if the profile cannot be used."""
    is_ink = profile[16:20] == b"CMYK"
    kind = mupdf.fz_device_cmyk() if is_ink else mupdf.fz_device_rgb()
    try:
        if is_ink:
            fine_link(None, profile, mode="LAB", intent=1, black_point=True)
        data = mupdf.fz_new_buffer_from_copied_data(profile)
        return mupdf.fz_new_icc_colorspace(kind.m_internal.type, 0, "output", data)
    except (mupdf.FzErrorBase, ImageCms.PyCMSError):
        raise PlateError("the profile of its output intent is damaged") from None


class PageDrawing:
    """One page, drawn as often as it has bands."""

    def __init__(
        self, page: Any, profile: bytes | None, tints: TintSpaces, listed: Tinted, *, text_knockout: bool
    ) -> None:
        """Prepare ``page``, a ``mupdf.PdfPage`` with renamed colorants; ``listed`` are their former names.

        ``profile`` is the CMYK profile to convert RGB, ICC grey and Lab with, before the output intent;
        native CMYK is not touched. PlateError: see there. mupdf.FzErrorBase: MuPDF cannot go on.
        """
        mupdf.fz_enable_icc()
        intent = output_intent(page)
        if profile is None and intent[16:20] == b"CMYK":
            profile = intent
        self.inks = Inks(icc_space(profile) if profile else mupdf.fz_device_cmyk())
        self.observed = Observed()
        self._page, self._tints, self._text_knockout = page, tints, text_knockout
        self._rgb = icc_space(intent) if intent[16:20] == b"RGB " else mupdf.fz_device_rgb()
        self._edges, self._samples = SHARP, NO_SAMPLES
        self._images, self._curves = ConvertedImages(self.inks), dict[str, NDArray[np.uint8]]()
        group = get(page.obj(), "Group")
        self._is_own_group, knockout = get(group, "CS") is None, get(group, "K")
        self._page_knockout = knockout is not None and bool(mupdf.pdf_to_bool(knockout))
        # Without a plate, MuPDF prints images in a process colorant by their tint transform.
        self._passes = [sorted(listed.plates) or ["none"]] if listed else [[]]
        if len(listed.plates) > PLATES_MAX or not self._is_own_group:
            self._survey(listed)

    def _survey(self, listed: Tinted) -> None:
        """Find which plates are painted on, and whether anything is transparent, by drawing a single pixel."""
        self._run(mupdf.FzMatrix(), np.zeros((1, 1, 4), np.uint8), [])
        if not self.observed.transparent:
            # What is opaque prints as it stands, whatever the page blends in.
            self._page.m_internal.transparency = 0
            self.observed.separated.clear()
        if len(listed.plates) <= PLATES_MAX:
            return
        painted = [plate for plates in self.observed.plates for plate in plates]
        if len(painted) > PLATES_MAX and len(painted) > len(self.observed.plates):
            what = f"it has {len(painted)} spot colours, some of them in one NChannel space"
            raise PlateError(f"{what}: at most {PLATES_MAX} of these can be ripped")
        painted = list(dict.fromkeys(painted)) or ["none"]
        self._passes = [painted[i : i + PLATES_MAX] for i in range(0, len(painted), PLATES_MAX)]

    def draw(self, ctm: Any, cmyk: NDArray[np.uint8], edges: Edges = SHARP, *, samples: Samples = ()) -> None:
        """Draw into the empty ``cmyk``, (rows, columns, 4); ``ctm`` maps the page to pixels."""
        self._edges, self._samples = edges, samples
        for number, plates in enumerate(self._passes):
            if not plates:
                self._run(ctm, cmyk, [])
                continue
            drawn = np.zeros((*cmyk.shape[:2], 4 + len(plates)), dtype=np.uint8)
            self._run(ctm, drawn, plates)
            if number == 0:  # the process inks of all passes are the same
                cmyk[:] = drawn[..., :4]
            merge_plates(drawn[..., 4:], [self._curve(name) for name in plates], cmyk)

    def _run(self, ctm: Any, drawn: NDArray[np.uint8], plates: list[str]) -> None:
        """Draw into (rows, columns, 4 + plates)."""
        rows, columns = drawn.shape[:2]
        separations = mupdf.fz_new_separations(0)  # an empty one still switches overprint on
        for number, name in enumerate(plates):
            mupdf.fz_add_separation(separations, name, self.inks.space, 0)
            mupdf.fz_set_separation_behavior(separations, number, mupdf.FZ_SEPARATION_SPOT)
        pixmap = mupdf.fz_new_pixmap_with_data(
            self.inks.space,
            columns,
            rows,
            separations,
            0,
            drawn.strides[0],
            mupdf.python_mutable_buffer_data(drawn),
        )
        with drawn_by(self._edges):
            drawing = mupdf.fz_new_draw_device(ctm, pixmap)
            device = PressDevice(
                drawing,
                self.inks,
                self._rgb,
                self._page.doc(),
                Raster(rows=rows, columns=columns, scale=ctm.a, shift=(ctm.e, ctm.f)),
                tints=self._tints,
                plates=plates,
                images=self._images,
                observed=self.observed,
                page_group=bool(self._page.m_internal.transparency),
                page_knockout=self._page_knockout,
                is_own_group=self._is_own_group,
                text_knockout=self._text_knockout,
                samples=self._samples,
            )
            mupdf.pdf_run_page_with_usage(self._page, device, mupdf.FzMatrix(), "Print", mupdf.FzCookie())
            device.close()
            mupdf.fz_close_device(drawing)

    def _curve(self, plate: str) -> NDArray[np.uint8]:
        """Return the CMYK values of every tint of a plate, (256, 4)."""
        if plate not in self._curves:
            tints = np.linspace(0.0, 1.0, 256)[:, None]
            amounts = np.zeros((256, 4))
            if plate != "none":
                parameters = mupdf.FzColorParams()  # kept as long as what is internal to it
                amounts = self._tints.plate(plate).ink_amounts(tints, self.inks, parameters.internal())
            self._curves[plate] = np.rint(255 * amounts.clip(0, 1)).astype(np.uint8)
        return self._curves[plate]


def merge_plates(plates: NDArray[np.uint8], curves: list[NDArray[np.uint8]], cmyk: NDArray[np.uint8]) -> None:
    """Add spot plates (rows, columns, spots) to ``cmyk`` (rows, columns, 4), at most full ink.

    ``curves`` are the CMYK values of each spot by its tint, (256, 4).
    """
    for top in range(0, len(plates), BAND_ROWS):
        band = cmyk[top : top + BAND_ROWS]
        for spot, curve in enumerate(curves):
            tint = plates[top : top + BAND_ROWS, :, spot]
            printed = tint > 0
            if printed.any():
                sums = band[printed].astype(np.uint16) + curve[tint[printed]]
                band[printed] = np.minimum(sums, 255)


def edges_of(rip: RipModel, dpi: float) -> Edges:
    """Return the fields of ``fz_aa_context`` by which a RIP of ``dpi`` fills pixels and draws thin lines."""
    by_rule = _BY_AREA if rip.fill == "area" else {}
    thinnest = 1.0 if rip.least_line_um is None else rip.least_line_um * 1e-3 * dpi / MM_PER_INCH
    return SHARP | by_rule | {"min_line_width": thinnest}


@contextlib.contextmanager
def drawn_by(edges: Edges) -> Iterator[None]:
    """Draw with these fields of ``fz_aa_context``; by ``SHARP`` a pixel is inside a shape if its centre is.

    MuPDF's own level 0 paints transparent objects solid (the opacity of groups that are not isolated is 1
    there). Its anti-aliasing therefore takes one sample of each pixel here, which no level of it does, and
    paints by the same rule.
    """
    settings = mupdf.internal_context_get().aa
    saved = {name: getattr(settings, name) for name in edges}
    for name, value in edges.items():
        setattr(settings, name, value)
    try:
        yield
    finally:
        for name, value in saved.items():
            setattr(settings, name, value)
