"""Families of statistics: what each kind of evidence on one page says, with the place where it says most."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.base import LAMP_WAVES
from prooflight.detectors.matched_filter.fit.nuisance import INKS
from prooflight.detectors.matched_filter.statistics.boxes import boxes, cells_of, ghosts
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    GHOST_BOXES_MM,
    LINE_MODES,
    MODES,
    SIZES,
    SPANS,
    WIDTHS,
    rows,
    streaks,
)
from prooflight.detectors.matched_filter.statistics.located import (
    INK,
    NOISE,
    of_bands,
    of_boxes,
    of_energy,
    of_flat_boxes,
    of_ghosts,
    of_streaks,
    of_swapped_planes,
    of_waves,
    waves_of,
)
from prooflight.detectors.matched_filter.statistics.page_scale import flat_part
from prooflight.detectors.matched_filter.statistics.statistic import NOWHERE, Box, Statistic

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.nuisance import Fit
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter, Sums
    from prooflight.registration.register import Registration

__all__ = ["NOWHERE", "Box", "Statistic", "all_statistics", "samples"]

SAMPLES: Final = 400


def all_statistics(sums: Sums, fit: Fit, found: Registration, scatter: Scatter) -> list[Statistic]:
    """Every statistic of one scan, always the same names in the same order."""
    flat = flat_part(sums)
    waves = waves_of(sums, scatter)
    return [
        *of_boxes(sums, scatter),
        *of_flat_boxes(flat, scatter),
        *of_streaks(sums, scatter, good="streak", own="line"),
        *of_streaks(flat, scatter, own="calm"),
        *of_bands(sums, waves, scatter),
        *of_waves(waves, family="wave"),
        *of_waves(waves_of(flat, scatter), family="swell"),
        *of_ghosts(sums, scatter.ghosts, good="ghost", own="echo"),
        *of_ghosts(flat, np.broadcast_to(NOISE, scatter.ghosts.shape), own="double"),
        *of_swapped_planes(sums),
        *_of_fit(fit),
        *_of_place(found),
        *_of_shifts(sums),
        *of_energy(sums),
    ]


def _of_fit(fit: Fit) -> Iterator[Statistic]:
    sensors, colours = fit.white.size, fit.shape.shape[1]
    at = np.cumsum([sensors + 1, LAMP_WAVES, sensors * colours, 3 * INKS, INKS])
    white, lamp, shape, gain, dot, planes = np.split(fit.pulls, at)
    gain, planes = gain.reshape(INKS, 3), planes.reshape(INKS, 2)
    yield Statistic(name="fit/white", value=float(np.abs(white).max()))
    yield Statistic(name="fit/lamp", value=float(np.sqrt((lamp**2).mean())))
    yield Statistic(name="fit/shape", value=float(np.sqrt((shape**2).mean())))
    yield Statistic(name="fit/shape-most", value=float(np.abs(shape).max()))
    for ink in range(INKS):
        yield Statistic(name=f"fit/gain-{INK[ink]}", value=float(abs(gain[ink, 0])))
        yield Statistic(name=f"fit/tilt-{INK[ink]}", value=float(np.abs(gain[ink, 1:]).max()))
        yield Statistic(name=f"fit/dot-{INK[ink]}", value=float(abs(dot[ink])))
        yield Statistic(name=f"fit/plane-{INK[ink]}", value=float(np.abs(planes[ink]).max()))
    yield Statistic(name="fit/gain-all", value=float(abs(gain[:, 0].sum()) / 2))
    yield Statistic(name="fit/gain-rms", value=float(np.sqrt((gain[:, 0] ** 2).sum())))
    yield Statistic(name="fit/spread", value=float(np.log(fit.spread + 0.1)))
    yield Statistic(name="fit/lost", value=float(np.log(fit.lost + 1e-4)))


def _of_place(found: Registration) -> Iterator[Statistic]:
    where = found.placement
    shift = max(abs(value) for value in where.shift_mm)
    # The placement moves with whatever plane leads; relative to the sheet nothing does.
    yield Statistic(name="place/lost", value=float(not found.found))
    yield Statistic(name="place/shift", value=float(shift))
    yield Statistic(name="place/skew", value=float(abs(where.skew_deg)))
    yield Statistic(name="place/stretch", value=float(max(abs(value) for value in where.stretch_percent)))
    warp = 0.0 if where.warp is None else float(np.abs(where.warp.nodes_mm).max())
    yield Statistic(name="place/warp", value=warp)
    yield Statistic(name="place/residual", value=float(min(found.residual_rms_pixels, 5.0)))
    yield Statistic(name="place/unlike", value=float(1 - found.tiles_matching))
    yield Statistic(name="place/foreign", value=float(found.tiles_foreign))
    yield Statistic(name="place/sheet", value=float(max(abs(value) for value in found.sheet_mm)))
    for ink in range(INKS):
        yield Statistic(name=f"place/plane-{INK[ink]}", value=float(np.abs(found.planes_mm[ink]).max()))
    yield Statistic(name="place/planes", value=float(np.ptp(found.planes_mm, axis=0).max()))


def _of_shifts(sums: Sums) -> Iterator[Statistic]:
    for ink, (sure, share, *_) in zip(INK, sums.shifts, strict=True):
        yield Statistic(name=f"moved/{ink}/sure", value=float(sure))
        yield Statistic(name=f"moved/{ink}/share", value=float(share))


def samples(sums: Sums, rng: np.random.Generator) -> dict[str, NDArray[np.float32]]:
    """Draws of (N', D', edges) for ``Scatter``, by name: boxes (modes, sizes, n, 3) and so on; NaN: nothing."""
    found: dict[str, NDArray[np.float32]] = {
        "boxes": np.full((len(MODES), len(SIZES), SAMPLES, 3), np.nan, np.float32),
        "streaks": np.full((LINE_MODES, len(WIDTHS), len(SPANS), SAMPLES, 3), np.nan, np.float32),
        "bands": np.full((len(MODES), SAMPLES, 3), np.nan, np.float32),
        "ghosts": np.full((INKS, len(GHOST_BOXES_MM), SAMPLES, 3), np.nan, np.float32),
    }

    def put(target: NDArray[np.float32], *maps: NDArray[np.floating]) -> None:
        known = np.flatnonzero(maps[1].ravel() > 1e-3)
        drawn = rng.permutation(known)[:SAMPLES]
        for index, one in enumerate(maps):
            target[: drawn.size, index] = one.ravel()[drawn]

    for place, cells in enumerate(cells_of(sums)):
        maps = boxes(cells)
        for mode in range(len(MODES)):
            put(found["boxes"][mode, place], *(one[mode] for one in maps))
    for w, s, lines in streaks(sums):
        for mode in range(LINE_MODES):
            put(found["streaks"][mode, w, s], *lines[:, mode])
    of_rows = rows(sums)
    for mode in range(len(MODES)):
        put(found["bands"][mode], *(one[mode] for one in of_rows))
    seen = ghosts(sums)
    for ink in range(INKS):
        for b, ghost in enumerate(seen.through(ink)):
            put(found["ghosts"][ink, b], *np.moveaxis(ghost.sums[..., ::-10], 2, 0))
    return found
