"""A contact sheet of all kinds of misprints at three severities, for visual inspection."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from prooflight.files.atomic import whole_file
from prooflight.pages.job import open_job
from prooflight.reporting.pictures import appearance
from prooflight.rng import stream
from prooflight.simulation.misprints.kinds import KINDS, Drawn, draw_misprint

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page

SEVERITIES: Final = (0.15, 0.5, 1.0)
DPI: Final = 300.0
"""Resolution of the pages: fine enough for the crops."""
PAGES: Final = 10
"""Greatest number of pages, spread evenly over a longer job."""
TRIALS: Final = 8
"""Number of draws of a kind, on random pages and places; the one that changes the most is shown."""
VIEW_MM: Final = {
    "density": 120.0,
    "plane-register": 16.0,
    "streak": 45.0,
    "banding": 110.0,
    "spots-voids": 40.0,
    "ghost-smear": 80.0,
    "local-blur": 24.0,
    "missing-content": 130.0,
}
"""Side of the piece of page that is shown; of other kinds the whole page is."""
PICTURE_PX: Final = 420
SAMPLE_STEP: Final = 10
"""Step of the pixels, both ways, on which the visibility of a misprint is evaluated."""
BACKING_SRGB: Final = 150
OUTLINE: Final = "#0a9e2c"
OUTLINE_MARGIN: Final = 0.012
"""Margin between a region and its outline, as a share of the view's width."""
_CELL_INCH: Final = (2.15, 2.42)


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Part of a page. [mm]"""

    x_mm: float
    y_mm: float
    width_mm: float
    height_mm: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exhibit:
    """One right page and its misprints at each of ``SEVERITIES``, and the part of it to show."""

    kind: str
    good: Page
    """The page without a misprint."""
    drawn: tuple[Drawn, ...]
    view: View


def draw_misprint_sheet(
    path: Path,
    job: Path,
    table: NDArray[np.uint8],
    *,
    kinds: Sequence[str] = KINDS,
    seed: int = 1,
    progress: Callable[[str], None] = lambda _text: None,
) -> None:
    """Write one picture of misprints on the pages of a job, in the format of ``path``'s suffix.

    table: ``Press.appearance_srgb``. JobError: the job cannot be used.
    """
    progress("ripping pages")
    with open_job(job, dpi=DPI) as opened:
        numbers = np.unique(np.linspace(1, len(opened), min(PAGES, len(opened))).round()).astype(int)
        pages = {int(number): opened.page(int(number)) for number in numbers}
    rows = -(-len(kinds) // 2)
    columns = 2 * (len(SEVERITIES) + 1)
    figure = Figure(figsize=(_CELL_INCH[0] * columns, _CELL_INCH[1] * rows + 0.3), dpi=150)
    FigureCanvasAgg(figure)
    figure.subplots_adjust(left=0.008, right=0.992, top=0.985, bottom=0.022, wspace=0.06, hspace=0.28)
    for place, kind in enumerate(kinds):
        progress(f"drawing {kind}")
        exhibit = exhibit_of(kind, pages, table, seed=seed)
        first = (place % rows) * columns + (place // rows) * (len(SEVERITIES) + 1)
        panels = [figure.add_subplot(rows, columns, first + 1 + step) for step in range(len(SEVERITIES) + 1)]
        _show(panels[0], exhibit, None, table)
        for axes, drawn in zip(panels[1:], exhibit.drawn, strict=True):
            _show(axes, exhibit, drawn, table)
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, format=path.suffix[1:])


def exhibit_of(kind: str, pages: Mapping[int, Page], table: NDArray[np.uint8], *, seed: int) -> Exhibit:
    """Return a kind of misprint on the page and at the place, of ``TRIALS`` drawn, where it is most visible.

    The three severities are the same draw but for the amounts. Wrong pages differ more in kind than in amount: each is
    a draw of its own.
    """
    choice = stream(seed, "exhibit-place", KINDS.index(kind))

    def draw(number: int, severity: float, draw_seed: int) -> Drawn:
        others = [other for other in pages if other != number]
        rng = stream(draw_seed, "exhibit-misprint")
        return draw_misprint(pages[number], kind, severity, others=others, fetch=pages.__getitem__, rng=rng)

    places = [(int(choice.choice(list(pages))), int(choice.integers(2**32))) for _ in range(TRIALS)]
    seen = [_where_seen(pages[one], draw(one, 1.0, drawn_by), kind, table) for one, drawn_by in places]
    best = max(range(TRIALS), key=lambda trial: seen[trial][0])
    (number, draw_seed), view = places[best], seen[best][1]
    drawn: list[Drawn] = []
    for severity in SEVERITIES:
        drawn.append(draw(number, severity, draw_seed))
        while kind == "wrong-page" and _way(drawn[-1]) in map(_way, drawn[:-1]):
            drawn[-1] = draw(number, severity, int(choice.integers(2**32)))
    return Exhibit(kind=kind, good=pages[number], drawn=tuple(drawn), view=view)


def _way(drawn: Drawn) -> str:
    """Return the detail without its numbers."""
    return re.sub(r"[0-9.]+", "", drawn.misprint.detail)


def _where_seen(page: Page, drawn: Drawn, kind: str, table: NDArray[np.uint8]) -> tuple[float, View]:
    """Return the visible change at the page's most changed place, and a view about it.

    For some kinds the view is the whole page.
    """
    sampled = [
        appearance(cmyk[::SAMPLE_STEP, ::SAMPLE_STEP], table).astype(np.float32)
        for cmyk in (page.cmyk, drawn.page.cmyk)
    ]
    pitch_mm = page.pixel_mm * SAMPLE_STEP
    change = np.abs(sampled[1] - sampled[0]).sum(axis=2) * _visibility(
        page.cmyk[::SAMPLE_STEP, ::SAMPLE_STEP], kind
    )
    if kind not in VIEW_MM:
        return float(change.mean()), View(x_mm=0, y_mm=0, width_mm=page.width_mm, height_mm=page.height_mm)
    side_mm = VIEW_MM[kind]
    about = cv2.GaussianBlur(change, (0, 0), side_mm / 4 / pitch_mm, borderType=cv2.BORDER_CONSTANT)
    row, column = np.unravel_index(int(about.argmax()), about.shape)
    width_mm, height_mm = min(side_mm, page.width_mm), min(side_mm, page.height_mm)
    return float(about.max()), View(
        x_mm=min(max(float(column) * pitch_mm - width_mm / 2, 0), page.width_mm - width_mm),
        y_mm=min(max(float(row) * pitch_mm - height_mm / 2, 0), page.height_mm - height_mm),
        width_mm=width_mm,
        height_mm=height_mm,
    )


def _visibility(cmyk: NDArray[np.uint8], kind: str) -> NDArray[np.float32]:
    """Return the visibility of a kind where such ink is printed (rows, columns), 0..1."""
    if kind == "plane-register":  # where two inks meet
        around = cv2.blur(cmyk, (5, 5)).astype(np.float32) / 255
        second: NDArray[np.float32] = np.sort(around, axis=2)[..., -2]
        return second
    if kind in ("scum", "ghost-smear"):  # ink where there should be paper
        return 1 - cmyk.max(axis=2).astype(np.float32) / 255
    return np.ones(cmyk.shape[:2], np.float32)


def _show(axes: Axes, exhibit: Exhibit, drawn: Drawn | None, table: NDArray[np.uint8]) -> None:
    """Show one panel: the good page, or one of its misprints with its region outlined."""
    view = exhibit.view
    picture = _picture(exhibit.good if drawn is None else drawn.page, view, table)
    if drawn is not None:
        picture = _placed(picture, view, drawn)
    extent = (view.x_mm, view.x_mm + view.width_mm, view.y_mm + view.height_mm, view.y_mm)
    axes.imshow(picture, extent=extent, interpolation="nearest", aspect="equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color("#999999")
        spine.set_linewidth(0.5)
    axes.set_anchor("N")
    if drawn is None:
        axes.set_title(exhibit.kind, fontsize=8, fontweight="bold", loc="left", pad=3)
        size = "the page" if exhibit.kind not in VIEW_MM else f"{view.width_mm:.0f} mm of the page"
        axes.set_xlabel(f"{size} as it should be", fontsize=5.5, loc="left", labelpad=2)
        return
    misprint = drawn.misprint
    axes.set_title(f"severity {misprint.severity:g}", fontsize=6.5, loc="left", pad=3)
    axes.set_xlabel(_wrapped(misprint.detail), fontsize=5.5, loc="left", labelpad=2)
    x, y, width, height = misprint.region_mm
    margin = OUTLINE_MARGIN * view.width_mm
    whole = width >= exhibit.good.width_mm - 0.01 and height >= exhibit.good.height_mm - 0.01
    for x, y, width, height in () if whole else misprint.regions_mm or (misprint.region_mm,):
        corner = (x - margin, y - margin)
        axes.add_patch(
            Rectangle(
                corner, width + 2 * margin, height + 2 * margin, fill=False, edgecolor=OUTLINE, linewidth=0.5
            )
        )
    axes.set_xlim(extent[0], extent[1])
    axes.set_ylim(extent[2], extent[3])


def _picture(page: Page, view: View, table: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a part of a page in sRGB (rows, columns, 3), at the page's resolution or ``PICTURE_PX`` wide."""
    left, top = round(view.x_mm / page.pixel_mm), round(view.y_mm / page.pixel_mm)
    width, height = round(view.width_mm / page.pixel_mm), round(view.height_mm / page.pixel_mm)
    part = page.cmyk[top : top + height, left : left + width]
    if width > PICTURE_PX:
        part = cv2.resize(
            part, (PICTURE_PX, round(PICTURE_PX * height / width)), interpolation=cv2.INTER_AREA
        )
    return appearance(part, table)


def _placed(picture: NDArray[np.uint8], view: View, drawn: Drawn) -> NDArray[np.uint8]:
    """Return the picture of a whole page that is displaced, with the backing around it."""
    rows, columns = picture.shape[:2]
    y_mm, x_mm = np.mgrid[:rows, :columns] + 0.5
    pitch = view.width_mm / columns
    seen = drawn.placement.seen_mm(
        x_mm * pitch + view.x_mm,
        y_mm * pitch + view.y_mm,
        page_width_mm=drawn.page.width_mm,
        page_height_mm=drawn.page.height_mm,
    )
    at = [
        ((s - first) / pitch - 0.5).astype(np.float32)
        for s, first in zip(seen, (view.x_mm, view.y_mm), strict=True)
    ]
    border = (BACKING_SRGB,) * 3
    moved = cv2.remap(
        picture, at[0], at[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=border
    )
    return np.asarray(moved, np.uint8)


def _wrapped(text: str, width: int = 44) -> str:
    """Break a text that is too long into two lines."""
    if len(text) <= width:
        return text
    at = text.rfind(" ", 0, width)
    return text[:at] + "\n" + text[at + 1 :]
