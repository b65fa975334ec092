"""Defects of a known size in scans of good prints, and the smallest of them that is detected at 99 %.

Sensitivity is reported in these terms. Strengths of trials are chosen adaptively.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import special

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zone import PageZones, Zone
    from prooflight.press.artefact import Press

SURE: Final = 0.99
SPREADS: Final = np.geomspace(0.05, 0.8, 10)
"""Spreads of the logarithm of the strength at which single prints begin to alarm."""
STEPS: Final = 161
LAPSE: Final = 0.002
"""Share of prints in which a defect passes however strong it is; assumed: one such print does not decide."""
CHANCES: Final = (0.6, 0.995)
"""Range of detection probabilities from which the next strength is drawn: 99 % is estimated best from about there."""
BETWEEN: Final = (0.05, 0.95)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One print with one defect."""

    strength: float
    caught: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Caught:
    """Least strength that is detected at 99 %, with its interval of 90 % probability.

    It is infinite where none of the range is detected.
    """

    least: float
    low: float
    high: float

    @property
    def ever(self) -> bool:
        """Return whether any strength is detected."""
        return bool(np.isfinite(self.least))


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Range of strengths of one kind of defect."""

    low: float
    high: float

    @property
    def middles(self) -> NDArray[np.float64]:
        """Return the candidate strengths of 50 % detection.

        They reach a third beyond the range either way.
        """
        edge = (self.high / self.low) ** (1 / 3)
        return np.geomspace(self.low / edge, self.high * edge, STEPS)


def weights_of(trials: Sequence[Trial], within: Range, *, false_alarms: float) -> NDArray[np.float64]:
    """Return the posterior probability (middles, spreads), sum 1: a flat prior times the likelihood of the trials.

    P(caught) = F + (1 - F - lapse) Phi((ln strength - ln middle) / spread), as in QUEST+ (Watson 2017).
    """
    log_likelihood = np.zeros((STEPS, SPREADS.size))
    for trial in trials:
        chance = _chances(trial.strength, within, false_alarms)
        log_likelihood += np.log(chance if trial.caught else 1 - chance)
    weight = np.exp(log_likelihood - log_likelihood.max())
    return np.asarray(weight / weight.sum())


def strength_for(chance: float, weight: NDArray[np.float64], within: Range, *, false_alarms: float) -> float:
    """Return the least strength that is detected with that mean probability; infinite: none of the range."""
    tried = np.geomspace(within.low, within.high, STEPS)
    mean = np.array([(_chances(one, within, false_alarms) * weight).sum() for one in tried])
    enough = np.flatnonzero(mean >= chance)
    return float(tried[enough[0]]) if enough.size else np.inf


def caught(trials: Sequence[Trial], within: Range, *, false_alarms: float) -> Caught:
    """Estimate the least detected strength from trials."""
    weight = weights_of(trials, within, false_alarms=false_alarms)
    least = strength_for(SURE, weight, within, false_alarms=false_alarms)
    at = special.ndtri((SURE - false_alarms) / (1 - false_alarms - LAPSE)) if false_alarms < SURE else -np.inf
    sure_from = np.exp(np.log(within.middles)[:, None] + at * SPREADS)
    order = np.argsort(sure_from, axis=None)
    total = np.cumsum(weight.ravel()[order])
    low, high = (float(sure_from.ravel()[order][np.searchsorted(total, one)]) for one in BETWEEN)
    return Caught(
        least=least,
        low=low if low <= within.high else np.inf,
        high=high if high <= within.high and np.isfinite(least) else np.inf,
    )


def next_strength(
    trials: Sequence[Trial], within: Range, rng: np.random.Generator, *, false_alarms: float
) -> float:
    """Draw a strength to try: uniformly over the range at first, then near the strength of 99 %."""
    if not trials:
        return float(np.exp(rng.uniform(np.log(within.low), np.log(within.high))))
    weight = weights_of(trials, within, false_alarms=false_alarms)
    chance = float(rng.uniform(*CHANCES))
    return min(strength_for(chance, weight, within, false_alarms=false_alarms), within.high)


def _chances(strength: float, within: Range, false_alarms: float) -> NDArray[np.float64]:
    off = (np.log(strength) - np.log(within.middles))[:, None] / SPREADS
    return np.asarray(false_alarms + (1 - false_alarms - LAPSE) * special.ndtr(off))


STREAK_MM: Final = 0.5
DARK: Final = 0.5
"""Share of bare paper's light below which defects are of bare paper, else of solid black."""
BLUR_PIXELS: Final = 0.7
"""Blur of a defect's edges, by the lens. assumed, near the prototype's"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sort:
    """Sort of defect, with the range and unit of its strength."""

    name: str
    within: Range
    unit: str


SORTS: Final = (
    Sort(name="spot", within=Range(low=0.15, high=6.0), unit="mm"),
    Sort(name="streak", within=Range(low=1.0, high=100.0), unit="%"),
    Sort(name="density", within=Range(low=1.0, high=100.0), unit="%"),
)
"""Sorts of defect.

