"""Results from rows of prints: counts with bounds, false alarms by difficulty, psychometric curves by place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import stats

from prooflight_studies.harness.operating import rate_below
from prooflight_studies.harness.picture import legend_below, new_figure, plain_axes, write_figure
from prooflight_studies.harness.psychometric import Psychometric
from prooflight_studies.visible.marks import EVERYWHERE, KINDS
from prooflight_studies.visible.rows import MEASURES, PEERS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from prooflight_studies.harness.result_cache import Rows
    from prooflight_studies.visible.rig import Camera
    from prooflight_studies.visible.rows import PlacedMark

CHANCES: Final = (0.5, 0.9, 0.99)
INTERVAL: Final = (0.025, 0.5, 0.975)
GREATEST: Final = 300.0
"""The strength, among ``STRENGTHS``, that a kind's greatest level is given."""
ANY_PAGE: Final = -1
"""A page that was not printed; the other pages predict it."""
QUINTILES: Final = 5
NEARLY_BLANK: Final = 0.01
"""Share of a page with ink below which it is nearly blank."""
BY_CHANCE: Final = 0.05
"""How often two equal methods differ by more, one way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Caught:
    """Prints with one mark."""

    mark: str
    place: str
    prints: int
    caught: int
    uninspected: int
    at_least: float
    """The share that is caught, with 95 % certainty (Clopper and Pearson 1934, one-sided)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GoodPrints:
    """Good prints of some pages."""

    pages: str
    prints: int
    alarms: int
    uninspected: int


def caught_of(rows: Rows, table: tuple[PlacedMark, ...]) -> list[Caught]:
    """Count the prints of every mark of a table."""
    counts = []
    for placed in table:
        here = rows["mark"] == placed.name
        prints, caught = int(here.sum()), int(rows["alarm"][here].sum())
        counts.append(
            Caught(
                mark=placed.mark.name,
                place=placed.place,
                prints=prints,
                caught=caught,
                uninspected=int(rows["uninspected"][here].sum()),
                at_least=1 - rate_below(prints - caught, prints),
            )
        )
    return counts


