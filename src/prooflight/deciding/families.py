"""Families of statistics: what each kind of evidence on one page says, with the place where it says most."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.comparing.boxed_evidence import boxes, cells_of, echoes, extremes
from prooflight.comparing.local_evidence import (
    GHOST_BOXES_MM,
    LINE_MODES,
    MODES,
    SEGMENTS,
    SIZES,
    SPANS,
    WIDTH_UNIT_MM,
    WIDTHS,
    periodogram,
    rows,
    statistic,
    streaks,
)
from prooflight.comparing.nuisance import INKS, LAMP_WAVES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from prooflight.comparing.boxed_evidence import Extremes
    from prooflight.comparing.local_evidence import Scatter, Sums
    from prooflight.comparing.nuisance import Fit
    from prooflight.comparing.register import Registration

Box = tuple[float, float, float, float]
"""x, y, width, height. [mm]"""
NOWHERE: Final[Box] = (np.nan,) * 4
INK: Final = "CMYK"
SAMPLES: Final = 400
LEAST_BOXES: Final = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """One statistic of one page."""

    name: str
    """``family/detail``."""
    value: float
    """Higher is worse."""
    box: Box = NOWHERE
    """Where; NaN: the page as a whole."""


def all_said(sums: Sums, fit: Fit, found: Registration, scatter: Scatter) -> list[Said]:
    """Every statistic of one scan, always the same names in the same order."""
    return [
        *_of_boxes(sums, scatter),
        *_of_streaks(sums, scatter),
        *_of_bands(sums, scatter),
        *_of_ghosts(sums, scatter),
        *_of_fit(fit),
        *_of_place(found),
        *_of_energy(sums),
    ]


def _of_boxes(sums: Sums, scatter: Scatter) -> Iterator[Said]:
    for place, cells in enumerate(cells_of(sums)):
        size = cells.size
        for name, t in zip(MODES, extremes(cells, scatter.boxes[:, place]), strict=True):
            for way, value, at in (("+", t.greatest, t.at_greatest), ("-", -t.least, t.at_least)):
                yield Said(name=f"box/{name}{way}/{size}", value=value, box=cells.box_mm(sums, *at))
            yield from _against_page(t, f"{name}/{size}")
            energy = float(np.log(t.energy + 0.1)) if t.informed else 0.0
            yield Said(name=f"spread/{name}/{size}", value=energy)


def _against_page(t: Extremes, name: str) -> Iterator[Said]:
    """The greatest over the page's own spread: a page of fine print scatters more than one of tints."""
    low, high = 0.0, 0.0
    if t.informed >= LEAST_BOXES:
        lower, middle, upper = np.quantile(t.drawn, (0.16, 0.5, 0.84))
        wide = max(float(upper - lower) / 2, 0.3)
        low, high = (float(middle) - t.least) / wide, (t.greatest - float(middle)) / wide
    yield Said(name=f"apart/{name}+", value=high)
    yield Said(name=f"apart/{name}-", value=low)


def _of_streaks(sums: Sums, scatter: Scatter) -> Iterator[Said]:
    lines_mm = sums.tiles.shape[2] * sums.tile_mm
    for w, width in enumerate(WIDTHS):
        for s, span in enumerate(SPANS):
            own, power, edges = streaks(sums, width, span)
            for mode in range(LINE_MODES):
                t = np.abs(statistic(own[mode], power[mode], edges[mode], scatter.streaks[mode, w, s]))
                part, column = np.unravel_index(int(np.argmax(t)), t.shape)
                width_mm = width * WIDTH_UNIT_MM
                x = (column + 0.5) * sums.pixel_mm + sums.left_mm
                length = {"quarter": 1, "half": 2, "full": SEGMENTS}[span] / SEGMENTS * lines_mm
                box = (
                    float(x - width_mm / 2),
                    float(part / SEGMENTS * lines_mm + sums.top_mm),
                    width_mm,
                    length,
                )
                yield Said(name=f"streak/{MODES[mode]}/{width}/{span}", value=float(t[part, column]), box=box)


