"""Variation of a press's good prints, measured on its own pages, in terms of a press file's ``[variation]``.

An amount whose prior has the standard deviation 1 and of which a page determines the share r (1 - posterior
variance over prior) is fitted as m = r (x + e), where x is its true value and e has the variance (1 - r) / r.
So the mean of m^2 is r^2 s^2 + r (1 - r), where s is the standard deviation of x: s^2 = (sum m^2 - sum r (1 -
r)) / sum r^2. Amounts with noise of their own (paper, flicker) are measured on two interleaved halves, whose
covariance is free of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from prooflight.cmyk import INK_NAMES
from prooflight.detectors.base import PrintState
from prooflight.detectors.matched_filter.fit.nuisance import COLOUR_LENGTH, Fit, FitLayout, FitParts
from prooflight.detectors.matched_filter.statistics.local_evidence import COLUMN_MM, FLAT

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.analysis import ScanAnalysis
    from prooflight.detectors.matched_filter.design import PreparedPage
    from prooflight.prediction.tables import SensorModel

AMOUNTS: Final[tuple[tuple[str, ...], ...]] = (
    ("page.shift_mm",),
    ("page.skew_deg",),
    ("page.scale_percent",),
    ("page.warp_across_um",),
    ("page.warp_along_um",),
    ("register.plane_um",),
    ("ink.gain_session_percent", "ink.gain_print_percent"),
    ("ink.gain_tilt_percent",),
    ("ink.dot_gain_percent",),
    ("paper.white_percent",),
    ("paper.white_channel_percent", "camera.table_gain_percent", "camera.table_shape_percent"),
    ("paper.cloudiness_percent",),
    ("lamp.profile_percent", "lamp.profile_print_percent"),
    ("lamp.flicker_percent",),
    ("camera.column_gain_percent",),
    ("camera.sigma_error",),
)
"""Amounts that a page determines; several together if pages of one session cannot separate them."""
UNTOLD: Final = {
    "register.plane_clip_um": "a limit, which few planes reach",
    "ink.halftone_contrast": "within single pixels, where the camera's noise hides it",
    "paper.specks_per_page": "too small to be distinguished from noise individually",
    "paper.specks_ink_percent": "as specks_per_page",
    "paper.specks_diameter_mm": "as specks_per_page",
}
"""Amounts of ``[variation]`` that are not estimated, and why."""
EVEN: Final = 3.0
"""a^2 over the variance of a uniform distribution between -a and a."""
LEAST_SHARE: Final = 0.3
"""Minimum share of an amount that a page must determine to count."""
BARE: Final = 0.005
"""Ink area up to which a tile is bare paper."""
BOX: Final = 4
"""Side of the boxes whose light shows clouds: 2 mm, finer than any cloud. [tiles]"""
FEWEST: Final = 60
"""Minimum number of bare places on a page from which its paper is measured."""
WIDEST: Final = 16.0
"""Limit of a page's square, relative to the median of pages: on Gaussian amounts it removes 1 %."""
NORMAL: Final = 1.4826
"""Standard deviation over median absolute deviation."""
LEAST_DETERMINED: Final = 0.4
"""Minimum share of an ink's amount that the page determines, instead of the prior, for it to count."""


def page_variation(prepared: PreparedPage, analysis: ScanAnalysis) -> NDArray[np.float32]:
    """Return each amount's square on this page, in units of ``[variation]``, and its weight: (AMOUNTS, 2).

    The weight is 0 if the page does not determine the amount. A square may be below 0, because noise has been
    subtracted.
    """
    by_name: dict[str, tuple[float, float]] = {}
    by_name |= _of_place(analysis)
    by_name |= _of_fit(prepared, analysis)
    by_name |= _of_light(prepared, analysis)
    rows = [by_name.get(names[0], (0.0, 0.0)) for names in AMOUNTS]
    table = np.array(rows, np.float32)
    table[~np.isfinite(table).all(axis=1)] = 0
    return table


def _of_place(analysis: ScanAnalysis) -> dict[str, tuple[float, float]]:
    """Return the amounts of placement and register."""
    registered, place = analysis.registration, analysis.registration.placement
    if not registered.located:
        return {}
    result = {
        "page.shift_mm": (EVEN * _square(place.shift_mm), 1.0),
        "page.skew_deg": (EVEN * _square(place.skew_deg), 1.0),
        "page.scale_percent": (EVEN * _square(place.stretch_percent), 1.0),
    }
    if place.warp is not None:
        across, along = np.moveaxis(1e3 * place.warp.nodes_mm.astype(np.float64), -1, 0)
        result |= {"page.warp_across_um": (_square(across), 1.0), "page.warp_along_um": (_square(along), 1.0)}
    squares, shares = [], []
    for axis, parts in enumerate(registered.plane_parts):
        # Planes are displaced from their weighted mean, which is the page's registered place.
        part = parts / max(float(parts.sum()), 1e-9)
        share = 1 - 2 * part + (part**2).sum()
        seen = (part > 0) & (share > LEAST_SHARE)
        squares += ((1e3 * registered.planes_mm[seen, axis]) ** 2).tolist()
        shares += share[seen].tolist()
    if shares:
        result["register.plane_um"] = sum(squares) / sum(shares), sum(shares)
    return result


