"""Drawings of the report: a timeline, bars, the picture of a place, and where on the page it is."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Any, Final

from PIL import Image
from reportlab.lib.units import mm
from reportlab.lib.utils import ImageReader
from reportlab.platypus import Flowable

from prooflight_line.run_package import report_style as style
from prooflight_line.run_package.pictures import A4_MM

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.detectors.verdict import Region
    from prooflight_line.run_package.pictures import SeenPicture
    from prooflight_line.run_package.report_texts import ReportTexts

MOST_BARS: Final = 9
CAPTION: Final = 4 * mm
LEAST_PIXELS: Final = 360
"""Least number of pixels along a picture: fewer are interpolated, as viewers show them as blocks or not."""
LEAST_MARK: Final = 1.2
"""Least side of a mark on the small page, so that it is seen. [pt]"""


class Timeline(Flowable):  # type: ignore[misc]
    """Counts in equal parts of a run, one bar a part, stacked."""

    def __init__(
        self,
        parts: Sequence[tuple[int, ...]],
        *,
        width: float,
        axis: tuple[str, str, str],
        legend: Sequence[tuple[str, Any]],
    ) -> None:
        super().__init__()
        self.width, self.height = width, 38 * mm
        self._parts, self._axis, self._legend = parts, axis, legend

    def draw(self) -> None:
        """Draw it."""
        canvas, base = self.canv, 10 * mm
        most = max(map(sum, self._parts))
        step, room = self.width / len(self._parts), self.height - base
        for index, counts in enumerate(self._parts):
            y = base
            for count, (_, colour) in zip(counts, self._legend, strict=True):
                height = room * count / most
                canvas.setFillColor(colour)
                if height:
                    canvas.rect(index * step + 0.1 * step, y, 0.8 * step, height, stroke=0, fill=1)
                y += height
        canvas.setStrokeColor(style.DIM)
        canvas.setLineWidth(0.6)
        canvas.line(0, base, self.width, base)
        for x, text, align in zip(
            (0, self.width / 2, self.width), self._axis, ("left", "centre", "right"), strict=True
        ):
            style.draw(canvas, x, base - 3.6 * mm, text, align=align)  # type: ignore[arg-type]
        x = 0.0
        for text, colour in self._legend:
            canvas.setFillColor(colour)
            canvas.rect(x, 0.4 * mm, 2.2 * mm, 2.2 * mm, stroke=0, fill=1)
            style.draw(canvas, x + 3.2 * mm, 0.6 * mm, text)
            x += self.width / len(self._legend)


class Bars(Flowable):  # type: ignore[misc]
    """A bar a name, the longest first."""

    def __init__(self, counts: Sequence[tuple[str, int]], *, width: float, say: ReportTexts) -> None:
        super().__init__()
        self._counts, self._say = counts[:MOST_BARS], say
        self.width, self.height = width, len(self._counts) * 7.2 * mm

    def draw(self) -> None:
        """Draw it."""
        canvas, most = self.canv, max(count for _, count in self._counts)
        for index, (name, count) in enumerate(self._counts):
            y = self.height - (index + 1) * 7.2 * mm
            style.draw(
                canvas, 0, y + 3.4 * mm, style.fitted(name, self.width - 12 * mm), colour=style.INK, size=8
            )
            style.draw(
                canvas, self.width, y + 3.4 * mm, self._say.number(count), bold=True, align="right", size=8
            )
            canvas.setFillColor(style.SOFT)
            canvas.rect(0, y + 1 * mm, self.width, 1.3 * mm, stroke=0, fill=1)
            canvas.setFillColor(style.STOP)
            canvas.rect(0, y + 1 * mm, self.width * count / most, 1.3 * mm, stroke=0, fill=1)


class Picture(Flowable):  # type: ignore[misc]
    """Picture of a place as the camera saw it, as large as fits a frame of 5 to 4, with place and scale."""

    def __init__(self, picture: SeenPicture, *, width: float, say: ReportTexts) -> None:
        super().__init__()
        self._picture, self._say = picture, say
        self.width, self._room = width, width * 0.8
        self.height = self._room + CAPTION

    def draw(self) -> None:
        """Draw it."""
        canvas, picture = self.canv, self._picture
        left, top, across, down = picture.box_mm
        scale = min(self.width / across, self._room / down)
        width, height = across * scale, down * scale
        corner = (self.width - width) / 2, CAPTION + (self._room - height) / 2
        canvas.setFillColor(style.SOFT)
        canvas.rect(0, CAPTION, self.width, self._room, stroke=0, fill=1)
        canvas.drawImage(_image(picture), *corner, width, height)
        canvas.setStrokeColor(style.LINE)
        canvas.setLineWidth(0.5)
        canvas.rect(0, CAPTION, self.width, self._room)
        box = None if picture.region is None else _clipped(picture.region, picture.box_mm)
        if box is not None:
            canvas.setStrokeColor(style.STOP)
            canvas.setLineWidth(0.8)
            low = corner[1] + (down - (box[1] - top) - box[3]) * scale
            canvas.rect(corner[0] + (box[0] - left) * scale, low, box[2] * scale, box[3] * scale)
        size = f"{self._say.number(across, 1)} × {self._say.number(down, 1)} mm"
        style.draw(canvas, 0, 0.4 * mm, size)


class Locator(Flowable):  # type: ignore[misc]
    """A small page with the places of a misprint; the page is at least A4, since a journal stores no size."""

    def __init__(self, regions: Sequence[Region], picture: SeenPicture | None, *, width: float) -> None:
        super().__init__()
        self._boxes = [
            (one.x_mm, one.y_mm, one.width_mm, one.height_mm)
            for one in regions
            if all(map(math.isfinite, (one.x_mm, one.y_mm, one.width_mm, one.height_mm)))
        ]
        whole = [] if picture is None or picture.region is not None else [picture.box_mm]
        boxes = [*self._boxes, *whole]
        self._page = (
            max([A4_MM[0], *(x + w for x, _, w, _ in boxes)]),
            max([A4_MM[1], *(y + h for _, y, _, h in boxes)]),
        )
        self._scale = width / self._page[0]
        self.width, self.height = width, self._page[1] * self._scale

    def draw(self) -> None:
        """Draw it."""
        canvas = self.canv
        canvas.setFillColor(style.SOFT)
        canvas.setStrokeColor(style.QUIET)
        canvas.setLineWidth(0.5)
        canvas.rect(0, 0, self.width, self.height, fill=1)
        canvas.setFillColor(style.STOP)
        for x, y, width, height in self._boxes:
            left, top = max(x, 0.0) * self._scale, max(y, 0.0) * self._scale
            across = max(min(width * self._scale, self.width - left), LEAST_MARK)
            down = max(min(height * self._scale, self.height - top), LEAST_MARK)
            canvas.rect(left, self.height - top - down, across, down, stroke=0, fill=1)


def _image(picture: SeenPicture) -> ImageReader:
    image = Image.fromarray(picture.grey)
    if (times := math.ceil(LEAST_PIXELS / max(image.size))) > 1:
        image = image.resize((image.width * times, image.height * times), Image.Resampling.BICUBIC)
    file = io.BytesIO()
    image.save(file, "PNG")
    file.seek(0)
    return ImageReader(file)


def _clipped(
    region: Region, box_mm: tuple[float, float, float, float]
) -> tuple[float, float, float, float] | None:
    """Return the part of a region within a box; None: there is none, or it is all of the box."""
    left, top, width, height = box_mm
    first = max(region.x_mm, left), max(region.y_mm, top)
    last = min(region.x_mm + region.width_mm, left + width), min(region.y_mm + region.height_mm, top + height)
    size = last[0] - first[0], last[1] - first[1]
    if min(size) <= 0 or (size[0] >= width and size[1] >= height):
        return None
    return *first, *size
