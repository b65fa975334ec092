"""What a press's detector would catch on a page, in closed form from the information of a good print's scan.

For a mode with the power D' over a box, of which edges have G and flat places F, an amount A over a share f of the box
makes T = A f D' / sqrt(c F + c' G + t^2 D'^2) (``comparing.local_evidence``); T scatters by 1 on good prints. The
detector's score says how great T must be to alarm; 2.33 more is reached by 99 of 100.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from scipy import ndimage

from prooflight.comparing.boxed_evidence import COMMON_NEAR, SMALL
from prooflight.comparing.local_evidence import COMMON, MODES, SIZES, WIDTH_UNIT_MM, WIDTHS
from prooflight.comparing.nuisance import Tolerance

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from prooflight.comparing.local_evidence import Sums
    from prooflight.comparing.nuisance import Fit
    from prooflight.deciding.calibrated import CalibratedDetector
    from prooflight.deciding.families import Said

SURE: Final = 2.326
"""99 of 100 draws of a normal distribution lie above its mean less so many standard deviations."""
CLIPPED_SIGMAS: Final = 10.0
"""A pixel counts for no more (``comparing.summing``)."""
GREATEST: Final = 1e5
LEAST_UNIT: Final = 1.0
"""T of a page where nothing stands out."""
STREAK_WIDTH: Final = 2
"""Of the streaks that are asked for: 0.5 mm. [units of 0.254 mm]"""
DENSITY_TILES: Final = 32
"""Of the places whose density is asked for: 16 mm. [tiles]"""
SPOT: Final = "add-K"
INKS: Final = "CMYK"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reach:
    """The least that is caught at 99 % on one page; NaN off the page, infinite where nothing would be."""

    spot_mm: NDArray[np.float64]
    """(tile rows, tile columns) diameter of a solid black spot. [mm]"""
    streak_percent: NDArray[np.float64]
    """(pixels,) ink of a black streak 0.5 mm wide over the whole height. [%]"""
    density_percent: NDArray[np.float64]
    """(tile rows, tile columns) change of all inks in a square of 16 mm. [%]"""
    inks_percent: dict[str, float]
    """Change of one ink all over the page, by its letter. [%]"""
    tile_mm: float
    pixel_mm: float
    left_mm: float
    """Where the first tile begins on the page. [mm]"""
    top_mm: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoodPage:
    """What a detector says of one good print of a page."""

    ours: CalibratedDetector
    said: Sequence[Said]
    portrait: NDArray[np.float64]

    def alarms_at(self, raised: Callable[[float], dict[str, float]]) -> float:
        """Least T at which what ``raised`` gives makes the page alarm; 0: it does anyway; infinite: none does."""
        names = {one.name: index for index, one in enumerate(self.said)}
        values = np.array([one.value for one in self.said])

        def alarm(t: float) -> bool:
            changed = values.copy()
            for name, value in raised(t).items():
                changed[names[name]] = max(value, changed[names[name]])
            score = self.ours.tolerance.score(changed[None], self.portrait[None])[0]
            return bool(score > self.ours.threshold)

        if alarm(0.0):  # this print alarms as it is: it tells nothing
            return 0.0
        if not alarm(GREATEST):
            return np.inf
        low, high = 1e-2, GREATEST
        while high - low > 0.01 * high:
            middle = np.sqrt(low * high)
            low, high = (low, middle) if alarm(middle) else (middle, high)
        return high

    def raised(self, first: str, *rest: str) -> Callable[[float], dict[str, float]]:
        """What T of one box or streak raises: itself, and in proportion whatever else is said of such boxes or streaks.

        first: the first word of its statistic's name; rest: the others, by which the rest of them are known.
        """
        of = {one.name: one.value for one in self.said}
        itself, others = "/".join((first, *rest)), "/".join(("", *rest))
        unit = max(of[itself], LEAST_UNIT)
        share = {name: value / unit for name, value in of.items() if name.endswith(others) and value > 0}
        share[itself] = 1.0
        return lambda t: {name: t * of_name for name, of_name in share.items()}


def reach(good: GoodPage, sums: Sums, fit: Fit) -> Reach:
    """The least that would be caught on a page, from one good print's sums and fit."""
    on_page = sums.tiles[1, MODES.index("light")] > 0
    density = _densities(good, sums)
    return Reach(
        spot_mm=np.where(on_page, _spots(good, sums), np.nan),
        streak_percent=_streaks(good, sums),
        density_percent=np.where(on_page, density, np.nan),
        inks_percent=_inks(good, fit),
        tile_mm=sums.tile_mm,
        pixel_mm=sums.pixel_mm,
        left_mm=sums.left_mm,
        top_mm=sums.top_mm,
    )


