"""Joint fit of one ink model to all scans of a chart, with effects of each print and scan removed.

A print's inks are a little stronger at one side than at the other and stronger than another print's, and a
sensor's black level, which dims nothing, makes dark patches lighter where the lamp is weak. Each effect is a
small known shape times an unknown amount with a known usual size; patches are shuffled over the sheet, so
that none looks like a property of a recipe. Amounts are fitted to the model's residuals at left-out patches,
by least squares regularised towards zero, and the model again to the patches without them, in turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.commissioning.chart.dn_model import SignalModel

if TYPE_CHECKING:
    from prooflight.commissioning.chart.patch_reading import PatchReadings
    from prooflight.inks.chart_layout import PlacedRecipes

_TILT: Final = 0.01  # assumed: usual relative change of an ink from the middle to an edge of the sheet
_LEVEL: Final = 0.02  # assumed: the same of an ink, and of its tone value at 50 %, from print to print
_BLACK: Final = 0.02  # assumed: usual black level over paper's light
_ROUNDS: Final = 3
_OUTLIER: Final = 6.0  # robust standard deviations
_MISFIT: Final = 0.02  # assumed: root of light that no honest model is off by
_TRUSTED: Final = 2.0  # sigmas
_DARK: Final = 0.01  # below, a root's own error is as large as what black level does to it
_PAPER_VARIANCE: Final = 1e-2  # relative variance of bare paper, whose light is 1 by definition


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointFit:
    """Ink model, and every reading with its prediction; arrays over all readings of all scans (n,)."""

    model: SignalModel
    black: NDArray[np.float64]
    """Black level (sensors,) over paper's light where the column gain is 1. [-]"""
    scan: NDArray[np.int64]
    """Index (n,) of the scan."""
    recipe: NDArray[np.int64]
    """Index (n,) of the chart's recipe."""
    light: NDArray[np.float64]
    """Measured light (n, sensors), without effects of print and scan. [-]"""
    fitted: NDArray[np.float64]
    """Predicted light (n, sensors). [-]"""
    used: NDArray[np.bool_]
    """Whether each reading (n,) is used, not rejected as an outlier."""


def fit_jointly(readings: Sequence[PatchReadings], placed: PlacedRecipes) -> JointFit:
    """Fit the inks of a chart to the readings of all its scans."""
    recipe = np.concatenate([reading.recipe for reading in readings])
    scan = np.repeat(np.arange(len(readings)), [reading.recipe.size for reading in readings])
    light = np.concatenate([reading.light.T for reading in readings])
    variance = np.concatenate([reading.light_variance.T for reading in readings])
    gain = np.concatenate([reading.gain.T for reading in readings])
    centre = np.concatenate([reading.centre_mm for reading in readings])
    place = centre / (placed.layout.width_mm / 2, placed.layout.height_mm / 2) - 1
    recipes, which = np.unique(placed.cmyk[recipe], axis=0, return_inverse=True)
    root = np.sqrt(np.maximum(light, 1e-5))
    noise = (variance / (4 * np.maximum(light, 1e-3))).mean(axis=1)
    noise = 0.5 * (noise / max(float(np.median(noise)), 1e-30) + 1)
    used = np.ones(recipe.size, dtype=bool)
    own = np.zeros_like(root)
    theta = np.zeros(0)
    rows, mean, relative = _averaged(which, root, noise, used, recipes)
    model = SignalModel.fit(recipes[rows], mean**2, relative)
    for _ in range(_ROUNDS):
        predicted = np.full((len(recipes), root.shape[1]), np.nan)
        predicted[rows] = mean - model.left_out
        left = root - np.where(np.isfinite(predicted[which]), predicted[which], model.root(recipes)[which])
        shapes, usual = _shapes(model, recipes[which], root, place, gain, scan)
        used = _inliers(left - own, used)
        theta = _amounts(left, shapes, usual, noise, used)
        own = np.einsum("nsk,k->ns", shapes, theta)
        rows, mean, relative = _averaged(which, root - own, noise, used, recipes)
        if len(rows) == len(model.cmyk):
            model = model.refit(mean**2, relative)
        else:
            model = SignalModel.fit(recipes[rows], mean**2, relative)
    sensors = root.shape[1]
    return JointFit(
        model=model,
        black=theta[-sensors:],
        scan=scan,
        recipe=recipe,
        light=np.maximum(root - own, 0) ** 2,
        fitted=model.light(recipes)[which],
        used=used,
    )


