"""Real copies against each other, the golden way: sheets as they are, and with voids and streaks laid into them.

Sheets lie in a folder for each copy, named by the page that they show, and go through what ``inspect --golden`` runs.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from PIL import Image

from prooflight.inspection.golden import GoldenInspector, golden_pages
from prooflight.inspection.scanner.finding import PlacedScan
from prooflight.pages.files import page_name
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.raster import MM_PER_INCH
from prooflight.pages.zones.zones_file import JobZones, ZoneEntry
from prooflight.rng import stream

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.verdict import Verdict
    from prooflight.inspection.golden import GoldenPage
    from prooflight.inspection.job import Pair

VOID_MM: Final = 0.5
VOIDS: Final = 8
STREAKS: Final = 2
STREAK_PIXELS: Final = 3
STREAK_SHARE: Final = 0.25
"""Share that a streak takes of the number of bare paper."""
STREAK_MM: Final = 60.0
"""Length of a streak, along the feed."""
BORDER_MM: Final = 15.0
SEPARATION_MM: Final = 5.0
INK: Final = 0.5
"""Number below which a pixel counts as ink, as a share of the greatest."""
LEAST_INK: Final = 0.2
"""Least share of a void that takes ink away: 0.1 mm of its 0.5 mm, where it crosses a line. One that takes hardly any
is no misprint."""
BARE: Final = 0.99
"""Least share of a streak that lies on bare paper."""
TRIES: Final = 20_000
BoxMm = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class VoidRow:
    """One void of a sheet."""

    ink_share: float
    """Share of the void that print filled."""
    caught: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class GoldenRow:
    """One sheet against the same page of the other copy."""

    scans: str
    golden: str
    page: int
    turned: bool
    """Whether one of both was fed by its other edge."""
    verdict: str
    places: int
    """Places that differ on the sheet as it is."""
    voids: tuple[VoidRow, ...]
    streaks: int
    streaks_caught: int


def golden_rows(
    copies: Mapping[Path, Sequence[Pair]],
    stamp_mm: BoxMm,
    seed: int,
    progress: Callable[[str], None],
) -> Iterator[GoldenRow]:
    """Yield a row for each sheet of each copy against each other copy; ``stamp_mm`` is not judged."""
    with tempfile.TemporaryDirectory() as temporary:
        folders = {path: Path(temporary) / path.stem for path in copies}
        turned = {path: _turned(path, pairs, folders[path]) for path, pairs in copies.items()}
        for at, (golden, scans) in enumerate(permutations(copies, 2)):
            pages = golden_pages(folders[golden], folders[scans])
            work = GoldenInspector.of(None, pages[0].goldens[0])
            for page, over in zip(
                _without_stamp(pages, work, turned[golden], stamp_mm), turned[golden], strict=True
            ):
                progress(f"{scans.stem} against {golden.stem}: page {page.number}")
                other = turned[scans][page.number - 1]
                rng = stream(seed, "real-marks", len(copies) + at, page.number)
                yield _row(page, work, scans.stem, golden.stem, over, other, stamp_mm, rng)


def _turned(path: Path, pairs: Sequence[Pair], folder: Path) -> list[bool]:
    """Write the scans of a copy by the names of their pages; return which of them are upside down."""
    folder.mkdir()
    turned = []
    with PdfJob(path) as pdf:
        for number, scan in pairs:
            assert isinstance(scan, PlacedScan)
            samples, dpi = pdf.picture(scan.scan.number)
            Image.fromarray(samples[..., 0]).save(folder / f"{page_name(number)}.png", dpi=dpi)
            turned.append(scan.where.turned)
    return turned


def _without_stamp(
    pages: Sequence[GoldenPage], work: GoldenInspector, turned: Sequence[bool], stamp_mm: BoxMm
) -> list[GoldenPage]:
    """Return the pages with the stamp as an ignored zone, where their golden has it."""
    sizes = [_size_mm(page, work) for page in pages]
    entries = [
        ZoneEntry(
            name=f"stamp {page.number}",
            kind="ignore",
            pages=str(page.number),
            rectangle_mm=_over(stamp_mm, size, over),
        )
        for page, size, over in zip(pages, sizes, turned, strict=True)
    ]
    path = pages[0].goldens[0].path.with_name("zones.json")
    JobZones.create(entries, sizes).save(path)
    return work.with_zones(pages, path)


def _size_mm(page: GoldenPage, work: GoldenInspector) -> tuple[float, float]:
    pitch_mm, shape = work.pitch_mm(page), page.goldens[0].read().light.shape
    return shape[2] * pitch_mm[0], shape[1] * pitch_mm[1]


def _over(box: BoxMm, size: tuple[float, float], turned: bool) -> BoxMm:
    """Return a box as it lies on a sheet of this size, turned by 180 degrees or not."""
    x, y, width, height = box
    return (max(size[0] - x - width, 0.0), size[1] - y - height, width, height) if turned else box


def _row(
    page: GoldenPage,
    work: GoldenInspector,
    scans: str,
    golden: str,
    golden_turned: bool,
    turned: bool,
    stamp_mm: BoxMm,
    rng: np.random.Generator,
) -> GoldenRow:
    assert page.scan is not None
    clean = work(page)
    picture = Image.open(page.scan.path)
    samples, pitch_mm = np.asarray(picture), MM_PER_INCH / float(picture.info["dpi"][0])
    size = samples.shape[1] * pitch_mm, samples.shape[0] * pitch_mm
    marked, voids, shares, streaks = _marked(samples, pitch_mm, _over(stamp_mm, size, turned), rng)
    Image.fromarray(marked).save(page.scan.path, dpi=picture.info["dpi"])
    judged = work(page)
    Image.fromarray(samples).save(page.scan.path, dpi=picture.info["dpi"])
    # A scan that is read the other way round has its places as the golden is read.
    round_ = turned != golden_turned
    new = new_places(judged, clean)
    caught = [
        [any(_touches(_over(box, size, round_), one) for one in new) for box in boxes]
        for boxes in (voids, streaks)
    ]
    return GoldenRow(
        scans=scans,
        golden=golden,
        page=page.number,
        turned=round_,
        verdict=clean.verdict,
        places=len(clean.regions),
        voids=tuple(
            VoidRow(ink_share=round(share, 2), caught=one)
            for share, one in zip(shares, caught[0], strict=True)
        ),
        streaks=len(streaks),
        streaks_caught=sum(caught[1]),
    )


def _marked(
    samples: NDArray[np.uint8], pitch_mm: float, stamp_mm: BoxMm, rng: np.random.Generator
) -> tuple[NDArray[np.uint8], list[BoxMm], list[float], list[BoxMm]]:
    """Return the sheet with voids in its print and streaks on its paper.

    Also the boxes of voids, the share of each that print filled, and the boxes of streaks. A void's centre is print.
    """
    marked, paper = samples.copy(), int(np.median(samples))
    radius = VOID_MM / 2 / pitch_mm
    reach = int(np.ceil(radius))
    along, across = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = (along**2 + across**2 <= radius**2).astype(np.float32)
    ink = (samples < INK * 255).astype(np.float32)
    filled = cv2.filter2D(ink, -1, disc / disc.sum())
    border, length = round(BORDER_MM / pitch_mm), round(STREAK_MM / pitch_mm)
    free = np.zeros(samples.shape, np.bool_)
    free[border:-border, border:-border] = True
    left, top, width, height = (round(side / pitch_mm) for side in stamp_mm)
    free[max(top - border, 0) : top + height + border, left : left + width] = False
    inked = np.argwhere((ink > 0) & (filled >= LEAST_INK) & free)
    bare = cv2.boxFilter((samples >= paper - 3).astype(np.float32), -1, (3 * STREAK_PIXELS, length)) > BARE
    inside = free.copy()
    inside[: length // 2 + border] = inside[len(samples) - length // 2 - border :] = False
    bare_places = np.argwhere(
        bare & inside & cv2.erode(free.astype(np.uint8), np.ones((length, 1))).astype(bool)
    )
    taken: list[tuple[float, float]] = []
    centres = _drawn(inked, VOIDS, taken, pitch_mm, rng)
    voids = [(x - reach, y - reach, 2 * reach + 1, 2 * reach + 1) for y, x in centres]
    streaks = [
        (x - STREAK_PIXELS // 2, y - length // 2, STREAK_PIXELS, length)
        for y, x in _drawn(bare_places, STREAKS, taken, pitch_mm, rng)
    ]
    for x, y, side, _ in voids:
        part = marked[y : y + side, x : x + side]
        part[disc > 0] = paper
    for x, y, wide, high in streaks:
        part = marked[y : y + high, x : x + wide]
        part[:] = np.rint(part * (1 - STREAK_SHARE))
    scale = [[tuple(side * pitch_mm for side in box) for box in boxes] for boxes in (voids, streaks)]
    return marked, scale[0], [float(filled[at]) for at in centres], scale[1]  # type: ignore[return-value]


def _drawn(
    places: NDArray[np.intp],
    count: int,
    taken: list[tuple[float, float]],
    pitch_mm: float,
    rng: np.random.Generator,
) -> list[tuple[int, int]]:
    """Draw places that lie apart from all that are taken; as many as there are."""
    chosen: list[tuple[int, int]] = []
    for at in rng.permutation(len(places))[:TRIES]:
        y, x = places[at].tolist()
        if all(np.hypot(y - one[0], x - one[1]) * pitch_mm > SEPARATION_MM for one in taken):
            chosen.append((y, x))
            taken.append((y, x))
            if len(chosen) == count:
                break
    return chosen


def new_places(judged: Verdict, before: Verdict) -> list[BoxMm]:
    """Return the places of a misprint that the sheet did not have before marks were laid into it."""
    if judged.verdict != "misprint":
        return []
    had = {(one.x_mm, one.y_mm) for one in before.regions}
    return [
        (one.x_mm, one.y_mm, one.width_mm, one.height_mm)
        for one in judged.regions
        if (one.x_mm, one.y_mm) not in had
    ]


def _touches(one: BoxMm, other: BoxMm) -> bool:
    """Return whether two boxes touch, within half a millimetre that regions are rounded and moved by."""
    return all(
        one[side] < other[side] + other[side + 2] + VOID_MM
        and other[side] < one[side] + one[side + 2] + VOID_MM
        for side in (0, 1)
    )
