"""Assembly of a press artefact from the estimates of a chart's scans."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from prooflight.camera.sensor import ROUNDING_DN2
from prooflight.commissioning.characterise import (
    CLEAR_SIGMA,
    STEPS,
    appearance_srgb,
    recipe_grid,
    srgb_bytes,
    unbiased_nodes,
)
from prooflight.commissioning.chart.edge_spread import footprint_of
from prooflight.commissioning.chart.scan import COLOUR
from prooflight.detectors.cost import RunningCosts
from prooflight.inks.built_in import built_in_inks
from prooflight.kernels.prediction.lookup import NODE_STEP, NODES
from prooflight.prediction.tables import ClippedShare, SensorModel, node_fractions
from prooflight.press.artefact import Press
from prooflight.press.blocks import IN_IDEAL, InspectionBlock
from prooflight.scans.geometry import ScanGeometry

if TYPE_CHECKING:
    from prooflight.commissioning.chart.dn_model import SignalModel
    from prooflight.commissioning.chart.joint_fit import JointFit
    from prooflight.commissioning.chart.patch_reading import ScanRead
    from prooflight.inks.chart_layout import Layout

_ROUNDS = 8
_OUTLIER = 4.0
_AREA_ERROR = 0.03  # assumed: how far a solid's ink may be from closed; a few per cent of gaps are grain too
_GRAIN_ERROR = 0.2  # assumed: relative error of the law of a halftone's grain, which hides the noise under it


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalNoise:
    """Temporal noise of one sensor."""

    constant_dn2: float
    """Variance at 0 DN, rounding included. [DN^2]"""
    gain_dn: float
    """Increase of variance for each digital number of signal. [DN]"""
    grain: float
    """Variance of halftone, over sum_i (d signal / d ink_i)^2 a_i (1 - a_i). [-]"""

    def variance_dn2(self, dn: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the temporal variance at digital numbers (...). [DN^2]"""
        return np.asarray(self.constant_dn2 + self.gain_dn * np.maximum(dn, 0.0), dtype=np.float64)


def fit_noise(
    dn: NDArray[np.float64],
    variance_dn2: NDArray[np.float64],
    halftone_dn2: NDArray[np.float64],
    inked_dn2: NDArray[np.float64],
    pixels: NDArray[np.float64],
) -> SignalNoise:
    """Fit the noise by weighted least squares with no term below 0; all arrays (patches,).

    halftone_dn2: sum over inks of (d signal / d ink)^2 a (1 - a); inked_dn2: the same sum without a (1 - a),
    over inks that are there.

    Weights come from the fitted variances (a sample variance of n pixels errs by sqrt(2 / n) of itself) and
    from how well the law of grain is known; outliers are left out in turn. The constant is at least that of
    rounding.
    """
    design = np.column_stack([np.ones_like(dn), np.maximum(dn, 0.0), halftone_dn2])
    used = np.ones(dn.size, dtype=bool)
    fitted = np.maximum(variance_dn2, ROUNDING_DN2)
    coarse = halftone_dn2 >= max(float(np.median(halftone_dn2)), 1e-12)
    grain = float(np.median(variance_dn2[coarse] / halftone_dn2[coarse])) if coarse.any() else 0.0
    terms = np.array([0.0, 0.0, grain])
    size = np.maximum(np.abs(design).max(axis=0), 1e-12)
    for _ in range(_ROUNDS):
        doubt = terms[2] * (_GRAIN_ERROR * halftone_dn2 + _AREA_ERROR * inked_dn2)
        error = np.hypot(fitted * np.sqrt(2 / np.maximum(pixels, 2)), doubt)
        weight = used / error
        terms = nnls(design / size * weight[:, None], variance_dn2 * weight)[0] / size
        fitted = np.maximum(design @ terms, ROUNDING_DN2)
        away = np.abs(variance_dn2 - fitted) / error
        used = away <= _OUTLIER * max(1.48 * float(np.median(away)), 1.0)
    return SignalNoise(
        constant_dn2=max(float(terms[0]), ROUNDING_DN2), gain_dn=float(terms[1]), grain=float(terms[2])
    )


