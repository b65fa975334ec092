"""Light level of a scan relative to its press's calibration, measured without knowing where the page lies.

A lamp or a gain scales the light of everything by one factor, of paper, of every ink and of the backing next
to the page. So each of many squares spread over the page gives a factor, and half of them have to agree. The
design's light there is known from its prediction: no paper need be bare.

A scan must have been made under the light that its press was calibrated for: the false-alarm rate rests on it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.registration.coarse import SHRINK
from prooflight.registration.coarse import shrunk
from prooflight.scans.scan import touching

if TYPE_CHECKING:
    from prooflight.detectors.print_prior import PrintPrior
    from prooflight.pages.raster import Page
    from prooflight.prediction.predict import Prediction
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry

MOST_SQUARES: Final = 1500
"""Greatest number of squares over the page, and as many at most over the backing."""
FLAT: Final = 0.03
"""Greatest range of the light about a flat square. [white]"""
ABOUT: Final = 5
"""Width of the neighbourhood of squares that is alike where it is flat: good prints lie 1 mm off their place."""
LEAST_FLAT: Final = 40
"""Least number of flat squares; of a page that has fewer, all are used."""
INSIDE, OUTSIDE = 2, 1
"""Distance in squares from the sheet's edges at which a square counts to the page, and to the backing."""
LEAST_LIGHT, LEAST_BACKING = 0.25, 0.02
"""Least light of a square of the page and of the backing, as a share of paper white.

Darker squares of the page show ink more than light, darker ones of the backing nothing.
"""
LEAST_SQUARES: Final = 12
AGREED: Final = 0.2
"""Greatest width of the interval that holds half of the squares, as a share of the factor, at which they agree."""
LEAST_LEVEL: Final = 0.05
"""Least level that the agreement of squares is measured against: without light all would agree."""
DARK: Final = 0.002
"""Share of a page whose light counts as its darkest: some letters' stems."""
LINE_STEP: Final = 16
EVERYTHING: Final = slice(None), slice(None)
WELL_BELOW: Final = 0.9
"""Share of the top code: a good print that should be darker does not reach it."""
OFF_SDS: Final = 5.0
"""Tolerance in standard deviations of the light of the press's good prints."""
LEAST_OFF: Final = 0.1
"""Least tolerance for a press whose good prints hardly vary: noise is then off by a twentieth, as on good days. [-]"""
DOT_OVER_AREA: Final = 2.0
"""Relative change of a tint's area by a dot gain of 1, which is stated at the area of a half. [-]"""
MOST_CLIPPED: Final = 0.05
"""Greatest share of a page at the top code that should lie well below it; the gloss of an ink is smaller."""
WITNESS: Final = 0.5
"""Deviation of the backing over the page's below which the backing shows that the light is right."""

NO_BACKING: Final = 1.0
"""Relative deviation of the backing from which on it is another sheet."""
DARK_PAGE: Final = 0.1
"""Light below which the darkest part of a page shows the black level. [white]"""
BLACK_OFF: Final = 0.05
"""Greatest error of the black level, as a share of white.

assumed: the darkest parts of good prints, by ink and tables, are off by a hundredth.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LitSquares:
    """Squares of ``SHRINK`` camera pixels of a design in its place, and their expected light."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    backing: NDArray[np.bool_]
    """Whether each square (squares,) lies outside the page."""
    light: NDArray[np.float32]
    """Expected light (sensors, squares), corrected for columns. [white]"""
    darkest: tuple[float, ...]
    """Light of each sensor that ``DARK`` of the page lies below, away from its edges. [white]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class LightLevel:
    """Light level of a scan in one sensor."""

    page: float | None
    """Light of the page over the expected; None: its squares do not agree. [-]

    All squares together, or those where the least ink is printed if these are off by less: light changes both, ink the
    others alone.
    """
    ink_share: float = 0.0
    """Relative change of light by a relative change of ink, (1 - L) / L of the expected L, where there is least. [-]"""
    backing: float | None
    """Light of the backing over the expected; None: its squares do not agree, or too few are in view."""
    clipped: float
    """Share of the page's squares that are at the top code and should lie well below. [-]"""
    brightest_dn: int
    """Greatest number in any square."""
    darkest: float
    """Light that hardly any of the scan lies below. [white]"""
    darkest_due: float
    """Light that twice as much of the page should lie below. [white]"""