def _told(
    maps: NDArray[np.float64], light: NDArray[np.float64], common: float, scatter: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """D' of sums (3, ...) of D, C, edges, and T for a whole amount; light: D of the light as a whole."""
    power, shared, edges = maps
    own = np.maximum(power - shared**2 / (light + 1 / common**2), 0)
    at_edges = edges * np.minimum(own / np.maximum(power, 1e-9), 1)
    noise, of_edges, tolerance = scatter
    spread = noise * np.maximum(own - at_edges, 0) + of_edges * at_edges + tolerance * own**2
    return own, np.where(own > 0, own / np.sqrt(spread + 1e-9), 0)


def _of_light(
    shared: NDArray[np.float64], light: NDArray[np.float64], scatter: NDArray[np.float64]
) -> NDArray[np.float64]:
    """T of the light as a whole for a whole amount of a mode with the shared C."""
    noise, _, tolerance = scatter
    return np.asarray(np.abs(shared) / np.sqrt(noise * light + tolerance * light**2 + 1e-9))


def _boxed(sums: Sums, mode: str, size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """D, C and edges of a mode, and D of light, over boxes about every tile."""
    maps = sums.tiles[1:4, MODES.index(mode)].astype(np.float64)
    light = sums.tiles[1, MODES.index("light")].astype(np.float64)
    added = [
        cv2.boxFilter(one, -1, (size, size), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for one in (*maps, light)
    ]
    return np.stack(added[:3]), added[3]


def _spots(good: GoodPage, sums: Sums) -> NDArray[np.float64]:
    """Least diameter of a solid spot: its share of the box that tells it best."""
    scatter = good.ours.tolerance.scatter.boxes
    least = np.full(sums.tiles.shape[2:], np.inf)
    pixels = sums.tiles[1, -1].astype(np.float64)
    for place, size in enumerate(SIZES):
        wanted = good.alarms_at(good.raised("box", f"{SPOT}+", str(size))) + SURE
        maps, light = _boxed(sums, SPOT, size)
        _, whole = _told(
            maps, light, COMMON_NEAR if size <= SMALL else COMMON, scatter[MODES.index(SPOT), place]
        )
        count = cv2.boxFilter(pixels, -1, (size, size), normalize=False, borderType=cv2.BORDER_CONSTANT)
        # A pixel is cut off at 10 sigma, whatever the ink.
        amount = np.minimum(CLIPPED_SIGMAS / np.sqrt(np.maximum(maps[0] / np.maximum(count, 1), 1e-12)), 1)
        share = np.divide(wanted, amount * whole, out=np.full(whole.shape, np.inf), where=whole > 0)
        # On bare paper a spot is told from changes of light by its size alone: there light itself says more.
        lighter = good.alarms_at(good.raised("box", "light-", str(size))) + SURE
        told = amount * _of_light(maps[1], light, scatter[MODES.index("light"), place])
        share = np.minimum(share, np.divide(lighter, told, out=np.full(told.shape, np.inf), where=told > 0))
        area_mm2 = (size * sums.tile_mm) ** 2
        diameter = 2 * np.sqrt(share * area_mm2 / np.pi)
        least = np.minimum(least, np.where(share <= np.pi / 4, diameter, np.inf))
    return least


def _densities(good: GoodPage, sums: Sums) -> NDArray[np.float64]:
    mode, place = "gain-all", SIZES.index(DENSITY_TILES)
    wanted = max(good.alarms_at(good.raised("box", mode + sign, str(DENSITY_TILES))) for sign in "+-") + SURE
    maps, light = _boxed(sums, mode, DENSITY_TILES)
    _, whole = _told(maps, light, COMMON, good.ours.tolerance.scatter.boxes[MODES.index(mode), place])
    return np.divide(100 * wanted, whole, out=np.full(whole.shape, np.inf), where=whole > 0)


def _streaks(good: GoodPage, sums: Sums) -> NDArray[np.float64]:
    """Ink of a full-length streak about every column."""
    mode, place = MODES.index(SPOT), WIDTHS.index(STREAK_WIDTH)
    wanted = good.alarms_at(good.raised("streak", SPOT, str(STREAK_WIDTH), "full")) + SURE
    parts = sums.columns[1:4].astype(np.float64).sum(axis=2)
    power, _, edges = parts[:, mode]
    # As in the sums of columns: first the common part, then the width.
    own, _ = _told(parts[:, mode], parts[0, 0], COMMON, np.array([1.0, 0.0, 0.0]))
    edges = edges * np.minimum(own / np.maximum(power, 1e-9), 1)
    width = max(round(STREAK_WIDTH * WIDTH_UNIT_MM / sums.pixel_mm), 1)
    own, edges = (ndimage.uniform_filter1d(one, width, mode="constant") * width for one in (own, edges))
    noise, of_edges, tolerance = good.ours.tolerance.scatter.streaks[mode, place, -1]
    spread = noise * np.maximum(own - edges, 0) + of_edges * edges + tolerance * own**2
    whole = np.where(own > 0, own / np.sqrt(spread + 1e-9), 0)
    least = np.divide(100 * wanted, whole, out=np.full(whole.shape, np.inf), where=whole > 0)
    return np.asarray(np.where(least <= 100, least, np.where(own > 0, np.inf, np.nan)))


def _inks(good: GoodPage, fit: Fit) -> dict[str, float]:
    """Change of each ink that the page tells of: T is its estimate over what good prints scatter by."""
    of = {one.name: one.value for one in good.said}
    prior = Tolerance().gain
    found = {}
    for ink, letter in enumerate(INKS):
        surprise, gain = of[f"fit/gain-{letter}"], abs(float(fit.gain[ink, 0])) / prior
        if surprise < 1e-6 or gain < 1e-6:
            continue
        known = min(gain / surprise, 1.0)  # sqrt(1 - what stays unknown)
        wanted = good.alarms_at(lambda t, letter=letter: {f"fit/gain-{letter}": t, "fit/gain-rms": t})  # type: ignore[misc]
        least = 100 * prior * (wanted + SURE) / known
        found[letter] = float(least)
    return found
