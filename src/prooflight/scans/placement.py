"""Where a page lies under the camera, which is never quite where it should.

A camera pixel that would see the page point p, did the page lie in its place, sees the point q(p): ``Placement`` is
that map. It is a turn and a stretch about the page's centre, a shift, and a small smooth warp.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from prooflight.kernels.placement import between_nodes

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Warp:
    """A smooth displacement of the page, bilinear between nodes; beyond the outer nodes it stays as it is there."""

    nodes_mm: NDArray[np.float32]
    """(rows, columns, 2) displacement x, y of the page at nodes ``pitch_mm`` apart. [mm]"""
    pitch_mm: float
    first_mm: tuple[float, float] = (0.0, 0.0)
    """Where the first node lies (x, y), measured on a page in its place. [mm]"""

    def at(
        self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Displacement at points x_mm, y_mm of one shape, as two arrays of it. [mm]"""
        found = np.empty((2, *np.shape(x_mm)))
        points = [np.ascontiguousarray(each, np.float64).reshape(-1) for each in (x_mm, y_mm)]
        nodes = np.ascontiguousarray(self.nodes_mm)
        between_nodes(nodes, self.pitch_mm, *self.first_mm, *points, *found.reshape(2, -1))
        return found[0], found[1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placement:
    """Where a page lies minus where it should."""

    shift_mm: tuple[float, float] = (0.0, 0.0)
    """How far the page's centre lies too far right and too far down (x, y). [mm]"""
    skew_deg: float = 0.0
    """How far the page is turned clockwise, as seen, about its centre. [degree]"""
    stretch_percent: tuple[float, float] = (0.0, 0.0)
    """How much longer the page is across the web and along the travel, from its centre. [%]"""
    warp: Warp | None = None

    @property
    def is_shift(self) -> bool:
        """Whether every point of the page is displaced alike."""
        return self.skew_deg == 0 and self.stretch_percent == (0.0, 0.0) and self.warp is None

    def seen_mm(
        self,
        x_mm: NDArray[np.float64],
        y_mm: NDArray[np.float64],
        *,
        page_width_mm: float,
        page_height_mm: float,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The page points that are seen where x_mm, y_mm (arrays of one shape) would be, did the page lie in its place.

        q = c + S^-1 R^-1 (p - c - shift - warp(p)), c the page's centre, R the turn, S the stretch. [mm]
        """
        centre_x, centre_y = page_width_mm / 2, page_height_mm / 2
        x = x_mm - centre_x - self.shift_mm[0]
        y = y_mm - centre_y - self.shift_mm[1]
        if self.warp is not None:
            warp_x, warp_y = self.warp.at(x_mm, y_mm)
            x, y = x - warp_x, y - warp_y
        turn = np.deg2rad(self.skew_deg)
        back_x = x * np.cos(turn) + y * np.sin(turn)
        back_y = y * np.cos(turn) - x * np.sin(turn)
        across, along = (1 + percent / 100 for percent in self.stretch_percent)
        return centre_x + back_x / across, centre_y + back_y / along


IN_PLACE = Placement()