def lit_squares(
    expected: Prediction, page: Page, *, sensors: Sequence[SensorModel], geometry: ScanGeometry
) -> LitSquares:
    """Choose the squares by which scans of a page are measured, from its prediction in its place."""
    images = expected.expected_dn
    light = np.stack([shrunk(images[[index]], sensors[index : index + 1]) for index in range(len(sensors))])
    even = np.ones((ABOUT, ABOUT), np.uint8)
    ranges = np.max([cv2.dilate(one, even) - cv2.erode(one, even) for one in light], axis=0)
    bright, seen = ((light > least).all(axis=0) for least in (LEAST_LIGHT, LEAST_BACKING))
    inside, outside = _inside_and_outside(geometry, light.shape[1:], page.width_mm, page.height_mm)
    of_page = np.flatnonzero(inside & bright & (ranges < FLAT))
    if of_page.size < LEAST_FLAT:
        of_page = np.flatnonzero(inside & bright)
    chosen = [
        some[:: max(some.size // MOST_SQUARES, 1)] for some in (of_page, np.flatnonzero(outside & seen))
    ]
    rows, columns = np.unravel_index(np.concatenate(chosen), light.shape[1:])
    backing = np.arange(rows.size) >= chosen[0].size
    edge = INSIDE * SHRINK + 1
    lines, pixels = (
        slice(part.start + edge, max(part.stop - edge, 0))
        for part in geometry.on_page(page.width_mm, page.height_mm)
    )
    return LitSquares(
        rows=rows,
        columns=columns,
        backing=backing,
        light=light[:, rows, columns],
        darkest=tuple(
            _darkest(image, sensor, (lines, pixels), DARK)
            for image, sensor in zip(images, sensors, strict=True)
        ),
    )


def light_levels(
    squares: LitSquares,
    scan: NDArray[np.uint16],
    sensors: Sequence[SensorModel],
    *,
    lost: NDArray[np.bool_] | None = None,
) -> tuple[LightLevel, ...]:
    """Measure the light level of a scan (sensors, lines, pixels) [DN] in each sensor.

    Squares beyond its end are left out, and so is any on lines that were ``lost`` (sensors, lines).
    """
    there = (squares.rows + 1) * SHRINK <= scan.shape[1]
    if lost is not None:
        there &= ~touching(lost, squares.rows * SHRINK, SHRINK).any(axis=0)
    rows, columns, backing = squares.rows[there], squares.columns[there], squares.backing[there]
    of_page = np.flatnonzero(~backing)
    step = np.arange(SHRINK)
    lines, pixels = rows[:, None] * SHRINK + step, columns[:, None] * SHRINK + step
    levels = []
    for image, sensor, due, darkest in zip(
        scan, sensors, squares.light[:, there], squares.darkest, strict=True
    ):
        numbers = image[lines[:, :, None], pixels[:, None, :]]
        mean = numbers.mean(axis=(1, 2), dtype=np.float64)
        offset, gain = (one[pixels].mean(axis=1) for one in (sensor.column_offset_dn, sensor.column_gain))
        ratio = (mean - offset) / (gain * sensor.white_dn * due)
        lightest = of_page[np.argsort(-due[of_page], kind="stable")[: max(of_page.size // 4, LEAST_SQUARES)]]
        at_top = mean > sensor.top_code_dn - 1
        below = offset + gain * sensor.white_dn * due < WELL_BELOW * sensor.top_code_dn
        levels.append(
            LightLevel(
                page=_of_page(ratio[~backing], ratio[lightest]),
                ink_share=float(np.median(1 / due[lightest] - 1)) if lightest.size else 0.0,
                backing=_agreed(ratio[backing]),
                clipped=float((at_top & below & ~backing).sum() / max(int((~backing).sum()), 1)),
                brightest_dn=int(numbers.max(initial=0)),
                darkest=_darkest(image, sensor, EVERYTHING, DARK / 2),
                darkest_due=darkest,
            )
        )
    return tuple(levels)


def _of_page(every: NDArray[np.float64], lightest: NDArray[np.float64]) -> float | None:
    """Return the ratio of the page from those of all its squares and of the lightest, whichever is nearer to 1."""
    of_every, of_lightest = _agreed(every), _agreed(lightest)
    if of_every is None or of_lightest is None:
        return of_every
    return min(of_every, of_lightest, key=lambda ratio: abs(ratio - 1))


def _inside_and_outside(
    geometry: ScanGeometry, shape: tuple[int, ...], width_mm: float, height_mm: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which squares (rows, columns) lie on a page in its place, and which lie outside it."""
    inside, outside = [], []
    for part, extent in zip(geometry.on_page(width_mm, height_mm), shape, strict=True):
        at, low, high = np.arange(extent), part.start / SHRINK, part.stop / SHRINK
        inside.append((at >= low + INSIDE) & (at + 1 <= high - INSIDE))
        outside.append((at + 1 <= low - OUTSIDE) | (at >= high + OUTSIDE))
    return np.logical_and.outer(*inside), np.logical_or.outer(*outside)


def _darkest(image: NDArray[Any], sensor: SensorModel, area: tuple[slice, slice], share: float) -> float:
    """Return the light [white] that a share of an area lies below, from some lines of image (lines, pixels) [DN]."""
    lines, pixels = area
    offset, gain = sensor.column_offset_dn[pixels], sensor.column_gain[pixels]
    light = (image[lines, pixels][::LINE_STEP] - offset) / (gain * np.float32(sensor.white_dn))
    if not light.size:
        return 1.0
    rank = int(share * light.size)
    return float(np.partition(light, rank, axis=None)[rank])


def _agreed(ratio: NDArray[np.float64]) -> float | None:
    """Return the median of the narrowest interval that holds half of the ratios.

    None: the interval is wide, or the ratios are few.
    """
    half = ratio.size // 2 + 1
    if ratio.size < LEAST_SQUARES:
        return None
    ordered = np.sort(ratio)
    width = ordered[half - 1 :] - ordered[: ordered.size - half + 1]
    first = int(width.argmin())
    level = float(np.median(ordered[first : first + half]))
    return level if width[first] <= AGREED * max(abs(level), LEAST_LEVEL) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class WrongLight:
    """Reason why a scan's light is wrong."""

    reason: str
    of_sheet: bool
    """Whether the cause may be the sheet alone: another paper, or a misprint, which is the more specific finding."""


def light_tolerance(prior: PrintPrior, ink_share: float) -> float:
    """Return the tolerance of the light of a good print. [-]

    Where no paper is bare, ink and tables are a part of it: on a dark tint, of light L, a relative change of the ink's
    area changes the light by (1 - L) / L as much (Murray-Davies), which is more than all of paper and lamp.

    Parameters
    ----------
    prior
        Variation of the press's good prints.
    ink_share
        See ``LightLevel.ink_share``. [-]
    """
    ink = ink_share * math.hypot(prior.gain, DOT_OVER_AREA * prior.dot)
    sds = prior.white, prior.common, prior.lamp, prior.shape, prior.gain, ink
    return max(LEAST_OFF, OFF_SDS * math.hypot(*sds))


def wrong_light(
    levels: Sequence[LightLevel], sensors: Sequence[SensorModel], *, prior: PrintPrior
) -> WrongLight | None:
    """Return what is wrong with the light of a scan; None: nothing. prior: variation of the press's good prints."""
    faults = [
        _of_sensor(level, sensor, light_tolerance(prior, level.ink_share))
        for level, sensor in zip(levels, sensors, strict=True)
    ]
    reasons = [
        (f"sensor {sensor.name}: {one.reason}" if len(sensors) > 1 else one.reason, one.of_sheet)
        for one, sensor in zip(faults, sensors, strict=True)
        if one is not None
    ]
    if not reasons:
        return None
    return WrongLight(
        reason="; ".join(reason for reason, _ in reasons), of_sheet=all(of for _, of in reasons)
    )


def _of_sensor(level: LightLevel, sensor: SensorModel, tolerance: float) -> WrongLight | None:
    top = sensor.top_code_dn
    if level.brightest_dn > top:
        what = f"the scan holds values up to {level.brightest_dn}, above the camera's greatest, {top}"
        return WrongLight(reason=f"{what}: record it with the settings of the calibration", of_sheet=False)
    if level.clipped > MOST_CLIPPED:
        what = f"{level.clipped:.0%} of the page is at the camera's greatest value, {top}"
        return WrongLight(
            reason=f"{what}: lower the light or the gain to its value in the calibration", of_sheet=False
        )
    if level.page is None:
        return _of_backing(level, tolerance)
    if abs(level.page - 1) <= tolerance:
        return _of_black(level, sensor)
    light = max(level.page, 0.0)
    paper = f"paper at {light * sensor.white_dn:.0f} DN, {sensor.white_dn:.0f} expected"
    if level.backing is not None and abs(level.backing - 1) < WITNESS * abs(level.page - 1):
        what = f"the sheet is {light:.2f} times as bright as in the calibration ({paper})"
        return WrongLight(
            reason=f"{what}, but the backing next to it is not: calibrate again for this paper", of_sheet=True
        )
    what = f"the light is {light:.2f} times what this press was calibrated for ({paper})"
    return WrongLight(reason=f"{what}: repair the lamp or the camera, or calibrate again", of_sheet=False)


def _of_backing(level: LightLevel, tolerance: float) -> WrongLight | None:
    """Check the backing, for a sensor to which the page itself, a dark picture perhaps, does not show its light."""
    if level.backing is None or not tolerance < abs(level.backing - 1) < NO_BACKING:
        return None
    what = f"the backing next to the page is {level.backing:.2f} times as bright as in the calibration"
    return WrongLight(reason=f"{what}: check the lamp and the camera, or calibrate again", of_sheet=True)


def _of_black(level: LightLevel, sensor: SensorModel) -> WrongLight | None:
    """Check the black level, for a sensor whose light is right: nothing is as dark as it should be.

    Specks may well be darker.
    """
    due = level.darkest_due
    if due > DARK_PAGE or level.darkest - due <= BLACK_OFF:
        return None
    seen_dn, due_dn = (round(light * sensor.white_dn) for light in (level.darkest, due))
    what = f"the darkest area of the page is at {seen_dn} DN above dark, {due_dn} expected"
    return WrongLight(reason=f"{what}: the camera's black level is off; calibrate again", of_sheet=True)
