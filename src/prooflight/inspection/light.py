"""Check that a scan was made under the light that its press was calibrated for.

The false-alarm rate rests on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight.detectors.print_prior import PrintPrior
    from prooflight.inspection.light_level import LightLevel
    from prooflight.prediction.tables import SensorModel

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
        return WrongLight(reason=f"{what}: record it as the press was calibrated", of_sheet=False)
    if level.clipped > MOST_CLIPPED:
        what = f"{level.clipped:.0%} of the page is at the camera's greatest value, {top}"
        return WrongLight(
            reason=f"{what}: lower the light or the gain to what was calibrated", of_sheet=False
        )
    if level.page is None:
        return _of_backing(level, tolerance)
    if abs(level.page - 1) <= tolerance:
        return _of_black(level, sensor)
    light = max(level.page, 0.0)
    paper = f"paper at {light * sensor.white_dn:.0f} DN, {sensor.white_dn:.0f} expected"
    if level.backing is not None and abs(level.backing - 1) < WITNESS * abs(level.page - 1):
        what = f"the sheet is {light:.2f} times as light as this press was calibrated for ({paper})"
        return WrongLight(
            reason=f"{what}, what lies beside it is not: calibrate again for this paper", of_sheet=True
        )
    what = f"the light is {light:.2f} times what this press was calibrated for ({paper})"
    return WrongLight(reason=f"{what}: mend lamp or camera, or calibrate again", of_sheet=False)


def _of_backing(level: LightLevel, tolerance: float) -> WrongLight | None:
    """Check the backing, for a sensor to which the page itself, a dark picture perhaps, does not show its light."""
    if level.backing is None or not tolerance < abs(level.backing - 1) < NO_BACKING:
        return None
    what = f"what lies beside the page is {level.backing:.2f} times as light as this press was calibrated for"
    return WrongLight(reason=f"{what}: mend lamp or camera, or calibrate again", of_sheet=True)


def _of_black(level: LightLevel, sensor: SensorModel) -> WrongLight | None:
    """Check the black level, for a sensor whose light is right: nothing is as dark as it should be.

    Specks may well be darker.
    """
    due = level.darkest_due
    if due > DARK_PAGE or level.darkest - due <= BLACK_OFF:
        return None
    seen_dn, due_dn = (round(light * sensor.white_dn) for light in (level.darkest, due))
    what = f"the darkest of the page is at {seen_dn} DN above dark, {due_dn} expected"
    return WrongLight(reason=f"{what}: the camera's black level is off; calibrate again", of_sheet=True)
