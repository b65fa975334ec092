"""Nuisance parameters: the variation of good prints, fitted to a scan and removed from it.

The fitted amounts are evidence as well. Measured minus expected is a sum of causes that act on the whole
page: paper and lamp (light as a whole), tables that are slightly wrong in some colours, ink gain and its
tilt, dot gain, planes slightly out of register. Each has a prior, which states what a good press does. The
amounts are estimated from means over blocks, by robust weighted least squares with that prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate
from math import prod
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.detectors.base import LAMP_WAVES
from prooflight.kernels.memory import unset
from prooflight.kernels.residuals.fit import (
    DOT_AT,
    EIGHT,
    GAIN_AT,
    LEVELS,
    SHAPE_AT,
    SHAPES,
    SLOPE_AT,
    SUMS,
    block_sums,
)
from prooflight.pages.parallel import parts_of, shared_out

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.fit.modes import Modes, PixelMap
    from prooflight.detectors.print_prior import PrintPrior
    from prooflight.prediction.predict import Prediction
    from prooflight.prediction.tables import SensorModel


class FitParts(NamedTuple):
    """Parameter vectors of the fit, or arrays whose last axis is such a vector, by kind of amount.

    The parts are views.
    """

    white: NDArray[np.float64]
    """(..., sensors) light of each sensor."""
    common: NDArray[np.float64]
    """(..., 1) light common to all sensors."""
    lamp: NDArray[np.float64]
    """(..., LAMP_WAVES) waves of the lamp's profile."""
    shape: NDArray[np.float64]
    """(..., sensors, colours) weights of smooth functions of the page's colours."""
    gain: NDArray[np.float64]
    """(..., 4, 3) gain of each ink at the centre, and its increase at the right and at the lower edge."""
    dot: NDArray[np.float64]
    """(..., 4) dot gain of each ink."""
    planes: NDArray[np.float64]
    """(..., 4, 2) displacement of each ink's plane, to the right and down."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitLayout:
    """Number and order of the amounts of a fit."""

    sensors: int
    colours: int
    """Number of smooth functions of colour that the page has."""

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes of the parts of one vector, in their order."""
        of_colours = self.sensors, self.colours
        return (self.sensors,), (1,), (LAMP_WAVES,), of_colours, (INKS, 3), (INKS,), (INKS, 2)

    @property
    def size(self) -> int:
        """Number of amounts."""
        return sum(prod(shape) for shape in self.shapes)

    def parts(self, vectors: NDArray[np.float64]) -> FitParts:
        """Return views of vectors (..., size) by kind of amount."""
        ends = list(accumulate(prod(shape) for shape in self.shapes))
        pieces = (
            vectors[..., end - prod(shape) : end].reshape(*vectors.shape[:-1], *shape)
            for end, shape in zip(ends, self.shapes, strict=True)
        )
        return FitParts(*pieces)


BLOCK: Final = EIGHT
"""Side of the blocks whose means are fitted. [pixels]"""
COLOURS: Final = SHAPES
"""Maximum number of a page's recipes between which tables are taken to err smoothly."""
COLOUR_LENGTH: Final = 0.5
"""Ink area over which a table's error varies: half of an ink's range (assumed, as in the press world)."""
FOLLOWED: Final = 0.25
"""``Colours.unfollowed`` up to which a page is like those that trained the ranking, of 500 of which 0.23 is
the most."""
ROUNDS: Final = 4
MOST_BLOCKS: Final = 10_000
"""No scan has so many that the fit uses: of more than twice ``BLOCKS`` it uses every second, and so on."""
BLOCKS: Final = 5000
"""Maximum number of blocks, spread evenly over the page, that are fitted."""
TEMPER: Final = 0.2
"""Weight of each block: blocks of one colour share their table's error, so that each counts for less than
one."""
EDGE_BIAS: Final = 0.05
"""Displacement by which all edges of a block may be biased: planes that hide each other's register. [pixels,
assumed]"""
FREE_GAIN: Final = 0.2
"""Standard deviation of the gain of an ink that is off. assumed: half of the most in ``worlds.toml``."""
BETTER: Final = 9.0
"""Decrease of minus twice the logarithm of the likelihood by which one more ink is taken to be off. assumed: three
standard deviations."""
FAR: Final = 4.685
"""Tukey's biweight constant: blocks off by more standard deviations get no weight."""


