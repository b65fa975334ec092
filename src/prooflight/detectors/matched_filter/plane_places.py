"""Places of ink planes that may lie further off than on good prints, from all edges of a page at once.

With g the darkening by an ink that is printed in its place, a plane that is displaced by d changes the light by
g(x) - g(x - d), for each ink alike, where inks hardly hide each other. The displacements of all planes are found
together by least squares (Gauss and Newton), beside the level of light and the gain of each ink, on images that are
blurred first much and then little: so the way to the place of a plane leads over none of its own strokes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.cmyk import INKS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.nuisance import PlacedScan

BAND: Final = 16
"""Lines that are used together ..."""
MARGIN: Final = 10
"""... lines beyond them that planes may come from, 2 mm: the greatest displacement of ``worlds.toml`` and a blur ..."""
STEP: Final = 128
"""... and lines from one band to the next. assumed: an eighth of a page's lines show where its planes are."""
BLURS: Final = (3.0, 3.0, 1.5, 1.5, 0.7)
"""Standard deviation of the blur in each step. [pixels]"""
MOST_STEP: Final = 1.5
"""Greatest change of a displacement in one step. [pixels]"""
SHARE: Final = 0.02
"""Standard deviation of the light beside its noise, as a share of it: tables and paper. assumed."""
TEMPER: Final = 1 / 64
"""Weight of a pixel: neighbours share what the model lacks. assumed: as the blocks of the fit, of 8 x 8 pixels."""
RIDGE: Final = 0.01
"""Weight of a scale of 1 beside what the page says of it. assumed."""
SCALES: Final = (0.5, 4.0)
"""Bounds of the darkening by an ink over its mode of gain. assumed: solid black has 2."""
PARTS: Final = 4
"""Parts of the bands whose places are compared."""
FREE: Final = 2.0
"""Standard deviation of displacements a priori. assumed: 0.4 mm, a quarter of the most in ``worlds.toml``. [pixels]"""


