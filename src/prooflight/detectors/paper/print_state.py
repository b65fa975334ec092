"""Print state from the light of columns: the variation of one print in lamp and streaks."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.base import LAMP_WAVES, PrintState
from prooflight.kernels.comparison.page_sums import column_sums
from prooflight.pages.parallel import shared_out

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.base import PressContext

PARTS: Final = 8
"""Number of parts of a page's height: a column's value is their median, so that no local misprint makes a
streak."""


def print_state(
    measured_dn: NDArray[np.uint16],
    expected_dn: NDArray[np.float32],
    part: slice,
    press_context: PressContext,
) -> PrintState:
    """Return the state of measured and expected lines (sensors, lines, columns) [DN].

    part: their columns in the field.
    """
    of_sensors = light_sums(measured_dn, expected_dn, part, press_context)
    pixels = press_context.geometry.pixels
    amounts = lamp_waves(of_sensors.sum(axis=0), part, pixels)
    for sensor, (over, whole) in zip(press_context.sensors, of_sensors, strict=True):
        amounts[f"light-{sensor.name}"] = float(np.median(over.sum(axis=0) / whole.sum(axis=0)))
    excess, light = (np.zeros((PARTS, pixels)) for _ in "el")
    excess[:, part], light[:, part] = of_sensors.sum(axis=0)
    return PrintState(
        amounts=amounts, excess=excess, light=light, pitch_mm=press_context.geometry.pixel_pitch_mm
    )


def light_sums(
    measured: NDArray[np.uint16], expected: NDArray[np.float32], part: slice, press_context: PressContext
) -> NDArray[np.float64]:
    """Return light minus expected light, and expected light, summed down the columns of an area.

    (sensors, 2, PARTS, columns of the area) [DN]
    """
    bounds = np.arange(PARTS + 1) * measured.shape[1] // PARTS
    sums = np.empty((len(press_context.sensors), 2, PARTS, measured.shape[2]))

    def add(index: int, share: int, first: int, last: int) -> None:
        offset = press_context.sensors[index].column_offset_dn[part]
        seen, due = np.zeros(offset.size, np.uint32), np.zeros(offset.size)
        column_sums(measured[index], expected[index], first, last, seen, due)
        sums[index, 0, share] = seen - due
        sums[index, 1, share] = due - (last - first) * offset

    tasks = [
        partial(add, index, share, first, last)
        for index in range(len(press_context.sensors))
        for share, (first, last) in enumerate(pairwise(bounds))
    ]
    shared_out(tasks, threads=press_context.threads or 1)
    return sums


def lamp_waves(sums: NDArray[np.float64], part: slice, pixels: int) -> dict[str, float]:
    """Return amplitudes of the lamp's waves cos(k pi x / W) over the field.

    sums: (2, parts, columns of ``part``).
    """
    ratio = sums[0].sum(axis=0) / sums[1].sum(axis=0)
    x = (np.arange(pixels)[part] + 0.5) / pixels
    waves = np.cos(np.pi * np.multiply.outer(x, np.arange(LAMP_WAVES + 1)))
    # Normal equations: a BLAS least-squares fit takes longer, in threads that compete with the inspection's.
    amplitudes = np.linalg.solve(waves.T @ waves, waves.T @ ratio)
    return {f"lamp-{k}": float(amplitudes[k]) for k in range(1, LAMP_WAVES + 1)}
