"""Display of results in a notebook: the evidence of an inspection, a verdict, a press's report card."""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import singledispatch
from typing import TYPE_CHECKING, Any, Final

from PIL import Image, ImageDraw, ImageFont

from prooflight.detectors.base import Inspection, PlannedPage
from prooflight.detectors.registry import promises
from prooflight.detectors.verdict import Region, Verdict
from prooflight.errors import RequestError
from prooflight.errors import sentence as one_line
from prooflight.press.artefact import Press
from prooflight.reporting import pictures, wording
from prooflight.reporting.html import data_uri, template

if TYPE_CHECKING:
    from prooflight.reporting.pictures import Frame

PANEL_PX: Final = 400
"""Width of each of the three pictures; the page's own pixels are never enlarged beyond ``LEAST_PX``."""
LEAST_PX: Final = 240
GAP_PX: Final = 14
CAPTION_PX: Final = 26
FONT_PX: Final = 14
INK: Final = (40, 44, 50)
GROUND: Final = (255, 255, 255)
EDGE: Final = (196, 196, 190)
MARK: Final = (0, 122, 61)
"""Colour of a region's box: neither end of the difference's scale, nor grey."""
CAPTIONS: Final = ("Expected by the camera", "Seen by the camera", "Difference")
SCALE_NOTE: Final = "orange: darker, blue: lighter"
"""Size of the page of a verdict alone, which is unknown."""


def picture(inspection: Inspection) -> Image.Image:
    """Draw expected image, camera image and difference side by side, with regions as numbered boxes.

    RequestError: the inspection is of no ``Inspector``.
    """
    planned = inspection.planned
    if planned is None:
        remedy = "inspect by pf.Inspector(press, detector)"
        raise RequestError(inspection.verdict.page, "is not known by its press", remedy=remedy)
    frame = pictures.frame_of(inspection, planned)
    expected, measured = pictures.signals(inspection, planned.press_context)
    width = min(PANEL_PX, max(expected.shape[1], LEAST_PX))
    images = (
        pictures.grey_picture(expected, frame, width_px=width),
        pictures.grey_picture(measured, frame, width_px=width),
        pictures.error_picture(inspection.block_z, expected, frame, width_px=width),
    )
    height = max(round(width * frame.height_mm / frame.width_mm), 1)
    panels = [one.resize((width, height), Image.Resampling.BOX).convert("RGB") for one in images]
    return _side_by_side(panels, frame, inspection.regions)


def sentence(result: Any) -> str:
    """Return a result in one line."""
    return one_line(_sentence(result))


@singledispatch
def html(result: Any) -> str:
    """Return a result as HTML."""
    raise TypeError(type(result).__name__)


@html.register
def _(result: Inspection) -> str:
    image = None if result.planned is None else _data(picture(result))
    return template("notebook_verdict").render(
        verdict=result.verdict, said=sentence(result), image=image, note=SCALE_NOTE
    )


@html.register
def _(result: Verdict) -> str:
    return template("notebook_verdict").render(verdict=result, said=sentence(result), image=None, note="")


@html.register
def _(result: Press) -> str:
    return template("notebook_press").render(press=result, said=sentence(result), promises=promises(result))


@singledispatch
def _sentence(result: object) -> str:
    raise TypeError(type(result).__name__)


@_sentence.register
def _(result: Inspection) -> str:
    return wording.judged(result.verdict, _size_mm(result.planned))


@_sentence.register
def _(result: Verdict) -> str:
    return wording.judged(result, None)


@_sentence.register
def _(result: Press) -> str:
    geometry = result.geometry
    return (
        f"Press {result.name}: {wording.count(len(result.sensors), 'sensor')} of {geometry.pixels:,} pixels, "
        f"{geometry.pixel_pitch_mm:.3f} mm each on the page, {geometry.field_mm:.0f} mm across."
    )


def _size_mm(planned: PlannedPage | None) -> tuple[float, float] | None:
    return None if planned is None else (planned.page.width_mm, planned.page.height_mm)


def _side_by_side(panels: Sequence[Image.Image], frame: Frame, regions: Sequence[Region]) -> Image.Image:
    width, height = panels[0].size
    whole = Image.new(
        "RGB",
        (len(panels) * (width + GAP_PX) + GAP_PX, height + CAPTION_PX + GAP_PX),
        GROUND,
    )
    draw, font = ImageDraw.Draw(whole), ImageFont.load_default(FONT_PX)
    for index, (panel, caption) in enumerate(zip(panels, CAPTIONS, strict=True)):
        left = GAP_PX + index * (width + GAP_PX)
        whole.paste(panel, (left, CAPTION_PX))
        draw.rectangle((left - 1, CAPTION_PX - 1, left + width, CAPTION_PX + height), outline=EDGE)
        draw.text((left, CAPTION_PX // 2), caption, fill=INK, font=font, anchor="lm")
        if index:  # the expected image has no boxes
            for number, region in enumerate(regions, start=1):
                _mark(draw, region, number, frame, (left, CAPTION_PX, width, height), font)
    return whole


def _mark(
    draw: ImageDraw.ImageDraw,
    region: Region,
    number: int,
    frame: Frame,
    panel: tuple[int, int, int, int],
    font: Any,
) -> None:
    """Draw a region's box and its number, within its panel (left, top, width, height)."""
    left, top, width, height = panel
    scale = width / frame.width_mm
    x = [left + (mm - frame.x_mm) * scale for mm in (region.x_mm, region.x_mm + region.width_mm)]
    y = [top + (mm - frame.y_mm) * scale for mm in (region.y_mm, region.y_mm + region.height_mm)]
    x = [min(max(one, left), left + width - 1) for one in x]
    y = [min(max(one, top), top + height - 1) for one in y]
    draw.rectangle((x[0], y[0], x[1], y[1]), outline=MARK, width=2)
    label = str(number)
    wide = draw.textlength(label, font=font) + 8
    high = FONT_PX + 4
    above = y[0] - high >= top
    at_x, at_y = min(x[0], left + width - wide), y[0] - high if above else min(y[0], top + height - high)
    draw.rectangle((at_x, at_y, at_x + wide, at_y + high), fill=MARK)
    draw.text((at_x + wide / 2, at_y + high / 2), label, fill=GROUND, font=font, anchor="mm")


def _data(image: Image.Image) -> str:
    file = io.BytesIO()
    image.save(file, "PNG", optimize=True)
    return data_uri(file.getvalue(), "png")
