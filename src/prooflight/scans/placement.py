"""Placement of a page under the camera, relative to its nominal place.

A camera pixel that would see the page point p if the page were at its nominal place sees the point q(p):
``Placement`` is that map. It is a turn and a stretch about the page's centre, a shift, and a small smooth
warp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.placement import between_nodes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Warp:
    """A smooth displacement of the page, bilinear between nodes and constant beyond the outer ones."""

    nodes_mm: NDArray[np.float32]
    """Displacement x, y of the page at nodes ``pitch_mm`` apart, (rows, columns, 2). [mm]"""
    pitch_mm: float
    first_mm: tuple[float, float] = (0.0, 0.0)
    """Place of the first node (x, y), on a page at its nominal place. [mm]"""

    def at(
        self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the displacement at points x_mm, y_mm of one shape, as two arrays of it. [mm]"""
        displacement = np.empty((2, *np.shape(x_mm)))
        points = [np.ascontiguousarray(each, np.float64).reshape(-1) for each in (x_mm, y_mm)]
        nodes = np.ascontiguousarray(self.nodes_mm)
        between_nodes(nodes, self.pitch_mm, *self.first_mm, *points, *displacement.reshape(2, -1))
        return displacement[0], displacement[1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placement:
    """Difference between a page's actual and nominal place."""

    shift_mm: tuple[float, float] = (0.0, 0.0)
    """Displacement of the page's centre to the right and down (x, y). [mm]"""
    skew_deg: float = 0.0
    """Turn of the page about its centre, clockwise as seen. [degree]"""
    stretch_percent: tuple[float, float] = (0.0, 0.0)
    """Elongation of the page across the web and along the travel, from its centre. [%]"""
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
        """Return the page points seen where x_mm, y_mm (arrays of one shape) would be without displacement.

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