def _averaged(
    which: NDArray[np.int64],
    root: NDArray[np.float64],
    noise: NDArray[np.float64],
    used: NDArray[np.bool_],
    recipes: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Average readings by recipe: recipes that were read, their mean root (m, sensors), its relative variance (m,)."""
    weight = np.where(used, 1 / noise, 0.0)
    total = np.bincount(which, weight, len(recipes))
    rows = np.flatnonzero(total > 0)
    summed = np.stack([np.bincount(which, weight * column, len(recipes)) for column in root.T], axis=1)
    mean = np.asarray(summed[rows] / total[rows, None], dtype=np.float64)
    relative = 1 / total[rows]
    paper = (recipes[rows] == 0).all(axis=1)
    mean[paper] = 1.0
    relative[paper] = _PAPER_VARIANCE * relative.min()
    return rows, mean, relative


def _shapes(
    model: SignalModel,
    cmyk: NDArray[np.float64],
    root: NDArray[np.float64],
    place: NDArray[np.float64],
    gain: NDArray[np.float64],
    scan: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the change of each reading's root with each amount, (n, sensors, amounts), and their usual sizes."""
    distinct, which = np.unique(cmyk, axis=0, return_inverse=True)
    slopes = model.root_slopes(distinct)[which]
    strength = slopes * cmyk[:, None, :]
    tone = slopes * (4 * cmyk * (1 - cmyk))[:, None, :]
    columns, usual = [], []
    scans = int(scan.max()) + 1
    for index in range(scans):
        here = (scan == index).astype(float)[:, None, None]
        for axis in (0, 1):
            columns.append(strength * here * place[:, axis, None, None])
            usual += [_TILT] * INKS
        if scans > 1:  # only what differs between prints: what they share is the inks'
            deviation = here - here.mean()
            columns += [strength * deviation, tone * deviation]
            usual += [_LEVEL] * (2 * INKS)
    sensors = root.shape[1]
    black = np.zeros((*root.shape, sensors))
    # About the mean of 1 / gain, so that it cannot pass for a property of dark recipes; the black level's own part in
    # hundred is left out thereby.
    deviation = 1 / gain - (1 / gain).mean(axis=0)
    for sensor in range(sensors):
        light = root[:, sensor] ** 2
        black[:, sensor, sensor] = (
            deviation[:, sensor] * (1 - light) / (2 * np.sqrt(np.maximum(light, _DARK)))
        )
    return np.concatenate([*columns, black], axis=2), np.array([*usual, *[_BLACK] * sensors])


def _inliers(left: NDArray[np.float64], used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Select readings that lie within six robust sigmas of the model in every sensor."""
    away = np.abs(left - np.median(left[used], axis=0))
    sigma = 1.48 * np.median(away[used], axis=0)
    return np.asarray((away <= np.maximum(_OUTLIER * sigma, _MISFIT)).all(axis=1))


def _amounts(
    left: NDArray[np.float64],
    shapes: NDArray[np.float64],
    usual: NDArray[np.float64],
    noise: NDArray[np.float64],
    used: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Fit the residuals by the shapes in least squares, each amount regularised towards zero by its usual size."""
    sigma = 1.48 * np.median(np.abs(left[used] / np.sqrt(noise[used])[:, None]), axis=0)
    error = np.maximum(sigma, 1e-6) * np.sqrt(noise)[:, None]
    flat = shapes.reshape(-1, shapes.shape[2])
    amounts = np.zeros(shapes.shape[2])
    for _ in range(_ROUNDS):
        # Huber's weights: at the corners of the ink cube left-out patches are off by more than their noise.
        away = np.abs(left.ravel() - flat @ amounts).reshape(left.shape) / error
        weight = np.where(used[:, None], 1 / error**2 / np.maximum(away / _TRUSTED, 1.0), 0.0)
        weighted = flat * weight.reshape(-1, 1)
        normal = weighted.T @ flat + np.diag(1 / usual**2)
        amounts[:] = np.linalg.solve(normal, weighted.T @ left.ravel())
    return np.asarray(amounts)
