"""What one inspection adds to its run: amounts of what good prints do, and the light of narrow columns."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import ndimage

from prooflight.detectors.matched_filter.fit.nuisance import INKS, LAMP_WAVES
from prooflight.kernels.columns import column_sums
from prooflight.line.monitor.channels import INKS as INK_NAMES
from prooflight.line.monitor.run import PageEvidence
from prooflight.pages.parallel import shared_out

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.analysis import Looked
    from prooflight.detectors.matched_filter.fit.nuisance import Fit
    from prooflight.inspection.inspection import Inspection
    from prooflight.prediction.tables import SensorModel
    from prooflight.press.artefact import Press

COLUMN_MM: Final = 0.5
"""Width of columns: the narrowest streaks of worlds.toml fill a third of one."""
NEARBY_MM: Final = 15.0
"""What is alike over so much is lamp, paper or ink, and no streak: the median of the columns about is taken off."""
PARTS: Final = 8
"""Of a page's height: the median of them is the column's, so that no local misprint makes a streak."""
LEAST_KNOWN: Final = 0.4
"""Share of an ink's amount that a page must tell, instead of the prior, to count at all."""
UNIT: Final = 1e-9


def columns_mm(press: Press) -> NDArray[np.float64]:
    """Middles of the columns of the widest page that the field holds, from its left edge."""
    return np.asarray((np.arange(int(press.geometry.field_mm / COLUMN_MM)) + 0.5) * COLUMN_MM)


def run_evidence(
    inspection: Inspection, press: Press, *, page_width_mm: float, threads: int = 1
) -> PageEvidence:
    """Amounts and columns of one page, whatever its detector; empty where the page was not found."""
    shift_mm = inspection.verdict.shift_mm
    if shift_mm is None:
        return PageEvidence()
    values = {"shift-x": shift_mm[0], "shift-y": shift_mm[1]}
    if inspection.looked is not None:
        values |= fitted_amounts(inspection.looked, press.sensors)
        excess, light = inspection.looked.sums.columns[:2, 0]
        pitch_mm = inspection.looked.sums.pixel_mm
    else:
        of_sensors = light_sums(inspection, press, threads=threads)
        for sensor, (over, whole) in zip(press.sensors, of_sensors, strict=True):
            values[f"light-{sensor.name}"] = float(np.median(over.sum(axis=0) / whole.sum(axis=0)))
        values |= lamp_waves(of_sensors.sum(axis=0), inspection.area[1], press.geometry.pixels)
        excess, light = (np.zeros((PARTS, press.geometry.pixels)) for _ in "el")
        excess[:, inspection.area[1]], light[:, inspection.area[1]] = of_sensors.sum(axis=0)
        pitch_mm = press.geometry.pixel_pitch_mm
    left_mm = press.geometry.left_mm(page_width_mm) + shift_mm[0]
    at_mm = np.asarray((np.arange(excess.shape[1]) + 0.5) * pitch_mm - left_mm)
    return PageEvidence(values=values, columns=columns(excess, light, at_mm, columns_mm(press).size))


def light_sums(inspection: Inspection, press: Press, *, threads: int = 1) -> NDArray[np.float64]:
    """Light over what was expected, and light expected, down the columns of an inspection's area.

    (sensors, 2, PARTS, columns of the area) [DN]
    """
    assert inspection.prediction is not None
    measured, expected = inspection.measured_dn, inspection.prediction.expected_dn
    bounds = np.arange(PARTS + 1) * measured.shape[1] // PARTS
    found = np.empty((len(press.sensors), 2, PARTS, measured.shape[2]))

    def add(index: int, part: int, first: int, last: int) -> None:
        offset = press.sensors[index].column_offset_dn[inspection.area[1]]
        seen, due = np.zeros(offset.size, np.uint32), np.zeros(offset.size)
        column_sums(measured[index], expected[index], first, last, seen, due)
        found[index, 0, part] = seen - due
        found[index, 1, part] = due - (last - first) * offset

    tasks = [
        partial(add, index, part, first, last)
        for index in range(len(press.sensors))
        for part, (first, last) in enumerate(pairwise(bounds))
    ]
    shared_out(tasks, threads=threads)
    return found


