"""What real sheets do: fields of ink that stay on every sheet, what one sheet adds to them, and slow drift of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.simulation.fields import Waves, smooth_field

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.simulation.worlds import SheetAmounts

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
