"""Beat of a press's screen against the camera's pixels, as variance of flat places (decision 47).

A tint of a screen is dots, and each camera pixel sees a few of them, never the same part: its light varies from
pixel to pixel with the beat between both lattices. Patches of every ink are screened and seen through lens and
pixel, and what is left of them is stated relative to a halftone's variance at unit contrast,
as ``ResidualVariance.contrast`` is.

A beat is correlated, so that a box, line or column of pixels that it fits sums it up where noise would average
out. What the sums of patches vary more than sums of noise would is a factor on the variance: the greatest of all sizes.

Along whole rows a beat does not average out at all where a lattice, or the pattern that the lattices of several inks
make together, lies level with the camera's lines: a dark tint of four inks shows waves along the travel over the
whole page. They are computed from patches of the page's own tints (``row_beats``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.pages.raster import MM_PER_INCH
from prooflight.pages.screen import Screen, screened

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.fit.modes import Modes
    from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
    from prooflight.pages.pdf.area_averages import InkLight
    from prooflight.pages.sampling import Footprint
    from prooflight.prediction.tables import SensorModel

LEVELS: Final = (26, 64, 128, 191, 230)
"""Bytes of the tints that are tried: 10, 25, 50, 75 and 90 %."""
PATCH_PIXELS: Final = 96
"""Side of a patch. [camera pixels]"""
BOXES: Final = (2, 4, 8, 16)
"""Sides of boxes, and lengths of pieces of lines and columns, whose sums are compared with sums of noise. Twelve
to a side remain of the largest, so that its variance is known within a tenth."""
LEAST_SHARE: Final = 1e-9
TINTS: Final = 8
"""Greatest number of a page's tints whose beat along rows is computed."""
STEPS: Final = 16
"""Steps of ink area to which tints are rounded."""
TINT_MM: Final = (12.0, 64.0)
"""Width and height of their patches: 43 cells of 175 lpi across, of which what is not level averages out, and more than
the longest wave."""