def columns(
    excess: NDArray[np.floating], light: NDArray[np.floating], at_mm: NDArray[np.float64], count: int
) -> NDArray[np.float32]:
    """Light of columns over what was expected, less the columns about: (count,) [-]; not finite where nothing tells.

    excess, light (parts, pixels): sums over lines; at_mm (pixels,): where pixels lie on the page.
    """
    place = np.floor(at_mm / COLUMN_MM).astype(np.intp)
    inside = (place >= 0) & (place < count)
    binned = np.zeros((2, len(light), count))
    for part in range(len(light)):
        for k, sums in enumerate((excess, light)):
            binned[k, part] = np.bincount(place[inside], weights=sums[part, inside], minlength=count)
    known = binned[1] > UNIT
    ratio = np.where(known, binned[0] / np.where(known, binned[1], 1), np.nan)
    found = np.full(count, np.nan)
    enough = known.sum(axis=0) > len(light) // 2
    found[enough] = np.nanmedian(ratio[:, enough], axis=0)
    if enough.any():
        at = np.flatnonzero(enough)
        whole = np.interp(np.arange(count), at, found[at])
        found -= ndimage.median_filter(whole, size=round(NEARBY_MM / COLUMN_MM) | 1, mode="nearest")
    return found.astype(np.float32)


def lamp_waves(sums: NDArray[np.float64], part: slice, pixels: int) -> dict[str, float]:
    """Amplitudes of the lamp's waves cos(k pi x / W) over the field, from (2, parts, columns of ``part``)."""
    ratio = sums[0].sum(axis=0) / sums[1].sum(axis=0)
    x = (np.arange(pixels)[part] + 0.5) / pixels
    waves = np.cos(np.pi * np.multiply.outer(x, np.arange(LAMP_WAVES + 1)))
    # By normal equations: BLAS would fit the long way round, in threads that fight with those that inspect.
    found = np.linalg.solve(waves.T @ waves, waves.T @ ratio)
    return {f"lamp-{k}": float(found[k]) for k in range(1, LAMP_WAVES + 1)}


def fitted_amounts(looked: Looked, sensors: Sequence[SensorModel]) -> dict[str, float]:
    """What our detector's fit says of lamp, paper, inks and register, by channel."""
    fit, values = looked.fit, {}
    for sensor, white in zip(sensors, fit.white, strict=True):
        values[f"light-{sensor.name}"] = float(white)
    values |= {f"lamp-{k}": float(one) for k, one in enumerate(fit.lamp, start=1)}
    known = known_shares(fit)
    for ink, name in enumerate(INK_NAMES):
        if known[ink] >= LEAST_KNOWN:
            values[f"gain-{name}"] = float(fit.gain[ink, 0] / known[ink])
        if looked.found.plane_parts[:, ink].min() > 0:
            for axis, letter in enumerate("xy"):
                values[f"register-{name}-{letter}"] = float(looked.found.planes_mm[ink, axis])
    return values


def known_shares(fit: Fit) -> NDArray[np.float64]:
    """How much of each ink's amount (4,) is the page's own word and not the prior's: 1 - posterior variance over prior.

    ``Fit.surprise`` is amount over the standard deviation it has on good prints, which is that share's root.
    """
    first = fit.white.size + 1 + fit.lamp.size + fit.shape.size
    surprise = fit.surprise[first : first + 3 * INKS : 3]
    amount = fit.gain[:, 0] / fit.tolerance.gain
    share = (amount / np.where(surprise == 0, 1, surprise)) ** 2
    return np.where(surprise == 0, 0.0, share.clip(max=1.0))