SUPERSAMPLING: Final = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Learned:
    """Estimates from the scans of a chart."""

    scans: tuple[ScanRead, ...]
    fit: JointFit
    noise: tuple[SignalNoise, ...]
    """Noise of each sensor."""

    @property
    def white_dn(self) -> NDArray[np.float64]:
        """Return paper's signal in the middle of the field, mean of all scans (sensors,), with black level. [DN]"""
        return np.mean([scan.patches.white_dn for scan in self.scans], axis=0)

    @property
    def black_dn(self) -> NDArray[np.float64]:
        """Return the black level (sensors,). [DN]"""
        return self.fit.black * self.white_dn

    def sigma_dn(self, light: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the temporal noise of one pixel at light over paper's, both (n, sensors). [DN]"""
        dn = light * self.white_dn
        return np.sqrt(
            np.stack([noise.variance_dn2(seen) for noise, seen in zip(self.noise, dn.T, strict=True)], axis=1)
        )


def assemble_press(name: str, layout: Layout, learned: Learned, *, origin: Mapping[str, str]) -> Press:
    """Assemble a press; values that no scan gives are the defaults of a press file."""
    light = _light_at_nodes(learned.fit.model)
    sensors = tuple(_sensor_model(index, light[..., index], learned) for index in range(light.shape[-1]))
    return Press(
        name=name,
        geometry=_geometry(learned, layout),
        sensors=sensors,
        supersampling=SUPERSAMPLING,
        appearance_srgb=_appearance(learned),
        fringes=InspectionBlock().fringes,
        costs=RunningCosts(),
        good_pages_per_false_alarm=IN_IDEAL,
        origin=origin,
        ink_facts={"name": f"{len(learned.fit.model.cmyk)} patches", "model": learned.fit.model.name},
        clipped=tuple(_clipped(sensor) for sensor in sensors),
    )


def _light_at_nodes(model: SignalModel) -> NDArray[np.float64]:
    """Return the light of every node of the tables, (33, 33, 33, 33, sensors).

    The last node has the light of the solid itself.
    """
    axis = np.minimum(node_fractions(), 1.0)
    return np.stack([model.light(recipe_grid([cyan], axis, axis, axis)[0]) for cyan in axis])


def _nodes(exact: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return node values whose interpolation errs evenly (``unbiased_nodes``) and meets the solids.

    exact (33, 33, 33, 33): the last of each axis is that of byte 255; the node there, 256, lies on the line
    through it, for solids are measured, and nothing is known beyond them.
    """
    moved = unbiased_nodes(exact).astype(np.float64)
    for axis in range(exact.ndim):
        values, result = np.moveaxis(exact, axis, 0), np.moveaxis(moved, axis, 0)
        result[-1] += (values[-1] - values[-2]) / (NODE_STEP - 1)
        second = values[-1] - 2 * values[-2] + values[-3]
        result[-1] += second / 12  # what unbiased_nodes took off a node that now is none
    return moved.astype(np.float32)


def _sensor_model(index: int, light: NDArray[np.float64], learned: Learned) -> SensorModel:
    """Build one sensor's model for prediction; light (33, 33, 33, 33) over paper's."""
    white, black = float(learned.white_dn[index]), float(learned.black_dn[index])
    noise = learned.noise[index]
    columns = _column_light(index, learned)
    across, along = ([edge for scan in learned.scans for edge in scan.edges[index][axis]] for axis in (0, 1))
    backings = np.array([scan.patches.backing_dn[index] for scan in learned.scans])
    # Where no scan shows what lies beyond the page: assumed white, as a flatbed's lid is.
    backing = float(np.nanmean(backings)) if np.isfinite(backings).any() else white
    return SensorModel(
        name=learned.scans[0].sensors[index],
        mean_dn=_nodes(light * white - black),
        variance_dn2=_nodes(noise.variance_dn2(light * white)),
        footprint=footprint_of(across, along, _pitch_mm(learned)),
        column_offset_dn=np.full(columns.size, black, np.float32),
        column_gain=((white * columns - black) / (white - black)).astype(np.float32),
        dark_variance_dn2=float(noise.variance_dn2(np.array(black))),
        backing_dn=max(backing - black, 0.0),
        backing_variance_dn2=float(noise.variance_dn2(np.array(backing))),
        top_code_dn=max(scan.top_code_dn for scan in learned.scans),
    )


def _column_light(index: int, learned: Learned) -> NDArray[np.float64]:
    """Return paper's light in each column over the middle's, mean of all scans.

    Columns beyond the paper have the value at its edge.
    """
    gains = np.array([scan.patches.column_gain[index] for scan in learned.scans])
    seen = np.isfinite(gains)
    mean = np.where(seen, gains, 0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    seen_columns = np.flatnonzero(seen.any(axis=0))
    return np.interp(np.arange(mean.size), seen_columns, mean[seen_columns])


def _pitch_mm(learned: Learned) -> tuple[float, float]:
    """Return the pitches of columns and of lines, means of all scans. [mm]"""
    across, along = np.mean([scan.chart.pitch_mm for scan in learned.scans], axis=0).tolist()
    return across, along


def _geometry(learned: Learned, layout: Layout) -> ScanGeometry:
    """Return how the camera samples a page: pitches from the marks, lead-in and lead-out the means of all scans."""
    across, along = _pitch_mm(learned)
    corners = np.array([[x, y, 1.0] for x in (0, layout.width_mm) for y in (0, layout.height_mm)])
    ends = []
    for scan in learned.scans:
        line = corners @ scan.chart.to_pixel[1]
        ends.append((line.min() + 0.5, scan.lines - 0.5 - line.max()))
    lead_in, lead_out = np.maximum(np.mean(ends, axis=0), 0.0) * along
    return ScanGeometry(
        pixels=learned.scans[0].pixels,
        pixel_pitch_mm=across,
        line_pitch_mm=along,
        lead_in_mm=round(float(lead_in), 3),
        lead_out_mm=round(float(lead_out), 3),
    )


def _appearance(learned: Learned) -> NDArray[np.uint8]:
    """Return the appearance of recipes, for pictures: red, green and blue as measured, else the built-in inks."""
    if learned.scans[0].sensors != COLOUR:
        return appearance_srgb(built_in_inks())
    axis = np.linspace(0, 1, STEPS)
    return srgb_bytes(learned.fit.model.light(recipe_grid(axis, axis, axis, axis)))


def _clipped(sensor: SensorModel) -> ClippedShare:
    """Return the shares of nodes within four sigma of the ends of the range."""
    mean = sensor.mean_dn + float(sensor.column_offset_dn.mean())
    reach = CLEAR_SIGMA * np.sqrt(sensor.variance_dn2)
    assert mean.size == NODES**4
    return ClippedShare(
        black=float((mean - reach < 0).mean()), saturation=float((mean + reach > sensor.top_code_dn).mean())
    )
