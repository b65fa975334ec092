"""A spot ink: spectra of its tints on a substrate and on another paper, and what a press with a unit of its own prints.

The latter is stated in the four inks of prediction's tables.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.pages.warnings import WHOLE_FILE, PageWarning
from prooflight.spectra import BANDS, xyz

LEAST: Final = 1e-4
"""Least reflectance factor by which another is divided; spectrophotometers resolve about 1e-3."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpotInk:
    """One spot ink, measured on its substrate."""

    name: str
    tint: NDArray[np.float64]
    """Tints (n,), rising, 0 to 1; the last is the solid, and 0 is the bare substrate. [-]"""
    measured: NDArray[np.float64]
    """Reflectance factors (n, 36). [-]"""
    on_black: NDArray[np.float64] | None = None
    """Reflectance factor (36,) of the solid printed on black; None: not measured. [-]"""
    condition: str = ""
    """Measurement condition (ISO 13655) and geometry, such as ``M1, 45:0``; empty: not stated."""

    @property
    def solid(self) -> NDArray[np.float64]:
        """Return the reflectance factor of the full ink, (36,). [-]"""
        return self.measured[-1]

    @property
    def opacity(self) -> float | None:
        """Return the contrast ratio of the solid: its Y (D50) on black over that on its substrate; None: not known."""
        if self.on_black is None:
            return None
        return round(float(xyz(self.on_black)[1] / max(xyz(self.solid)[1], LEAST)), 3)

    def reflectance(self, tint: float) -> NDArray[np.float64]:
        """Return the reflectance factor (36,) of a tint, 0 to 1, interpolated between the measured ones. [-]

        The square root of reflectance is interpolated, as light spreads in paper about its dots (Yule and Nielsen,
        1951, with n = 2). Below the least measured tint, that one holds.
        """
        roots = np.sqrt(self.measured)
        return np.array([np.interp(tint, self.tint, roots[:, band]) for band in range(BANDS)]) ** 2

    def on_paper(self, paper: NDArray[np.float64]) -> Self:
        """Return the ink as it looks on another paper, whose reflectance factor (36,) becomes that of tint 0.

        What passes through the ink meets the other paper: reflectance scales with the papers' ratio, band by band, but
        for the part that the solid reflects on black as well. Assumed: that part grows with the tint. An ink without a
        measured substrate is taken to have been measured on this paper.
        """
        if self.tint[0] > 0:
            return replace(
                self, tint=np.array([0.0, *self.tint]), measured=np.concatenate([paper[None], self.measured])
            )
        ratio = paper / np.maximum(self.measured[0], LEAST)
        covered = np.zeros(BANDS)
        if self.on_black is not None:
            covered = np.clip(self.on_black / np.maximum(self.solid, LEAST), 0, 1)
        share = self.tint[:, None] * covered
        return replace(self, measured=self.measured * (share + (1 - share) * ratio))


STEPS: Final = 17
"""Even steps of tint at which a mixture is computed, paper first; between them it is interpolated."""
KIND: Final = "spot-print"
"""Kind of the warning that a spot ink may look otherwise than predicted."""

Recipe = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class SpotPrint:
    """One spot ink that a press prints by a unit of its own; small, hashable and picklable."""

    name: str
    """Name of the colorant in PDFs."""
    mixture: tuple[Recipe, ...] = ()
    """Shares 0 to 1 of C, M, Y and K, at ``STEPS`` even tints, that give the camera the light of the ink.

    Empty: its spectrum is not known, and the file's tint transform predicts it."""
    light_off: float = 0.0
    """Greatest difference of that light from the ink's, over sensors and tints, as a share of paper white."""
    warnings: tuple[str, ...] = ()
    """What may print otherwise than predicted, as sentences."""

    def cmyk(self, tints: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the shares (n, 4) of process inks of tints (n,)."""
        curves, even = np.array(self.mixture), np.linspace(0, 1, len(self.mixture))
        return np.stack([np.interp(tints, even, curve) for curve in curves.T], axis=1)

    @property
    def page_warnings(self) -> tuple[PageWarning, ...]:
        """Return the warnings as those of a whole job."""
        return tuple(
            PageWarning(
                page=WHOLE_FILE, kind=KIND, message=f"spot ink {self.name}: {text}", object_name=self.name
            )
            for text in self.warnings
        )
