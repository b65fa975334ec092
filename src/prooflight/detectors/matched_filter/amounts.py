"""How much of which ink a place lacks or has too much of, and ink and register of a misprint in full.

The sums of ``local_evidence`` limit residuals to a few standard deviations, and the fit takes a part of what is off for
a variation of good prints. So amounts come from the light of the place itself: measured less expected, without the
level of lamp and paper, by least squares. A mode that explains little of it has no amount, nor has one that differs
from part to part of the place by as much as it is.

The fit and registration state the amounts of a good print, by the channels of a run. Their priors are those of good
prints, so that of an ink or a plane that is far off they state a part, and the detector's evidence is the rest
(``FarAmounts``). A run's charts, causes and corrections need the whole.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS, INK_NAMES, INKS
from prooflight.detectors.matched_filter.extents import ADDED, GAINED
from prooflight.detectors.matched_filter.fit.modes import AddedInks, moved
from prooflight.detectors.matched_filter.fit.nuisance import (
    Fit,
    FitBlocks,
    PlacedScan,
    ResidualVariance,
)
from prooflight.detectors.matched_filter.fit.residuals import fitted_amounts
from prooflight.registration.planes import isolated

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.analysis import ScanAnalysis
    from prooflight.detectors.matched_filter.design import PreparedPage

MODES_OF_AMOUNT: Final = {
    "streak": ("light", "void", *GAINED, *ADDED),
    "spots-voids": ("light", "void", *GAINED, *ADDED),
    "scum": ADDED,
    "ghost-smear": ADDED,
    "missing-content": ("void",),
    "missing-plane": GAINED,
    "density": (*GAINED, "gain-all"),
}
"""Modes of which a kind of place is stated in amounts."""
CORE: Final = 0.5
"""Share of a place's sides, about its middle, that is measured: its edges are soft."""
LEAST_CORE: Final = 3
"""Least side of what is measured. [binned pixels]"""
LEAST_EXPLAINED: Final = 0.3
"""Least share of what is off in a place that an amount explains. assumed"""
PARTS: Final = 4
"""Parts of a place, each way, of which amounts are compared."""
MOST_UNEVEN: Final = 0.25
"""Greatest standard deviation of an amount, as a share of it. assumed: 20 % is then between 10 and 30 %."""
MOST_PERCENT: Final = 105.0
"""Greatest amount that is taken for all of an ink or of the light: more, and something else is off there."""
CLEARER: Final = 2.0
"""Factor by which the next ink leaves more unexplained than the one that is named. assumed"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Amount:
    """What is off in a place."""

    ink: str = ""
    """Letter of the ink; empty: it is none, or not certain which."""
    darker_percent: float | None = None
    """Amount of ``Region``; None: it is not certain."""


def amount_in(
    kind: str,
    rows: slice,
    columns: slice,
    placed: PlacedScan,
    added: AddedInks,
    fit: Fit,
    *,
    distinct: Collection[str],
    inks: Collection[str],
) -> Amount:
    """Return by how much the light of a place is off, and by which ink.

    Parameters
    ----------
    kind : of the defect, which decides the modes that are compared.
    rows, columns : place, in binned pixels.
    placed, added, fit : of the scan.
    distinct : letters of the inks that the sensors distinguish from others.
    inks : letters of the inks that the page has.
    """
    rows, columns = _core(rows), _core(columns)
    off = _off(placed, fit, rows, columns)
    total = float((off**2).sum())
    if total <= 0:
        return Amount()
    fits = [
        _Fitted.of(name, mode, off)
        for name, mode in _modes(MODES_OF_AMOUNT.get(kind, ()), placed, added, rows, columns)
        if mode.any()
    ]
    if not fits:
        return Amount()
    best = min(fits, key=lambda one: one.left)
    letter = best.mode[-1] if best.mode in (*ADDED, *GAINED) else ""
    others = [one.left for one in fits if one.mode[-1] != best.mode[-1] and one.mode in (*ADDED, *GAINED)]
    certain = not others or min(others) >= CLEARER * best.left
    named = letter if letter and (list(inks) == [letter] or (letter in distinct and certain)) else ""
    if 1 - best.left / total < LEAST_EXPLAINED or best.uneven > MOST_UNEVEN:
        return Amount(ink=named)
    percent = 100 * best.amount * (-1 if best.mode in ("light", "void") else 1)
    possible = abs(percent) <= MOST_PERCENT and bool(named) == bool(letter)
    return Amount(ink=named, darker_percent=min(max(percent, -100.0), 100.0) if possible else None)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fitted:
    mode: str
    amount: float
    left: float
    """Sum of squares that it leaves."""
    uneven: float
    """Standard deviation of the amount from part to part, of their mean, as a share of the amount."""

    @classmethod
    def of(cls, name: str, mode: NDArray[np.float64], off: NDArray[np.float64]) -> _Fitted:
        pushes, powers = (_in_parts(one) for one in (mode * off, mode * mode))
        push, power = pushes.sum(), powers.sum()
        amount = float(push / power)
        informed = powers > 0
        deviations = pushes[informed] / powers[informed] - amount
        shares = powers[informed] / power
        sd = np.sqrt((shares**2 * deviations**2).sum()) if informed.sum() > 1 else abs(amount)
        left = float((off**2).sum() - push * amount)
        return cls(mode=name, amount=amount, left=left, uneven=float(sd / max(abs(amount), 1e-9)))


def _off(placed: PlacedScan, fit: Fit, rows: slice, columns: slice) -> NDArray[np.float64]:
    """Return measured less expected light of a place, (sensors, lines, pixels), paper white 1."""
    pixels = placed.where.inside.shape[1]
    levels = fitted_amounts(fit, placed.colours, pixels)
    off = np.empty((len(placed.sensors), *placed.where.inside[rows, columns].shape))
    for index, (sensor, level) in enumerate(zip(placed.sensors, levels, strict=True)):
        expected = placed.seen.expected_dn[index, rows, columns].astype(np.float64)
        light = expected - sensor.column_offset_dn[columns]
        measured = placed.measured_dn[index, rows, columns].astype(np.float64)
        off[index] = (measured - expected - light * level.columns[columns]) / sensor.white_dn
        off[index][~placed.inside(index)[rows, columns]] = 0
    return off


def _modes(
    names: Collection[str], placed: PlacedScan, added: AddedInks, rows: slice, columns: slice
) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield modes in a place, (sensors, lines, pixels), paper white 1."""
    sensors, modes = placed.sensors, placed.modes
    white = np.array([sensor.white_dn for sensor in sensors])[:, None, None]
    inside = np.stack([placed.inside(index)[rows, columns] for index in range(len(sensors))])
    offset = np.stack([sensor.column_offset_dn[columns] for sensor in sensors])[:, None]
    light = (placed.seen.expected_dn[:, rows, columns] - offset) / white
    ink = None
    for name in names:
        if name in ("light", "void"):
            yield name, inside * (light if name == "light" else 1 - light)
        elif name == "gain-all":
            yield name, inside * modes.gain[:, :, rows, columns].sum(axis=1) / white
        elif name in GAINED:
            yield name, inside * modes.gain[:, GAINED.index(name), rows, columns] / white
        else:
            if ink is None:
                images = moved(added.images, placed.where)
                ink = images.reshape(len(sensors), -1, *images.shape[1:])[:, :, rows, columns]
            yield name, inside * ink[:, ADDED.index(name)] / white


def _core(cells: slice) -> slice:
    extent = cells.stop - cells.start
    side = min(max(round(CORE * extent), LEAST_CORE), extent)
    first = cells.start + (extent - side) // 2
    return slice(first, first + side)


def _in_parts(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sums of images (sensors, lines, pixels) over ``PARTS`` each way."""
    sums = image.sum(axis=0)
    rows, columns = (np.unique(np.linspace(0, extent, PARTS + 1).astype(int))[:-1] for extent in sums.shape)
    return np.asarray(np.add.reduceat(np.add.reduceat(sums, rows, axis=0), columns, axis=1))


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
        model = self.prepared.nuisance_model(self.blocks, self.sums, self.planes, self.residual_variance)
        return {f"gain-{INK_NAMES[ink]}": gain for ink, gain in model.free_gains().items()}


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
