"""Gradients in the inks of the press (ISO 32000-2, 8.7.4.5).

Imported late, by ``device`` only: it needs PyMuPDF at import.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pymupdf import mupdf

from prooflight.pages.pdf.images import converted_samples, pixmap_samples, raster_matrix

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight.pages.pdf.colour_management import ToInk
    from prooflight.pages.pdf.images import Raster

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
