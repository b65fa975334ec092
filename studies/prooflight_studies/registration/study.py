"""Accuracy of registration on press-world scans with a known position; writes ``registration.md``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.errors import JobError
from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight.prediction.predict import predict
from prooflight.registration.register import prepare, register
from prooflight.rng import stream
from prooflight.scans.placement import Placement
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.fast import fast_scan
from prooflight.simulation.prints import Print, composed
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import Amounts, worlds_digest
from prooflight_studies.harness.folder import Folder
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.result_cache import digest_of, run_pieces
from prooflight_studies.registration.results import (
    COLUMNS,
    draw_errors,
    plane_parts,
    printed_at,
    register_results,
    reported_at,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight_studies.harness.result_cache import Rows

SCHEMA: Final = 3
"""Version of the cached rows; raise it whenever code changes the values of rows."""
CONDITIONS: Final = ("good", "missing plane", "missing block", "far off", "another page")
SEED: Final = 6
"""Seed of the page in docs/results."""
DESIGNS, PRINTS, REAL = 100, 5, 30
"""Designs, good prints of each, and number of designs that are real pages where there are any."""
CROP_MM: Final = 60.0
"""Side of the crops from designs in the count of silent errors: 5,000 whole pages would take a day."""
CROPS_A_DESIGN: Final = 25
CROP_PIXELS: Final = 640
"""Pixels of a line that sees a crop and its margins."""
GRID_MM: Final = 3.0
EDGE_SHARE: Final = 0.02
"""Least slope of the signal, rms over 3 mm, at which a point has content. [white/pixel]"""
BLOCK_SHARE: Final = (0.2, 0.5)
"""Side of a missing block, as a share of the page's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Error of a reported position of a page, relative to the true one. [pixels]"""

    global_rms: float
    """Rms of the part that is linear over the page."""
    rms: float
    p99: float
    """99th percentile of the components' magnitudes."""
    worst: float

    mean: float
    """Length of the mean displacement."""

    @classmethod
    def of(cls, error: NDArray[np.float64], points: NDArray[np.float64], counts: NDArray[np.bool_]) -> Errors:
        """Compute errors from differences (n, 2) [pixels] at points (n, 2).

        counts (n, 2): which points count across and along.
        """
        model = np.hstack([np.ones((len(points), 1)), points - points.mean(axis=0)])
        linear, kept, mean = [], [], []
        for axis in range(2):
            rows, own = model[counts[:, axis]], error[counts[:, axis], axis]
            if own.size:
                linear.append(rows @ np.linalg.lstsq(rows, own, rcond=None)[0])
                kept.append(np.abs(own))
                mean.append(own.mean())
        if not kept:
            return cls(global_rms=np.nan, rms=np.nan, p99=np.nan, worst=np.nan, mean=np.nan)
        size = np.concatenate(kept)
        return cls(
            global_rms=float(np.sqrt(np.mean(np.concatenate(linear) ** 2))),
            rms=float(np.sqrt(np.mean(size**2))),
            p99=float(np.percentile(size, 99)),
            worst=float(size.max()),
            mean=float(np.linalg.norm(mean)),
        )


def errors(
    where: Placement, truth: Placement, page: Page, press: Press, content: NDArray[np.bool_]
) -> tuple[Errors, Errors]:
    """Return the errors over the page, and over the points with content (points, 2)."""
    x, y = _grid(page)
    size = {"page_width_mm": page.width_mm, "page_height_mm": page.height_mm}
    reported, is_ = where.seen_mm(x, y, **size), truth.seen_mm(x, y, **size)
    off = np.stack([b - a for a, b in zip(reported, is_, strict=True)], axis=-1).reshape(-1, 2)
    off /= [press.geometry.pixel_pitch_mm, press.geometry.line_pitch_mm]
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    return Errors.of(off, points, np.ones_like(content)), Errors.of(off, points, content)


def _grid(page: Page) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    x, y = np.meshgrid(
        np.arange(GRID_MM / 2, page.width_mm, GRID_MM), np.arange(GRID_MM / 2, page.height_mm, GRID_MM)
    )
    return x, y


