"""Rows of prints: named marks and good prints on composed designs, and marks of all levels on pages of all places."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import cv2
import numpy as np

from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import Corpus
from prooflight_studies.harness.baselines import LEAST_PIXELS, dissimilarity
from prooflight_studies.visible.marks import KINDS, LETTERS, NAMED, ON_TINTS, SMALLEST, levels_of
from prooflight_studies.visible.rig import Bench, alarmed, uninspected
from prooflight_studies.visible.sheets import (
    SIZES_PT,
    WHERE,
    PlacesPage,
    edge_length_m,
    ink_share,
    nearly_blank,
    slip_of,
    somewhere,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection
    from prooflight.inspection.inspector import Prepared
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight_studies.harness.result_cache import Rows
    from prooflight_studies.visible.marks import NamedMark
    from prooflight_studies.visible.rig import Camera

SCREENING_DPI: Final = 50.0
"""Resolution at which designs are searched for places; the print's own resolution decides."""
SLACK_MM: Final = 0.3
"""Margin by which a place must be larger at that resolution."""
DESIGN_SEED: Final = 2
"""Added to the study's seed: designs that are judged are of a seed of their own."""
GOOD_FROM: Final = 100_000
"""Numbers of designs that are printed well alone, apart from those with marks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedMark:
    """A named mark and where it is to be."""

    mark: NamedMark
    place: str

    @property
    def name(self) -> str:
        """Name of mark and place."""
        return f"{self.mark.name}/{self.place}"


TABLE: Final = (
    *(PlacedMark(mark=mark, place="paper") for mark in NAMED),
    PlacedMark(mark=LETTERS, place="near text"),
    *(PlacedMark(mark=mark, place="tint") for mark in NAMED[:ON_TINTS]),
)
FINE: Final = (PlacedMark(mark=SMALLEST, place="paper"),)
"""Marks before the camera of finer pixels."""
BY_NAME: Final = {placed.name: placed for placed in (*TABLE, *FINE)}


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacesWork:
    """Designs -> which of the table's marks have a place on each; columns design, name."""

    seed: int

    def __call__(self, designs: tuple[int, ...], /) -> Rows:
        """``Work``."""
        corpus = Corpus(seed=self.seed + DESIGN_SEED, dpi=SCREENING_DPI)
        places: list[tuple[int, str]] = []
        for index in designs:
            page = corpus.page(index)
            places += [
                (index, placed.name)
                for placed in (*TABLE, *FINE)
                if WHERE[placed.place](page, placed.mark.reach_mm + SLACK_MM).any()
            ]
        return {
            "design": np.array([index for index, _ in places], np.int64),
            "name": np.array([name for _, name in places], "U96"),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Prints:
    """Prints of one page: good ones, and those with named marks."""

    source: str
    """``design``: a composed design; ``blank``: a nearly blank page."""
    index: int
    marks: tuple[tuple[str, int], ...] = ()
    """Names of ``PlacedMark``, with the number of prints of each."""
    good: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class MarksWork:
    """Prints of pages -> a row each.

    Columns: source, design, mark (name of ``PlacedMark``; "" where good), alarm, uninspected, score, edges_m, ink.
    Also ``unmade``, the mark of each print for which the page has no place at its full resolution.
    """

    press: Path
    camera: Camera
    seed: int

    def __call__(self, pages: tuple[Prints, ...], /) -> Rows:
        """``Work``."""
        columns: dict[str, list[Any]] = defaultdict(list)
        unmade: list[str] = []
        number = self.camera.number
        for prints in pages:
            source = ("design", "blank").index(prints.source)
            rng = stream(self.seed, "visible-print", number, source, prints.index)
            bench = Bench.begin(self.press, rng)
            page = bench.press.geometry.lay(self._page(prints, bench.press.dpi))
            prepared = bench.prepare(page)
            facts = {
                "source": prints.source,
                "design": prints.index,
                "edges_m": edge_length_m(page),
                "ink": ink_share(page),
            }
            for name, count in (("", prints.good), *prints.marks):
                for printed in _printed(page, name, count, rng):
                    if printed is None:
                        unmade.append(name)
                        continue
                    row = facts | {"mark": name} | outcome(bench.inspect(prepared, printed, rng))
                    for column, value in row.items():
                        columns[column].append(value)
        rows = {name: np.array(values) for name, values in columns.items()}
        texts = {"source": rows["source"].astype("U8"), "mark": rows["mark"].astype("U96")}
        return rows | texts | {"unmade": np.array(unmade, "U96")}

    def _page(self, prints: Prints, dpi: float) -> Page:
        if prints.source == "blank":
            return nearly_blank(self.seed, prints.index, dpi=dpi)
        return Corpus(seed=self.seed + DESIGN_SEED, dpi=dpi).page(prints.index)


def _printed(page: Page, name: str, count: int, rng: np.random.Generator) -> Iterator[Page | None]:
    """Draw a mark so often, each time at another place, or nothing where it has no name; None: it has no place."""
    if not name:
        yield from [page] * count
        return
    placed = BY_NAME[name]
    places = WHERE[placed.place](page, placed.mark.reach_mm)
    for _ in range(count):
        at = somewhere(page, places, rng)
        yield None if at is None else placed.mark.draw(page, at, rng)


def outcome(inspection: Inspection) -> dict[str, Any]:
    """Return the verdict of the matched filter on one print."""
    score = inspection.verdict.score
    return {
        "alarm": alarmed(inspection),
        "uninspected": uninspected(inspection),
        "score": np.nan if score is None else score,
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class CurvePiece:
    """One page of all places before one camera."""

    camera: Camera
    page: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveWork:
    """A page of all places before a camera -> a row for each of its prints that is judged.

    First come good prints from which the variation model learns the page; they are not judged. Columns: camera
    (``Camera.number``), page, kind ("" where good), place, level, alarm, uninspected, score, peers (``MEASURES``).
    Every kind on every place is printed on a press day of its own, one print a level.
    """

    presses: dict[int, Path]
    """Press files by ``Camera.number``."""
    seed: int
    levels: int
    learned: int
    """Good prints that the variation model learns from."""
    good: int
    """Good prints that are judged."""
    per_day: int = 8
    """Good prints of a press day."""

    def __call__(self, piece: CurvePiece, /) -> Rows:
        """``Work``."""
        number = piece.camera.number
        rng = stream(self.seed, "visible-curve", number, piece.page)
        bench = Bench.begin(self.presses[number], rng)
        press = bench.press
        composed = PlacesPage.composed(self.seed + DESIGN_SEED, piece.page, dpi=press.dpi)
        prepared = bench.prepare(composed.page)
        columns: dict[str, list[Any]] = defaultdict(list)
        aligned = []
        for turn in range(self.learned):
            if turn % self.per_day == 0:
                bench = bench.another_day(rng)
            aligned.append(in_place(bench.inspect(prepared, prepared.page, rng), press))
        variation = PageVariation.learn(aligned)

        def judge(printed: Page, kind: str, place: str, level: float) -> None:
            inspection = bench.inspect(prepared, printed, rng)
            row = {"camera": number, "page": piece.page, "kind": kind, "place": place, "level": level}
            row |= outcome(inspection) | {"peers": peer_scores(inspection, press, variation)}
            for name, value in row.items():
                columns[name].append(value)

        for turn in range(self.good):
            if turn % self.per_day == 0:
                bench = bench.another_day(rng)
            judge(prepared.page, "", "", 0.0)
        for name, kind in KINDS.items():
            for place in kind.places:
                bench = bench.another_day(rng)
                for level in self.levels_of(name):
                    judge(self._printed(composed, prepared, name, place, level, rng), name, place, level)
        rows = {name: np.array(values) for name, values in columns.items()}
        return rows | {name: rows[name].astype("U16") for name in ("kind", "place")}

    def levels_of(self, kind: str) -> list[float]:
        """Return the levels of a kind; for letters, sizes that the page has."""
        if KINDS[kind].draw is None:
            return list(SIZES_PT[:: max(len(SIZES_PT) // self.levels, 1)])
        return levels_of(kind, self.levels)

    def _printed(
        self,
        composed: PlacesPage,
        prepared: Prepared,
        name: str,
        place: str,
        level: float,
        rng: np.random.Generator,
    ) -> Page:
        kind, page = KINDS[name], prepared.page
        if kind.draw is None:
            slip = slip_of(composed.letters, level, missing=name == "missing glyph", rng=rng)
            return PlacesPage.composed(self.seed + DESIGN_SEED, page.number - 1, dpi=page.dpi, slip=slip).page
        at = composed.point(place, kind.extent_mm, rng, takes=kind.takes)
        return kind.draw(page, at, level, place == "border", rng)


# --- other methods on the same scans ---

WINDOWS: Final = (1, 3, 5)
"""Sides of the squares over which absolute differences are averaged. [pixels]"""
FLOORS: Final = (0.005, 0.02)
"""Least spreads that the variation model assumes, as shares of paper white."""
MARGIN_PIXELS: Final = 2
"""Rim of the page that the variation model ignores, because prints are not placed alike."""
MEASURES: Final = (
    *(f"difference, {side} x {side}" for side in WINDOWS),
    "SSIM, worst",
    "SSIM, mean",
    *(f"variation, {floor:.1%}" for floor in FLOORS),
)
"""Names in the order of ``peer_scores``."""
PEERS: Final = {"difference": (0, 1, 2), "SSIM": (3, 4), "variation": (5, 6)}
"""Measures that are one method with different settings."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageVariation:
    """Mean and spread of a page's good prints at every pixel, as HALCON's variation model has them."""

    mean: NDArray[np.float32]
    """(sensors, lines, pixels), each print moved to the page's nominal place. [DN]"""
    spread: NDArray[np.float32]
    """Standard deviation, of the same shape. [DN]"""

    @classmethod
    def learn(cls, aligned: Sequence[NDArray[np.float32]]) -> Self:
        """Learn from two or more good prints at the page's nominal place (``in_place``)."""
        total = np.zeros(aligned[0].shape)
        squares = np.zeros_like(total)
        for one in aligned:
            total += one
            squares += one.astype(np.float64) ** 2
        mean = total / len(aligned)
        variance = np.maximum(squares / len(aligned) - mean**2, 0) * len(aligned) / (len(aligned) - 1)
        return cls(mean=mean.astype(np.float32), spread=np.sqrt(variance).astype(np.float32))

    def score(self, aligned: NDArray[np.float32], white_dn: Sequence[float], floor: float) -> float:
        """Return the greatest k at which 4 pixels of a sensor differ from the mean by k max(spread, floor). [-]"""
        inside = slice(MARGIN_PIXELS, -MARGIN_PIXELS)
        worst = 0.0
        for seen, mean, spread, white in zip(aligned, self.mean, self.spread, white_dn, strict=True):
            off = np.abs(seen - mean) / np.maximum(spread, np.float32(floor * white))
            far = off[inside, inside].ravel()
            worst = max(worst, float(np.partition(far, -LEAST_PIXELS)[-LEAST_PIXELS]))
        return worst


def in_place(inspection: Inspection, press: Press) -> NDArray[np.float32]:
    """Move a print to the page's nominal place; (sensors, lines, pixels) of the page alone. [DN]

    The placement is that of our registration; interpolation is linear. Pixels beyond the judged area repeat the last.
    """
    assert inspection.planned is not None
    page, geometry = inspection.planned.page, press.geometry
    rows, columns = geometry.on_page(page.width_mm, page.height_mm)
    x, y = np.meshgrid(
        geometry.centres_x_mm(page.width_mm)[columns],
        geometry.centres_y_mm(geometry.lines(page.height_mm))[rows],
    )
    seen_x, seen_y = inspection.placement.seen_mm(
        x, y, page_width_mm=page.width_mm, page_height_mm=page.height_mm
    )
    # The page point p is seen near p + (p - q(p)): shifts are of a millimetre and vary over the page by far less.
    lines, pixels = (extent.start for extent in inspection.area)
    from_x = np.arange(columns.start, columns.stop) - pixels + (x - seen_x) / geometry.pixel_pitch_mm
    from_y = np.arange(rows.start, rows.stop)[:, None] - lines + (y - seen_y) / geometry.line_pitch_mm
    at = from_x.astype(np.float32), from_y.astype(np.float32)
    return np.stack(
        [
            cv2.remap(image.astype(np.float32), *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for image in inspection.measured_dn
        ]
    )


def peer_scores(inspection: Inspection, press: Press, variation: PageVariation) -> NDArray[np.float64]:
    """Return every measure of one print, of the worst sensor, in the order of ``MEASURES``; higher is worse.

    Differences and SSIM compare with the page's prediction at the placement of our registration.
    """
    white = [sensor.white_dn for sensor in press.sensors]
    measured, expected = inspection.measured_dn, inspection.expect().expected_dn
    differences = [local_difference(measured, expected, white_dn=white, side=side) for side in WINDOWS]
    unlike = dissimilarity(measured, expected, white_dn=white)
    aligned = in_place(inspection, press)
    return np.array(
        [
            *differences,
            unlike.worst,
            unlike.mean,
            *(variation.score(aligned, white, floor) for floor in FLOORS),
        ]
    )


def local_difference(
    measured_dn: NDArray[np.uint16],
    expected_dn: NDArray[np.float32],
    *,
    white_dn: Sequence[float],
    side: int,
) -> float:
    """Return the greatest mean absolute difference over squares of ``side`` pixels, as a share of paper white. [-]"""
    worst = 0.0
    for measured, expected, white in zip(measured_dn, expected_dn, white_dn, strict=True):
        share = cv2.absdiff(measured.astype(np.float32), expected)
        worst = max(worst, float(cv2.boxFilter(share, -1, (side, side)).max()) / white)
    return worst
