"""Joint estimate of pose and smooth displacement field from noisy tile displacements."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.kernels.memory import unset
from prooflight.kernels.registration.field import backward, cholesky, equations_of_waves, forward
from prooflight.registration.pose import Pose, slopes

if TYPE_CHECKING:
    from numpy.typing import NDArray

NEGLIGIBLE: Final = 1e-2
"""Waves whose amplitude is less than this share of the longest wave's are left out."""
FAR: Final = 3.0
"""Residual beyond which a tile's weight decreases (Huber). [standard deviations]"""
HOPELESS: Final = 8.0
"""Residual beyond which a tile has no weight, as it shows something else. [standard deviations]"""
POSE: Final = 5
SMOOTH: Final = 13
"""Index of the first wave among the unknowns, which begin with the pose and the planes."""
SHIFT_SD_MM: Final = 1.0
"""Standard deviation of a page's shift; it is no bound where any edge is seen, which fixes the shift to
hundredths."""
UPRIGHT: Final = Pose()


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """Prior of the displacements of a good print, as standard deviations.

    The defaults are those of a good office-class press (assumed); the matched filter learns those of its own
    press (``PrintPrior.of_place``). Half of the field's variance along the travel is common to the whole web.
    """

    turn_deg: float = 0.2
    stretch_percent: float = 0.06
    warp_across_um: float = 30.0
    warp_along_um: float = 41.0
    line_share: float = 0.5
    """Share of the variance along the travel that depends on the line alone, since the whole web slips."""
    plane_um: float = 48.0
    """Standard deviation of every ink plane, across and along, on the page."""
    smooth_mm: float = 25.0
    """Distance over which the field's correlation falls to 1/e."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Waves:
    """Smooth random fields on the page as sums of cosines with independent amplitudes.

    A Gaussian correlation exp(-d^2 / (2 l^2)) has the spectrum sqrt(2 pi) l exp(-(l k)^2 / 2) along each
    axis. On a rectangle larger than the page by smooth_mm on all sides it is well approximated by the cosines
    with zero slope at the rectangle's ends (Solin and Saerkkae 2020). The longest waves come first.
    """

    numbers_x: NDArray[np.int64]
    """Half periods across the rectangle, (waves,)."""
    numbers_y: NDArray[np.int64]
    share: NDArray[np.float64]
    """Amplitude of each wave relative to the longest, (waves,). [-]"""
    size_mm: tuple[float, float]
    variance: NDArray[np.float64]
    """Variances of the amplitudes of a field of variance 1, (waves,)."""
    line_variance: NDArray[np.float64]
    """Variances of the amplitudes of a field of variance 1 that depends on the line alone, (waves,)."""

    @classmethod
    def over(
        cls, width_mm: float, height_mm: float, smooth_mm: float, negligible: float = NEGLIGIBLE
    ) -> Waves:
        """Return the waves of a field on a page."""
        scale = smooth_mm / np.sqrt(2)
        size = (width_mm + 2 * smooth_mm, height_mm + 2 * smooth_mm)
        amplitudes, powers = [], []
        for extent in size:
            count = int(np.sqrt(-2 * np.log(negligible)) * extent / (np.pi * scale)) + 1
            k = np.pi * np.arange(count) / extent
            amplitudes.append(np.exp(-((scale * k) ** 2) / 2))
            powers.append(np.sqrt(2 * np.pi) * scale * amplitudes[-1] * np.where(k > 0, 2, 1) / extent)
        share = np.multiply.outer(amplitudes[1], amplitudes[0])
        rows, columns = np.nonzero(share >= negligible)
        order = np.argsort(-share[rows, columns], kind="stable")
        rows, columns = rows[order], columns[order]
        return cls(
            numbers_x=columns,
            numbers_y=rows,
            share=share[rows, columns],
            size_mm=size,
            variance=powers[1][rows] * powers[0][columns],
            line_variance=np.where(columns == 0, powers[1][rows], 0.0),
        )

    def cosines(
        self, x_mm: NDArray[np.floating], y_mm: NDArray[np.floating], times: int = 1
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the cosines (points, numbers) across and along at points measured from the page's centre.

        Numbers run up to ``times`` the largest one.
        """
        x, y = (
            np.cos(np.pi * np.outer(at / extent + 0.5, np.arange(times * int(numbers.max()) + 1)))
            for at, extent, numbers in zip(
                (x_mm, y_mm), self.size_mm, (self.numbers_x, self.numbers_y), strict=True
            )
        )
        return x, y

    def at(self, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the waves (points, waves) at points measured from the page's centre."""
        x, y = self.cosines(x_mm, y_mm)
        return x[:, self.numbers_x] * y[:, self.numbers_y]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Basis:
    """Terms that all fits of one design's tiles share."""

    points_mm: NDArray[np.float64]
    """Tiles' centres from the page's centre, (tiles, 2)."""
    waves: Waves
    cosines: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Cosines (tiles, numbers) across and along, to twice the largest number."""
    at: NDArray[np.float64]
    """Waves at the tiles, (tiles, waves)."""
    fixed: NDArray[np.float64]
    """Derivatives of displacements across and along by the pose, (2, tiles, 5)."""
    scale: NDArray[np.float64]
    """Standard deviations of pose, planes, waves across and waves along, (13 + waves + waves,). [mm and the
    like]"""

    @classmethod
    def of(
        cls, points_mm: NDArray[np.float64], page_width_mm: float, page_height_mm: float, prior: Prior
    ) -> Basis:
        """Return the basis of tiles at points (n, 2) measured from the page's centre."""
        waves = Waves.over(page_width_mm, page_height_mm, prior.smooth_mm)
        across_mm2, along_mm2 = (1e-3 * prior.warp_across_um) ** 2, (1e-3 * prior.warp_along_um) ** 2
        free, lines = (1 - prior.line_share) * waves.variance, prior.line_share * waves.line_variance
        pose = [SHIFT_SD_MM, SHIFT_SD_MM, np.deg2rad(prior.turn_deg), *[prior.stretch_percent / 100] * 2]
        smooth = np.sqrt(np.concatenate([across_mm2 * waves.variance, along_mm2 * (free + lines)]))
        x, y = points_mm.T
        return cls(
            points_mm=points_mm,
            waves=waves,
            cosines=waves.cosines(x, y, times=2),
            at=waves.at(x, y),
            fixed=slopes(x, y),
            scale=np.concatenate([pose, np.full(8, 1e-3 * prior.plane_um), smooth]),
        )

    def loosened(self, *, turn_deg: float, stretch_percent: float) -> Basis:
        """Return the basis with other standard deviations of turn and stretch."""
        scale = self.scale.copy()
        scale[2:POSE] = np.deg2rad(turn_deg), stretch_percent / 100, stretch_percent / 100
        return replace(self, scale=scale)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Field:
    """Result of a fit: steps of the pose and amplitudes of the waves, with their covariance."""

    basis: Basis
    count: int
    """Number of the basis's waves that were fitted, longest first."""
    solution: NDArray[np.float64]
    """Estimates (13 + waves + waves,): pose, planes (4, 2), waves across, waves along."""
    mean: NDArray[np.float64]
    """Prior mean of the pose's steps, (5,): the steps that take the page back to its nominal place."""
    root: NDArray[np.float64]
    """Lower Cholesky factor of the precision of the unknowns, each divided by its scale: waves, pose, planes."""
    weight: NDArray[np.float64]
    """Weight of each tile, (tiles,)."""
    left_mm: NDArray[np.float64]
    """Residuals of the tiles, (tiles, 2)."""

    @property
    def step(self) -> NDArray[np.float64]:
        """Steps of the pose, (5,)."""
        return self.solution[:POSE]

    @property
    def planes_mm(self) -> NDArray[np.float64]:
        """Displacement of each ink plane to the right and down on the page, (4, 2)."""
        return self.solution[POSE:SMOOTH].reshape(4, 2)

    def cost(self, precision: NDArray[np.float64]) -> float:
        """Return minus the logarithm of the likelihood of the tiles times the prior of the estimates.

        precision: (tiles, 2, 2) of the tiles. [1/mm^2, -]
        """
        misfit = np.einsum("n,ni,nij,nj->", self.weight, self.left_mm, precision, self.left_mm)
        off = self.solution.copy()
        off[:POSE] -= self.mean
        unlikely = np.square(off / _scale(self.basis, self.count)).sum()
        return float(misfit + unlikely) / 2

    def moves_mm(self, shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return all tiles' displacements by field and planes, without the pose, (tiles, 2); shares (tiles, 2, 4)."""
        amplitudes = self.solution[SMOOTH:].reshape(2, self.count)
        smooth = self.basis.at[:, : self.count] @ amplitudes.T
        return np.asarray(smooth + np.einsum("nap,pa->na", shares, self.planes_mm))

    def warp_mm(self, x_mm: NDArray[np.floating], y_mm: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the field alone, (rows, columns, 2), at columns x_mm and rows y_mm measured from the page's centre."""
        waves = self.basis.waves
        across, along = waves.cosines(x_mm, y_mm)
        numbers = waves.numbers_y[: self.count], waves.numbers_x[: self.count]
        both = []
        for amplitudes in self.solution[SMOOTH:].reshape(2, self.count):
            table = np.zeros((along.shape[1], across.shape[1]))
            table[numbers] = amplitudes
            both.append(along @ table @ across.T)
        return np.stack(both, axis=-1)

    def sd_mm(self, tiles: NDArray[np.intp], shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the standard deviation (n, 2) of the place of tiles (n,) with shares (n, 2, 4) of inks. [mm]"""
        rows = np.zeros((2, tiles.size, self.solution.size))
        rows[:, :, :SMOOTH] = _fixed(self.basis.fixed[:, tiles], shares)
        for axis in range(2):
            first = SMOOTH + axis * self.count
            rows[axis, :, first : first + self.count] = self.basis.at[tiles, : self.count]
        return self._sd(rows.reshape(-1, self.solution.size)).reshape(2, -1).T

    def turn_sd(self) -> float:
        """Return the standard deviation of the pose's turn. [radian]"""
        row = np.zeros((1, self.solution.size))
        row[0, 2] = 1
        return float(self._sd(row)[0])

    def _sd(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the standard deviations (n,) of sums of the unknowns with weights (n, unknowns)."""
        spread = _waves_first(rows * _scale(self.basis, self.count))
        forward(self.root, spread)
        return np.sqrt(np.square(spread).sum(axis=1))


def _waves_first(unknowns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unknowns (.., n) in the order of ``Field.root``: a fit with other planes has the same waves."""
    return np.concatenate([unknowns[..., SMOOTH:], unknowns[..., :SMOOTH]], axis=-1)


def _scale(basis: Basis, count: int) -> NDArray[np.float64]:
    smooth = basis.scale[SMOOTH:].reshape(2, -1)[:, :count]
    return np.concatenate([basis.scale[:SMOOTH], smooth.ravel()])


def _fixed(pose: NDArray[np.float64], shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the derivatives of displacements across and along by pose and planes, (2, n, 13)."""
    planes = np.zeros((2, len(shares), 4, 2))
    planes[0, :, :, 0], planes[1, :, :, 1] = shares[:, 0], shares[:, 1]
    return np.concatenate([pose, planes.reshape(2, -1, 8)], axis=2)


def fitted(
    basis: Basis,
    tiles: NDArray[np.intp],
    moves_mm: NDArray[np.float64],
    precision: NDArray[np.float64],
    shares: NDArray[np.float64],
    *,
    pose: Pose = UPRIGHT,
    negligible: float = NEGLIGIBLE,
    weight: NDArray[np.float64] | None = None,
    root: NDArray[np.float64] | None = None,
    waves_root: NDArray[np.float64] | None = None,
) -> Field:
    """Fit pose, planes and field to measured tiles.

    The result is the most likely set of amplitudes under the basis's prior: a Gaussian process written in
    waves. The prior is one of the whole displacement, not of one more step, so what no tile determines stays
    as it is on good prints, however many steps are taken.

    Parameters
    ----------
    tiles : (n,) indices of the tiles, in order
    moves_mm : (n, 2) displacements from where a page of that ``pose`` has them [mm]
    precision : (n, 2, 2) of these [1/mm^2]
    shares : (n, 2, 4) of inks in the tiles' edges
    weight : (n,) of the tiles; by default Huber weights about a first such field
    root : with ``weight``, ``Field.root`` of a fit that differed in ``moves_mm`` alone; None: there was none
    waves_root : the same of a fit that differed in ``shares`` as well
    """
    count = int((basis.waves.share >= negligible).sum())
    chosen = slice(None) if tiles.size == len(basis.at) else tiles  # arrays of all tiles are not copied
    at = basis.at[chosen, :count]
    fixed = _fixed(basis.fixed[:, chosen], shares)
    scale = _waves_first(_scale(basis, count))
    mean = -pose.numbers
    # Where no weight is given, two rounds: tiles that are far off a first field weigh less in the second.
    given = np.ones(tiles.size) if weight is None else weight
    for last in (True,) if weight is not None else (False, True):
        weighted = precision * given[:, None, None]
        if root is None or weight is None:
            factor = unset((scale.size, 2 * scale.size)).view(np.float64)
            begin = 0 if waves_root is None else 2 * count
            if waves_root is None:
                _put_waves(basis, chosen, count, weighted, scale, factor)
            else:
                factor[:begin] = waves_root[:begin]
            _put_fixed(at, fixed, weighted, scale, factor)
            cholesky(factor, begin)
        else:
            factor = root
        pull = np.einsum("nab,nb->na", weighted, moves_mm)
        solution = np.concatenate([(pull.T @ at).ravel(), np.einsum("anj,na->j", fixed, pull)]) * scale
        of_pose = slice(2 * count, 2 * count + POSE)
        solution[of_pose] += mean / scale[of_pose]
        forward(factor, solution[None])
        backward(factor, solution)
        solution *= scale
        solution = np.concatenate([solution[-SMOOTH:], solution[:-SMOOTH]])
        left = moves_mm - np.einsum("anj,j->na", fixed, solution[:SMOOTH])
        left -= at @ solution[SMOOTH:].reshape(2, count).T
        if not last:
            given = trust(left, precision, hopeless=np.inf)
    return Field(
        basis=basis, count=count, solution=solution, root=factor, weight=given, left_mm=left, mean=mean
    )


def _put_waves(
    basis: Basis,
    chosen: slice | NDArray[np.intp],
    count: int,
    precision: NDArray[np.float64],
    scale: NDArray[np.float64],
    normal: NDArray[np.float64],
) -> None:
    """Write the rows of ``count`` waves across and along into the normal equations of chosen tiles."""
    numbers = basis.waves.numbers_x[:count], basis.waves.numbers_y[:count]
    x, y = (each[chosen, : 2 * most.max() + 1] for each, most in zip(basis.cosines, numbers, strict=True))
    tables = np.stack([(x.T * precision[:, a, b]) @ y for a, b in ((0, 0), (0, 1), (1, 1))])
    equations_of_waves(tables, *numbers, scale, normal)


def _put_fixed(
    at: NDArray[np.float64],
    fixed: NDArray[np.float64],
    precision: NDArray[np.float64],
    scale: NDArray[np.float64],
    normal: NDArray[np.float64],
) -> None:
    """Write the rows of pose and planes, the last ones, into the normal equations of tiles; at (n, count): waves."""
    waves = 2 * at.shape[1]
    pulls = [
        (each[:, 0, None] * fixed[0] + each[:, 1, None] * fixed[1]).T for each in precision.swapaxes(0, 1)
    ]
    rows = [pulls[0] @ at, pulls[1] @ at, pulls[0] @ fixed[0] + pulls[1] @ fixed[1]]
    normal[waves:] = np.concatenate(rows, axis=1) * np.outer(scale[waves:], scale)
    normal[waves:, waves:] += np.eye(len(scale) - waves)


def trust(
    left_mm: NDArray[np.float64], precision: NDArray[np.float64], *, hopeless: float = HOPELESS
) -> NDArray[np.float64]:
    """Return Huber weights (n,) of tiles with residuals (n, 2); 0 beyond ``hopeless`` standard deviations."""
    far = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", left_mm, precision, left_mm), 0))
    return np.minimum(1, FAR / np.maximum(far, 1e-9)) * (far < hopeless)
