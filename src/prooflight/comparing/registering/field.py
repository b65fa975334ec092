"""From tiles that err a little each to where every point of the page lies: pose and smooth field in one estimate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import linalg

from prooflight.comparing.registering.pose import slopes

if TYPE_CHECKING:
    from numpy.typing import NDArray

NEGLIGIBLE: Final = 1e-2
"""Waves of which a field holds less than this share of what it holds of the longest are left out."""
FAR: Final = 3.0
"""Tiles further off than so many standard deviations weigh less (Huber)."""
HOPELESS: Final = 8.0
"""Tiles further off than so many count for nothing: they show something else."""
ROUNDS: Final = 2
POSE: Final = 5
SMOOTH: Final = 13
"""The unknowns begin with the pose, then the planes; from here on they are waves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """What a good print may do, before it has been looked at; standard deviations.

    The defaults are those of the press world: shift and so on twice as wide as its uniform amounts allow, the field as
    it is, half of its variance along the travel the whole web's.
    """

    turn_deg: float = 0.2
    stretch_percent: float = 0.06
    warp_across_um: float = 30.0
    warp_along_um: float = 41.0
    line_share: float = 0.5
    """Of the variance along the travel that depends on the line alone: the whole web slips."""
    plane_um: float = 48.0
    """Of every ink plane, across and along, on the page."""
    smooth_mm: float = 25.0
    """Distance over which the field's correlation falls to 1/e."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Waves:
    """A smooth random field as a sum of cosines with independent amplitudes.

    A Gaussian correlation exp(-d^2 / (2 l^2)) has the spectrum sqrt(2 pi) l exp(-(l k)^2 / 2) along each axis; on a
    rectangle that is larger than the page by smooth_mm on all sides it is as good as that of the cosines with zero
    slope at its ends (Solin and Saerkkae 2020).
    """

    numbers_x: NDArray[np.float64]
    """(waves,) half periods across the rectangle."""
    numbers_y: NDArray[np.float64]
    size_mm: tuple[float, float]
    variance: NDArray[np.float64]
    """(waves,) of the amplitudes of a field of variance 1."""

    @classmethod
    def over(cls, width_mm: float, height_mm: float, smooth_mm: float, negligible: float) -> Waves:
        """Waves of a field on the page; width 0 for one that depends on the line alone."""
        scale = smooth_mm / np.sqrt(2)
        size = (width_mm + 2 * smooth_mm, height_mm + 2 * smooth_mm)
        held = []
        for extent, alone in zip(size, (width_mm == 0, False), strict=True):
            count = (
                1 if alone else int(np.ceil(np.sqrt(-2 * np.log(negligible)) * extent / (np.pi * scale))) + 1
            )
            k = np.pi * np.arange(count) / extent
            power = (
                np.sqrt(2 * np.pi) * scale * np.exp(-((scale * k) ** 2) / 2) * np.where(k > 0, 2, 1) / extent
            )
            held.append(np.ones(1) if alone else power)
        share = np.exp(
            -((scale * np.pi) ** 2)
            / 2
            * (
                (np.arange(held[0].size) / size[0])[None, :] ** 2
                + (np.arange(held[1].size) / size[1])[:, None] ** 2
            )
        )
        rows, columns = np.nonzero(share >= negligible)
        return cls(
            numbers_x=columns.astype(np.float64),
            numbers_y=rows.astype(np.float64),
            size_mm=size,
            variance=held[1][rows] * held[0][columns],
        )

    def at(self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """(points, waves) at points measured from the page's centre."""
        x = np.cos(np.pi * np.outer(x_mm / self.size_mm[0] + 0.5, np.arange(self.numbers_x.max() + 1)))
        y = np.cos(np.pi * np.outer(y_mm / self.size_mm[1] + 0.5, np.arange(self.numbers_y.max() + 1)))
        return x[:, self.numbers_x.astype(np.intp)] * y[:, self.numbers_y.astype(np.intp)]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Field:
    """What was found: steps of the pose and amplitudes of the waves, with their covariance."""

    waves: Waves
    line_waves: Waves
    solution: NDArray[np.float64]
    """(13 + waves + waves + line waves,): pose, planes (4, 2), across, along, along by line."""
    root: NDArray[np.float64]
    """Lower Cholesky factor of the precision of the unknowns, each divided by its ``scale``."""
    scale: NDArray[np.float64]
    weight: NDArray[np.float64]
    """(tiles,) share that each tile kept."""
    left_mm: NDArray[np.float64]
    """(tiles, 2) how far each lies off what was found."""

    @property
    def step(self) -> NDArray[np.float64]:
        """(5,) of the pose."""
        return self.solution[:POSE]

    @property
    def planes_mm(self) -> NDArray[np.float64]:
        """(4, 2) how far each ink plane lies too far right and down on the page."""
        return self.solution[POSE:SMOOTH].reshape(4, 2)

    def warp_mm(self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """(points, 2) the field without the pose, at points measured from the page's centre. [mm]"""
        across, along = design(self.waves, self.line_waves, x_mm, y_mm, np.zeros((x_mm.size, 2, 4)))
        return np.stack([rows[:, SMOOTH:] @ self.solution[SMOOTH:] for rows in (across, along)], axis=1)

    def moves_mm(self, points_mm: NDArray[np.float64], shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """(points, 2) field and planes at tiles: points (n, 2) from the page's centre, shares (n, 2, 4). [mm]"""
        return self.warp_mm(points_mm[:, 0], points_mm[:, 1]) + np.einsum(
            "nap,pa->na", shares, self.planes_mm
        )

    def sd_mm(
        self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64], shares: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(points, 2) standard deviation of the displacement of what is printed in ``shares`` of inks. [mm]"""
        rows = np.concatenate(design(self.waves, self.line_waves, x_mm, y_mm, shares))
        return self._sd(rows).reshape(2, x_mm.size).T

    def turn_sd(self) -> float:
        """Standard deviation of the pose's turn. [radian]"""
        row = np.zeros((1, self.scale.size))
        row[0, 2] = 1
        return float(self._sd(row)[0])

    def _sd(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        spread = linalg.solve_triangular(self.root, (rows * self.scale).T, lower=True, check_finite=False)
        return np.asarray(np.sqrt((spread**2).sum(axis=0)))


def design(
    waves: Waves,
    line_waves: Waves,
    x_mm: NDArray[np.float64],
    y_mm: NDArray[np.float64],
    shares: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How displacements across and along answer to every unknown, (points, unknowns) each.

    shares (points, 2, 4): as in ``Landmarks``.
    """
    pose = slopes(x_mm, y_mm)
    planes = np.zeros((2, x_mm.size, 4, 2))
    planes[0, :, :, 0], planes[1, :, :, 1] = shares[:, 0], shares[:, 1]
    across, along = planes.reshape(2, x_mm.size, 8)
    free, lines = waves.at(x_mm, y_mm), line_waves.at(np.zeros_like(x_mm), y_mm)
    none, no_lines = np.zeros_like(free), np.zeros_like(lines)
    return (
        np.hstack([pose[0], across, free, none, no_lines]),
        np.hstack([pose[1], along, none, free, lines]),
    )


def fitted(
    points_mm: NDArray[np.float64],
    moves_mm: NDArray[np.float64],
    precision: NDArray[np.float64],
    shares: NDArray[np.float64],
    *,
    page_width_mm: float,
    page_height_mm: float,
    prior: Prior,
    shift_sd_mm: float,
    negligible: float = NEGLIGIBLE,
    rounds: int = ROUNDS,
) -> Field:
    """Pose and field from tiles at points (n, 2) from the page's centre, off by moves (n, 2) with precision (n, 2, 2).

    The most likely amplitudes under ``prior`` with Huber weights: a Gaussian process written in waves. [mm, 1/mm^2]
    """
    waves = Waves.over(page_width_mm, page_height_mm, prior.smooth_mm, negligible)
    line_waves = Waves.over(0.0, page_height_mm, prior.smooth_mm, negligible)
    across_mm2, along_mm2 = (1e-3 * prior.warp_across_um) ** 2, (1e-3 * prior.warp_along_um) ** 2
    pose = np.array(
        [shift_sd_mm, shift_sd_mm, np.deg2rad(prior.turn_deg), *[prior.stretch_percent / 100] * 2]
    )
    variance = np.concatenate(
        [
            pose**2,
            np.full(8, (1e-3 * prior.plane_um) ** 2),
            across_mm2 * waves.variance,
            along_mm2 * (1 - prior.line_share) * waves.variance,
            along_mm2 * prior.line_share * line_waves.variance,
        ]
    )
    across, along = design(waves, line_waves, points_mm[:, 0], points_mm[:, 1], shares)
    scale = np.sqrt(variance)
    # Scaled so that every unknown has variance 1: well-conditioned whatever its unit.
    by = [
        (rows * scale)[:, columns].astype(np.float32)
        for rows, columns in zip((across, along), _held(waves, line_waves), strict=True)
    ]
    weight = np.ones(len(points_mm))
    for turn in range(rounds):
        p = (precision * weight[:, None, None]).astype(np.float32)
        normal, asked = _normal(by, _held(waves, line_waves), p, moves_mm, scale.size)
        root = linalg.cholesky(normal, lower=True, check_finite=False)
        solution = scale * linalg.cho_solve((root, True), asked, check_finite=False)
        left = moves_mm - np.stack([across @ solution, along @ solution], axis=1)
        deviation = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", left, precision, left), 0))
        weight = np.minimum(1, FAR / np.maximum(deviation, 1e-9)) * ((deviation < HOPELESS) | (turn == 0))
    return Field(
        waves=waves,
        line_waves=line_waves,
        solution=solution,
        root=root,
        scale=scale,
        weight=weight,
        left_mm=left,
    )


def _held(waves: Waves, line_waves: Waves) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Which unknowns act across, and which along."""
    count, first = waves.variance.size, np.arange(SMOOTH)
    along = np.arange(SMOOTH + count, SMOOTH + 2 * count + line_waves.variance.size)
    return np.concatenate([first, np.arange(SMOOTH, SMOOTH + count)]), np.concatenate([first, along])


def _normal(
    by: list[NDArray[np.float32]],
    held: tuple[NDArray[np.intp], NDArray[np.intp]],
    precision: NDArray[np.float32],
    moves_mm: NDArray[np.float64],
    unknowns: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normal equations of unknowns of variance 1; products in 32 bits, whose errors are far below the prior's 1."""
    normal, asked = np.eye(unknowns), np.zeros(unknowns)
    for one in range(2):
        for other in range(2):
            weighted = by[other] * precision[:, one, other, None]
            asked[held[one]] += by[one].T @ (precision[:, one, other] * moves_mm[:, other])
            if one <= other:
                block = by[one].T @ weighted
                normal[np.ix_(held[one], held[other])] += block
                if one < other:
                    normal[np.ix_(held[other], held[one])] += block.T
    return normal, asked