def _of_bands(sums: Sums, scatter: Scatter) -> Iterator[Said]:
    own, power, edges = rows(sums)
    for mode, name in enumerate(MODES):
        _, waves, together = periodogram(
            own[mode], power[mode], edges[mode], scatter.bands[mode], sums.tile_mm
        )
        yield Said(name=f"band/{name}/wave", value=float(waves.max()))
        yield Said(name=f"band/{name}/harmonics", value=float(together.max()))
        t = statistic(own[mode], power[mode], edges[mode], scatter.bands[mode])
        row = int(np.argmax(np.abs(t)))
        y = float(row * sums.tile_mm + sums.top_mm)
        yield Said(name=f"band/{name}/row", value=float(abs(t[row])), box=(0.0, y, np.inf, sums.tile_mm))


def _of_ghosts(sums: Sums, scatter: Scatter) -> Iterator[Said]:
    seen = echoes(sums)
    for ink in range(INKS):
        for b, (height, width) in enumerate(GHOST_BOXES_MM):
            value, middle = seen.greatest(ink, (height, width), scatter.ghosts[ink, b])
            box = NOWHERE
            if middle is not None:
                x, y = middle[0] + sums.left_mm - width / 2, middle[1] + sums.top_mm - height / 2
                box = (x, y, width, height)
            yield Said(name=f"ghost/{INK[ink]}/{b}", value=value, box=box)


def _of_fit(fit: Fit) -> Iterator[Said]:
    sensors, colours = fit.white.size, fit.shape.shape[1]
    at = np.cumsum([sensors + 1, LAMP_WAVES, sensors * colours, 3 * INKS, INKS])
    white, lamp, shape, gain, dot, planes = np.split(fit.surprise, at)
    gain, planes = gain.reshape(INKS, 3), planes.reshape(INKS, 2)
    yield Said(name="fit/white", value=float(np.abs(white).max()))
    yield Said(name="fit/lamp", value=float(np.sqrt((lamp**2).mean())))
    yield Said(name="fit/shape", value=float(np.sqrt((shape**2).mean())))
    for ink in range(INKS):
        yield Said(name=f"fit/gain-{INK[ink]}", value=float(abs(gain[ink, 0])))
        yield Said(name=f"fit/tilt-{INK[ink]}", value=float(np.abs(gain[ink, 1:]).max()))
        yield Said(name=f"fit/dot-{INK[ink]}", value=float(abs(dot[ink])))
        yield Said(name=f"fit/plane-{INK[ink]}", value=float(np.abs(planes[ink]).max()))
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
        yield Said(name=f"place/plane-{INK[ink]}", value=float(np.abs(found.planes_mm[ink]).max()))
    yield Said(name="place/planes", value=float(np.ptp(found.planes_mm, axis=0).max()))


def _of_energy(sums: Sums) -> Iterator[Said]:
    energy, pixels = sums.tiles[0, -1], sums.tiles[1, -1]
    yield Said(name="energy/page", value=float(np.log(energy.sum() / max(pixels.sum(), 1.0) + 1e-3)))
    for size in (2, 8, 32):
        rows_, columns = (extent // size * size for extent in energy.shape)
        if not rows_ or not columns:
            yield Said(name=f"energy/{size}", value=0.0)
            continue
        cut = np.stack([energy, pixels])[:, :rows_, :columns]
        e, n = cut.reshape(2, rows_ // size, size, columns // size, size).sum(axis=(2, 4))
        full = n >= 0.5 * n.max()
        mean = np.where(full, e / np.maximum(n, 1), 0)
        row, column = np.unravel_index(int(np.argmax(mean)), mean.shape)
        extent = size * sums.tile_mm
        box = (float(column * extent + sums.left_mm), float(row * extent + sums.top_mm), extent, extent)
        yield Said(name=f"energy/{size}", value=float(np.log(mean[row, column] + 1e-3)), box=box)


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
    for w, width in enumerate(WIDTHS):
        for s, span in enumerate(SPANS):
            lines = streaks(sums, width, span)
            for mode in range(LINE_MODES):
                put(found["streaks"][mode, w, s], *(one[mode] for one in lines))
    of_rows = rows(sums)
    for mode in range(len(MODES)):
        put(found["bands"][mode], *(one[mode] for one in of_rows))
    seen = echoes(sums)
    for ink in np.flatnonzero(seen.present):
        for b, box_mm in enumerate(GHOST_BOXES_MM):
            drawn = [seen.boxes(int(ink), int(lag), box_mm) for lag in seen.lags[::10]]
            put(found["ghosts"][ink, b], *np.stack(drawn, axis=1))
    return found
