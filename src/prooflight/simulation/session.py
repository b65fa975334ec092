"""State of one press today: the parameters that a session's prints share, and the tables that are then true."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.camera.sensor import ROUNDING_DN2
from prooflight.kernels.prediction.lookup import NODE_STEP, NODES
from prooflight.kernels.simulation.inks import NOISE_STEPS, TRUE_NODES
from prooflight.rng import stream
from prooflight.simulation.halftone import dot_gain_factor
from prooflight.simulation.sheets import ColourWaves, SheetState, smooth_line
from prooflight.simulation.worlds import Amounts, World, amounts_of, world_named

if TYPE_CHECKING:
    from prooflight.pages.screen import Screen
    from prooflight.prediction.tables import SensorModel
    from prooflight.press.artefact import Press

LAMP_LENGTH: Final = 0.25
"""assumed: a lamp is a row of sources or a tube, uniform over a quarter of the field."""
_LAMP_KNOTS: Final = 33
_SOLID: Final = (NODES - 1) * NODE_STEP / 255 + 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorDay:
    """Deviation of one sensor today from its tables."""

    sigma_error: float
    """True temporal sigma over the table's. [-]"""
    table_gain: float
    """True signal over the table's, of every colour and of the backing. [-]"""
    table_shape: ColourWaves
    table_shape_sd: float
    """Standard deviation of the relative error of the table that is smooth in CMYK. [-]"""
    column_gain: NDArray[np.float64]
    """Residual (pixels,) of flat-fielding, 1 on average. [-]"""

    def shape_at(self, area: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the true signal over the table's of ink areas (..., 4) -> (...), besides ``table_gain`` [-]."""
        return 1 + self.table_shape_sd * self.table_shape.at(area)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Session:
    """State of one press on one day."""

    amounts: Amounts
    ink_gain: NDArray[np.float64]
    """Relative gain (4,) of each ink. [-]"""
    lamp: NDArray[np.float64]
    """Lamp's profile (pixels,) across, over the calibrated one. [-]"""
    sensors: tuple[SensorDay, ...]
    sheets: SheetState | None = None
    """What its sheets share; None: not of this world."""
    screen: Screen | None = None
    """Screen of its prints; None: pages are printed as they are."""
    dots: float = 1.0
    """Factor on dot gain, of a press that screens its pages: see ``dot_gain_factor``."""

    @classmethod
    def draw(cls, amounts: Amounts, press: Press, rng: np.random.Generator) -> Self:
        """Draw a day of ``press``; sensors share the lamp, and nothing else."""
        camera, pixels = amounts.camera, press.geometry.pixels
        low, high = np.log(camera.sigma_error)
        return cls(
            amounts=amounts,
            ink_gain=rng.standard_normal(4) * (amounts.ink.gain_session_percent / 100),
            lamp=1 + lamp_profile(pixels, rng) * (amounts.lamp.profile_percent / 100),
            sensors=tuple(
                SensorDay(
                    sigma_error=float(np.exp(rng.uniform(low, high))),
                    table_gain=float(1 + rng.standard_normal() * camera.table_gain_percent / 100),
                    table_shape=ColourWaves.draw(rng),
                    table_shape_sd=camera.table_shape_percent / 100,
                    column_gain=1 + rng.standard_normal(pixels) * (camera.column_gain_percent / 100),
                )
                for _ in press.sensors
            ),
            sheets=None if amounts.sheet is None else SheetState.draw(amounts.sheet, rng),
        ).printing(amounts.screen, press)

    def printing(self, screen: Screen | None, press: Press) -> Self:
        """Return the same day on which pages are printed by ``screen``; None: as they are."""
        dots = 1.0 if screen is None else dot_gain_factor(screen, press.ink_light)
        return replace(self, screen=screen, dots=dots)

    def plain(self, press: Press) -> dict[str, Any]:
        """Return the parameters for a person, in per cent; inks in the order C, M, Y, K."""
        return {
            "amounts": asdict(self.amounts),
            "ink_gain_percent": rounded(100 * self.ink_gain, 3),
            "lamp_percent": bounds_percent(self.lamp),
            "sensors": [
                {
                    "name": model.name,
                    "sigma_error": round(day.sigma_error, 4),
                    "table_gain_percent": round(100 * (day.table_gain - 1), 3),
                }
                for model, day in zip(press.sensors, self.sensors, strict=True)
            ],
        }


def session_of(press: Press, seed: int, world: str = "press") -> Session | None:
    """Return the day of a seed in a world; None: in the ideal one days are alike.

    It is the same object for every print in one process, so that its true tables are cached.
    """
    return None if world == "ideal" else _session_of(press, seed, world_named(world))


@lru_cache(maxsize=1)
def _session_of(press: Press, seed: int, world: World) -> Session:
    return Session.draw(amounts_of(press, world), press, stream(seed, "session"))


def rounded(values: NDArray[np.float64] | tuple[float, ...], digits: int) -> list[float]:
    """Return plain numbers, for a person."""
    return [round(float(value), digits) for value in values]


def bounds_percent(lamp: NDArray[np.float64]) -> list[float]:
    """Return least and greatest deviation from 1. [%]"""
    return rounded((100 * (lamp.min() - 1), 100 * (lamp.max() - 1)), 3)


def lamp_profile(pixels: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw a lamp's drift across, smooth over a quarter of the field, of standard deviation 1: (pixels,) [-]."""
    knots = smooth_line(_LAMP_KNOTS, pitch_mm=1 / (_LAMP_KNOTS - 1), length_mm=LAMP_LENGTH, rng=rng)
    return np.interp(np.linspace(0, _LAMP_KNOTS - 1, pixels), np.arange(_LAMP_KNOTS), knots)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueSensor:
    """Tables of one sensor as they are today, ready for ``kernels.scan_lines``."""

    model: SensorModel
    nodes: NDArray[np.float32]
    """Nodes (37^4, 2) at 0, 8/255, ..., 288/255 of each ink.

    They hold the light of bare columns [DN], and the relative variance of a halftone of unit contrast, the
    sum over inks of (d log light / d ink)^2 a (1 - a) [-]: light falls almost exponentially with ink, so that
    this lies on straight lines between nodes.
    """
    bends: NDArray[np.float32]
    """Curvature (4, 36) of light between nodes n and n + 1 of each ink. [-]

    The share f of the way counts as f + bend f (1 - f), as light is curved along that ink alone.
    """
    noise_dn2: NDArray[np.float32]
    """Temporal variance (1024,) before rounding at light 0 .. ``noise_top_dn``, at even steps. [DN^2]"""
    noise_top_dn: float
    columns: NDArray[np.float32]
    """Product (pixels,) of lamp, table gain and the residual of flat-fielding. [-]"""


@lru_cache(maxsize=2)
def true_sensors(session: Session, press: Press) -> tuple[TrueSensor, ...]:
    """Return the press's tables with the session's errors.

    They are cached, for they take a third of a second a sensor.
    """
    return tuple(
        _true_sensor(model, day, session) for model, day in zip(press.sensors, session.sensors, strict=True)
    )


def _true_sensor(model: SensorModel, day: SensorDay, session: Session) -> TrueSensor:
    axis = np.arange(TRUE_NODES, dtype=np.float64) * (NODE_STEP / 255)
    light = _exact_light(model) * (1 + day.table_shape_sd * day.table_shape.on_grid(axis))
    logarithm, texture = np.log(light.clip(min=1e-3)), np.zeros_like(light)
    for ink in range(4):
        # The node just beyond the solid stays negative, so that the line through it is 0 at the solid.
        open_area = np.where(axis <= _SOLID, axis * (1 - axis), 0.0).reshape(
            [-1 if i == ink else 1 for i in range(4)]
        )
        texture += np.gradient(logarithm, NODE_STEP / 255, axis=ink) ** 2 * open_area
    top = 1.25 * model.top_code_dn
    return TrueSensor(
        model=model,
        nodes=np.stack([light.ravel(), texture.ravel()], axis=1).astype(np.float32),
        bends=bends_of(light),
        noise_dn2=(noise_curve(model, top) * day.sigma_error**2).astype(np.float32),
        noise_top_dn=top,
        columns=(session.lamp * day.table_gain * day.column_gain).astype(np.float32),
    )


@lru_cache(maxsize=4)
def _exact_light(model: SensorModel) -> NDArray[np.float64]:
    """Return the light of bare columns without the session's errors, (37, 37, 37, 37): on every day the same."""
    return beyond_solid(exact_nodes(model.mean_dn.astype(np.float64)))


def exact_nodes(nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the exact values at the nodes of a table whose straight lines err evenly to both sides.

    It inverts ``commissioning.characterise.unbiased_nodes``, which takes a twelfth of the second difference
    off each node, by fixed-point iteration; axis by axis, in the opposite order.
    """
    exact = nodes
    for axis in reversed(range(nodes.ndim)):
        given, estimate = np.moveaxis(exact, axis, 0), np.moveaxis(exact, axis, 0).copy()
        for _ in range(4):
            second = np.diff(estimate, 2, axis=0) / 12
            estimate[1:-1] = given[1:-1] + second
            estimate[-1] = given[-1] + second[-1]
        exact = np.moveaxis(estimate, 0, axis)
    return np.ascontiguousarray(exact)


def bends_of(light: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return ``TrueSensor.bends`` of a table (37, 37, 37, 37), from each ink's ramp alone.

    Up to the solid the parabola through neighbouring nodes; beyond it the exponential of ``beyond_solid``.
    """
    bends = np.zeros((4, TRUE_NODES - 1), np.float32)
    for ink in range(4):
        ramp = np.moveaxis(light, ink, 0)[:, 0, 0, 0]
        tints = ramp[:NODES]
        second = np.pad(np.diff(tints, 2), 1, mode="edge")
        falling = np.minimum(np.diff(tints), -1e-3)  # an ink that takes no light has no curve either
        bends[ink, : NODES - 1] = (-(second[1:] + second[:-1]) / (4 * falling)).clip(-0.5, 0.5)
        ratio = (ramp[NODES:] / ramp[NODES - 1 : -1].clip(min=1e-3)).clip(0.25, 1)
        bends[ink, NODES - 1 :] = 4 / (1 + np.sqrt(ratio)) - 2
    return bends


def beyond_solid(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Extrapolate a table (33, 33, 33, 33) to 37 nodes an ink: its logarithm goes on as over its last step.

    More ink than a full solid makes a thicker film, whose density grows in proportion; ``PrintedInks`` does
    the same.
    """
    for ink in range(4):
        last, before = np.take(table, [-1], axis=ink), np.take(table, [-2], axis=ink)
        ratio = np.divide(last, before, out=np.ones_like(last), where=before > 0)
        further = [last * ratio**step for step in range(1, TRUE_NODES - NODES + 1)]
        table = np.concatenate([table, *further], axis=ink)
    return table


def noise_curve(model: SensorModel, top_dn: float) -> NDArray[np.float64]:
    """Return temporal variance before rounding as a function of light 0 .. top_dn, (1024,) [DN^2].

    A sensor's noise depends on its signal alone, so the variance table is one curve over the mean table: its
    average in bins of light, linear between them, with the dark variance at 0 and a straight line beyond
    white.
    """
    step = top_dn / (NOISE_STEPS - 1)
    place = np.rint(model.mean_dn.ravel() / step).astype(np.int64).clip(0, NOISE_STEPS - 1)
    count = np.bincount(place, minlength=NOISE_STEPS)
    mean = np.bincount(place, weights=model.mean_dn.ravel(), minlength=NOISE_STEPS)
    variance = np.bincount(place, weights=model.variance_dn2.ravel(), minlength=NOISE_STEPS)
    filled = count > 0
    at = np.concatenate([[0.0], mean[filled] / count[filled]])
    seen = np.concatenate([[model.dark_variance_dn2], variance[filled] / count[filled]])
    light = np.arange(NOISE_STEPS) * step
    curve = np.interp(light, at, seen)
    beyond = light > at[-1]
    curve[beyond] = seen[-1] + (light[beyond] - at[-1]) * (seen[-1] - seen[0]) / at[-1]
    return (curve - ROUNDING_DN2).clip(min=0)
