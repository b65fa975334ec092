"""Families of statistics: the values of each kind of evidence on one page, with the place of the greatest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS, INKS
from prooflight.detectors.matched_filter.statistics.boxes import (
    Cells,
    boxes,
    cells_of,
    ghosts,
    smallest_cells,
)
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    LINE_MODES,
    MODES,
    SCATTER_SHAPES,
    Scatter,
    Sums,
    rows,
    streaks,
)
from prooflight.detectors.matched_filter.statistics.located import (
    NOISE,
    of_bands,
    of_boxes,
    of_energy,
    of_ghosts,
    of_steps,
    of_streaks,
    of_swapped_planes,
    of_waves,
    waves_of,
)
from prooflight.detectors.matched_filter.statistics.page_scale import flat_part
from prooflight.detectors.matched_filter.statistics.slants import of_slants
from prooflight.detectors.matched_filter.statistics.statistic import (
    FLAT_AREAS,
    GOOD_PRINTS,
    OWN_PAGE,
    SCREEN_MODES,
    Observed,
    Statistic,
    in_screen,
)
from prooflight.pages.parallel import shared_out

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.fit.nuisance import Fit
    from prooflight.detectors.matched_filter.statistics.marks import Marks
    from prooflight.registration.register import Registration

SAMPLES: Final = 400
GHOST_MODES: Final = ("light", *(name for name in MODES if name.startswith("add")))
MODE_GROUPS: Final = (
    ("light", *(name for name in MODES if name.startswith("gain") or name == "blur")),
    GHOST_MODES,
)
"""Modes that are not summed up for the screen, grouped by their cost."""


def all_statistics(
    sums: Sums, marks: Marks, fit: Fit, registration: Registration, scatter: Scatter
) -> list[Observed]:
    """Return every statistic of one scan, in a fixed order."""
    flat, cells = flat_part(sums), smallest_cells(sums, scatter.light)
    return [
        *_of_modes(sums, cells, flat, scatter),
        *of_ghosts(sums, scatter.ghosts, GOOD_PRINTS, OWN_PAGE),
        *of_ghosts(flat, np.broadcast_to(NOISE, scatter.ghosts.shape), FLAT_AREAS),
        *of_swapped_planes(sums),
        *of_steps(sums),
        *of_slants(sums, cells, scatter),
        *_of_fit(fit),
        *_of_place(registration),
        *_of_shifts(sums),
        *of_energy(sums),
        *marks.statistics(),
    ]


def screen_statistics(
    sums: Sums, marks: Marks, fit: Fit, registration: Registration, scatter: Scatter, *, threads: int = 1
) -> list[Observed]:
    """Return those of ``all_statistics`` that are ``in_screen``, in the same order; threads share the parts.

    sums: of ``SCREEN_MODES`` at least; all statistics of these modes alone are in the screen.
    """
    sums = sums if sums.modes == SCREEN_MODES else sums.of_modes(SCREEN_MODES)
    own = scatter.of_modes(sums.modes)
    cells, flat = smallest_cells(sums, own.light), flat_part(sums)
    parts: list[Callable[[], list[Observed]]] = [
        *_parts_of_modes(sums, cells, flat, own),
        lambda: [
            *of_slants(sums, cells, own),
            *_of_fit(fit),
            *_of_place(registration),
            *of_energy(sums),
            *marks.statistics(),
        ],
    ]
    return [one for part in shared_out(parts, threads=threads) for one in part]


def remaining_statistics(
    sums: Sums,
    scatter: Scatter,
    seen: Sequence[Observed],
    *,
    order: Sequence[Statistic] | None = None,
    threads: int = 1,
) -> list[Observed]:
    """Complete the statistics ``in_screen`` of a scan to ``all_statistics``; threads share the parts.

    order: order of the result; None: any. ValueError: the statistics are not those of the order.
    """
    groups = MODE_GROUPS if threads > 1 else (tuple(dict.fromkeys(sum(MODE_GROUPS, ()))),)
    noise = np.broadcast_to(NOISE, scatter.ghosts.shape)
    parts: list[Callable[[], list[Observed]]] = [
        *(partial(_of_mode_group, sums, scatter, names) for names in groups),
        lambda: list(of_ghosts(sums, scatter.ghosts, GOOD_PRINTS, OWN_PAGE)),
        lambda: list(of_ghosts(flat_part(sums.of_modes(GHOST_MODES)), noise, FLAT_AREAS)),
        lambda: [*of_swapped_planes(sums), *of_steps(sums), *_of_shifts(sums)],
    ]
    computed = [one for part in shared_out(parts, threads=threads) for one in part]
    by_statistic = {one.statistic: one for one in (*computed, *seen)}
    if order is None:
        return list(by_statistic.values())
    if by_statistic.keys() != set(order):
        raise ValueError("these are not the requested statistics")
    return [by_statistic[which] for which in order]


def _of_mode_group(sums: Sums, scatter: Scatter, names: tuple[str, ...]) -> list[Observed]:
    """Return the statistics of some modes, light the first, that are not in the screen."""
    own, of_own = sums.of_modes(names), scatter.of_modes(names)
    cells = smallest_cells(own, of_own.light)
    every = [*_of_modes(own, cells, flat_part(own), of_own), *of_slants(own, cells, of_own)]
    return [one for one in every if not in_screen(one.statistic)]


def _of_modes(sums: Sums, cells: Cells, flat: Sums, scatter: Scatter) -> list[Observed]:
    """Return the statistics of every mode in ``sums``; as ``_parts_of_modes``."""
    return [one for part in _parts_of_modes(sums, cells, flat, scatter) for one in part()]


def _parts_of_modes(
    sums: Sums, cells: Cells, flat: Sums, scatter: Scatter
) -> list[Callable[[], list[Observed]]]:
    """Return functions that return the statistics of every mode in ``sums``, and take about as long each.

    cells: ``smallest_cells`` of these; flat: ``flat_part``; scatter: of these modes.
    """
    return [
        lambda: list(of_boxes(sums, cells, scatter, GOOD_PRINTS, OWN_PAGE)),
        lambda: list(of_boxes(flat, smallest_cells(flat, scatter.light), scatter, FLAT_AREAS)),
        lambda: list(_of_lines(sums, flat, scatter)),
    ]


def _of_lines(sums: Sums, flat: Sums, scatter: Scatter) -> Iterator[Observed]:
    """Yield the streaks and waves of every mode; flat: ``flat_part``."""
    waves = waves_of(sums, scatter)
    yield from of_streaks(sums, scatter, GOOD_PRINTS, OWN_PAGE)
    yield from of_streaks(flat, scatter, FLAT_AREAS)
    yield from of_bands(sums, waves, scatter)
    yield from of_waves(waves, OWN_PAGE)
    yield from of_waves(waves_of(flat, scatter), FLAT_AREAS)


def _of_fit(fit: Fit) -> Iterator[Observed]:
    white, common, lamp, shape, gain, dot, planes = fit.surprises
    amount = partial(_amount, "fit")
    yield amount("white", np.abs([*white, *common]).max())
    yield amount("lamp", np.sqrt((lamp**2).mean()))
    yield amount("shape", np.sqrt((shape**2).mean()))
    yield amount("shape-most", np.abs(shape).max())
    for ink, letter in enumerate(INK_LETTERS):
        yield amount("gain", abs(gain[ink, 0]), letter)
        yield amount("tilt", np.abs(gain[ink, 1:]).max(), letter)
        yield amount("dot", abs(dot[ink]), letter)
        yield amount("plane", np.abs(planes[ink]).max(), letter)
    yield amount("gain-all", abs(gain[:, 0].sum()) / 2)
    yield amount("gain-rms", np.sqrt((gain[:, 0] ** 2).sum()))
    yield amount("spread", np.log(fit.spread + 0.1))
    yield amount("lost", np.log(fit.lost + 1e-4))


def _of_place(registration: Registration) -> Iterator[Observed]:
    where, amount = registration.placement, partial(_amount, "place")
    # The placement depends on the leading plane; the place relative to the sheet does not.
    yield amount("lost", not registration.located)
    yield amount("shift", np.abs(where.shift_mm).max())
    yield amount("skew", abs(where.skew_deg))
    yield amount("stretch", np.abs(where.stretch_percent).max())
    yield amount("warp", 0.0 if where.warp is None else np.abs(where.warp.nodes_mm).max())
    yield amount("residual", min(registration.residual_rms_pixels, 5.0))
    yield amount("unlike", 1 - registration.tiles_matching)
    yield amount("foreign", registration.tiles_foreign)
    yield amount("sheet", np.abs(registration.sheet_mm).max())
    for letter, plane_mm in zip(INK_LETTERS, registration.planes_mm, strict=True):
        yield amount("plane", np.abs(plane_mm).max(), letter)
    yield amount("planes", np.ptp(registration.planes_mm, axis=0).max())


def _amount(family: str, mode: str, value: float, ink: str = "") -> Observed:
    return Observed(statistic=Statistic(family, mode, ink), value=float(value))


def _of_shifts(sums: Sums) -> Iterator[Observed]:
    for ink, (sure, share, *_) in zip(INK_LETTERS, sums.shifts, strict=True):
        yield Observed(statistic=Statistic("moved", ink=ink, part="sure"), value=float(sure))
        yield Observed(statistic=Statistic("moved", ink=ink, part="share"), value=float(share))


def samples(
    sums: Sums, light: NDArray[np.floating], rng: np.random.Generator
) -> dict[str, NDArray[np.float32]]:
    """Draw samples of (N', D', edges) for ``Scatter``, by name: boxes (modes, sizes, n, 3) and so on.

    NaN fills the places of missing samples. light: ``Scatter.light``.
    """
    draws = {
        name: np.full((*shape, SAMPLES, 3), np.nan, np.float32) for name, shape in SCATTER_SHAPES.items()
    }

    def put(target: NDArray[np.float32], *maps: NDArray[np.floating]) -> None:
        informative = np.flatnonzero(maps[1].ravel() > 1e-3)
        drawn = rng.permutation(informative)[:SAMPLES]
        for index, one in enumerate(maps):
            target[: drawn.size, index] = one.ravel()[drawn]

    for place, cells in enumerate(cells_of(sums, light)):
        maps = boxes(cells)
        for mode in range(len(MODES)):
            put(draws["boxes"][mode, place], *(one[mode] for one in maps))
    for w, s, lines in streaks(sums):
        for mode in range(len(LINE_MODES)):
            put(draws["streaks"][mode, w, s], *lines[:, mode])
    of_rows = rows(sums)[:3]
    for mode in range(len(MODES)):
        put(draws["bands"][mode], *(one[mode] for one in of_rows))
    seen = ghosts(sums)
    for ink in range(INKS):
        for b, ghost in enumerate(seen.through(ink)):
            put(draws["ghosts"][ink, b], *np.moveaxis(ghost.sums[..., ::-10], 2, 0))
    return draws