def _of_fit(prepared: PreparedPage, analysis: ScanAnalysis) -> dict[str, tuple[float, float]]:
    """Return the amounts of inks, lamp and light as a whole."""
    fit, prior = analysis.fit, analysis.fit.prior
    layout = FitLayout(sensors=fit.white.size, colours=fit.shape.shape[1])
    share, amounts = (
        layout.parts(fit.determined_share),
        layout.parts(fit.pulls * np.sqrt(fit.determined_share)),
    )

    def square(
        of: FitParts, shares: FitParts, name: str, sd: float, *, at: int | slice | None = None
    ) -> tuple[float, float]:
        m, r = (getattr(one, name) for one in (of, shares))
        m, r = (m, r) if at is None else (m[:, at], r[:, at])
        sufficient = r > LEAST_SHARE
        if not sufficient.any():
            return 0.0, 0.0
        m, r = m[sufficient], r[sufficient]
        weight = float((r**2).sum())
        return (100 * sd) ** 2 * float((m**2 - r * (1 - r)).sum()) / weight, weight

    # Signal of bare paper, where a table's errors of gain and of shape cannot be distinguished.
    bare = prepared.colours.root @ np.exp(-((prepared.colours.centres / COLOUR_LENGTH) ** 2).sum(axis=1))
    paper = 100 * (fit.white + prior.shape * (fit.shape @ bare))
    result = {
        "ink.gain_session_percent": square(amounts, share, "gain", prior.gain, at=0),
        "ink.gain_tilt_percent": square(amounts, share, "gain", prior.tilt, at=slice(1, 3)),
        "ink.dot_gain_percent": square(amounts, share, "dot", prior.dot),
        "lamp.profile_percent": square(amounts, share, "lamp", prior.lamp),
        "camera.sigma_error": (EVEN * _square(np.log(analysis.noise) / 2), 1.0),
    }
    if paper.size > 1:
        variance = float(paper.var(ddof=1))
        result["paper.white_channel_percent"] = variance, 1.0
        result["paper.white_percent"] = float(paper.mean() ** 2) - variance / paper.size, 1.0
    return result


