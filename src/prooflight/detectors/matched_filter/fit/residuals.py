"""A scan without what good prints do: residuals, how sure they are, and the small displacements that remained."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.detectors.base import LAMP_WAVES
from prooflight.kernels.memory import unset
from prooflight.kernels.residuals.flat_squares import flat_squares
from prooflight.kernels.residuals.residuals import (
    FittedAmounts,
    VarianceShares,
    foretell_anew,
    residuals,
    slope_sums,
    take_slopes,
    variances,
)
from prooflight.pages.parallel import parts_of, shared_out
from prooflight.prediction.printed import PrintedPage
from prooflight.scans.placement import Warp

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.nuisance import Fit, PlacedScan, ResidualVariance
    from prooflight.pages.raster import Page
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.placement import Placement

MOST_PLANE: Final = 1.75
"""Of the most that good planes are off: from each other they are off by up to twice that."""
LOCAL_PIXELS: Final = 16
LOCAL_SMOOTH: Final = 1.0
"""Tiles over which local displacements are smoothed (standard deviation)."""
LOCAL_SD: Final = 0.15
"""Of displacements that registration leaves. [pixels]"""
NEARER: Final = 0.7
"""Of such displacements, how much the page is placed anew by: an edge that is sharper than a pixel seems to have moved
by up to twice as much as it has. (of 0.7 and 1, on designs of their own)"""
FLAT_SIGMAS: Final = 2.0
"""Neighbours that differ by less are flat."""
LEAST_FLAT: Final = 500
"""Squares."""
PLAIN: Final = 0.02
"""Variance of a halftone, as a share of the noise's, up to which a square tells of noise ..."""
LEAST_PLAIN: Final = 0.05
"""... or so many of all squares, where fewer are so plain. [-]"""
NOISE_FACTORS: Final = (0.4, 2.6)
"""Bounds of true over stated variance: sigma is wrong by 0.67 to 1.5 (worlds.toml), and a little more."""


