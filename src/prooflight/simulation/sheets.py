"""What real sheets do: fields of ink that stay on every sheet, what one sheet adds to them, and slow drift of a run.

Random lines, fields and functions of colour are smooth and Gaussian, of mean 0 and standard deviation 1 everywhere.
Points a length l apart have the correlation exp(-(d / l)^2): "smooth over l" means that it has fallen to 1/e there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.simulation.worlds import SheetAmounts

WAVES = 64
"""Number of cosines in a function; the sum of so many is Gaussian to a per cent of kurtosis."""
COLOUR_LENGTH = 0.5
"""assumed: tables drift with an ink's tints, not with single patches: smooth over half of an ink's range."""


def smooth_line(
    count: int, *, pitch_mm: float, length_mm: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw values at ``count`` points pitch_mm apart, smooth over length_mm: (count,) [-]."""
    root = _root(count, pitch_mm / length_mm)
    return np.asarray(root @ rng.standard_normal(root.shape[1]))


def smooth_field(
    rows: int, columns: int, *, pitch_mm: float, length_mm: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw values at points pitch_mm apart down and across, smooth over length_mm in both: (rows, columns) [-]."""
    down, across = (_root(count, pitch_mm / length_mm) for count in (rows, columns))
    return np.asarray(down @ rng.standard_normal((down.shape[1], across.shape[1])) @ across.T)


@lru_cache(maxsize=64)
def _root(count: int, step: float) -> NDArray[np.float64]:
    """Return a matrix whose product with its transpose is the correlation of ``count`` points ``step`` lengths apart.

    Its columns are the few shapes that a smooth line has; those that hold less than 1e-9 of the variance are
    left out.
    """
    place = np.arange(count) * step
    correlation = np.exp(-(np.subtract.outer(place, place) ** 2))
    value, vector = np.linalg.eigh(correlation)
    used = value > 1e-9 * count
    return np.asarray(vector[:, used] * np.sqrt(value[used]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Waves:
    """Smooth random function of d coordinates: a sum of cosines of random direction, wavelength and phase.

    Random Fourier features (Rahimi and Recht 2007) of the correlation above; the same at every call. Over many lengths
    its standard deviation is 1.
    """

    wave: NDArray[np.float64]
    """Wave vectors (waves, d). [radian a unit of each coordinate]"""
    phase: NDArray[np.float64]
    """Phases (waves,). [radian]"""

    @classmethod
    def over(cls, lengths: Sequence[float], rng: np.random.Generator) -> Self:
        """Draw one function that is smooth over these lengths, one a coordinate."""
        return cls(
            wave=rng.standard_normal((WAVES, len(lengths))) * (np.sqrt(2) / np.array(lengths)),
            phase=rng.uniform(0, 2 * np.pi, WAVES),
        )

    def at(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the values at points (..., d) -> (...) [-]."""
        return np.asarray(np.cos(points @ self.wave.T + self.phase).sum(axis=-1) * np.sqrt(2 / WAVES))


class ColourWaves(Waves):
    """Smooth random function of ink areas: a product of functions of two inks each, so that a whole table costs one
    matrix product.
    """

    __slots__ = ()

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        """Draw one function."""
        return cls.over((COLOUR_LENGTH,) * INKS, rng)

    def on_grid(self, axis: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values at all combinations of the areas ``axis`` (n,) -> (n, n, n, n) [-]."""
        c, m, y, k = (np.exp(1j * np.multiply.outer(axis, wave)) for wave in self.wave.T)
        cm = (c[:, None] * m[None] * np.exp(1j * self.phase)).reshape(-1, WAVES)
        yk = (y[:, None] * k[None]).reshape(-1, WAVES)
        table = (cm @ yk.T).real * np.sqrt(2 / WAVES)
        return np.asarray(table.reshape((axis.size,) * INKS))


FIELD_PITCH_MM: Final = 2.5
"""Pitch of the nodes of a field; half of the shortest length in ``measured.toml``."""
RUN_SHEETS: Final = 10_000
"""Sheets of a day, of which one is drawn where nobody says which sheet a print is."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InkFields:
    """Deviations of the inks of one print from place to place; nodes FIELD_PITCH_MM apart, linear between."""

    gain: NDArray[np.float32]
    """Relative gain (4, rows, columns). [-]"""
    dot_gain: NDArray[np.float32]
    """Ink area (4, rows, columns) added at 50 %; 4 d a (1 - a) elsewhere. [-]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetState:
    """What the sheets of one day share."""

    amounts: SheetAmounts
    zones: tuple[Waves, ...]
    """Waves of each ink over the place across. [mm]"""
    places: tuple[Waves, ...]
    """Waves of each ink over the places across and along. [mm]"""
    drift: tuple[Waves, ...]
    """Waves of each ink and of the paper over the number of the sheet."""

    @classmethod
    def draw(cls, amounts: SheetAmounts, rng: np.random.Generator) -> Self:
        """Draw a day."""
        return cls(
            amounts=amounts,
            zones=tuple(Waves.over((amounts.zone_mm,), rng) for _ in range(INKS)),
            places=tuple(Waves.over((amounts.place_mm,) * 2, rng) for _ in range(INKS)),
            drift=tuple(Waves.over((amounts.drift_sheets,), rng) for _ in range(INKS + 1)),
        )

    def drifted(self, sheet: int, own: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return deviations of the inks and the paper on a sheet, (5,), of standard deviation 1 over many days.

        own: the part (5,) of this sheet alone, of standard deviation 1.
        """
        share = self.amounts.drift_share
        slow = np.array([float(wave.at(np.array([float(sheet)]))) for wave in self.drift])
        return np.asarray(np.sqrt(share) * slow + np.sqrt(1 - share) * own)

    def fields(self, page: Page, rng: np.random.Generator) -> InkFields:
        """Return the fields of one print of a page: what stays, and what this sheet adds.

        A place with more ink has it in solids and in tints, each by its own amount: solids by ``gain``, a mid-tint by
        gain + 2 dot_gain of its ink.
        """
        amounts = self.amounts
        rows, columns = (int(extent / FIELD_PITCH_MM) + 2 for extent in (page.height_mm, page.width_mm))
        y, x = np.arange(rows) * FIELD_PITCH_MM, np.arange(columns) * FIELD_PITCH_MM
        points = np.stack(np.broadcast_arrays(x, y[:, None]), axis=-1)
        solid, tint = np.empty((2, INKS, rows, columns))
        for ink in range(INKS):
            stays = np.sqrt(amounts.zone_share) * self.zones[ink].at(x[:, None])
            stays = stays + np.sqrt(1 - amounts.zone_share) * self.places[ink].at(points)
            own = smooth_field(rows, columns, pitch_mm=FIELD_PITCH_MM, length_mm=amounts.residual_mm, rng=rng)
            solid[ink] = stays * amounts.solid_percent + own * amounts.residual_solid_percent
            tint[ink] = stays * amounts.tint_percent + own * amounts.residual_tint_percent
        return InkFields(
            gain=(solid / 100).astype(np.float32), dot_gain=((tint - solid) / 200).astype(np.float32)
        )