def _of_light(prepared: PreparedPage, analysis: ScanAnalysis) -> dict[str, tuple[float, float]]:
    """Return the amounts of places, lines and columns of bare paper."""
    sums, geometry = analysis.sums, prepared.landmarks.geometry
    push, power, _, edges = sums.tiles[:, 0].astype(np.float64)
    bare = (sums.cover.sum(axis=0) < BARE) & (edges <= FLAT * power) & (power > 1)
    push, power = push * bare, power * bare
    result: dict[str, tuple[float, float]] = {}
    lines = max(round(sums.tile_mm / geometry.line_pitch_mm), 1)
    wide = round(COLUMN_MM / sums.tile_mm) | 1
    halves = [(push[:, at::2].sum(axis=1), power[:, at::2].sum(axis=1)) for at in (0, 1)]
    rows = np.minimum(halves[0][1], halves[1][1]) > 0.2 * max(float(power.sum(axis=1).max()) / 2, 1)
    flicker = 0.0
    if rows.sum() > FEWEST:
        levels = [_rough(n / np.maximum(d, 1e-9), rows, wide)[rows] for n, d in halves]
        flicker = _shared(*levels) * wide / (wide - 1)
        result["lamp.flicker_percent"] = 1e4 * lines * flicker, 1.0
    down, across = (extent // BOX for extent in push.shape)
    chess = np.add.outer(np.arange(push.shape[0]), np.arange(push.shape[1])) % 2
    parts = []
    for colour in (0, 1):
        cut = np.stack([push, power])[:, : down * BOX, : across * BOX] * (
            chess[: down * BOX, : across * BOX] == colour
        )
        parts.append(cut.reshape(2, down, BOX, across, BOX).sum(axis=(2, 4)))
    whole = bare[: down * BOX, : across * BOX].reshape(down, BOX, across, BOX).all(axis=(1, 3))
    if whole.sum() > FEWEST:
        clouds = _shared(*(n[whole] / d[whole] for n, d in parts)) - flicker / BOX
        result["paper.cloudiness_percent"] = 1e4 * clouds, 1.0
    gains, sensors = sums.column_gains.astype(np.float64), len(sums.column_gains)
    information = sums.columns[1, 0].sum(axis=0).astype(np.float64) / sensors
    seen = information > 0.5 * information.max()
    if seen.sum() > FEWEST:
        bins = max(round(sums.pixel_mm / geometry.pixel_pitch_mm), 1)
        wide = round(COLUMN_MM / sums.pixel_mm) | 1
        share = float(np.median(information[seen] / (information[seen] + sums.prior.column**-2)))
        scatter = (NORMAL * np.median(np.abs(gains[:, seen]))) ** 2 / share**2 * wide / (wide - 1)
        result["camera.column_gain_percent"] = (
            1e4 * bins * (scatter - 1 / float(np.median(information[seen]))),
            1.0,
        )
    return result


def _square(values: object) -> float:
    return float(np.mean(np.asarray(values, np.float64) ** 2))


def _rough(level: NDArray[np.float64], valid: NDArray[np.bool_], wide: int) -> NDArray[np.float64]:
    """Return the part of a level that is not smooth over ``wide`` places."""
    smooth, share = (
        ndimage.uniform_filter1d(one, wide, mode="nearest")
        for one in (level * valid, valid.astype(np.float64))
    )
    return np.asarray(level - smooth / np.maximum(share, 1e-9))


def _shared(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return the covariance of two measurements.

    It is a quarter of their sum's variance less their difference's, robust.
    """
    plus, minus = one + other, one - other
    spread = [NORMAL * float(np.median(np.abs(both - np.median(both)))) for both in (plus, minus)]
    return (spread[0] ** 2 - spread[1] ** 2) / 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Learned:
    """One amount of ``[variation]``, or several combined, as estimated from good pages."""

    names: tuple[str, ...]
    value: float
    """Value in the unit of ``names``; for ``sigma_error``, the greatest factor."""
    low: float
    """Lower end of the 90 % interval for independent pages; amounts of a session are drawn only once."""
    high: float
    pages: int


def learned_amounts(pages: NDArray[np.floating]) -> list[Learned]:
    """Estimate amounts from ``page_variation`` of pages, (pages, AMOUNTS, 2).

    Those that no page determines are omitted.
    """
    result = []
    for index, names in enumerate(AMOUNTS):
        squares, weights = np.asarray(pages, np.float64)[:, index].T
        measured = weights > 0
        if measured.sum() < 2:
            continue
        squares, weights = squares[measured], weights[measured] / weights[measured].sum()
        most = WIDEST * float(np.median(np.abs(squares)))
        squares = squares.clip(-most, most)
        mean = float(weights @ squares)
        error = 1.645 * float(np.sqrt((weights**2) @ (squares - mean) ** 2))
        value, low, high = np.sqrt(np.maximum([mean, mean - error, mean + error], 0)).tolist()
        if names[0] == "camera.sigma_error":
            value, low, high = (float(np.exp(one)) for one in (value, low, high))
        result.append(Learned(names=names, value=value, low=low, high=high, pages=int(measured.sum())))
    return result


def print_state(
    analysis: ScanAnalysis, sensors: Sequence[SensorModel], far: Callable[[], Mapping[str, float]] = dict
) -> PrintState:
    """Return the print state of one scan; far: returns the amounts that are further off than the fit follows."""
    excess, light = analysis.sums.columns[:2, 0]
    amounts = fitted_amounts(analysis, sensors) | dict(far())
    return PrintState(amounts=amounts, excess=excess, light=light, pitch_mm=analysis.sums.pixel_mm)


def fitted_amounts(analysis: ScanAnalysis, sensors: Sequence[SensorModel]) -> dict[str, float]:
    """Return the fitted amounts of lamp, paper, inks and register, by channel."""
    fit, values = analysis.fit, {}
    for sensor, white in zip(sensors, fit.white, strict=True):
        values[f"light-{sensor.name}"] = float(white)
    values |= {f"lamp-{k}": float(one) for k, one in enumerate(fit.lamp, start=1)}
    shares = determined_shares(fit)
    for ink, name in enumerate(INK_NAMES):
        if shares[ink] >= LEAST_DETERMINED:
            values[f"gain-{name}"] = float(fit.gain[ink, 0] / shares[ink])
        if analysis.registration.plane_parts[:, ink].min() > 0:
            for axis, letter in enumerate("xy"):
                values[f"register-{name}-{letter}"] = float(analysis.registration.planes_mm[ink, axis])
    return values


def determined_shares(fit: Fit) -> NDArray[np.float64]:
    """Return the share of each ink's amount (4,) that the page determines: 1 - posterior over prior variance.

    ``Fit.pulls`` is the amount over its standard deviation on good prints, which is the root of that share.
    """
    pulls = fit.surprises.gain[:, 0]
    amount = fit.gain[:, 0] / fit.prior.gain
    share = (amount / np.where(pulls == 0, 1, pulls)) ** 2
    return np.where(pulls == 0, 0.0, share.clip(max=1.0))
