"""Residuals of a scan, without the variation of good prints, and local displacements that they show.

The displacements are relative to the page's prediction, and are taken out of the residuals.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.base import LAMP_WAVES
from prooflight.kernels.memory import unset
from prooflight.kernels.residuals.local_moves import slope_sums, take_slopes
from prooflight.kernels.residuals.residuals import (
    FittedAmounts,
    VarianceShares,
    flat_squares,
    predict_again,
    residuals,
    variances,
)
from prooflight.pages.parallel import parts_of, shared_out
from prooflight.pages.planes import PARTS, displaced_by_parts
from prooflight.prediction.printed import PrintedPage
from prooflight.scans.placement import Placement, Warp

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.fit.nuisance import Colours, Fit, PlacedScan, ResidualVariance
    from prooflight.pages.pdf.area_averages import InkLight
    from prooflight.pages.raster import Page
    from prooflight.scans.geometry import ScanGeometry

MOST_PLANE: Final = 1.75
"""Maximum displacement of planes, relative to good planes' maximum: from each other these are off by up to
twice that."""
FLAT_SIGMAS: Final = 2.0
"""Neighbours that differ by fewer standard deviations are flat."""
LEAST_FLAT: Final = 500
"""Minimum number of flat squares."""
PLAIN: Final = 0.02
"""Variance of a halftone, as a share of the noise's, up to which a square is used to measure noise."""
LEAST_PLAIN: Final = 0.05
"""Share of all squares, the plainest, that are used where fewer are so plain. [-]"""
MEDIAN_BITS: Final = 19
"""Last bits of a number that its step leaves out: a sixteenth of an octave."""
NOISE_FACTORS: Final = (0.4, 2.6)
"""Bounds of true over stated variance: sigma is wrong by a factor of 0.67 to 1.5 (worlds.toml), plus a
margin."""


def residual_images(
    scan: PlacedScan,
    fit: Fit,
    light: NDArray[np.float32],
    *,
    residual_variance: ResidualVariance,
    threads: int = 1,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float64]]:
    """Return residuals, their inverse variance, the edges' share of that, and each sensor's noise factor.

    Local displacements of the page relative to its prediction (``moves``) are not removed yet. The temporal
    noise is estimated from the scan itself, because true and stated sigma differ by up to half.

    Parameters
    ----------
    scan : the scan at its page's placement.
    fit : its nuisance parameters.
    light : ``PlacedScan.light`` [DN].
    residual_variance : variance of good prints in addition to the fit.
    threads : number of threads that share the lines.

    Returns
    -------
    residuals : (sensors, lines, pixels) [DN].
    weight : (sensors, lines, pixels) inverse variance of residuals [1/DN^2].
    of_edges : (sensors, lines, pixels) the edges' share of that.
    noise : (sensors,) true temporal variance over the stated one [-].
    """
    seen, modes, sensors = scan.seen, scan.modes, scan.sensors
    lines = len(scan.where.inside)
    left, weight, of_edges = (unset(seen.expected_dn.shape) for _ in range(3))
    noise, bells = np.ones(len(sensors)), scan.colours.bells()
    inside = [scan.inside(index) for index in range(len(sensors))]
    fitted = fitted_amounts(fit, scan.colours, scan.where.inside.shape[1])

    def taken(index: int, first: int, last: int) -> None:
        residuals(
            scan.measured_dn[index],
            seen.expected_dn[index],
            sensors[index].column_offset_dn,
            inside[index],
            modes.inks(index),
            bells,
            fitted[index],
            first,
            last,
            left[index],
        )

    def weighted(index: int, first: int, last: int) -> None:
        variances(
            light[index],
            seen.variance_dn2[index],
            modes.texture[index],
            inside[index],
            variance_shares(residual_variance, noise[index], sensors[index].white_dn),
            first,
            last,
            weight[index],
            of_edges[index],
        )

    stripes = [(index, *part) for index in range(len(sensors)) for part in parts_of(lines, threads)]
    shared_out([partial(taken, *stripe) for stripe in stripes], threads=threads)
    noise[:] = shared_out(
        [
            partial(
                noise_factor,
                left[index],
                seen.variance_dn2[index],
                light[index],
                modes.texture[index],
                inside[index],
                residual_variance,
            )
            for index in range(len(sensors))
        ],
        threads=threads,
    )
    shared_out([partial(weighted, *stripe) for stripe in stripes], threads=threads)
    return left, weight, of_edges, noise


