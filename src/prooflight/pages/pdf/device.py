"""The MuPDF device that paints what a press prints: ink amounts to the nearest byte, other colours by Little CMS.

Imported late, by ``drawing`` only: it needs PyMuPDF at import.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from pymupdf import _mupdf, mupdf

from prooflight.pages.pdf.colour_management import Inks, ToInk, address
from prooflight.pages.pdf.fonts import DrawnFonts, has_outlines, outlines
from prooflight.pages.pdf.images import (
    ConvertedImages,
    Decoding,
    ImageFault,
    Raster,
    converted_samples,
    pixmap_samples,
    placed,
    raster_matrix,
)
from prooflight.pages.pdf.rip_model import MIDDLE, TOUCHED
from prooflight.pages.pdf.tints import COLOURS_MAX, TintSpaces, TintUse

_FORWARDED = {
    name: name
    for name in (
        *("clip_path", "clip_stroke_path", "pop_clip"),
        *("ignore_text", "render_flags", "end_tile"),
    )
} | {"begin_tile": "begin_tile_tid"}
"""Drawing calls without a colour, and the function that takes all of their arguments."""
_PAINTING = {"fill_path": 3, "stroke_path": 3, "fill_text": 2, "stroke_text": 3}
"""Drawing calls with a colour, and the index of the colour space among their arguments; the colour and its
opacity follow."""
_CLIPPING = ("clip_text", "clip_stroke_text")
_OVERRIDDEN = (
    *("fill_shade", "fill_image", "fill_image_mask", "clip_image_mask"),
    *("begin_mask", "end_mask", "begin_group", "end_group", "set_default_colorspaces"),
)
_NO_TINT = TintUse()
Samples = tuple[tuple[float, float], ...]
NO_SAMPLES: Final[Samples] = ()
COLOURS_CACHED: Final = 4096
"""Colours of a page of which it is kept how they are painted. Assumed: type and tints have fewer, a picture more."""


def nearest_byte(value: float) -> float:
    """Return the number in 0..1 that MuPDF truncates to the byte ``round(255 * value)``; above 0 stays above 0.

    Overprint mode 1 does not paint amounts of exactly 0, so a trace of ink must not become 0 here. MuPDF
    stores colours in single precision: six decimals restore the number that the file states.
    """
    return min(1.0, (round(255 * round(value, 6)) + 0.25) / 255) if value > 0 else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Observed:
    """Observations of a page while it was drawn."""

    troubles: dict[str, None] = field(default_factory=dict)
    """Errors of drawing, in MuPDF's words."""
    faults: list[ImageFault] = field(default_factory=list)
    fonts: DrawnFonts = field(default_factory=DrawnFonts)
    plates: dict[tuple[str, ...], None] = field(default_factory=dict)
    """Plates that were painted on, those of one colour space as one entry."""
    transparent: list[bool] = field(default_factory=list)
    """Not empty: an object is not opaque, or blends."""
    separated: list[bool] = field(default_factory=list)
    """Not empty: ink was painted in a group that blends in other colours, and is separated again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Group:
    foreign: bool
    """Whether its colours are other than the press's."""
    mask: bool = False
    """Whether it is a soft mask, or within one; its colours then print nothing."""
    knockout: bool = False
    drawn: bool = True