def good_prints(rows: Rows) -> list[GoodPrints]:
    """Count good prints of all composed designs, of each quintile of their edges' length, and of nearly blank pages."""
    good = rows["mark"] == ""
    composed, blank = good & (rows["source"] != "blank"), good & (rows["source"] == "blank")
    parts = [("all composed designs", composed)]
    if composed.sum() >= QUINTILES:
        bounds = np.quantile(rows["edges_m"][composed], np.linspace(0, 1, QUINTILES + 1))
        quintile = np.clip(np.searchsorted(bounds, rows["edges_m"], side="right") - 1, 0, QUINTILES - 1)
        parts += [
            (f"edges of {bounds[at]:.1f} to {bounds[at + 1]:.1f} m", composed & (quintile == at))
            for at in range(QUINTILES)
        ]
    parts += [
        (f"designs with ink on less than {NEARLY_BLANK:.0%}", composed & (rows["ink"] < NEARLY_BLANK)),
        ("one band, gradient or line of type", blank),
    ]
    return [
        GoodPrints(
            pages=name,
            prints=int(here.sum()),
            alarms=int(rows["alarm"][here].sum()),
            uninspected=int(rows["uninspected"][here].sum()),
        )
        for name, here in parts
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """The level that is caught with one chance on a page that was not printed, in the kind's unit."""

    low: float
    value: float
    high: float
    """Upper end of the range that holds it with 95 % certainty; the value is the median."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OfMethod:
    """The prints of a cell that one method caught."""

    method: str
    setting: str
    caught: int
    at: list[Level]
    """One for each of ``CHANCES``."""
    better: bool
    """Whether it caught more than ours did, by more than chance has once in 20 times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One kind of mark on one place before one camera."""

    kind: str
    place: str
    unit: str
    least: float
    greatest: float
    """Levels that were printed."""
    prints: int
    uninspected: int
    methods: list[OfMethod]
    """Ours first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Curves:
    """All cells of one camera."""

    camera: str
    pages: int
    good: int
    alarms: int
    """Good prints that alarmed; every other method's tolerance lets as many alarm."""
    learned: int
    cells: list[Cell]
    worse: int
    """Cells in which another method is better."""


def curves_of(rows: Rows, cameras: Mapping[int, Camera], *, learned: int) -> Iterator[Curves]:
    """Fit every cell, camera by camera, in the order given."""
    for number, camera in cameras.items():
        here = rows["camera"] == number
        if not here.any():
            continue
        of_camera = {name: column[here] for name, column in rows.items()}
        good = of_camera["kind"] == ""
        alarms = int(of_camera["alarm"][good].sum())
        tolerance = tolerances(of_camera["peers"][good], alarms)
        caught = np.column_stack([of_camera["alarm"], of_camera["peers"] > tolerance])
        rate = (alarms + 0.5) / (
            int(good.sum()) + 1
        )  # after Jeffreys: none that alarmed are not none that ever will
        cells = [
            _cell(of_camera, caught, kind, place, rate)
            for kind, known in KINDS.items()
            for place in known.places
            if ((of_camera["kind"] == kind) & (of_camera["place"] == place)).any()
        ]
        yield Curves(
            camera=camera.name,
            pages=len(np.unique(of_camera["page"])),
            good=int(good.sum()),
            alarms=alarms,
            learned=learned,
            cells=cells,
            worse=sum(any(one.better for one in cell.methods) for cell in cells),
        )


def tolerances(scores: NDArray[np.float64], alarms: int) -> NDArray[np.float64]:
    """Set the tolerance of every measure so that it alarms at as many good prints as the matched filter.

    scores: of the good prints, (prints, measures).
    """
    ranked = np.sort(scores, axis=0)[::-1]
    return np.asarray(ranked[min(alarms, len(ranked) - 1)])


def _cell(rows: Rows, caught: NDArray[np.bool_], kind: str, place: str, rate: float) -> Cell:
    here = (rows["kind"] == kind) & (rows["place"] == place)
    level, page, of_cell = rows["level"][here], rows["page"][here], caught[here]
    greatest = float(level.max())
    methods = [_method("matched_filter", "", of_cell[:, 0], of_cell[:, 0], level, page, rate, greatest)]
    for name, measures in PEERS.items():
        best = max(measures, key=lambda at: of_cell[:, 1 + at].sum())
        methods.append(
            _method(name, MEASURES[best], of_cell[:, 1 + best], of_cell[:, 0], level, page, rate, greatest)
        )
    return Cell(
        kind=kind,
        place=place,
        unit=KINDS[kind].unit,
        least=float(level.min()),
        greatest=greatest,
        prints=int(here.sum()),
        uninspected=int(rows["uninspected"][here].sum()),
        methods=methods,
    )


def _method(
    method: str,
    setting: str,
    caught: NDArray[np.bool_],
    matched_filter: NDArray[np.bool_],
    level: NDArray[np.float64],
    page: NDArray[np.int64],
    rate: float,
    greatest: float,
) -> OfMethod:
    seen = Psychometric.unknown(rate)
    for one, strength, hit in zip(page, level * GREATEST / greatest, caught, strict=True):
        seen = seen.seen(int(one), float(strength), caught=bool(hit))
    at = []
    for chance in CHANCES:
        low, value, high = (each * greatest / GREATEST for each in seen.strengths(ANY_PAGE, chance, INTERVAL))
        at.append(Level(low=low, value=value, high=high))
    return OfMethod(
        method=method,
        setting=setting,
        caught=int(caught.sum()),
        at=at,
        better=better(caught, matched_filter),
    )


def better(caught: NDArray[np.bool_], matched_filter: NDArray[np.bool_]) -> bool:
    """Test whether another method caught more of the same prints, beyond chance (sign test, one-sided)."""
    alone, other_way = int((caught & ~matched_filter).sum()), int((matched_filter & ~caught).sum())
    return bool(stats.binom.sf(alone - 1, alone + other_way, 0.5) < BY_CHANCE) if alone else False


# --- the picture: the level caught in nine of ten prints, by kind, place and method ---

NINE_OF_TEN: Final = CHANCES.index(0.9)
COLOURS: Final = {
    "matched_filter": "#0b3d85",
    "difference": "#c8006f",
    "SSIM": "#8a8a82",
    "variation": "#c98a00",
}
MARKERS: Final = {"matched_filter": "o", "difference": "s", "SSIM": "^", "variation": "D"}
SHOWN: Final = ("spot", "void", "hair", "scratch", "streak", "band", "smear", "local density")
"""Kinds with several places."""
CAMERA: Final = "two sensors, 0.254 mm"


def draw_curves(path: Path, curves: Sequence[Curves]) -> None:
    """A panel a kind; the cameras' first where there is none of two sensors at 0.254 mm."""
    if not curves:
        return
    shown = next((one for one in curves if one.camera == CAMERA), curves[0])
    figure = new_figure(13.5, 6.4)
    grid = figure.add_gridspec(2, 4)
    for at, kind in enumerate(SHOWN):
        axes = figure.add_subplot(grid[divmod(at, 4)])
        _panel(axes, [cell for cell in shown.cells if cell.kind == kind])
        axes.set_title(
            f"{kind} [{next(cell.unit for cell in shown.cells if cell.kind == kind)}]", fontsize=10
        )
    legend_below(figure, figure.axes[0], columns=4, size_pt=10)
    figure.suptitle(
        f"Caught in 9 of 10 prints ({shown.camera} a pixel); lower is better; hollow: more than was printed",
        fontsize=11,
    )
    write_figure(figure, path)


def _panel(axes: Axes, cells: Sequence[Cell]) -> None:
    plain_axes(axes)
    places = [place for place in EVERYWHERE if any(cell.place == place for cell in cells)]
    by_place = {cell.place: cell for cell in cells}
    for name, colour in COLOURS.items():
        axes.plot([], [], MARKERS[name], color=colour, label=name)
    for shift, name in zip((-0.24, -0.08, 0.08, 0.24), COLOURS, strict=True):
        for x, place in enumerate(places):
            cell = by_place[place]
            level = next(one for one in cell.methods if one.method == name).at[NINE_OF_TEN]
            top = cell.greatest
            beyond = level.value > top
            axes.plot(
                x + shift,
                min(level.value, top),
                MARKERS[name],
                color=COLOURS[name],
                markerfacecolor="white" if beyond else COLOURS[name],
                markersize=6,
            )
            if not beyond:
                axes.plot(
                    [x + shift] * 2, [level.low, min(level.high, top)], color=COLOURS[name], linewidth=1
                )
    axes.set_yscale("log")
    ticks = np.geomspace(cells[0].least, cells[0].greatest, 3)
    axes.set_yticks(ticks, [f"{tick:.2g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xticks(range(len(places)), places)
    axes.set_xlim(-0.5, len(places) - 0.5)
    axes.set_ylim(0.7 * cells[0].least, 1.3 * cells[0].greatest)
