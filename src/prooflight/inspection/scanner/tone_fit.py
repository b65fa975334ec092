"""Fit of a scan's tone to the page itself: paper white, black point and gamma, by what the page should show.

A scanner's curve is only roughly the one that its file states: devices set the white of each sheet, and many make paper
plain white, so that its light is unknown above the file's greatest number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from scipy.optimize import brentq, least_squares

from prooflight.inspection.scanner.placing import PRINTED, expected_light

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.inspection.scanner.placing import DrawnScan
    from prooflight.prediction.predict import Prediction
    from prooflight.prediction.tables import SensorModel

FLAT_PIXELS: Final = 5
"""Side of the squares within which a flat place's expected light does not change. [pixels]"""
FLAT: Final = 0.02
"""Greatest change of expected light within a flat place. [white]"""
PAPER: Final = 0.98
"""Least expected light of what counts as paper. [paper]"""
LEAST_PIXELS: Final = 64
"""Least number of pixels of a tint by which the tone is fitted."""
TINTS: Final = 25
"""Number of classes of expected light between black and white."""
LEAST_TINTS: Final = 3
"""Least number of tints by which black and gamma are fitted; white is known besides."""
MOST_LOG_GAMMA: Final = 0.8
"""Greatest logarithm of a gamma that type makes up for: sharpening and the weight of an office printer. [-]"""
MOSTLY: Final = 0.5
"""Share of the paper that is clipped from which on its white is unknown above the file's greatest number."""
TINT_SD: Final = 0.02
"""Standard deviation of a tint's light on good prints, by ink and tables. [white]"""
BLACK_SD: Final = 0.1
"""Standard deviation of the light that a scanner shows where there is none. assumed [white]"""
GAMMA_SD: Final = 0.25
"""Standard deviation of the logarithm of the gamma that a scan has beyond its curve. assumed [-]"""
SOLID: Final = 0.15
"""Expected light up to which a tint is a solid, which tells a scan's black point by itself. [paper]"""
MOST_BLACK: Final = 0.1
"""Greatest black point that one solid tells: beyond it, ink is missing. assumed, ``BLACK_SD`` [paper]"""
LEAST_WHITE: Final = 0.05
"""Least light of paper, as a share of the file's white point; darker scans show no paper."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedTone:
    """Tone of one channel of a scan: light = white (black + (1 - black) expected^gamma)."""

    white: float
    """Light of paper. [share of the file's white point]"""
    clipped: bool
    """Whether most of the paper is clipped, so that its light may be greater."""
    black: float = 0.0
    """Light of what has none. [paper]"""
    gamma: float = 1.0
    tints: int = 0
    """Number of tints by which black and gamma were fitted; 0: they are the file's."""

    def light(self, seen: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return light as the press's camera would see it, as a share of its paper."""
        bare = (seen / np.float32(self.white) - np.float32(self.black)) / np.float32(1 - self.black)
        return np.asarray(np.power(np.maximum(bare, 0), np.float32(1 / self.gamma)), np.float32)


def fitted_tone(
    light: NDArray[np.float32],
    clipped: NDArray[np.float32],
    expected: NDArray[np.float32],
    seen: NDArray[np.bool_],
    *,
    by_type: bool = True,
) -> FittedTone:
    """Return the tone of one channel, all arrays (lines, pixels).

    Paper is the median of its unclipped pixels unless most are clipped. Black and gamma are the most likely by the
    medians of the page's flat tints, given what scanners usually do. On a page of few tints gamma is the one by which
    its print is as dark as expected on the mean, so that such a page cannot tell that all of its ink is too strong.

    Parameters
    ----------
    light, clipped, seen : see ``DrawnScan``
    expected : light that is expected of the page in its place [paper]
    by_type : whether gamma comes from type where the page has few tints; else black comes from a solid, if there is one
    """
    square = np.ones((FLAT_PIXELS, FLAT_PIXELS), np.uint8)
    flat = seen & (cv2.dilate(expected, square) - cv2.erode(expected, square) < FLAT)
    paper = flat & (expected >= PAPER)
    if paper.sum() < LEAST_PIXELS:
        return FittedTone(white=1.0, clipped=False)
    whole = clipped[paper] > 0
    mostly = bool(whole.mean() > MOSTLY)
    white = float(np.median(light[paper] if mostly else light[paper][~whole]) / np.median(expected[paper]))
    if white < LEAST_WHITE:
        return FittedTone(white=1.0, clipped=False)
    tinted = flat & (expected < PAPER) & (clipped == 0)
    classes = np.minimum((expected[tinted] * TINTS).astype(np.intp), TINTS)
    due, observed, weight = [], [], []
    for one in np.unique(classes):
        inside = classes == one
        if inside.sum() >= LEAST_PIXELS:
            due.append(float(np.median(expected[tinted][inside])))
            observed.append(float(np.median(light[tinted][inside])) / white)
            weight.append(1 / TINT_SD)
    if len(due) < LEAST_TINTS:
        if by_type:
            gamma = _gamma_of_print(light / white, expected, seen)
            return FittedTone(white=white, clipped=mostly, gamma=gamma)
        dark = min(zip(due, observed, strict=True), default=(1.0, 1.0))
        if dark[0] > SOLID:
            return FittedTone(white=white, clipped=mostly)
        black = (dark[1] - dark[0]) / (1 - dark[0])
        return FittedTone(
            white=white, clipped=mostly, black=float(np.clip(black, -MOST_BLACK, MOST_BLACK)), tints=1
        )
    at, level, sure = (np.array(values) for values in (due, observed, weight))

    def off(amounts: NDArray[np.float64]) -> NDArray[np.float64]:
        black, log_gamma = amounts
        fit = black + (1 - black) * np.maximum(at, 1e-4) ** np.exp(log_gamma)
        return np.concatenate([(fit - level) * sure, [black / BLACK_SD, log_gamma / GAMMA_SD]])

    black, log_gamma = least_squares(off, np.zeros(2), loss="soft_l1").x
    return FittedTone(
        white=white,
        clipped=mostly,
        black=float(np.clip(black, -0.2, 0.5)),
        gamma=float(np.exp(np.clip(log_gamma, -1, 1))),
        tints=len(due),
    )


def _gamma_of_print(
    light: NDArray[np.float32], expected: NDArray[np.float32], seen: NDArray[np.bool_]
) -> float:
    """Return the gamma by which what is printed is as light on the mean as expected; light as shares of paper."""
    square = np.ones((FLAT_PIXELS, FLAT_PIXELS), np.uint8)
    near = seen & (cv2.erode(expected, square) < PRINTED)
    if near.sum() < LEAST_PIXELS:
        return 1.0
    observed = np.clip(light[near].astype(np.float64), 0, 1)
    due = float(np.minimum(expected[near], 1).mean())

    def off(log_gamma: float) -> float:
        return float((observed ** np.exp(-log_gamma)).mean()) - due

    ends = off(-MOST_LOG_GAMMA), off(MOST_LOG_GAMMA)
    if ends[0] * ends[1] >= 0:  # what no tone explains is left to the detector
        nearest = -MOST_LOG_GAMMA if abs(ends[0]) < abs(ends[1]) else MOST_LOG_GAMMA
        return float(np.exp(nearest))
    return float(np.exp(brentq(off, -MOST_LOG_GAMMA, MOST_LOG_GAMMA, xtol=1e-4)))


def toned_lines(
    drawn: DrawnScan, expected: Prediction, sensors: tuple[SensorModel, ...], *, by_type: bool = True
) -> tuple[NDArray[np.uint16], tuple[FittedTone, ...]]:
    """Return a drawn scan as lines of the press's camera (sensors, lines, pixels) [DN], and each channel's tone.

    What is clipped has at least the light that the file states; where more is expected, that counts as seen. What
    lies beside the page or beyond the scan counts as expected, since nothing is known of it. by_type: ``fitted_tone``.
    """
    lines = np.empty(drawn.light.shape, np.uint16)
    tones = []
    for index, (sensor, due) in enumerate(zip(sensors, expected_light(expected, sensors), strict=True)):
        tone = fitted_tone(drawn.light[index], drawn.clipped[index], due, drawn.seen, by_type=by_type)
        observed = tone.light(drawn.light[index])
        observed += drawn.clipped[index] * np.maximum(due - observed, 0)
        observed = np.where(drawn.seen, observed, due)
        dn = sensor.column_offset_dn + sensor.column_gain * np.float32(sensor.white_dn) * observed
        lines[index] = np.clip(np.rint(dn), 0, sensor.top_code_dn)
        tones.append(tone)
    return lines, tuple(tones)