def content_map(page: Page, expected_dn: NDArray[np.float32], press: Press) -> NDArray[np.bool_]:
    """Return whether the print shows a displacement across, or along, about each point of the grid: (n, 2).

    Points next to the sheet's edge do not count: the signal there is the sheet's.
    """
    sensor, geometry = press.sensors[0], press.geometry
    light = (expected_dn - sensor.column_offset_dn) / sensor.column_gain / sensor.white_dn
    x, y = _grid(page)
    columns = ((x[0] + geometry.left_mm(page.width_mm)) / geometry.pixel_pitch_mm).astype(int)
    lines = ((y[:, 0] + geometry.lead_in_mm) / geometry.line_pitch_mm).astype(int)
    half = int(GRID_MM / 2 / geometry.pixel_pitch_mm)
    informative = []
    for axis in (1, 0):
        slope2 = np.gradient(light, axis=axis) ** 2
        means = [
            slope2[max(line - half, 0) : line + half, max(column - half, 0) : column + half].mean()
            for line in lines
            for column in columns
        ]
        enough = np.array(means).reshape(x.shape) > EDGE_SHARE**2
        informative.append((enough & np.pad(np.ones(np.array(x.shape) - 2, bool), 1)).ravel())
    return np.stack(informative, axis=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One design, and whether it is a real page and is cropped."""

    design: int
    real: bool
    crops: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FindDesign:
    """Registration of prints of one design; sent to worker processes."""

    press: Press
    composed: Corpus
    real: Folder | None
    seed: int
    prints: int

    def page(self, task: Task) -> Page:
        """Return the design as it enters the press; a design to be cropped is not placed on a sheet."""
        source = self.real if task.real and self.real is not None else self.composed
        page = source.page(task.design)
        return page if task.crops else self.press.geometry.lay(page)

    def __call__(self, task: Task) -> Rows:
        """Return one row for each scan."""
        rng = stream(self.seed, "registration-prints", task.design, int(task.real), int(task.crops))
        try:
            page = self.page(task)
        except JobError:  # a real page wider than the press sees
            return {"rows": np.zeros((0, len(COLUMNS)))}
        session = Session.draw(Amounts.stated(), self.press, rng)
        rows: list[tuple[float, ...]] = []
        if not task.crops:
            rows = self._registered(task, page, page, session, [0] * self.prints + [1, 2], rng)
        else:
            other = self.page(replace(task, design=task.design + 1))
            for _ in range(CROPS_A_DESIGN // len(CONDITIONS)):
                cut = _cut(page, rng), _cut(other, rng)
                rows += self._registered(task, *cut, session, list(range(len(CONDITIONS))), rng)
        return {"rows": np.array(rows, np.float64).reshape(len(rows), -1)}

    def _registered(
        self,
        task: Task,
        page: Page,
        other: Page,
        session: Session,
        plan: list[int],
        rng: np.random.Generator,
    ) -> list[tuple[float, ...]]:
        press = self.press
        prediction = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
        landmarks = prepare(page, prediction, sensors=press.sensors, geometry=press.geometry)
        content = content_map(page, prediction.expected_dn[0], press)
        white = float((page.cmyk[::4, ::4].max(axis=2) < 8).mean())
        parts = plane_parts(page, press)
        rows = []
        for condition in plan:
            printed, print_ = self._printed(page, other, session, condition, rng)
            scan = fast_scan(printed, press, session, print_, rng=rng)
            result = register(landmarks, scan)
            seen = parts if printed is page else plane_parts(printed, press)
            truth = printed_at(print_, seen, printed)
            everywhere, where_content = errors(reported_at(result, seen), truth, page, press, content)
            _, alone = errors(result.placement, truth, page, press, content)
            rows.append(
                (
                    *(task.design, task.real, condition, white, result.located, result.off_place),
                    *(
                        getattr(each, name)
                        for each in (everywhere, where_content)
                        for name in Errors.__slots__
                    ),
                    *(max(result.shift_sd_mm) / press.geometry.pixel_pitch_mm, result.tiles_used),
                    *(result.tiles_matching, result.tiles_foreign, result.residual_rms_pixels),
                    alone.rms,
                )
            )
        return rows

    def _printed(
        self, page: Page, other: Page, session: Session, condition: int, rng: np.random.Generator
    ) -> tuple[Page, Print]:
        """Return the page that is printed under a condition, and its print."""
        print_ = Print.draw(session, self.press, page, rng)
        name = CONDITIONS[condition]
        if name == "missing plane":
            return _without_plane(page, rng), print_
        if name == "missing block":
            return _without_block(page, rng), print_
        if name == "far off":
            return page, replace(print_, placement=composed(print_.placement, _far_off(rng)))
        if name == "another page":
            return other, print_
        return page, print_


def _cut(page: Page, rng: np.random.Generator) -> Page:
    side = min(round(CROP_MM / page.pixel_mm), *page.cmyk.shape[:2])
    top, left = (int(rng.integers(0, extent - side + 1)) for extent in page.cmyk.shape[:2])
    return replace(page, cmyk=np.ascontiguousarray(page.cmyk[top : top + side, left : left + side]))


def _without_plane(page: Page, rng: np.random.Generator) -> Page:
    """Remove one of the inks that cover at least a thousandth of the page."""
    used = np.flatnonzero(page.cmyk[::4, ::4].reshape(-1, 4).mean(axis=0) > 0.255)
    cmyk = page.cmyk.copy()
    if used.size:
        cmyk[..., rng.choice(used)] = 0
    return replace(page, cmyk=cmyk)


def _without_block(page: Page, rng: np.random.Generator) -> Page:
    cmyk = page.cmyk.copy()
    rows, columns = (round(extent * rng.uniform(*BLOCK_SHARE)) for extent in cmyk.shape[:2])
    top, left = (
        int(rng.integers(0, whole - part + 1))
        for whole, part in zip(cmyk.shape, (rows, columns), strict=False)
    )
    cmyk[top : top + rows, left : left + columns] = 0
    return replace(page, cmyk=cmyk)


def _far_off(rng: np.random.Generator) -> Placement:
    """Draw a misprint ``wrong-page``: off by 1.8 to 12 mm, or rotated by 0.3 to 1 degree."""
    if rng.random() < 0.5:
        return Placement(skew_deg=float(rng.choice([-1, 1]) * rng.uniform(0.3, 1.0)))
    far, way = 1.8 * (12 / 1.8) ** rng.random(), rng.uniform(0, 2 * np.pi)
    return Placement(shift_mm=(float(far * np.cos(way)), float(far * np.sin(way))))


def whole_task(number: int, real_pages: int) -> Task:
    """Return the study's design ``number``.

    Three of any ten are real pages, so that a shortened study is a sample of the whole. Every other real page is used,
    from the second on, where there are enough: the rest served development.
    """
    of_ten = (0, 3, 6)
    before = 3 * (number // 10) + sum(one < number % 10 for one in of_ten)
    page = 2 * before + 1 if real_pages >= 2 * REAL else before
    if number % 10 in of_ten and page < real_pages:
        return Task(design=page, real=True, crops=False)
    return Task(design=number, real=False, crops=False)


def _progress_of(name: str, progress: Callable[[str], None]) -> Callable[[int, int], None]:
    return lambda done, of_all: progress(f"{name}: design {done} of {of_all}")


def run_register_study(
    press: Press,
    crop_press: Press,
    out: Path,
    cache: Path,
    *,
    pages: Path | None = None,
    seed: int = SEED,
    designs: int = DESIGNS,
    prints: int = PRINTS,
    crop_designs: int = 200,
    processes: int | None = None,
    progress: Callable[[str], None] = lambda _text: None,
) -> dict[str, object]:
    """Register prints of ``designs`` designs and crops of ``crop_designs``; writes ``registration.md`` and returns it.

    crop_press: the same press with a line as long as a crop of 60 mm and its margins. pages: real pages, of which three
    are among any ten designs. cache: folder of rows, so that a study resumes, or starts small and grows; their digest
    covers press, world, number of pages, seed and ``SCHEMA``, not the code, which must raise that. A real page wider
    than the press sees is left out.
    """
    dpi = press.dpi
    real = None if pages is None else Folder(path=pages, dpi=dpi)
    whole = [whole_task(number, 0 if real is None else len(real)) for number in range(designs)]
    cut = [Task(design=1000 + number, real=False, crops=True) for number in range(crop_designs)]
    tables: dict[str, NDArray[np.float64]] = {}
    for name, of, tasks in (("whole", press, whole), ("crops", crop_press, cut)):
        work = FindDesign(press=of, composed=Corpus(seed=seed, dpi=dpi), real=real, seed=seed, prints=prints)
        facts = {
            "schema": SCHEMA,
            "press": of.digest,
            "world": worlds_digest(),
            "pages": 0 if real is None else len(real),
            "seed": seed,
            "prints": prints,
        }
        tables[name] = run_pieces(
            work,
            tasks,
            cache / name,
            digest=digest_of(facts),
            processes=processes,
            progress=_progress_of(name, progress),
        )["rows"]
    pitch_mm = press.geometry.pixel_pitch_mm
    facts_shown = f"{dpi * pitch_mm / MM_PER_INCH:g} raster pixels a camera pixel of {pitch_mm:.4f} mm"
    results = register_results(tables["whole"], tables["crops"], seed=seed, facts=facts_shown)
    draw_errors(out / "registration.png", tables["whole"])
    write_page(out / "registration.md", "registration", results)
    return {"whole": results["whole"], "silent": results["silent"]}