def residual_images(
    scan: PlacedScan,
    fit: Fit,
    light: NDArray[np.float32],
    *,
    residual_variance: ResidualVariance,
    threads: int = 1,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float64]]:
    """What the fit leaves, its inverse variance and the edges' share of that; and each sensor's noise factor.

    (sensors, lines, pixels) but for the last. light: ``PlacedScan.light``. threads: that share its lines out. Where the
    page lies off where it was predicted is in it (``local_moves``).

    The temporal noise is found in the scan itself: true and stated sigma differ by up to half.
    """
    seen, modes, sensors = scan.seen, scan.modes, scan.sensors
    lines, pixels = scan.where.inside.shape
    u = (np.arange(pixels) + 0.5) / pixels
    lamp = np.cos(np.pi * np.multiply.outer(u, np.arange(1, LAMP_WAVES + 1))) @ fit.lamp
    left = np.empty(seen.expected_dn.shape, np.float32)
    weight, of_edges = np.empty_like(left), np.empty_like(left)
    noise, bells = np.ones(len(sensors)), scan.colours.bells()
    inside = [scan.inside(index) for index in range(len(sensors))]
    gain, dot, planes = (amounts.astype(np.float32) for amounts in (fit.gain, fit.dot, fit.planes))
    fitted = [
        FittedAmounts(
            shape=scan.colours.weights(shape),
            columns=(white + lamp).astype(np.float32),
            gain=gain,
            dot=dot,
            planes=planes,
        )
        for shape, white in zip(fit.shape, fit.white, strict=True)
    ]

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

    def weighed(index: int, first: int, last: int) -> None:
        amounts = (
            noise[index],
            residual_variance.edge,
            residual_variance.contrast,
            residual_variance.share,
            residual_variance.dark,
            sensors[index].white_dn,
        )
        variances(
            light[index],
            seen.variance_dn2[index],
            modes.texture[index],
            inside[index],
            VarianceShares._make(map(np.float32, amounts)),
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
    shared_out([partial(weighed, *stripe) for stripe in stripes], threads=threads)
    return left, weight, of_edges, noise


def in_register(
    page: Page, planes_mm: NDArray[np.float64], *, good_mm: float
) -> tuple[Page | PrintedPage, NDArray[np.float64]]:
    """A page with its ink planes where registration found them, and what is left of their displacements (4, 2) [mm].

    By whole raster pixels, half of the camera's, and hardly further than planes of good prints lie apart, each of which
    is off by ``good_mm`` at most: what is left is small enough for the linear fit, and a misprint's plane stays one.
    """
    most_mm = MOST_PLANE * good_mm
    steps = np.rint(planes_mm.clip(-most_mm, most_mm) / page.pixel_mm).astype(np.int64)
    if not steps.any():
        return page, planes_mm
    return PrintedPage(page=page, planes=steps), planes_mm - steps * page.pixel_mm


def local_moves(
    left: NDArray[np.float32], weight: NDArray[np.float32], light: NDArray[np.float32], *, threads: int = 1
) -> NDArray[np.float32]:
    """The smooth field of small displacements that explains residuals best: how far right and down the light that was
    predicted would have to move, (2, rows, columns) at squares of ``LOCAL_PIXELS`` [pixels].
    """
    lines, pixels = left.shape[1:]
    side = LOCAL_PIXELS
    shape = (max(lines // side, 1), max(pixels // side, 1))
    sums = np.zeros((5, *shape), np.float32)

    def said(first: int, last: int) -> None:
        for index in range(len(light)):
            slope_sums(left[index], weight[index], light[index], side, first, last, sums)

    shared_out([partial(said, *part) for part in parts_of(shape[0], threads)], threads=threads)
    ax, ay, xx, yy, xy = (cv2.GaussianBlur(one, (0, 0), LOCAL_SMOOTH) for one in sums)
    known = 1 / LOCAL_SD**2
    xx, yy = xx + known, yy + known
    whole = xx * yy - xy * xy
    return -np.stack([(yy * ax - xy * ay) / whole, (xx * ay - xy * ax) / whole])


def take_moves(
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    light: NDArray[np.float32],
    moves: NDArray[np.float32],
    *,
    threads: int = 1,
) -> None:
    """Take displacements, as ``local_moves`` finds them, out of the residuals, in place and to first order."""
    lines, pixels = left.shape[1:]
    fields = [-cv2.resize(one, (pixels, lines), interpolation=cv2.INTER_LINEAR) for one in moves]

    def taken(first: int, last: int) -> None:
        for index in range(len(light)):
            take_slopes(left[index], weight[index], light[index], *fields, first, last)

    shared_out([partial(taken, *part) for part in parts_of(lines, threads)], threads=threads)


def by_prediction(
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    before_dn: NDArray[np.float32],
    after_dn: NDArray[np.float32],
    *,
    threads: int = 1,
) -> None:
    """Residuals by another prediction (sensors, lines, pixels) than before, in place; what was fitted stays."""

    def foretold(first: int, last: int) -> None:
        for index in range(len(left)):
            foretell_anew(left[index], weight[index], before_dn[index], after_dn[index], first, last)

    shared_out([partial(foretold, *part) for part in parts_of(left.shape[1], threads)], threads=threads)


def nearer(
    placement: Placement, moves: NDArray[np.float32], geometry: ScanGeometry, page_width_mm: float
) -> Placement:
    """The placement with ``NEARER`` of what residuals say (``local_moves``) that the page lies off it."""
    pitch_mm = np.array([geometry.pixel_pitch_mm, geometry.line_pitch_mm])
    middle, step_mm = (LOCAL_PIXELS - 1) / 2, LOCAL_PIXELS * float(pitch_mm.min())
    corner_mm = np.array([geometry.centres_x_mm(page_width_mm)[0], geometry.centres_y_mm(1)[0]])
    first_mm = corner_mm + middle * pitch_mm
    squares = np.array(moves.shape[:0:-1])
    count = np.ceil((squares - 1) * LOCAL_PIXELS * pitch_mm / step_mm).astype(np.int64) + 1
    x_mm, y_mm = np.meshgrid(*(step_mm * np.arange(n) for n in count))
    field = Warp(nodes_mm=np.moveaxis(moves, 0, -1), pitch_mm=LOCAL_PIXELS)
    nodes = np.stack(field.at(x_mm / pitch_mm[0], y_mm / pitch_mm[1]), axis=-1) * (NEARER * pitch_mm)
    if placement.warp is not None:
        nodes += np.stack(placement.warp.at(x_mm + first_mm[0], y_mm + first_mm[1]), axis=-1)
    first_x, first_y = first_mm.tolist()
    warp = Warp(nodes_mm=nodes.astype(np.float32), pitch_mm=step_mm, first_mm=(first_x, first_y))
    return replace(placement, warp=warp)


def noise_factor(
    left: NDArray[np.float32],
    variance: NDArray[np.float32],
    light: NDArray[np.float32],
    texture: NDArray[np.float32],
    inside: NDArray[np.bool_],
    residual_variance: ResidualVariance,
) -> float:
    """True temporal variance over the stated one, from second differences over squares of flat paper."""
    lines, pixels = left.shape
    found = unset((2, (lines // 2) * (pixels // 2)))
    count = flat_squares(left, variance, light, texture, inside, FLAT_SIGMAS, found)
    if count < LEAST_FLAT:
        return 1.0
    square, ratio = found[:, :count]
    ratio *= np.float32(residual_variance.contrast)
    plain = ratio <= PLAIN
    if np.count_nonzero(plain) < LEAST_PLAIN * count:
        plain = ratio <= float(np.quantile(ratio, LEAST_PLAIN))
    rest = float(ratio[plain].mean(dtype=np.float64))
    if rest > 1:
        return 1.0
    return float(np.clip(np.median(square[plain]) / 0.6745**2 - rest, *NOISE_FACTORS))