@lru_cache(maxsize=8)
def beat_contrasts(
    screen: Screen,
    light: InkLight,
    footprint: Footprint,
    pitch_mm: tuple[float, float],
    bins: int = 1,
    *,
    correlated: bool = True,
) -> NDArray[np.float64]:
    """Return the variance of a screen's beat relative to a halftone's at unit contrast, by ink and tint.

    Parameters
    ----------
    screen
        The press's.
    light
        Light that tints take (``Press.ink_light``).
    footprint
        What one camera pixel sees.
    pitch_mm
        Pitch of the camera's pixels, across and along. [mm]
    bins
        Camera pixels that are taken together, each way.
    correlated
        Whether the variance is that of sums of pixels a pixel, or of single pixels.

    Returns
    -------
    NDArray
        Variance over J^2 a (1 - a), times the factor of correlation if ``correlated``, (4, LEVELS). [-]
    """
    across, along = (
        _seen_by(edges, footprint.reach_mm, pitch, MM_PER_INCH / screen.dpi)
        for edges, pitch in zip((footprint.across, footprint.along), pitch_mm, strict=True)
    )
    contrasts = np.empty((INKS, len(LEVELS)))
    for at, level in enumerate(LEVELS):
        plates = np.full((along.shape[1], across.shape[1], INKS), level, np.uint8)
        dots = screened(plates, screen, tone=light)
        for ink, curve in enumerate(light):
            steps, amount = np.linspace(0, 1, len(curve)), level / 255
            taken = np.interp(dots[..., ink] / 255, steps, curve)
            seen = along @ taken @ across.T
            rows, columns = (side // bins for side in seen.shape)
            seen = seen[: rows * bins, : columns * bins].reshape(rows, bins, columns, bins).mean(axis=(1, 3))
            slope = float(np.interp(amount, steps, np.gradient(np.asarray(curve), steps)))
            halftone = max(slope**2 * amount * (1 - amount), LEAST_SHARE)
            beat = seen - seen.mean()
            largest = _largest_mean_square(beat) if correlated else float((beat**2).mean())
            contrasts[ink, at] = largest / halftone
    return contrasts


def add_beat(modes: Modes, contrasts: NDArray[np.float64], residual_variance: ResidualVariance) -> None:
    """Add the beat's variance to ``modes.texture``, which is multiplied by ``residual_variance.contrast``.

    J^2 a (1 - a) of an ink is its gain's effect J a times a quarter of its dot gain's, 4 J a (1 - a): of solids and of
    their edges it is 0.
    """
    levels = np.array(LEVELS) / 255
    for ink, of_ink in enumerate(contrasts / residual_variance.contrast):
        if not modes.dot[:, ink].any():
            continue
        factor = np.interp(modes.cover[ink], levels, of_ink).astype(np.float32) / 4
        for index in range(modes.sensors):
            modes.texture[index] += factor * modes.gain[index, ink] * modes.dot[index, ink]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowBeats:
    """Beat of a page's tints along whole rows of tiles, as shares of their light."""

    tints: NDArray[np.float32]
    """(n, 4) ink areas."""
    wave: NDArray[np.float32]
    """(n,) amplitude of the strongest wave along the travel within ``periods_mm``. [-]"""
    sd: NDArray[np.float32]
    """(n,) standard deviation of rows. [-]"""

    def at(self, cover: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return wave and standard deviation of the nearest tint at places of ink areas (4, rows, columns)."""
        off = np.abs(self.tints[:, :, None, None] - cover).sum(axis=1)
        nearest = off.argmin(axis=0)
        return self.wave[nearest], self.sd[nearest]


def row_beats(
    cover: NDArray[np.float32],
    screen: Screen,
    light: InkLight,
    sensors: Sequence[SensorModel],
    *,
    line_mm: float,
    tile_lines: int,
    periods_mm: tuple[float, float],
) -> RowBeats | None:
    """Return the beat of a page's commonest tints along rows of tiles.

    Parameters
    ----------
    cover
        (4, lines, pixels) ink area of the page.
    screen, light
        As in ``beat_contrasts``.
    sensors
        Of these pixels; the one that sees most of a beat counts.
    line_mm, tile_lines
        Pitch of the lines, and lines of a tile.
    periods_mm
        Shortest and longest wave that is inspected.

    Returns
    -------
    RowBeats | None
        None: dots are scattered by error diffusion, which averages out along rows, or the page has no tints.
    """
    if screen.kind == "error-diffusion":
        return None
    steps = np.rint(cover[:, ::4, ::4].reshape(INKS, -1) * np.float32(STEPS)).clip(0, STEPS).astype(np.int64)
    counts = np.bincount(np.ravel_multi_index(tuple(steps), (STEPS + 1,) * INKS))
    tints = np.stack(np.unravel_index(np.flatnonzero(counts), (STEPS + 1,) * INKS), axis=1)
    counts = np.where((tints % STEPS != 0).any(axis=1), counts[counts > 0], 0)
    chosen = tints[np.argsort(-counts, kind="stable")[: min(TINTS, np.count_nonzero(counts))]]
    if not len(chosen):
        return None
    seen = np.array(
        [
            np.max(
                [
                    _row_beat(
                        tuple(tint.tolist()), screen, light, one.footprint, line_mm, tile_lines, periods_mm
                    )
                    for one in sensors
                ],
                axis=0,
            )
            for tint in chosen
        ]
    )
    without = np.array(list(product((0.0, 1.0), repeat=INKS)))  # bare paper and solids have none
    areas = np.concatenate([without, chosen / STEPS]).astype(np.float32)
    wave, sd = np.concatenate([np.zeros((len(without), 2)), seen]).astype(np.float32).T
    return RowBeats(tints=areas, wave=wave, sd=sd)


@lru_cache(maxsize=256)
def _row_beat(
    tint: tuple[int, ...],
    screen: Screen,
    light: InkLight,
    footprint: Footprint,
    line_mm: float,
    tile_lines: int,
    periods_mm: tuple[float, float],
) -> tuple[float, float]:
    """Return ``RowBeats.wave`` and ``sd`` of one tint, in ``STEPS``."""
    device_mm = MM_PER_INCH / screen.dpi
    lines = int((TINT_MM[1] - 2 * footprint.reach_mm) / line_mm) // tile_lines * tile_lines
    along = _seen_by(footprint.along, footprint.reach_mm, line_mm, device_mm, pixels=lines)
    plates = np.empty((along.shape[1], round(TINT_MM[0] / device_mm), INKS), np.uint8)
    plates[:] = np.rint(np.array(tint) * (255 / STEPS))
    screened(plates, screen, tone=light, out=plates)
    left = np.ones(plates.shape[:2], np.float32)
    for ink, curve in enumerate(light):
        takes = np.interp(np.linspace(0, 1, 256), np.linspace(0, 1, len(curve)), curve)
        left *= (1 - takes).astype(np.float32)[plates[..., ink]]
    tiles = (along @ left.mean(axis=1, dtype=np.float64)).reshape(-1, tile_lines).mean(axis=1)
    beat = tiles / tiles.mean() - 1
    window = np.hanning(beat.size)
    amplitude = 2 * np.abs(np.fft.rfft(beat * window, 4 * beat.size)) / window.sum()
    frequency = np.fft.rfftfreq(4 * beat.size, tile_lines * line_mm)
    wanted = (frequency >= 1 / periods_mm[1]) & (frequency <= 1 / periods_mm[0])
    return float(amplitude[wanted].max(initial=0)), float(beat.std())


def _seen_by(
    edges: NDArray[np.float64],
    reach_mm: float,
    pitch_mm: float,
    device_mm: float,
    *,
    pixels: int = PATCH_PIXELS,
) -> NDArray[np.float64]:
    """Return the weights of device pixels in camera pixels, (pixels, device pixels); each row sums to 1."""
    count = int(np.ceil((pixels * pitch_mm + 2 * reach_mm) / device_mm)) + 1
    centres = reach_mm + (np.arange(pixels) + 0.5) * pitch_mm
    borders = np.arange(count + 1) * device_mm
    places = np.linspace(-reach_mm, reach_mm, edges.size)
    return np.asarray(np.diff(np.interp(borders - centres[:, None], places, edges), axis=1))


def _largest_mean_square(seen: NDArray[np.float64]) -> float:
    """Return the mean square of boxes' sums a pixel, the greatest of all sizes and of pieces of lines and columns."""
    most = float((seen**2).mean())
    for side in BOXES:
        for high, wide in ((side, side), (side, 1), (1, side)):
            rows, columns = seen.shape[0] // high, seen.shape[1] // wide
            if min(rows, columns) < 2:
                continue
            cut = seen[: rows * high, : columns * wide].reshape(rows, high, columns, wide)
            most = max(most, float((cut.sum(axis=(1, 3)) ** 2).mean()) / (high * wide))
    return most