def planes_by_edges(
    placed: PlacedScan,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the displacement of each plane right and down of its place in the prediction, and its standard deviation.

    (4, 2) each; the latter is of noise, of what the mean of parts of the page differs by, and of the last step, which
    is large where no place was reached. [pixels]
    """
    lines = placed.where.inside.shape[0]
    starts = np.arange(0, max(lines - BAND - 2 * MARGIN, 0) + 1, STEP)
    rows = (starts[:, None] + np.arange(BAND + 2 * MARGIN)).ravel()
    rows = rows[rows < lines]
    used = (np.arange(rows.size) % (BAND + 2 * MARGIN) - MARGIN) // BAND == 0
    sensors = range(len(placed.sensors))
    white = [sensor.white_dn for sensor in placed.sensors]
    light = placed.light()[:, rows]
    off = np.stack([placed.measured_dn[at][rows] - placed.seen.expected_dn[at, rows] for at in sensors])
    seen = np.stack([placed.inside(at)[rows] for at in sensors])
    off = np.where(seen, off, 0).astype(np.float32)
    inks = [_darkening(placed, at, rows, seen[at], light[at]) for at in sensors]
    variance = (
        placed.seen.variance_dn2[:, rows]
        + (SHARE * np.maximum(light, 0.02 * np.array(white)[:, None, None])) ** 2
    )
    weight = TEMPER * (seen & used[:, None]) / variance
    part = np.arange(rows.size) // (BAND + 2 * MARGIN) % PARTS
    # Beforehand, planes are taken to lie within millimetres, and inks within tenths.
    own = np.concatenate([np.full(2 * INKS, FREE), np.full(INKS + len(white), 0.3)])
    planes, by_part, step = np.zeros((INKS, 2)), np.zeros((PARTS, INKS, 2)), np.zeros((INKS, 2))
    for blur in BLURS:
        normal, right = np.zeros((PARTS, own.size, own.size)), np.zeros((PARTS, own.size))
        for at in sensors:
            here = np.stack([cv2.GaussianBlur(one, (0, 0), blur) for one in inks[at]])
            there = [_moved(one, place) for one, place in zip(here, planes, strict=True)]
            left = cv2.GaussianBlur(off[at], (0, 0), blur) - (here - there).sum(axis=0)
            slopes = [
                cv2.Sobel(one, cv2.CV_32F, *way, ksize=1, scale=0.5)
                for one in there
                for way in ((1, 0), (0, 1))
            ]
            level = [light[at] if other == at else np.zeros_like(left) for other in sensors]
            effects = np.stack([*slopes, *(-one for one in there), *level])
            for k in range(PARTS):
                of_part = weight[at] * (part == k)[:, None] > 0
                x, w = effects[:, of_part].astype(np.float64), weight[at][of_part]
                normal[k] += (x * w) @ x.T
                right[k] += (x * w) @ left[of_part]
        pull = np.concatenate([planes.ravel(), np.zeros(INKS + len(white))]) / own**2
        step = _solved(normal.sum(axis=0), right.sum(axis=0), own, pull).clip(-MOST_STEP, MOST_STEP)
        by_part = np.array([_solved(*one, own, pull) for one in zip(normal, right, strict=True)]) - step
        planes = planes + step
    of_noise = np.linalg.inv(normal.sum(axis=0) + np.diag(1 / own**2)).diagonal()[: 2 * INKS].reshape(INKS, 2)
    of_parts = (by_part**2).sum(axis=0) / (PARTS * (PARTS - 1))
    return planes.clip(-MARGIN, MARGIN), np.sqrt(of_noise + of_parts + step**2)


def _solved(
    normal: NDArray[np.float64],
    right: NDArray[np.float64],
    own: NDArray[np.float64],
    pull: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the step of the planes, (4, 2), with priors of standard deviations ``own`` that pull them back."""
    step = np.linalg.solve(normal + np.diag(1 / own**2), right - pull)
    return np.asarray(step[: 2 * INKS].reshape(INKS, 2), np.float64)


def _darkening(
    placed: PlacedScan,
    sensor: int,
    rows: NDArray[np.intp],
    seen: NDArray[np.bool_],
    light: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return by how much each ink darkens what a sensor sees, (4, rows, pixels) [DN].

    A mode of gain is the slope at the amount that is printed, which is flatter than the way from bare paper to
    there. So modes are scaled to make up the page's darkness together, by least squares.
    """
    modes = np.where(seen, -placed.modes.gain[sensor][:, rows], 0).astype(np.float64)
    dark = np.where(seen, placed.sensors[sensor].white_dn - light, 0)
    flat = modes.reshape(INKS, -1)
    normal = flat @ flat.T
    own = np.diag(
        RIDGE * normal.diagonal() + 1e-9
    )  # of inks that always print together each has the same scale
    scale = np.linalg.solve(normal + own, flat @ dark.ravel() + own.sum(axis=1))
    return (modes * scale.clip(*SCALES)[:, None, None]).astype(np.float32)


def _moved(image: NDArray[np.float32], by: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return an image displaced to the right and down; what comes from beyond it is 0."""
    shift = np.array([[1, 0, by[0]], [0, 1, by[1]]])
    return np.asarray(cv2.warpAffine(image, shift, image.shape[::-1], flags=cv2.INTER_LINEAR), np.float32)


def of_most(planes: NDArray[np.float64], located: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return displacements (4, 2) from where most of the located planes (4, 2) lie; 0 for those that are not located.

    That is the plane to which the others are nearest. Of two planes it is the one that registration followed more.

    >>> of_most(np.array([[3.0, 0], [0, 0], [0.2, 0], [0, 0]]), np.array([[True] * 2] * 3 + [[False] * 2]))[:, 0]
    array([ 2.8, -0.2,  0. ,  0. ])
    """
    relative = np.zeros_like(planes)
    for axis in range(2):
        own = planes[located[:, axis], axis]
        if own.size:
            far = np.abs(own[:, None] - own).sum(axis=0) + 0.01 * np.abs(own)
            relative[located[:, axis], axis] = own - own[int(far.argmin())]
    return relative
