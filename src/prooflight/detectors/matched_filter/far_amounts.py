"""Amounts of ink and register of a misprint in full, by the channels of a run.

On a good print the fit and registration state them. Their priors are those of good prints, so that of an ink or a plane
that is far off they state a part, and the detector's evidence is the rest. A run's charts, causes and corrections need
the whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from prooflight.cmyk import INK_LETTERS, INK_NAMES, INKS
from prooflight.detectors.matched_filter.fit.nuisance import free_gains
from prooflight.registration.planes import isolated

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.analysis import PreparedPage, ScanAnalysis
    from prooflight.detectors.matched_filter.fit.nuisance import FitBlocks, ResidualVariance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FarAmounts:
    """What the amounts of one misprint are computed from; called, it returns those that are far off."""

    prepared: PreparedPage
    planes: NDArray[np.float64]
    """(4, 2) place of each plane in register. [pixels]"""
    planes_mm: NDArray[np.float64]
    """(4, 2) places of planes by the fringes of their edges, about a common one; 0 where they are not located."""
    located: NDArray[np.bool_]
    """(4,) which are located."""
    blocks: FitBlocks
    sums: NDArray[np.float32]
    """Sums of ``blocks`` over the scan."""
    residual_variance: ResidualVariance

    @classmethod
    def of(
        cls,
        prepared: PreparedPage,
        analysis: ScanAnalysis,
        residual_variance: ResidualVariance,
    ) -> FarAmounts:
        """Take what is needed of the scan's images, before these are forgotten."""
        pitch, (blocks, sums) = prepared.binned_geometry.pixel_pitch_mm, analysis.block_sums()
        planes_mm, located = analysis.far_planes() or (np.zeros((INKS, 2)), np.zeros(INKS, bool))
        return cls(
            prepared=prepared,
            planes=analysis.registration.planes_mm / pitch,
            planes_mm=planes_mm,
            located=located,
            blocks=blocks,
            sums=sums,
            residual_variance=residual_variance,
        )

    @property
    def displaced(self) -> NDArray[np.bool_]:
        """Return which planes (4,) lie far off all others that are located."""
        displaced = np.zeros(INKS, bool)
        good_mm = self.prepared.prior.most_plane_mm
        displaced[self.located] = isolated(self.planes_mm[self.located], good_mm=good_mm)
        return displaced

    @property
    def register_mm(self) -> NDArray[np.float64]:
        """Displacements (4, 2) from where most planes lie; 0 for those that are not located."""
        return of_most(self.planes_mm, self.located)

    @property
    def displaced_ink(self) -> str:
        """Letter of the one plane that is displaced; empty: there is none, or two planes do not say which of them is.

        It is known by its edges, and so even where the sensors cannot distinguish its colour.
        """
        displaced = np.flatnonzero(self.displaced)
        return INK_LETTERS[displaced[0]] if displaced.size == 1 and self.located.sum() > 2 else ""

    def __call__(self) -> dict[str, float]:
        """Return the displacements of planes, if one is far off, or else the gains of the inks that are, by channel.

        Where planes lie elsewhere, blocks have other light as well, and would be taken for a change of ink.
        """
        if self.displaced.any():
            return {
                f"register-{INK_NAMES[ink]}-{axis}": float(mm)
                for ink in np.flatnonzero(self.located).tolist()
                for axis, mm in zip("xy", self.register_mm[ink], strict=True)
            }
        gains = free_gains(
            self.blocks,
            self.sums,
            sensors=self.prepared.binned_sensors,
            colours=self.prepared.colours,
            planes=self.planes,
            pixel_mm=self.prepared.binned_geometry.pixel_pitch_mm,
            prior=self.prepared.prior,
            residual_variance=self.residual_variance,
        )
        return {f"gain-{INK_NAMES[ink]}": gain for ink, gain in gains.items()}


def of_most(planes: NDArray[np.float64], located: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return displacements (4, 2) from where most of the located planes (4,) lie; 0 for those that are not located.

    That is the plane to which the others are nearest.

    >>> of_most(np.array([[3.0, 0], [0, 0], [0.2, 0], [0, 0]]), np.array([True, True, True, False]))[:, 0]
    array([ 2.8, -0.2,  0. ,  0. ])
    """
    relative = np.zeros_like(planes)
    own = planes[located]
    far = np.abs(own[:, None] - own).sum(axis=0) + 0.01 * np.abs(own)
    relative[located] = own - np.take_along_axis(own, far.argmin(axis=0)[None], axis=0)
    return relative
