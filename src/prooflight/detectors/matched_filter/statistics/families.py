"""Families of statistics: what each kind of evidence on one page says, with the place where it says most."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INK_LETTERS, INKS
from prooflight.detectors.base import LAMP_WAVES
from prooflight.detectors.matched_filter.statistics.boxes import boxes, cells_of, echoes
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
    NOISE,
    of_bands,
    of_boxes,
    of_energy,
    of_exchange,
    of_flat_boxes,
    of_ghosts,
    of_streaks,
    of_waves,
    waves_of,
)
from prooflight.detectors.matched_filter.statistics.page_scale import flat_part
from prooflight.detectors.matched_filter.statistics.statistic import NOWHERE, Box, Said

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.nuisance import Fit
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter, Sums
    from prooflight.registration.register import Registration

__all__ = ["NOWHERE", "Box", "Said", "all_said", "samples"]

SAMPLES: Final = 400


def all_said(sums: Sums, fit: Fit, found: Registration, scatter: Scatter) -> list[Said]:
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
        *of_exchange(sums),
        *_of_fit(fit),
        *_of_place(found),
        *_of_shifts(sums),
        *of_energy(sums),
    ]


def _of_fit(fit: Fit) -> Iterator[Said]:
    sensors, colours = fit.white.size, fit.shape.shape[1]
    at = np.cumsum([sensors + 1, LAMP_WAVES, sensors * colours, 3 * INKS, INKS])
    white, lamp, shape, gain, dot, planes = np.split(fit.surprise, at)
    gain, planes = gain.reshape(INKS, 3), planes.reshape(INKS, 2)
    yield Said(name="fit/white", value=float(np.abs(white).max()))
    yield Said(name="fit/lamp", value=float(np.sqrt((lamp**2).mean())))
    yield Said(name="fit/shape", value=float(np.sqrt((shape**2).mean())))
    yield Said(name="fit/shape-most", value=float(np.abs(shape).max()))
    for ink in range(INKS):
        yield Said(name=f"fit/gain-{INK_LETTERS[ink]}", value=float(abs(gain[ink, 0])))
        yield Said(name=f"fit/tilt-{INK_LETTERS[ink]}", value=float(np.abs(gain[ink, 1:]).max()))
        yield Said(name=f"fit/dot-{INK_LETTERS[ink]}", value=float(abs(dot[ink])))
        yield Said(name=f"fit/plane-{INK_LETTERS[ink]}", value=float(np.abs(planes[ink]).max()))
    yield Said(name="fit/gain-all", value=float(abs(gain[:, 0].sum()) / 2))
    yield Said(name="fit/gain-rms", value=float(np.sqrt((gain[:, 0] ** 2).sum())))
    yield Said(name="fit/spread", value=float(np.log(fit.spread + 0.1)))
    yield Said(name="fit/lost", value=float(np.log(fit.lost + 1e-4)))


def _of_place(found: Registration) -> Iterator[Said]:
    where = found.placement
    shift = max(abs(value) for value in where.shift_mm)
    # The placement moves with whatever plane leads; relative to the sheet nothing does.
    yield Said(name="place/lost", value=float(not found.found))
    yield Said(name="place/shift", value=float(shift))
    yield Said(name="place/skew", value=float(abs(where.skew_deg)))
    yield Said(name="place/stretch", value=float(max(abs(value) for value in where.stretch_percent)))
    warp = 0.0 if where.warp is None else float(np.abs(where.warp.nodes_mm).max())
    yield Said(name="place/warp", value=warp)
    yield Said(name="place/residual", value=float(min(found.residual_rms_pixels, 5.0)))
    yield Said(name="place/unlike", value=float(1 - found.tiles_matching))
    yield Said(name="place/foreign", value=float(found.tiles_foreign))
    yield Said(name="place/sheet", value=float(max(abs(value) for value in found.sheet_mm)))
    for ink in range(INKS):
        yield Said(name=f"place/plane-{INK_LETTERS[ink]}", value=float(np.abs(found.planes_mm[ink]).max()))
    yield Said(name="place/planes", value=float(np.ptp(found.planes_mm, axis=0).max()))


def _of_shifts(sums: Sums) -> Iterator[Said]:
    for ink, (sure, share, *_) in zip(INK_LETTERS, sums.shifts, strict=True):
        yield Said(name=f"moved/{ink}/sure", value=float(sure))
        yield Said(name=f"moved/{ink}/share", value=float(share))


def samples(sums: Sums, rng: np.random.Generator) -> dict[str, NDArray[np.float32]]:
    """Draws of (N', D', edges) for ``Scatter``, by name: boxes (modes, sizes, n, 3) and so on; NaN: nothing."""
    found: dict[str, NDArray[np.float32]] = {
        "boxes": np.full((len(MODES), len(SIZES), SAMPLES, 3), np.nan, np.float32),
        "streaks": np.full((LINE_MODES, len(WIDTHS), len(SPANS), SAMPLES, 3), np.nan, np.float32),
        "bands": np.full((len(MODES), SAMPLES, 3), np.nan, np.float32),
        "ghosts": np.full((INKS, len(GHOST_BOXES_MM), SAMPLES, 3), np.nan, np.float32),
    }

    def put(target: NDArray[np.float32], *maps: NDArray[np.floating]) -> None:
        said = np.flatnonzero(maps[1].ravel() > 1e-3)
        drawn = rng.permutation(said)[:SAMPLES]
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
    seen = echoes(sums)
    for ink in range(INKS):
        for b, echoed in enumerate(seen.through(ink)):
            put(found["ghosts"][ink, b], *np.moveaxis(echoed.sums[..., ::-10], 2, 0))
    return found
