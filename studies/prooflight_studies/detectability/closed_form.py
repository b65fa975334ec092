"""Strength of the evidence of defects on a page, in closed form from the information of a good print's scan.

For a mode with the power D' over a box, of which edges have G and flat places F, an amount A all over the box makes T =
A D' / sqrt(c F + c' G + t^2 D'^2) (``local_evidence``), its strength. A spot fills no box, and good prints have nothing
like it: its strength is the root of F / c under the spot alone, and the contribution of each of its pixels is limited.
The strength at which a defect is caught is learned from prints (``catching``); the map of the least amounts follows
from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from scipy import ndimage

from prooflight.cmyk import INK_LETTERS
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    MODES,
    SIZES,
    WIDTH_UNIT_MM,
    WIDTHS,
)
from prooflight.detectors.matched_filter.statistics.statistic import Statistic

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.nuisance import Fit
    from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter, Sums
    from prooflight.detectors.matched_filter.statistics.statistic import Observed

CLIPPED_SIGMAS: Final = 10.0
"""Limit on the contribution of a pixel (``comparing.summing``)."""
STREAK_WIDTH: Final = 2
"""Width of the streaks that are evaluated: 0.5 mm. [units of 0.254 mm]"""
PATCH_TILES: Final = 32
"""Side of the patches whose density is evaluated: 16 mm. [tiles]"""
SPOT: Final = "add-K"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Strengths:
    """Strengths of whole defects on one page; 0 where a defect gives no evidence."""

    spot: NDArray[np.float64]
    """Strength of a spot that fills a box with solid black, (SIZES, tile rows, tile columns).

    A smaller spot's strength follows from its side.
    """
    streak: NDArray[np.float64]
    """Strength of a solid black streak 0.5 mm wide. (pixels,)"""
    patch: NDArray[np.float64]
    """Strength of a patch without ink. (tile rows, tile columns)"""
    inks: dict[str, float]
    """Strength of one ink missing all over, by its letter."""
    on_page: NDArray[np.bool_]
    """(tile rows, tile columns)"""
    tile_mm: float
    pixel_mm: float
    left_mm: float
    """Position of the first tile's left edge on the page; ``top_mm``: of its top edge. [mm]"""
    top_mm: float

    @classmethod
    def of(cls, sums: Sums, fit: Fit, statistics: Sequence[Observed], scatter: Scatter) -> Strengths:
        """Compute the strengths from one good print."""
        return cls(
            spot=_spots(sums, scatter),
            streak=_streaks(sums, scatter),
            patch=_patches(sums, scatter),
            inks=_inks(fit, statistics),
            on_page=sums.tiles[1, MODES.index("light")] > 0,
            tile_mm=sums.tile_mm,
            pixel_mm=sums.pixel_mm,
            left_mm=sums.left_mm,
            top_mm=sums.top_mm,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reach:
    """Least defects that are caught on one page; NaN off the page, infinite where none would be."""

    spot_mm: NDArray[np.float64]
    """Diameter of a solid black spot, (tile rows, tile columns). [mm]"""
    streak_percent: NDArray[np.float64]
    """Ink of a black streak 0.5 mm wide over the whole height, (pixels,). [%]"""
    patch_percent: NDArray[np.float64]
    """Loss of all inks in a square of 16 mm, (tile rows, tile columns). [%]"""
    inks_percent: dict[str, float]
    """Loss of one ink all over the page, by its letter. [%]"""
    tile_mm: float
    pixel_mm: float
    left_mm: float
    """Position of the first tile's left edge on the page; ``top_mm``: of its top edge. [mm]"""
    top_mm: float

    @classmethod
    def of(cls, strengths: Strengths, wanted: Mapping[str, float]) -> Reach:
        """Return the defects that have the strengths ``wanted`` of a spot, a streak, a patch and an ink."""
        return cls(
            spot_mm=np.where(
                strengths.on_page,
                _diameters(_over(wanted["spot"], strengths.spot), strengths.tile_mm),
                np.nan,
            ),
            streak_percent=np.where(
                np.isnan(strengths.streak), np.nan, _percent(_over(wanted["streak"], strengths.streak))
            ),
            patch_percent=np.where(
                strengths.on_page, _percent(_over(wanted["patch"], strengths.patch)), np.nan
            ),
            inks_percent={
                letter: float(_percent(_over(wanted["ink"], np.array(whole))))
                for letter, whole in strengths.inks.items()
            },
            tile_mm=strengths.tile_mm,
            pixel_mm=strengths.pixel_mm,
            left_mm=strengths.left_mm,
            top_mm=strengths.top_mm,
        )


def _over(wanted: float, whole: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.divide(wanted, whole, out=np.full(whole.shape, np.inf), where=whole > 0)


def _diameters(sides: NDArray[np.float64], tile_mm: float) -> NDArray[np.float64]:
    """Return diameters of round spots with the area of squares; infinite: none.

    ``sides`` (SIZES, ...) are those of the squares, as shares of each box's.
    """
    diameters = np.full(sides.shape[1:], np.inf)
    smaller_mm = 0.0
    for side, size in zip(sides, SIZES, strict=True):
        # The smallest box that holds the spot says; what is within a smaller one was not enough.
        box_mm = size * tile_mm
        diameter = np.maximum(2 * side / np.sqrt(np.pi) * box_mm, smaller_mm)
        diameters = np.where(np.isinf(diameters) & (diameter <= box_mm), diameter, diameters)
        smaller_mm = box_mm
    return diameters


def _percent(share: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(share <= 1, 100 * share, np.inf)


def _strength(
    maps: NDArray[np.float64], light: NDArray[np.float64], common: float, scatter: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return D' of sums (3, ...) of D, C, edges, and T for a whole amount; light: D of the light as a whole."""
    power, shared, edges = maps
    edges = np.maximum(edges, 0)  # box sums round
    own = np.maximum(power - shared**2 / (light + 1 / common**2), 0)
    at_edges = edges * np.minimum(own / np.maximum(power, 1e-9), 1)
    noise, of_edges, tolerance = scatter
    spread = noise * np.maximum(own - at_edges, 0) + of_edges * at_edges + tolerance * own**2
    return own, np.where(own > 0, own / np.sqrt(spread + 1e-9), 0)


def _boxed(tiles: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Return sums over boxes about every tile."""
    added = cv2.boxFilter(tiles, -1, (size, size), normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(added)


def _spots(sums: Sums, scatter: Scatter) -> NDArray[np.float64]:
    """Return the strengths of spots; edges do not count, since residual misregistration hides small defects there."""
    mode = MODES.index(SPOT)
    power, edges, pixels = (
        sums.tiles[part, of].astype(np.float64) for part, of in ((1, mode), (3, mode), (1, -1))
    )
    # Cut off tile by tile: where a box is partly black already, few of its pixels have all its contrast.
    cut = np.minimum(CLIPPED_SIGMAS**2 * pixels / np.maximum(power, 1e-9), 1)
    counted = np.clip(power - edges, 0, None) * cut
    strengths = []
    for size, (noise, _, _) in zip(SIZES, scatter.boxes[mode], strict=True):
        strengths.append(np.sqrt(np.maximum(_boxed(counted, size), 0) / noise))
    return np.stack(strengths)


def _patches(sums: Sums, scatter: Scatter) -> NDArray[np.float64]:
    mode, place = MODES.index("gain-all"), SIZES.index(PATCH_TILES)
    *maps, light = (
        _boxed(one.astype(np.float64), PATCH_TILES)
        for one in (*sums.tiles[1:4, mode], sums.tiles[1, MODES.index("light")])
    )
    return _strength(np.stack(maps), light, sums.prior.place, scatter.boxes[mode, place])[1]


def _streaks(sums: Sums, scatter: Scatter) -> NDArray[np.float64]:
    """Return the strengths of streaks about every column; NaN: off the page."""
    mode, place = MODES.index(SPOT), WIDTHS.index(STREAK_WIDTH)
    parts = sums.columns[1:4].astype(np.float64).sum(axis=2)
    power, _, edges = parts[:, mode]
    # As in the sums of columns: first the common part, then the width.
    own, _ = _strength(parts[:, mode], parts[0, 0], sums.prior.place, np.array([1.0, 0.0, 0.0]))
    edges = edges * np.minimum(own / np.maximum(power, 1e-9), 1)
    width = max(round(STREAK_WIDTH * WIDTH_UNIT_MM / sums.pixel_mm), 1)
    own, edges = (ndimage.uniform_filter1d(one, width, mode="constant") * width for one in (own, edges))
    noise, of_edges, tolerance = scatter.streaks[mode, place, -1]
    spread = noise * np.maximum(own - edges, 0) + of_edges * edges + tolerance * own**2
    return np.where(own > 0, own / np.sqrt(spread + 1e-9), np.nan)


def _inks(fit: Fit, statistics: Sequence[Observed]) -> dict[str, float]:
    """Return T, an ink's estimate over the scatter of good prints.

    Inks that the page does not determine are left out.
    """
    of, prior = {one.statistic: one.value for one in statistics}, fit.prior.gain
    strengths = {}
    for ink, letter in enumerate(INK_LETTERS):
        pull, gain = of[Statistic("fit", "gain", letter)], abs(float(fit.gain[ink, 0])) / prior
        if pull >= 1e-6 and gain >= 1e-6:
            strengths[letter] = min(gain / pull, 1.0) / prior  # sqrt(1 - what stays unknown)
    return strengths