Spot: a round spot of solid ink; its strength is the diameter. Streak: half a millimetre wide through the
area; its strength is the ink. Density: all inks weaker all over the area; its strength is the share. Spots
and streaks are of solid black, or bare paper where the print gives the camera less than half of paper's
light, so that they are visible.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Area:
    """Area of a page in which defects are put."""

    name: str
    kind: str
    """Kind of zone: ignore, careful or normal; rest: the page outside all zones."""
    holds: Callable[[NDArray[np.floating], NDArray[np.floating]], NDArray[np.bool_]]
    """Function that returns which points of a grid (n,) x (m,) [mm] are in the area, (m, n)."""


def areas_of(zones: PageZones) -> list[Area]:
    """Return all zones of a page as far as they count, and the rest of it."""
    areas = [Area(name=zone.name, kind=zone.kind, holds=_counted(zones, zone)) for zone in zones.zones]
    return [*areas, Area(name="the rest of the page", kind="rest", holds=lambda x, y: _rest(zones, x, y))]


def _counted(
    zones: PageZones, zone: Zone
) -> Callable[[NDArray[np.floating], NDArray[np.floating]], NDArray[np.bool_]]:
    return lambda x, y: zone.holds(x, y) & zones.holds(zone.kind, x, y)


def _rest(zones: PageZones, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.bool_]:
    outside = np.ones((y.size, x.size), bool)
    for zone in zones.zones:
        outside &= ~zone.holds(x, y)
    return outside


def with_defect(
    dn: NDArray[np.uint16],
    sort: str,
    strength: float,
    area: Area,
    *,
    page: Page,
    press: Press,
    shift_mm: tuple[float, float],
    rng: np.random.Generator,
) -> NDArray[np.uint16] | None:
    """Return a scan (sensors, lines, pixels) [DN] with a defect of a sort of ``SORTS`` somewhere in an area.

    None: no pixel of the scan is in the area. shift_mm: displacement of the page.
    """
    geometry = press.geometry
    x = geometry.centres_x_mm(page.width_mm, shift_mm=shift_mm[0])
    y = geometry.centres_y_mm(dn.shape[1], shift_mm=shift_mm[1])
    on_page = (y > 0)[:, None] & (y < page.height_mm)[:, None] & (x > 0) & (x < page.width_mm)
    of_area = area.holds(x, y) & on_page
    rows, columns = np.nonzero(of_area)
    if not rows.size:
        return None
    at = int(rng.integers(rows.size))
    cover = np.zeros(of_area.shape, np.float32)
    if sort == "spot":
        reach = max(int(strength / geometry.pixel_pitch_mm) + 4, 4)
        near = tuple(slice(max(one[at] - reach, 0), one[at] + reach + 1) for one in (rows, columns))
        distance_mm = np.hypot(x[near[1]] - x[columns[at]], (y[near[0]] - y[rows[at]])[:, None])
        cover[near] = disc(distance_mm, diameter_mm=strength, pixel_mm=geometry.pixel_pitch_mm)
    elif sort == "streak":
        across = np.clip(0.5 + (STREAK_MM / 2 - np.abs(x - x[columns[at]])) / geometry.pixel_pitch_mm, 0, 1)
        cover[...] = of_area * across * (strength / 100)
    else:
        cover[...] = of_area
    cover = cv2.GaussianBlur(cover, (0, 0), BLUR_PIXELS)
    changed = dn.astype(np.float32)
    dark = sort != "density" and _dark(changed, cover, press)
    for image, sensor in zip(changed, press.sensors, strict=True):
        offset, gain = sensor.column_offset_dn, sensor.column_gain
        if sort == "density":
            light = np.maximum((image - offset) / gain, 1.0)
            paper = np.maximum(light, np.float32(sensor.white_dn))
            image[...] = light * (paper / light) ** (cover * np.float32(strength / 100)) * gain + offset
        else:
            there = np.float32(sensor.white_dn if dark else sensor.mean_dn[0, 0, 0, -1]) * gain + offset
            image += cover * (there - image)
    top = np.array([sensor.top_code_dn for sensor in press.sensors], np.float32)[:, None, None]
    return np.clip(np.rint(changed), 0, top).astype(np.uint16)


def _dark(dn: NDArray[np.float32], cover: NDArray[np.float32], press: Press) -> bool:
    """Return whether a scan (sensors, lines, pixels) [DN] shows less than ``DARK`` of paper's light under ``cover``."""
    seen = [
        (cover * (image - sensor.column_offset_dn) / sensor.column_gain).sum() / sensor.white_dn
        for image, sensor in zip(dn, press.sensors, strict=True)
    ]
    return float(np.mean(seen)) < DARK * float(cover.sum())


def disc(distance_mm: NDArray[np.floating], *, diameter_mm: float, pixel_mm: float) -> NDArray[np.floating]:
    """Return the share of each pixel that a disc covers, from the distances of its centre to theirs.

    The edge is one pixel wide and leaves the disc's area as it is (with its edge at the radius itself it
    would be larger by pi pixel^2 / 12).
    """
    edge_mm = np.sqrt(max(diameter_mm**2 / 4 - pixel_mm**2 / 12, 0.0))
    return np.clip(0.5 + (edge_mm - distance_mm) / pixel_mm, 0, 1)
