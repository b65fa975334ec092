"""Amounts of ink and register of a misprint in full, by the channels of a run.

On a good print the fit and registration state them. Their priors are those of good prints, so that of an ink or a plane
that is far off they state a part, and the detector's evidence is the rest. A run's charts, causes and corrections need
the whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INK_NAMES
from prooflight.detectors.matched_filter.fit.nuisance import free_gains
from prooflight.detectors.matched_filter.plane_places import of_most, planes_by_edges

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.analysis import PreparedPage, ScanAnalysis
    from prooflight.detectors.matched_filter.fit.nuisance import FitBlocks, PlacedScan, ResidualVariance

SURE_MM: Final = 0.03
"""Greatest standard deviation of the place of a located plane. assumed: three of them are a good plane's most."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FarAmounts:
    """What the amounts of one misprint are computed from; called, it returns those that are far off."""

    prepared: PreparedPage
    planes: NDArray[np.float64]
    """(4, 2) place of each plane in register. [pixels]"""
    further_mm: NDArray[np.float64]
    """(4, 2) displacements from where most planes lie; 0 where they are not located."""
    located: NDArray[np.bool_]
    """(4, 2) which are located."""
    blocks: FitBlocks
    sums: NDArray[np.float32]
    """Sums of ``blocks`` over the scan."""
    residual_variance: ResidualVariance

    @classmethod
    def of(
        cls,
        prepared: PreparedPage,
        analysis: ScanAnalysis,
        placed: PlacedScan,
        block_sums: tuple[FitBlocks, NDArray[np.float32]],
        residual_variance: ResidualVariance,
    ) -> FarAmounts:
        """Take what is needed of the scan's images, before these are forgotten."""
        blocks, sums = block_sums
        pitch = prepared.binned_geometry.pixel_pitch_mm
        off, sd = planes_by_edges(placed)
        located, planes_mm = pitch * sd < SURE_MM, analysis.registration.planes_mm
        return cls(
            prepared=prepared,
            planes=planes_mm / pitch,
            further_mm=of_most(planes_mm + pitch * off, located),
            located=located,
            blocks=blocks,
            sums=sums,
            residual_variance=residual_variance,
        )

    def __call__(self) -> dict[str, float]:
        """Return the displacements of planes, if one is far off, or else the gains of the inks that are, by channel.

        Where planes lie elsewhere, blocks have other light as well, and would be taken for a change of ink.
        """
        prior = self.prepared.prior
        if np.abs(self.further_mm).max() > prior.most_plane_mm:
            return {
                f"register-{INK_NAMES[ink]}-{'xy'[axis]}": float(self.further_mm[ink, axis])
                for ink, axis in np.argwhere(self.located).tolist()
            }
        gains = free_gains(
            self.blocks,
            self.sums,
            sensors=self.prepared.binned_sensors,
            colours=self.prepared.colours,
            planes=self.planes,
            pixel_mm=self.prepared.binned_geometry.pixel_pitch_mm,
            prior=prior,
            residual_variance=self.residual_variance,
        )
        return {f"gain-{INK_NAMES[ink]}": gain for ink, gain in gains.items()}
