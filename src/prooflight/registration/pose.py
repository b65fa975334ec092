"""Pose of a page relative to its nominal place: shift, turn and stretch, about its centre."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """A ``Placement`` without its warp, as the steps of a fit change it."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    turn: float = 0.0
    """Clockwise, as seen. [radian]"""
    across: float = 0.0
    along: float = 0.0
    """Relative elongation. [-]"""

    @property
    def numbers(self) -> NDArray[np.float64]:
        """All five numbers in the order of ``moved``, (5,). [mm, radian, -]"""
        return np.array([self.x_mm, self.y_mm, self.turn, self.across, self.along])

    def displacement_mm(
        self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the displacement to the right and down of page points measured from the page's centre. [mm]"""
        cosine, sine = np.cos(self.turn), np.sin(self.turn)
        x, y = x_mm * (1 + self.across), y_mm * (1 + self.along)
        return self.x_mm + cosine * x - sine * y - x_mm, self.y_mm + sine * x + cosine * y - y_mm

    def moved(self, step: NDArray[np.float64]) -> Pose:
        """Return the pose after one step (5,) of a fit."""
        return Pose(
            x_mm=self.x_mm + float(step[0]),
            y_mm=self.y_mm + float(step[1]),
            turn=self.turn + float(step[2]),
            across=self.across + float(step[3]),
            along=self.along + float(step[4]),
        )


def slopes(x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the derivatives of displacements at points [mm from the centre] by the five numbers, (2, n, 5)."""
    one, none = np.ones_like(x_mm), np.zeros_like(x_mm)
    return np.stack(
        [
            np.stack([one, none, -y_mm, x_mm, none], axis=1),
            np.stack([none, one, x_mm, none, y_mm], axis=1),
        ]
    )