class PressDevice(mupdf.FzDevice2):  # type: ignore[misc]
    """Device that draws on another MuPDF device. ``close`` it once the page is drawn."""

    def __init__(
        self,
        drawing: Any,
        inks: Inks,
        rgb: Any,
        document: Any,
        raster: Raster,
        *,
        tints: TintSpaces,
        plates: Iterable[str],
        images: ConvertedImages,
        observed: Observed,
        page_group: bool,
        page_knockout: bool,
        is_own_group: bool,
        text_knockout: bool,
        samples: Samples,
    ) -> None:
        """Prepare drawing with ``inks`` for DeviceCMYK and ``rgb`` for DeviceRGB.

        They apply whatever the document's output intent is. ``plates`` are those that are drawn on.
        ``page_group``: the first group is the page's, and ``page_knockout`` is its K. ``is_own_group``: it
        names no colours to blend in, so these are the press's inks (ISO 32000-2, 11.4.7). ``text_knockout``:
        glyphs knock each other out. ``samples``: as ``RipModel.samples``.
        """
        super().__init__()
        self._drawing, self._inks, self._rgb, self._raster = drawing.m_internal, inks, rgb, raster
        device = (mupdf.fz_device_gray(), mupdf.fz_device_rgb(), mupdf.fz_device_cmyk())
        intent = mupdf.pdf_document_output_intent(document)
        self._replaced = frozenset(address(space.m_internal) for space in (*device, intent))
        self._defaults: Any = None
        self._amounts = mupdf.new_floats(COLOURS_MAX)
        self._groups = [_Group(foreign=False)]
        self._tints, self._plates, self._images, self.observed = tints, frozenset(plates), images, observed
        self._uses: dict[int, TintUse] = {}
        self._colours: dict[tuple[Any, ...], tuple[Any, list[float] | None, int, int]] = {}
        self._spaces: dict[int, Any] = {}  # so that addresses stay their own
        self._text_knockout, self._samples = text_knockout, samples
        self._page_group, self._page_knockout, self._is_own_group = page_group, page_knockout, is_own_group
        for name in (*_FORWARDED, *_PAINTING, *_CLIPPING, *_OVERRIDDEN):
            getattr(self, f"use_virtual_{name}")()

    def close(self) -> None:
        """End the page; call it once."""
        mupdf.fz_close_device(self)
        mupdf.delete_floats(self._amounts)
        mupdf.ll_fz_drop_default_colorspaces(self._defaults)

    def pass_on(self, draw: Callable[..., Any], *arguments: Any) -> Any:
        """Draw; an error is recorded and the object omitted, as MuPDF itself does with a damaged image or font."""
        try:
            return draw(self._drawing, *arguments)
        except mupdf.FzErrorBase as error:
            self.observed.troubles[str(error)] = None
            return 0

    def set_default_colorspaces(self, _context: Any, defaults: Any) -> None:
        """Use the press's inks for DeviceCMYK; a /DefaultCMYK, /DefaultRGB or /DefaultGray stays."""
        mine = mupdf.ll_fz_clone_default_colorspaces(defaults)
        own = {"gray": mupdf.fz_device_gray(), "rgb": self._rgb, "cmyk": self._inks.space}
        for colours, space in own.items():
            if address(getattr(mupdf, f"ll_fz_default_{colours}")(mine)) in self._replaced:
                getattr(mupdf, f"ll_fz_set_default_{colours}")(mine, space.m_internal)
        mupdf.ll_fz_set_default_output_intent(mine, self._inks.space.m_internal)
        self.pass_on(_mupdf.ll_fz_set_default_colorspaces, mine)
        mupdf.ll_fz_drop_default_colorspaces(self._defaults)
        self._defaults = mine
        self._colours.clear()

    def begin_group(
        self, _context: Any, area: Any, space: Any, isolated: int, knockout: int, blend: int, alpha: float
    ) -> None:
        """Begin a group.

        Inside a group that blends in other colours, MuPDF converts to them first, and to ink at its end. A
        group that is not isolated blends in the colours around it (ISO 32000-2, 11.6.6). If it is opaque and
        nothing in it is knocked out, its content is drawn directly.
        """
        if not isolated or (self._page_group and self._is_own_group):
            space = None
        knockout = int(
            knockout or (self._page_group and self._page_knockout)
        )  # MuPDF does not read the page's
        self._page_group = False
        outer = self._groups[-1]
        if blend or alpha < 1:
            self.observed.transparent.append(True)
        if not (isolated or knockout or blend or outer.knockout) and alpha == 1:
            self._groups.append(_Group(foreign=outer.foreign, mask=outer.mask, drawn=False))
            return
        other = bool(space) and address(self._resolved(space)) != address(self._inks.space.m_internal)
        foreign = other or outer.foreign
        self._groups.append(_Group(foreign=foreign, mask=outer.mask, knockout=bool(knockout)))
        opacity = nearest_byte(alpha)
        self.pass_on(_mupdf.ll_fz_begin_group, area, space, isolated, knockout, blend, opacity)

    def end_group(self, _context: Any) -> None:
        """End a group, and return to the colours of the group around it."""
        if self._groups.pop().drawn:
            self.pass_on(_mupdf.ll_fz_end_group)

    def begin_mask(self, _context: Any, *arguments: Any) -> None:
        """Begin a soft mask, which is grey."""
        self.observed.transparent.append(True)
        self._groups.append(_Group(foreign=True, mask=True))
        self.pass_on(_mupdf.ll_fz_begin_mask, *arguments)

    def end_mask(self, _context: Any, function: Any) -> None:
        """End a soft mask, which clips from here to its pop_clip."""
        self._groups.pop()
        self.pass_on(_mupdf.ll_fz_end_mask_tr, function)

    def fill_shade(self, _context: Any, shade: Any, ctm: Any, alpha: float, parameters: Any) -> None:
        """Draw a gradient; a mesh without a function is drawn as an image of its colours."""
        space = shade.colorspace
        if not self._leaves_mark(space, alpha, parameters):
            return
        to_ink, alpha = self._to_ink(space, parameters), nearest_byte(alpha)
        if shade.function_stride:
            is_ink = not self._groups[-1].foreign and bool(
                mupdf.ll_fz_colorspace_is_subtractive(space) or space.n == 1
            )
            with function_in_ink(shade, self._inks.space, to_ink, is_ink=is_ink):
                self.pass_on(_mupdf.ll_fz_fill_shade, shade, ctm, alpha, parameters)
        elif to_ink is None:
            self.pass_on(_mupdf.ll_fz_fill_shade, shade, ctm, alpha, parameters)
        elif mupdf.ll_fz_colorspace_is_device_n(space) and space.n > MESH_COLORANTS_MAX:
            trouble = f"a gradient mesh of {space.n} colorants is left out: convert it to process inks"
            self.observed.troubles[trouble] = None
        else:
            mesh = mesh_in_ink(shade, ctm, self._raster, self._inks.space, to_ink)
            if mesh is not None:
                mupdf.ll_fz_enable_device_hints(self._drawing, mupdf.FZ_DONT_INTERPOLATE_IMAGES)
                image, matrix = mesh
                self.pass_on(_mupdf.ll_fz_fill_image, image.m_internal, matrix, alpha, parameters)

    def fill_image(self, _context: Any, image: Any, ctm: Any, alpha: float, parameters: Any) -> None:
        """Draw an image, in ink if its colours must be converted."""
        space = image.colorspace
        if space and mupdf.ll_fz_colorspace_is_indexed(space):
            space = mupdf.ll_fz_base_colorspace(space)
        if not self._leaves_mark(space, alpha, parameters):
            return
        with Decoding(image, ctm, self.observed.faults):
            to_ink = self._to_ink(space, parameters) if space else None
            if to_ink is not None and not mupdf.ll_fz_colorspace_is_lab(space):
                image = self._images.get(image, self._resolved(space), to_ink, parameters)
            self._draw_image(_mupdf.ll_fz_fill_image, image, ctm, nearest_byte(alpha), parameters)

    def fill_image_mask(
        self, _context: Any, image: Any, ctm: Any, space: Any, colour: Any, alpha: float, parameters: Any
    ) -> None:
        """Paint through a stencil."""
        if self._leaves_mark(space, alpha, parameters):
            exact = self.exact(space, colour, parameters)
            with Decoding(image, ctm, self.observed.faults):
                draw = _mupdf.ll_fz_fill_image_mask
                self._draw_image(draw, image, ctm, *exact, nearest_byte(alpha), parameters)

    def clip_image_mask(self, _context: Any, image: Any, ctm: Any, scissor: Any) -> None:
        """Clip to a stencil, or to the soft mask of an image."""
        if image.bpc > 1:
            self.observed.transparent.append(True)
        with Decoding(image, ctm, self.observed.faults):
            self._draw_image(_mupdf.ll_fz_clip_image_mask, image, ctm, scissor)

    def _draw_image(self, draw: Callable[..., Any], image: Any, ctm: Any, *rest: Any) -> None:
        # A clip must be passed on whatever becomes of its image, because its pop_clip will be.
        try:
            best, matrix, blended = placed(image, ctm, self._raster)
        except mupdf.FzErrorBase as error:
            self.observed.troubles[str(error)] = None
            best, matrix, blended = mupdf.FzImage(mupdf.ll_fz_keep_image(image)), ctm, True
        switch = mupdf.ll_fz_disable_device_hints if blended else mupdf.ll_fz_enable_device_hints
        switch(self._drawing, mupdf.FZ_DONT_INTERPOLATE_IMAGES)
        self.pass_on(draw, best.m_internal, matrix, *rest)

    def paint(self, draw: Callable[..., Any], place: int, arguments: tuple[Any, ...]) -> None:
        """Draw a path or a text; ``place`` is the index of colour space, colour and opacity among its arguments."""
        (space, colour, alpha), parameters = arguments[place : place + 3], arguments[-1]
        if self._leaves_mark(space, alpha, parameters):
            exact = self.exact(space, colour, parameters)
            self.pass_on(draw, *arguments[:place], *exact, nearest_byte(alpha), *arguments[place + 3 :])

    def paint_path(self, draw: Callable[..., Any], place: int, arguments: tuple[Any, ...]) -> None:
        """Draw a filled or a stroked path, once for each sample of its pixels.

        One that is not opaque is drawn once: where copies overlap, ink would add up.
        """
        if not self._samples:
            self.paint(draw, place, arguments)
            return
        ctm = arguments[2]
        is_hairline = draw is _STROKE_PATH and (
            arguments[1].linewidth * mupdf.ll_fz_matrix_expansion(ctm) * self._raster.scale <= 1.0 + TOUCHED
        )
        for sample in (MIDDLE,) if is_hairline or arguments[place + 2] < 1 else self._samples:
            self.paint(draw, place, (*arguments[:2], self._sampled(ctm, sample), *arguments[3:]))

    def _sampled(self, ctm: Any, sample: tuple[float, float]) -> Any:
        """Return the matrix by which MuPDF, whose sample of a pixel is its last corner, takes another."""
        by = [(1 - part) / self._raster.scale for part in sample]
        return mupdf.ll_fz_concat(ctm, mupdf.ll_fz_translate(*by))

    def _paint_glyphs(self, draw: Callable[..., Any], place: int, arguments: tuple[Any, ...]) -> None:
        """Draw a text, as paths where the rule of filling is stated: MuPDF puts glyphs in whole pixels."""
        if draw is not _FILL_TEXT or not self._samples or not has_outlines(arguments[0]):
            self.paint(draw, place, arguments)
            return
        ctm = self._sampled(arguments[1], MIDDLE)
        for outline in outlines(arguments[0]):
            self.paint(_FILL_PATH, _PAINTING["fill_path"], (outline, 0, ctm, *arguments[2:]))

    def paint_text(self, draw: Callable[..., Any], place: int, arguments: tuple[Any, ...]) -> None:
        """Draw a text whose glyphs knock each other out (11.7.4.4): where they overlap, they do not add up."""
        text, alpha = arguments[0], arguments[place + 2]
        self.observed.fonts.take_in(text)
        if (
            alpha == 1
            or not self._text_knockout
            or not self._leaves_mark(arguments[place], alpha, arguments[-1])
        ):
            self._paint_glyphs(draw, place, arguments)
            return
        stroke, ctm = (
            (arguments[1], arguments[2]) if place == _PAINTING["stroke_text"] else (None, arguments[1])
        )
        area = mupdf.ll_fz_bound_text(text, stroke, ctm)
        self.pass_on(_mupdf.ll_fz_begin_group, area, None, 0, 0, mupdf.FZ_BLEND_NORMAL, nearest_byte(alpha))
        self._paint_glyphs(draw, place, (*arguments[: place + 2], 1.0, *arguments[place + 3 :]))
        self.pass_on(_mupdf.ll_fz_end_group)

    def clip_to_text(self, draw: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        """Clip to a text."""
        self.observed.fonts.take_in(arguments[0])
        self.pass_on(draw, *arguments)

    def exact(self, space: Any, colour: Any, parameters: Any) -> tuple[Any, Any]:
        """Return colour space and colour (float*) to paint with: rounded ink amounts, or other colours in ink."""
        if not space:
            return space, colour
        amounts = tuple(mupdf.floats_getitem(colour, i) for i in range(space.n))
        stated = parameters.op, parameters.opm, parameters.ri, parameters.bp
        key = address(space), amounts, stated, self._groups[-1].foreign
        if key not in self._colours:  # a page sets thousands of texts in few colours
            if len(self._colours) == COLOURS_CACHED:
                self._colours.clear()
            self._spaces.setdefault(key[0], mupdf.FzColorspace(mupdf.ll_fz_keep_colorspace(space)))
            painted = self._painted(space, amounts, parameters)
            self._colours[key] = *painted, parameters.op, parameters.opm
        target, rounded, parameters.op, parameters.opm = self._colours[key]
        if rounded is None:
            return space, colour
        for i, amount in enumerate(rounded):
            mupdf.floats_setitem(self._amounts, i, amount)
        return target, self._amounts

    def _painted(
        self, space: Any, amounts: tuple[float, ...], parameters: Any
    ) -> tuple[Any, list[float] | None]:
        """Return the space and the amounts that stand for a colour; None: MuPDF paints it right as it is stated."""
        to_ink, press = self._to_ink(space, parameters), self._inks.space.m_internal
        if to_ink is not None:
            return press, list(map(nearest_byte, to_ink(np.asarray([amounts]))[0].tolist()))
        if self._groups[-1].foreign:
            return space, None
        if mupdf.ll_fz_colorspace_is_device_n(space):
            return space, list(map(nearest_byte, amounts))
        actual = self._resolved(space)
        if address(actual) != address(press):
            parameters.opm = 0
        inks = self._inks.amounts(actual, [amounts], parameters)[0].tolist()
        return press, list(map(nearest_byte, inks))

    def _leaves_mark(self, space: Any, alpha: float, parameters: Any) -> bool:
        """Return whether anything of a colour space is painted, and record its plates."""
        if alpha < 1:
            self.observed.transparent.append(True)
        use = self._use(space)
        if use.leaves_no_mark:
            return False
        if use.plates:
            self.observed.plates[use.plates] = None
        group = self._groups[-1]
        if group.foreign and not group.mask and not self.observed.separated and self._is_ink(space):
            self.observed.separated.append(True)
        # On plates that are drawn another time, nothing is left where this overprints, else what it knocks out.
        return not (parameters.op and use.plates and self._plates.isdisjoint(use.plates))

    def _is_ink(self, space: Any) -> bool:
        return bool(space) and bool(
            mupdf.ll_fz_colorspace_is_device_n(space) or self._inks.is_native(self._resolved(space))
        )

    def _use(self, space: Any) -> TintUse:
        if not space or not mupdf.ll_fz_colorspace_is_device_n(space):
            return _NO_TINT
        key = address(space)
        if key not in self._uses:
            self._spaces.setdefault(key, mupdf.FzColorspace(mupdf.ll_fz_keep_colorspace(space)))
            self._uses[key] = self._tints.use(space)
        return self._uses[key]

    def _to_ink(self, space: Any, parameters: Any) -> ToInk | None:
        """Return the conversion of colours of a space (low level) to ink here; None if MuPDF paints them correctly.

        All is as much of each process ink, and knocks spots out, because their plates are not printed. Ink
        that results from a computation overprints as OPM 0 (ISO 32000-2, 11.7.4.3: mode 1 is for DeviceCMYK
        alone).
        """
        use = self._use(space)
        if use.is_all:
            parameters.op = 0
            return lambda colours: np.repeat(colours, 4, axis=1)
        if self._groups[-1].foreign:
            return None
        if use.mixture is not None:
            parameters.opm = 0
            mixture = use.mixture
            return lambda colours: mixture.ink_amounts(colours, self._inks, parameters)
        if use.plates and not self._plates.issuperset(use.plates):
            return lambda colours: np.zeros((len(colours), 4))
        if mupdf.ll_fz_colorspace_is_device_n(space):
            return None
        actual = self._resolved(space)
        if self._inks.is_native(actual):
            return None
        parameters.opm = 0
        return lambda colours: self._inks.amounts(actual, colours, parameters)

    def _resolved(self, space: Any) -> Any:
        """Return the colour space that a device colour space represents on this page."""
        if not self._defaults or not mupdf.ll_fz_colorspace_is_device(space):
            return space
        for colours in ("cmyk", "rgb", "gray"):
            if getattr(mupdf, f"ll_fz_colorspace_is_{colours}")(space):
                return getattr(mupdf, f"ll_fz_default_{colours}")(self._defaults)
        return space


def _forwarding(name: str) -> Callable[..., Any]:
    draw = getattr(_mupdf, f"ll_fz_{name}")
    return lambda self, _context, *arguments: self.pass_on(draw, *arguments)


_FILL_PATH, _STROKE_PATH, _FILL_TEXT = (
    _mupdf.ll_fz_fill_path,
    _mupdf.ll_fz_stroke_path,
    _mupdf.ll_fz_fill_text,
)


def _path(name: str, place: int) -> Callable[..., Any]:
    draw = getattr(_mupdf, f"ll_fz_{name}")  # not mupdf's: there, some take no more than four colorants
    return lambda self, _context, *arguments: self.paint_path(draw, place, arguments)


def _clipping(name: str) -> Callable[..., Any]:
    draw = getattr(_mupdf, f"ll_fz_{name}")
    return lambda self, _context, *arguments: self.clip_to_text(draw, arguments)


def _text(name: str, place: int) -> Callable[..., Any]:
    draw = getattr(_mupdf, f"ll_fz_{name}")
    return lambda self, _context, *arguments: self.paint_text(draw, place, arguments)


for _name, _function in _FORWARDED.items():
    setattr(PressDevice, _name, _forwarding(_function))
for _name in _CLIPPING:
    setattr(PressDevice, _name, _clipping(_name))
for _name, _place in _PAINTING.items():
    setattr(PressDevice, _name, (_text if _name.endswith("text") else _path)(_name, _place))


MESH_COLORANTS_MAX: Final = 4
"""Most components of a vertex that MuPDF copies."""
STEPS: Final = 256
"""Steps of MuPDF's gradients."""
_HALF_BYTE: Final = 0.5 / 255


@contextlib.contextmanager
def function_in_ink(shade: Any, space: Any, to_ink: ToInk | None, *, is_ink: bool) -> Iterator[None]:
    """Give each step of a gradient with a function the colour of its middle, in ink ``space`` by ``to_ink``.

    MuPDF takes the colour at the step's start and truncates it: up to 4 of 255 too low on steep gradients.
    With ``to_ink`` None, the colours stay those of the gradient's own space. ``is_ink``: they are ink
    amounts.
    """
    samples, stride, own = shade.function, shade.function_stride, shade.colorspace
    given = [mupdf.floats_getitem(samples, i) for i in range(STEPS * stride)]
    colours = np.asarray(given).reshape(STEPS, stride)
    middles = (colours + np.concatenate([colours[1:], colours[-1:]])) / 2
    if to_ink is not None:
        middles = np.column_stack([to_ink(middles[:, : own.n]), middles[:, own.n :]])
        shade.colorspace, shade.function_stride = space.m_internal, middles.shape[1]
    wanted = np.minimum(middles + (_HALF_BYTE if is_ink or to_ink is not None else 0.0), 1.0).ravel()
    floats = mupdf.new_floats(wanted.size)
    for i, value in enumerate(wanted.tolist()):
        mupdf.floats_setitem(floats, i, value)
    shade.function = floats
    try:
        yield
    finally:  # the gradient belongs to the document: leave it as it was
        shade.function, shade.function_stride, shade.colorspace = samples, stride, own
        mupdf.delete_floats(floats)


def mesh_in_ink(shade: Any, ctm: Any, raster: Raster, space: Any, to_ink: ToInk) -> tuple[Any, Any] | None:
    """Return a mesh without a function as an image in ink ``space``, and its matrix; None if it is off the raster.

    Colours between its corners are those of its own space (8.7.4.5.5): they are blended there and converted
    then. It has at most ``MESH_COLORANTS_MAX`` colorants if its space is DeviceN.
    """
    scale = mupdf.FzMatrix(raster.scale, 0, 0, raster.scale, *raster.shift)
    placed = mupdf.fz_concat(mupdf.FzMatrix(ctm.a, ctm.b, ctm.c, ctm.d, ctm.e, ctm.f), scale)
    bounds = mupdf.FzRect(mupdf.ll_fz_bound_shade(shade, placed.internal()))
    page = mupdf.FzIrect(0, 0, raster.columns, raster.rows)
    area = mupdf.fz_intersect_irect(mupdf.fz_irect_from_rect(bounds), page)
    if mupdf.fz_is_empty_irect(area):
        return None
    own = mupdf.FzColorspace(mupdf.ll_fz_keep_colorspace(shade.colorspace))
    if mupdf.fz_colorspace_is_device_n(
        own
    ):  # MuPDF paints into no such pixmap, and copies colours of one space
        colours = mupdf.fz_device_cmyk().m_internal.type
        own = mupdf.fz_new_colorspace(colours, 0, own.m_internal.n, "colorants of a mesh")
    pixmap = mupdf.fz_new_pixmap_with_bbox(own, area, mupdf.FzSeparations(), 1)
    mupdf.fz_clear_pixmap(pixmap)
    parameters = mupdf.FzColorParams()  # kept as long as what is internal to it
    given, shade.colorspace = shade.colorspace, own.m_internal
    try:
        mupdf.ll_fz_paint_shade(
            shade,
            None,
            placed.internal(),
            pixmap.m_internal,
            parameters.internal(),
            area.internal(),
            None,
        )
    finally:  # the gradient belongs to the document: leave it as it was
        shade.colorspace = given
    samples = pixmap_samples(pixmap)
    inside = samples[..., -1:]
    inks = converted_samples(samples[..., :-1], to_ink) * (inside > 0)
    ink = mupdf.fz_new_pixmap_with_bbox(space, area, mupdf.FzSeparations(), 1)
    pixmap_samples(ink)[:] = np.concatenate([inks, inside], axis=2)
    image = mupdf.fz_new_image_from_pixmap(ink, mupdf.FzImage())
    return image, raster_matrix(raster, area.x0, area.y0, area.x1 - area.x0, area.y1 - area.y0)
