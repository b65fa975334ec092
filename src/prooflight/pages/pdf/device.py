"""The MuPDF device that paints what a press prints: ink amounts to the nearest byte, other colours by Little CMS.

Imported late, by ``plates`` only: it needs PyMuPDF at import.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pymupdf import _mupdf, mupdf

from prooflight.pages.pdf.colour_management import Inks, address
from prooflight.pages.pdf.images import ConvertedImages, Raster, placed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

INKS_MAX = 32  # MuPDF's FZ_MAX_COLORS
SHADE_STEPS = 256  # of MuPDF's gradients

_FORWARDED = {
    name: name
    for name in (
        *("clip_path", "clip_stroke_path", "clip_text", "clip_stroke_text", "pop_clip"),
        *("ignore_text", "render_flags", "end_tile"),
    )
} | {"begin_tile": "begin_tile_tid"}
"""Drawing calls without a colour, and the function that takes all of their arguments."""
_PAINTING = {"fill_path": 3, "stroke_path": 3, "fill_text": 2, "stroke_text": 3}
"""Drawing calls with a colour, and where among their arguments the colour space stands; the colour follows."""
_OVERRIDDEN = (
    *("fill_shade", "fill_image", "fill_image_mask", "clip_image_mask"),
    *("begin_mask", "end_mask", "begin_group", "end_group", "set_default_colorspaces"),
)


def nearest_byte(value: float) -> float:
    """The ink amount that MuPDF's truncation turns into the byte ``round(255 * value)``; above 0 stays above 0.

    Overprint mode 1 leaves alone what is exactly 0, so a trace of ink must not become 0 here. MuPDF holds colours
    in single precision: six decimals bring back the number that the file states.
    """
    return min(1.0, (round(255 * round(value, 6)) + 0.25) / 255) if value > 0 else 0.0


class PressDevice(mupdf.FzDevice2):  # type: ignore[misc]
    """Draws on another MuPDF device. ``close`` it once the page is drawn."""

    def __init__(self, drawing: Any, inks: Inks, rgb: Any, document: Any, raster: Raster) -> None:
        """``inks`` stand for DeviceCMYK and ``rgb`` for DeviceRGB, whatever the document's output intent is."""
        super().__init__()
        self.troubles: list[str] = []
        """What could not be drawn, in MuPDF's words."""
        self._drawing, self._inks, self._rgb, self._raster = drawing.m_internal, inks, rgb, raster
        device = (mupdf.fz_device_gray(), mupdf.fz_device_rgb(), mupdf.fz_device_cmyk())
        intent = mupdf.pdf_document_output_intent(document)
        self._replaced = frozenset(address(space.m_internal) for space in (*device, intent))
        self._defaults: Any = None
        self._amounts = mupdf.new_floats(INKS_MAX)
        self._foreign = [False]  # for every open group: are its colours other than the press's?
        self._images = ConvertedImages(inks, self._resolved)
        for name in (*_FORWARDED, *_PAINTING, *_OVERRIDDEN):
            getattr(self, f"use_virtual_{name}")()

    def close(self) -> None:
        """End the page; call it once."""
        mupdf.fz_close_device(self)
        mupdf.delete_floats(self._amounts)
        mupdf.ll_fz_drop_default_colorspaces(self._defaults)

    def pass_on(self, draw: Callable[..., Any], *arguments: Any) -> Any:
        """Draw; what fails is noted and left out, as MuPDF itself does with a damaged image or font."""
        try:
            return draw(self._drawing, *arguments)
        except mupdf.FzErrorBase as error:
            self.troubles.append(str(error))
            return 0

    def set_default_colorspaces(self, _context: Any, defaults: Any) -> None:
        """Let the press's inks stand for DeviceCMYK; a /DefaultCMYK, /DefaultRGB or /DefaultGray stays."""
        mine = mupdf.ll_fz_clone_default_colorspaces(defaults)
        own = {"gray": mupdf.fz_device_gray(), "rgb": self._rgb, "cmyk": self._inks.space}
        for colours, space in own.items():
            if address(getattr(mupdf, f"ll_fz_default_{colours}")(mine)) in self._replaced:
                getattr(mupdf, f"ll_fz_set_default_{colours}")(mine, space.m_internal)
        mupdf.ll_fz_set_default_output_intent(mine, self._inks.space.m_internal)
        self.pass_on(_mupdf.ll_fz_set_default_colorspaces, mine)
        mupdf.ll_fz_drop_default_colorspaces(self._defaults)
        self._defaults = mine

    def begin_group(self, _context: Any, area: Any, space: Any, *rest: Any) -> None:
        """Inside a group that blends in other colours, MuPDF converts: to them first, and to ink at its end."""
        other = bool(space) and address(self._resolved(space)) != address(self._inks.space.m_internal)
        self._foreign.append(other or self._foreign[-1])
        self.pass_on(_mupdf.ll_fz_begin_group, area, space, *rest)

    def end_group(self, _context: Any) -> None:
        """Back to the colours of the group around this one."""
        self._foreign.pop()
        self.pass_on(_mupdf.ll_fz_end_group)

    def begin_mask(self, _context: Any, *arguments: Any) -> None:
        """A soft mask is grey."""
        self._foreign.append(True)
        self.pass_on(_mupdf.ll_fz_begin_mask, *arguments)

    def end_mask(self, _context: Any, function: Any) -> None:
        """From here to its pop_clip the mask clips."""
        self._foreign.pop()
        self.pass_on(_mupdf.ll_fz_end_mask_tr, function)

    def fill_shade(self, _context: Any, shade: Any, *rest: Any) -> None:
        """Draw a gradient, each of its 256 steps in the colour of its middle.

        MuPDF would take the colour at the step's start and truncate it: up to 4 of 255 too low on steep gradients.
        """
        samples, stride = shade.function, shade.function_stride
        colours = [mupdf.floats_getitem(samples, i) for i in range(SHADE_STEPS * stride)] if samples else []
        is_ink = mupdf.ll_fz_colorspace_is_subtractive(shade.colorspace) or shade.colorspace.n == 1
        half_byte = 0.5 / 255 if is_ink and not self._foreign[-1] else 0.0
        for i, (start, end) in enumerate(zip(colours, colours[stride:] + colours[-stride:], strict=True)):
            mupdf.floats_setitem(samples, i, min(1.0, (start + end) / 2 + half_byte))
        self.pass_on(_mupdf.ll_fz_fill_shade, shade, *rest)
        for i, colour in enumerate(colours):  # the gradient belongs to the document: leave it as it was
            mupdf.floats_setitem(samples, i, colour)

    def fill_image(self, _context: Any, image: Any, ctm: Any, *rest: Any) -> None:
        """Draw an image, in ink if it was in colours to be converted."""
        try:
            ink = image if self._foreign[-1] else self._images.get(image, rest[-1])
        except mupdf.FzErrorBase as error:
            self.troubles.append(str(error))
            return
        self._draw_image(_mupdf.ll_fz_fill_image, ink, ctm, *rest)

    def fill_image_mask(
        self, _context: Any, image: Any, ctm: Any, space: Any, colour: Any, *rest: Any
    ) -> None:
        """Paint through a stencil."""
        self._draw_image(
            _mupdf.ll_fz_fill_image_mask, image, ctm, *self.exact(space, colour, rest[-1]), *rest
        )

    def clip_image_mask(self, _context: Any, image: Any, ctm: Any, scissor: Any) -> None:
        """Clip to a stencil."""
        self._draw_image(_mupdf.ll_fz_clip_image_mask, image, ctm, scissor)

    def _draw_image(self, draw: Callable[..., Any], image: Any, ctm: Any, *rest: Any) -> None:
        # A clip must be passed on whatever becomes of its image, because its pop_clip will be.
        try:
            best, matrix, blended = placed(image, ctm, self._raster)
        except mupdf.FzErrorBase as error:
            self.troubles.append(str(error))
            best, matrix, blended = mupdf.FzImage(mupdf.ll_fz_keep_image(image)), ctm, True
        switch = mupdf.ll_fz_disable_device_hints if blended else mupdf.ll_fz_enable_device_hints
        switch(self._drawing, mupdf.FZ_DONT_INTERPOLATE_IMAGES)
        self.pass_on(draw, best.m_internal, matrix, *rest)

    def exact(self, space: Any, colour: Any, parameters: Any) -> tuple[Any, Any]:
        """Colour space and colour (float*) to paint with.

        Ink amounts are rounded; Separation /All becomes as much of each process ink and knocks spots out, because
        their plates are not printed; other colours are converted, where Little CMS can, and then overprint as OPM 0
        (ISO 32000-2, 11.7.4.3: mode 1 is for DeviceCMYK alone).
        """
        if not space or self._foreign[-1]:
            return space, colour
        if mupdf.ll_fz_colorspace_is_device_n(space):
            amounts = [mupdf.floats_getitem(colour, i) for i in range(space.n)]
            if space.n == 1 and mupdf.ll_fz_colorspace_colorant(space, 0) == "All":
                parameters.op = 0
                return self._painted(self._inks.space.m_internal, amounts * 4)
            return self._painted(space, amounts)
        actual = self._resolved(space)
        inks = self._inks.convert(
            actual, [[mupdf.floats_getitem(colour, i) for i in range(actual.n)]], parameters
        )
        if inks is None:
            return space, colour
        if address(actual) != address(self._inks.space.m_internal):
            parameters.opm = 0
        return self._painted(self._inks.space.m_internal, inks[0].tolist())

    def _painted(self, space: Any, amounts: Iterable[float]) -> tuple[Any, Any]:
        for i, amount in enumerate(amounts):
            mupdf.floats_setitem(self._amounts, i, nearest_byte(amount))
        return space, self._amounts

    def _resolved(self, space: Any) -> Any:
        """What a device colour space stands for on this page."""
        if not self._defaults or not mupdf.ll_fz_colorspace_is_device(space):
            return space
        for colours in ("cmyk", "rgb", "gray"):
            if getattr(mupdf, f"ll_fz_colorspace_is_{colours}")(space):
                return getattr(mupdf, f"ll_fz_default_{colours}")(self._defaults)
        return space


def _forwarding(name: str) -> Callable[..., Any]:
    draw = getattr(_mupdf, f"ll_fz_{name}")
    return lambda self, _context, *arguments: self.pass_on(draw, *arguments)


def _painting(name: str, place: int) -> Callable[..., Any]:
    draw = getattr(_mupdf, f"ll_fz_{name}")  # not mupdf's: there, some take no more than four colorants

    def paint(self: PressDevice, _context: Any, *arguments: Any) -> None:
        colour = self.exact(arguments[place], arguments[place + 1], arguments[-1])
        self.pass_on(draw, *arguments[:place], *colour, *arguments[place + 2 :])

    return paint


for _name, _function in _FORWARDED.items():
    setattr(PressDevice, _name, _forwarding(_function))
for _name, _place in _PAINTING.items():
    setattr(PressDevice, _name, _painting(_name, _place))