def fitted_amounts(fit: Fit, colours: Colours, pixels: int) -> list[FittedAmounts]:
    """Return a fit's amounts as kernels take them, for each sensor; pixels: of a line."""
    u = (np.arange(pixels) + 0.5) / pixels
    lamp = np.cos(np.pi * np.multiply.outer(u, np.arange(1, LAMP_WAVES + 1))) @ fit.lamp
    gain, dot, planes = (amounts.astype(np.float32) for amounts in (fit.gain, fit.dot, fit.planes))
    return [
        FittedAmounts(
            shape=colours.weights(shape),
            columns=(white + lamp).astype(np.float32),
            gain=gain,
            dot=dot,
            planes=planes,
        )
        for shape, white in zip(fit.shape, fit.white, strict=True)
    ]


def variance_shares(residual_variance: ResidualVariance, noise: float, white_dn: float) -> VarianceShares:
    """Return the coefficients of a sensor's variance as kernels take them; noise: its factor."""
    of = residual_variance
    amounts = noise, of.edge, of.contrast, of.share, of.dark, white_dn
    return VarianceShares._make(map(np.float32, amounts))


def most_steps(page: Page, *, good_mm: float) -> int:
    """Return the maximum number of raster pixels by which ``in_register`` shifts planes; at least 1."""
    return max(math.ceil(MOST_PLANE * good_mm / page.pixel_mm), 1)


def in_register(
    page: Page, planes_mm: NDArray[np.float64], *, good_mm: float, light: InkLight | None = None
) -> tuple[Page | PrintedPage, NDArray[np.float64]]:
    """Shift a page's ink planes to where registration found them.

    The remaining displacements (4, 2) [mm] are returned as well.

    Planes are shifted by whole raster pixels, half of the camera's, and hardly further than planes of good
    prints are separated, each of which is off by ``good_mm`` at most: the remainder is small enough for the
    linear fit, and a misprint's displaced plane is still found. Planes of a press that rips pages itself lie between
    raster pixels: with the light that its inks take, they are shifted by parts of a pixel.
    """
    most_mm = MOST_PLANE * good_mm
    if light is not None:
        part_mm = page.pixel_mm / PARTS
        parts = np.rint(planes_mm.clip(-most_mm, most_mm) / part_mm).astype(np.int64)
        return displaced_by_parts(page, parts, light), planes_mm - parts * part_mm
    steps = np.rint(planes_mm.clip(-most_mm, most_mm) / page.pixel_mm).astype(np.int64)
    if not steps.any():
        return page, planes_mm
    return PrintedPage(page=page, planes=steps), planes_mm - steps * page.pixel_mm