def amounts_sd(prior: PrintPrior, layout: FitLayout, pixel_mm: float) -> NDArray[np.float64]:
    """Return the standard deviations of the fit's amounts, (amounts,), in the units of ``Fit``."""
    sd = np.empty(layout.size)
    of = layout.parts(sd)
    of.white[...] = prior.white
    of.common[...] = prior.common
    of.lamp[...] = prior.lamp_sd
    of.shape[...] = prior.shape
    of.gain[...] = prior.gain, prior.tilt, prior.tilt
    of.dot[...] = prior.dot
    # The prior is about the planes' registered places.
    of.planes[...] = 0.25 * prior.plane_mm / pixel_mm
    return sd


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """Nuisance parameters of one scan."""

    white: NDArray[np.float64]
    """(sensors,) light of each sensor, with what is common to all. [-]"""
    lamp: NDArray[np.float64]
    """(LAMP_WAVES,) amplitudes of cos(k pi x / W). [-]"""
    shape: NDArray[np.float64]
    """(sensors, colours) weights of the page's colour features, relative to the prior's standard
    deviation."""
    gain: NDArray[np.float64]
    """(4, 3) gain of each ink at the centre, and its increase at the right and at the lower edge. [-]"""
    dot: NDArray[np.float64]
    """(4,) ink area added at 50 %. [-]"""
    planes: NDArray[np.float64]
    """(4, 2) displacement of each plane, right and down. [pixels]"""
    pulls: NDArray[np.float64]
    """(amounts,) each amount over the standard deviation it would have on good prints, in the order of
    ``FitLayout``."""
    determined_share: NDArray[np.float64]
    """(amounts,) share of each amount that the page determines, not the prior: 1 - posterior over prior
    variance. [-]"""
    spread: float
    """Robust spread of blocks about the fit, in units of their standard deviation. [-]"""
    lost: float
    """Share of blocks that the fit does not explain. [-]"""
    prior: PrintPrior
    """Prior of the fit."""

    @property
    def surprises(self) -> FitParts:
        """``pulls`` by kind of amount."""
        layout = FitLayout(sensors=self.white.size, colours=self.shape.shape[1])
        return layout.parts(self.pulls)

    def emptied(self) -> Fit:
        """Return the fit with every amount 0, which explains nothing."""
        amounts = ("white", "lamp", "shape", "gain", "dot", "planes")
        return replace(self, **{name: np.zeros_like(getattr(self, name)) for name in amounts})


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualVariance:
    """Variance of good prints in addition to the fit; the defaults are an office-class press's, assumed."""

    edge: float = 0.001
    """Variance per squared slope of the light. [pixels^2]"""
    contrast: float = 0.0009
    """Variance relative to that of a halftone at unit contrast."""
    share: float = 0.002
    """Standard deviation as a share of the light."""
    dark: float = 0.02
    """Increase of ``share`` in the dark, per squared natural logarithm of white over light: an error of an
    ink's film or of a table changes its density. assumed: 1 % of light at 50 %, 18 % at 5 %."""

    @classmethod
    def none(cls) -> ResidualVariance:
        """Return the variance of a press whose good prints differ from their prediction by noise alone."""
        return cls(edge=0.0, contrast=0.0, share=0.0, dark=0.0)

    @property
    def exact(self) -> bool:
        """Whether good prints are as predicted: in their nominal place and with the planned inks."""
        return self == ResidualVariance.none()

    def with_edges_off(self, sd_pixels: float) -> ResidualVariance:
        """Return the variance of a page whose edges are displaced in addition.

        An exact page has no displacement.
        """
        return self if self.exact else replace(self, edge=self.edge + sd_pixels**2)

    def share_of(self, light: NDArray[np.floating], white: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the standard deviation as a share of the light, for a light and the white it is relative to.

        [-]
        """
        depth = np.log(white / np.clip(light, 0.01 * white, white))
        return np.asarray(self.share + self.dark * depth**2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Colours:
    """Smooth functions of a page's colours, with independent amplitudes."""

    centres: NDArray[np.float32]
    """(n, 4) ink areas."""
    root: NDArray[np.float32]
    """(n, n): features = root @ exp(-|a - centres|^2 / length^2); inverse Cholesky factor of their kernel."""
    unfollowed: float = 0.0
    """Error of a table that these functions do not represent: its rms over all that is printed, relative to
    that error's standard deviation."""

    @property
    def widening(self) -> float:
        """Factor by which this page's tolerances are wider than others'; its light may be off by more."""
        return max(self.unfollowed / FOLLOWED, 1.0)

    def bells(self) -> NDArray[np.float32]:
        """Return the factors by ink, (4, LEVELS, SHAPES), of exp(-|a - centre|^2 / length^2).

        They are 0 beyond the centres.
        """
        factors = np.zeros((INKS, LEVELS, SHAPES), np.float32)
        levels = np.linspace(0, 1, LEVELS)[None, :, None]
        off = levels - self.centres.T[:, None].astype(np.float64)
        factors[:, :, : len(self.centres)] = np.exp(-((off / COLOUR_LENGTH) ** 2))
        return factors

    def weights(self, amounts: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return the weights of the Gaussian functions, (SHAPES,), from amounts (n,) of the features."""
        result = np.zeros(SHAPES, np.float32)
        result[: len(self.root)] = self.root.T @ amounts
        return result


def page_colours(cover: NDArray[np.float32]) -> Colours:
    """Choose recipes that represent the page's.

    Each is the least explained by those before (pivoted Cholesky).
    """
    steps = np.rint(cover[:, ::4, ::4].reshape(INKS, -1) * np.float32(16)).clip(0, 16).astype(np.int32)
    counts = np.bincount(np.ravel_multi_index(tuple(steps), (17,) * INKS), minlength=17**INKS)
    counts[0] += 1  # bare paper is always one of them
    keys = np.flatnonzero(counts)
    count = counts[keys]
    colours = np.stack(np.unravel_index(keys, (17,) * INKS), axis=1) / 16
    weight = np.sqrt(count)
    left = np.ones(len(colours))
    basis = np.zeros((len(colours), 0))
    chosen: list[int] = []
    for _ in range(min(COLOURS, len(colours))):
        pivot = (
            int(np.flatnonzero((colours == 0).all(axis=1))[0])
            if not chosen
            else int(np.argmax(left * weight))
        )
        if left[pivot] < 0.02:
            break
        chosen.append(pivot)
        kernel = np.exp(-((colours - colours[pivot]) ** 2).sum(axis=1) / COLOUR_LENGTH**2)
        column = (kernel - basis @ basis[pivot]) / np.sqrt(left[pivot])
        basis = np.column_stack([basis, column])
        left = (left - column**2).clip(min=0)
    printed = keys > 0  # key 0 is bare paper
    unfollowed = np.sqrt((left * count)[printed].sum() / max(count[printed].sum(), 1))
    centres = colours[chosen]
    kernel = np.exp(-((centres[:, None] - centres) ** 2).sum(axis=2) / COLOUR_LENGTH**2)
    factor = np.linalg.cholesky(kernel + 1e-6 * np.eye(len(chosen)))
    return Colours(
        centres=centres.astype(np.float32),
        root=np.linalg.inv(factor).astype(np.float32),
        unfollowed=float(unfollowed),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedScan:
    """A scan, and what is known of its page at its placement; arrays are (sensors, lines, pixels)."""

    measured_dn: NDArray[np.generic]
    seen: Prediction
    modes: Modes
    """Modes at the page's placement."""
    where: PixelMap
    sensors: Sequence[SensorModel]
    colours: Colours
    lost: NDArray[np.bool_] | None = None
    """(sensors, lines) missing lines; None: none are missing."""

    def inside(self, sensor: int) -> NDArray[np.bool_]:
        """Return which pixels of the page this sensor measured, (lines, pixels)."""
        return self.where.inside if self.lost is None else self.where.inside & ~self.lost[sensor, :, None]

    def seen_by_all(self) -> NDArray[np.bool_]:
        """Return which pixels of the page all sensors measured, (lines, pixels)."""
        if self.lost is None:
            return self.where.inside
        return self.where.inside & ~np.any(self.lost, axis=0, keepdims=True).T

    def light(self) -> NDArray[np.float32]:
        """Return the expected signal less the columns' dark signal, (sensors, lines, pixels). [DN]"""
        offset = np.stack([sensor.column_offset_dn for sensor in self.sensors])
        expected = self.seen.expected_dn
        return np.subtract(expected, offset[:, None], out=unset(expected.shape))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Blocks:
    """Means over the pixels of some blocks of every sensor; darker is less."""

    pixels: NDArray[np.float64]
    """(sensors, blocks) number of pixels inside the page."""
    residual: NDArray[np.float64]
    """Measured minus expected signal. [DN]"""
    light: NDArray[np.float64]
    variance: NDArray[np.float64]
    steepness: NDArray[np.float64]
    """Squared slope of the light. [DN^2 / pixel^2]"""
    texture: NDArray[np.float64]
    gain: NDArray[np.float64]
    """(sensors, 4, blocks) ``Modes.gain``."""
    dot: NDArray[np.float64]
    shape: NDArray[np.float64]
    """(sensors, colours, blocks) colour features times light."""
    slopes: NDArray[np.float64]
    """(sensors, 2, 4, blocks) slope of each ink's plane, across and along. [DN / pixel]"""
    across: NDArray[np.float64]
    """(blocks,) position, -1 left .. 1 right."""
    along: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitBlocks:
    """Blocks of a scan that the fit uses."""

    place: NDArray[np.int64]
    """(2, blocks) row and column of each, in blocks."""
    shape: tuple[int, int]
    """Rows and columns of all blocks."""

    @classmethod
    def of(cls, inside: NDArray[np.bool_]) -> FitBlocks:
        """Choose blocks of which at least half is inside (lines, pixels)."""
        rows, columns = (extent // BLOCK for extent in inside.shape)
        cut = np.ascontiguousarray(inside[: rows * BLOCK, : columns * BLOCK])
        # A block's columns are the bytes of one number: none is above BLOCK, and a product adds them in the highest.
        down = cut.view(np.uint64).reshape(rows, BLOCK, columns).sum(axis=1)
        full = (down * np.uint64(0x0101010101010101)) >> np.uint64(56)
        used = np.flatnonzero(full.ravel() >= BLOCK * BLOCK / 2)
        used = used[:: max(used.size // BLOCKS, 1)]
        return cls(place=np.stack(np.divmod(used, columns)), shape=(rows, columns))

    @property
    def corners(self) -> NDArray[np.int64]:
        """(blocks, 2) first line and pixel of each."""
        return np.ascontiguousarray(self.place.T * BLOCK)


def summed_blocks(scan: PlacedScan, blocks: FitBlocks, threads: int) -> NDArray[np.float32]:
    """Return sums over blocks of every sensor, (sensors, blocks, SUMS); see ``block_sums``."""
    corners, inside = blocks.corners, scan.seen_by_all()
    sums = np.empty((len(scan.sensors), len(corners), SUMS), np.float32)
    bells = scan.colours.bells()
    shared_out(
        [
            partial(
                block_sums,
                scan.measured_dn[index],
                scan.seen.expected_dn[index],
                sensor.column_offset_dn,
                scan.seen.variance_dn2[index],
                scan.modes.inks(index),
                inside,
                bells,
                corners[first:last],
                sums[index, first:last],
            )
            for index, sensor in enumerate(scan.sensors)
            for first, last in parts_of(len(corners), threads)
        ],
        threads=threads,
    )
    return sums


def _means(blocks: FitBlocks, sums: NDArray[np.float32], colours: Colours) -> _Blocks:
    pixels = sums[..., 0].astype(np.float64)
    means = np.ascontiguousarray(np.moveaxis(sums, -1, 1)) / np.maximum(pixels, 1)[:, None]
    residual, light, variance, steepness, texture = np.moveaxis(means[:, 1:GAIN_AT], 1, 0)
    along, across = 2 * (blocks.place + 0.5) / np.array(blocks.shape)[:, None] - 1
    return _Blocks(
        pixels=pixels,
        residual=residual,
        light=light,
        variance=variance,
        steepness=steepness,
        texture=texture,
        gain=means[:, GAIN_AT:DOT_AT],
        dot=means[:, DOT_AT:SHAPE_AT],
        shape=colours.root @ means[:, SHAPE_AT : SHAPE_AT + len(colours.centres)],
        slopes=means[:, SLOPE_AT:].reshape(len(means), 2, INKS, -1),
        across=across,
        along=along,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NuisanceModel:
    """Linear model of block means; its rows are the blocks of all sensors."""

    layout: FitLayout
    residual: NDArray[np.float64]
    """(sensors, blocks) measured minus expected signal. [DN]"""
    variance: NDArray[np.float64]
    """(sensors, blocks) variance of the residual. [DN^2]"""
    x: NDArray[np.float64]
    """(sensors, blocks, amounts) design matrix, scaled by the prior's standard deviations. [DN]"""
    scale: NDArray[np.float64]
    """(amounts,) prior standard deviations."""
    start: NDArray[np.float64]
    """(amounts,) prior means."""
    prior: PrintPrior

    @classmethod
    def of(
        cls,
        places: FitBlocks,
        sums: NDArray[np.float32],
        *,
        sensors: Sequence[SensorModel],
        colours: Colours,
        planes: NDArray[np.float64],
        pixel_mm: float,
        prior: PrintPrior,
        residual_variance: ResidualVariance,
    ) -> NuisanceModel:
        """Create the model of one scan.

        Parameters
        ----------
        places : blocks of the scan.
        sums : (sensors, blocks, SUMS) sums over them (``summed_blocks``).
        sensors, colours : of the page.
        planes : (4, 2) register of planes from registration, where their estimation starts [pixels].
        pixel_mm : pitch of the pixels [mm].
        prior : standard deviations of the amounts.
        residual_variance : variance of good prints in addition to the fit.
        """
        blocks = _means(places, sums, colours)
        layout, light = FitLayout(sensors=len(sensors), colours=blocks.shape.shape[1]), blocks.light
        # One amount after the other in memory: products with the transpose are faster, and parts are filled at once.
        x = np.moveaxis(np.zeros((layout.size, *light.shape)), 0, -1)
        by, scale = layout.parts(x), amounts_sd(prior, layout, pixel_mm)
        waves = np.arange(1, LAMP_WAVES + 1)
        for sensor in range(layout.sensors):
            by.white[sensor, :, sensor] = light[sensor]
            by.shape[sensor, :, sensor] = blocks.shape[sensor].T
        by.common[...] = light[..., None]
        by.lamp[...] = light[..., None] * np.cos(np.pi * np.multiply.outer((blocks.across + 1) / 2, waves))
        for ink in range(INKS):
            gain = blocks.gain[:, ink]
            for column, one in enumerate((gain, gain * blocks.across, gain * blocks.along)):
                by.gain[..., ink, column] = one
            by.dot[..., ink] = blocks.dot[:, ink]
            for axis in range(2):
                by.planes[..., ink, axis] = -blocks.slopes[:, axis, ink]
        x *= scale
        start = np.zeros(layout.size)
        layout.parts(start).planes[...] = planes / layout.parts(scale).planes
        white_dn = np.array([[sensor.white_dn] for sensor in sensors])
        variance = (
            blocks.variance
            + residual_variance.contrast * blocks.texture
            + 4 * residual_variance.edge * blocks.steepness
        )
        variance = variance / blocks.pixels + EDGE_BIAS**2 * blocks.steepness
        variance = variance + (residual_variance.share_of(light, white_dn) * light) ** 2
        return cls(
            layout=layout,
            residual=blocks.residual,
            variance=variance,
            x=x,
            scale=scale,
            start=start,
            prior=prior,
        )

    def fit(self) -> Fit:
        """Estimate every nuisance parameter of the scan."""
        amounts, sd, robust, lost = self.solved()
        fitted = self.layout.parts(amounts * self.scale)
        return Fit(
            white=fitted.white + fitted.common,
            lamp=fitted.lamp,
            shape=fitted.shape,
            gain=fitted.gain,
            dot=fitted.dot,
            planes=fitted.planes,
            pulls=amounts / sd,
            determined_share=sd**2,
            spread=robust,
            lost=lost,
            prior=self.prior,
        )

    def free_gains(self) -> dict[int, float]:
        """Return the gain of each ink that is further off than on good prints, by its number; empty: none is.

        The prior of good prints holds gains back. Inks are freed of it one by one, the one first whose freedom explains
        most: that one ink is off is likelier than that several are, of which the same light may be a mixture.
        """

        def with_free(inks: tuple[int, ...]) -> tuple[float, NDArray[np.float64]]:
            free = self.freed(inks, FREE_GAIN / self.prior.gain)
            amounts = free.solved()[0]
            z = (self.residual - free.x @ amounts) / np.sqrt(self.variance)
            cost = TEMPER * np.minimum(z**2, FAR**2).sum() + (amounts**2).sum()
            return float(cost), self.layout.parts(amounts * free.scale).gain[:, 0]

        freed: tuple[int, ...] = ()
        cost, gains = with_free(freed)
        while len(freed) < INKS:
            tried = {ink: with_free((*freed, ink)) for ink in range(INKS) if ink not in freed}
            best = min(tried, key=lambda ink: tried[ink][0])
            if tried[best][0] > cost - BETTER:
                break
            freed, (cost, gains) = (*freed, best), tried[best]
        return {ink: float(gains[ink]) for ink in freed}

    def freed(self, inks: Sequence[int], times: float) -> NuisanceModel:
        """Return the model with priors of the gains of some inks that are so many times as wide."""
        wider = np.ones(self.layout.size)
        self.layout.parts(wider).gain[list(inks), 0] = times
        return replace(self, x=self.x * wider, scale=self.scale * wider, start=self.start / wider)

    def solved(self) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float]:
        """Return the amounts in prior standard deviations, their scatter, the spread and the share lost."""
        weight = TEMPER / self.variance
        robust = np.ones_like(weight)
        size = self.x.shape[-1]
        amounts, spread = self.start.copy(), 1.0
        unsure: NDArray[np.float64] = np.eye(size)
        for _ in range(ROUNDS):
            w = (weight * robust / max(spread, 1.0) ** 2).ravel()
            x = self.x.reshape(-1, size) * np.sqrt(w)[:, None]
            normal = x.T @ x + np.eye(
                size
            )  # a product with the transpose of the same matrix takes half the work
            rhs = x.T @ (np.sqrt(w) * self.residual.ravel()) + self.start
            unsure = np.asarray(np.linalg.inv(normal), np.float64)
            amounts = unsure @ rhs
            z = (self.residual - self.x @ amounts) / np.sqrt(self.variance)
            spread = float(np.median(np.abs(z)) / 0.6745)
            far = z / (FAR * max(spread, 1.0))
            robust = np.where(np.abs(far) < 1, (1 - far**2) ** 2, 0) + 1e-4
        # On good prints an estimate has the prior's variance less the posterior variance.
        sd = np.sqrt(np.maximum(1 - np.diag(unsure), 1e-4))
        self.layout.parts(sd).planes[...] = 1
        return amounts, sd, spread, float((robust < 0.01).mean())