def noise_factor(
    left: NDArray[np.float32],
    variance: NDArray[np.float32],
    light: NDArray[np.float32],
    texture: NDArray[np.float32],
    inside: NDArray[np.bool_],
    residual_variance: ResidualVariance,
) -> float:
    """Return true over stated temporal variance, from second differences over squares of flat paper."""
    lines, pixels = left.shape
    flat = unset((2, (lines // 2) * (pixels // 2)))
    count = flat_squares(left, variance, light, texture, inside, FLAT_SIGMAS, flat)
    return noise_of(flat[:, :count], residual_variance)


def noise_of(flat: NDArray[np.float32], residual_variance: ResidualVariance) -> float:
    """Return true over stated temporal variance from flat squares (2, squares), as ``flat_squares`` gives them."""
    count = flat.shape[1]
    if count < LEAST_FLAT:
        return 1.0
    square, ratio = flat
    ratio *= np.float32(residual_variance.contrast)
    plain = ratio <= PLAIN
    if np.count_nonzero(plain) < LEAST_PLAIN * count:
        plain = ratio <= float(np.quantile(ratio, LEAST_PLAIN))
    rest = float(ratio[plain].mean(dtype=np.float64))
    if rest > 1:
        return 1.0
    return float(np.clip(median_of(square[plain]) / 0.6745**2 - rest, *NOISE_FACTORS))


def median_of(values: NDArray[np.float32]) -> float:
    """Return the median of numbers (n,) of at least 0, in a third of the time that ``np.median`` takes.

    The first bits of such numbers are in their order: only those are sorted that have the same as the middle.
    """
    middle = (values.size - 1) // 2, values.size // 2
    steps = values.view(np.int32) >> MEDIAN_BITS
    ends = np.cumsum(np.bincount(steps))
    first, last = np.searchsorted(ends, middle, side="right")
    near = np.sort(values[(steps >= first) & (steps <= last)])
    before = ends[first - 1] if first else 0
    return float(near[middle[0] - before : middle[1] - before + 1].mean())


LOCAL_PIXELS: Final = 16
LOCAL_SMOOTH: Final = 1.0
"""Standard deviation of the Gaussian that smooths local displacements. [tiles]"""
LOCAL_SD: Final = 0.15
"""Standard deviation of the displacements that registration leaves. [pixels]"""
CORRECTED_SHARE: Final = 0.7
"""Share of an estimated displacement by which the placement is corrected: an edge that is sharper than a
pixel seems to have moved by up to twice its true displacement. (chosen from 0.7 and 1, on designs of their
own)"""


def local_moves(
    left: NDArray[np.float32], weight: NDArray[np.float32], light: NDArray[np.float32], *, threads: int = 1
) -> NDArray[np.float32]:
    """Return the smooth field of small displacements that explains residuals best.

    That is how far right and down the predicted light would have to move: (2, rows, columns), at squares of
    ``LOCAL_PIXELS``. [pixels]
    """
    lines, pixels = left.shape[1:]
    side = LOCAL_PIXELS
    shape = tile_shape(lines, pixels)
    sums = np.zeros((5, *shape), np.float32)

    def add_sums(first: int, last: int) -> None:
        for index in range(len(light)):
            slope_sums(left[index], weight[index], light[index], side, first, last, sums)

    shared_out([partial(add_sums, *part) for part in parts_of(shape[0], threads)], threads=threads)
    return moves_of(sums)


def tile_shape(lines: int, pixels: int) -> tuple[int, int]:
    """Return rows and columns of the squares of ``local_moves``."""
    return max(lines // LOCAL_PIXELS, 1), max(pixels // LOCAL_PIXELS, 1)


def moves_of(sums: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return ``local_moves`` from the sums of all sensors, (5, rows, columns) as ``slope_sums`` gives them."""
    ax, ay, xx, yy, xy = (cv2.GaussianBlur(one, (0, 0), LOCAL_SMOOTH) for one in sums)
    prior_information = 1 / LOCAL_SD**2
    xx, yy = xx + prior_information, yy + prior_information
    whole = xx * yy - xy * xy
    return np.stack([(xy * ay - yy * ax) / whole, (xy * ax - xx * ay) / whole])


def take_moves(
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    light: NDArray[np.float32],
    moves: NDArray[np.float32],
    *,
    threads: int = 1,
) -> None:
    """Remove displacements by ``local_moves`` from the residuals, in place and to first order."""
    lines, pixels = left.shape[1:]
    fields = [cv2.resize(one, (pixels, len(one)), interpolation=cv2.INTER_LINEAR) for one in moves]
    stripes = [(index, part) for index in range(len(left)) for part in parts_of(lines, threads)]
    shared_out(
        [partial(take_slopes, left[i], weight[i], light[i], *fields, *part) for i, part in stripes],
        threads=threads,
    )


def by_prediction(
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    before_dn: NDArray[np.float32],
    after_dn: NDArray[np.float32],
    *,
    threads: int = 1,
) -> None:
    """Change residuals to another prediction (sensors, lines, pixels), in place; fitted amounts stay."""
    stripes = [(index, part) for index in range(len(left)) for part in parts_of(left.shape[1], threads)]
    shared_out(
        [partial(predict_again, left[i], weight[i], before_dn[i], after_dn[i], *part) for i, part in stripes],
        threads=threads,
    )


def corrected(
    placement: Placement, moves: NDArray[np.float32], geometry: ScanGeometry, page_width_mm: float
) -> Placement:
    """Return the placement, corrected by ``CORRECTED_SHARE`` of the ``local_moves``."""
    pitch_mm = np.array([geometry.pixel_pitch_mm, geometry.line_pitch_mm])
    middle, step_mm = (LOCAL_PIXELS - 1) / 2, LOCAL_PIXELS * float(pitch_mm.min())
    corner_mm = np.array([geometry.centres_x_mm(page_width_mm)[0], geometry.centres_y_mm(1)[0]])
    first_mm = corner_mm + middle * pitch_mm
    squares = np.array(moves.shape[:0:-1])
    count = np.ceil((squares - 1) * LOCAL_PIXELS * pitch_mm / step_mm).astype(np.int64) + 1
    x_mm, y_mm = np.meshgrid(*(step_mm * np.arange(n) for n in count))
    field = Warp(nodes_mm=np.moveaxis(moves, 0, -1), pitch_mm=LOCAL_PIXELS)
    nodes = np.stack(field.at(x_mm / pitch_mm[0], y_mm / pitch_mm[1]), axis=-1) * (CORRECTED_SHARE * pitch_mm)
    if placement.warp is not None:
        nodes += np.stack(placement.warp.at(x_mm + first_mm[0], y_mm + first_mm[1]), axis=-1)
    first_x, first_y = first_mm.tolist()
    warp = Warp(nodes_mm=nodes.astype(np.float32), pitch_mm=step_mm, first_mm=(first_x, first_y))
    return replace(placement, warp=warp)
