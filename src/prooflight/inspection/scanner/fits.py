"""What is fitted to the scans of an office scanner: the tone of each, and the signal chain of printer and scanner.

A scanner's curve is only roughly the one that its file states: devices set the white of each sheet, and many make paper
plain white, so that its light is unknown above the file's greatest number. Paper white, black point and gamma are
fitted by what the page should show.

The chain has one growth and one kernel a channel for all edges of all sheets, so that no single misprint can bend it:
what it does not explain weighs little (Cauchy weights), and a sheet is judged by the chain of the others where there
are enough of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, least_squares

from prooflight.detectors.golden.chain import (
    GROWN_PIXELS,
    RINGS,
    UM_PER_MM,
    SignalChain,
    between,
    grown_light,
    rings,
    slope_of_numbers,
    to_numbers,
)
from prooflight.detectors.golden.differences import place_of
from prooflight.inspection.scanner.placing import PRINTED, DrawnScan, expected_light

if TYPE_CHECKING:
    from prooflight.detectors.base import PressContext
    from prooflight.pages.raster import Page
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


NEAR_PIXELS: Final = 7
"""Side of the squares about printed pixels whose pixels are samples."""
GROWN_PRINT: Final = 0.95
"""Light of grown print below which a pixel counts as printed. [paper]"""
MOST_SAMPLES: Final = 20_000
"""Samples of one sheet, evenly over its print; all of a full page would say the same."""
LEAST_SAMPLES: Final = 500
"""Samples below which a sheet tells nothing of the chain: a word has some thousand."""
MOST_SHEETS: Final = 24
"""Sheets of one run that are measured; the chain is one device's, so that more add little."""
LEAST_OTHERS: Final = 2
"""Other sheets from which on a sheet is judged by these alone."""
GROWTHS: Final = 9
"""Growths that are tried, evenly; the best one lies on the parabola through the least three."""
DOUBT: Final = 0.1
"""Difference at which a sample has half its weight: twice the noise of a good sheet's edge. assumed [of full scale]"""
ROUNDS: Final = 8
"""Number of weighted linear steps."""
RIDGE: Final = 1e-2
"""Samples by which each weight is kept where it is: rings of a page of hairlines are nearly the same."""
VARYING: Final = 0.2
"""Least variation about a pixel by which its uncertainty is measured. [of full scale]"""
OUTER: Final = 0.95
"""Share of good edges within two standard deviations: their tails are longer than a normal distribution's."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetEdges:
    """Samples near the print of one sheet."""

    dark: NDArray[np.float32]
    """(growths, channels, samples, rings) mean darkness of each ring. [paper]"""
    numbers: NDArray[np.float32]
    """(channels, samples) what the scan shows, 0 to 1."""
    varying: NDArray[np.float32]
    """(channels, samples) what the page's numbers vary by within a pixel."""


def sheet_edges(
    page: Page, press_context: PressContext, light: NDArray[np.float32], seen: NDArray[np.bool_]
) -> SheetEdges | None:
    """Return the samples of one sheet; None: it has too little print, or does not show the page.

    light : (channels, lines, pixels) of the scan, at the press's pixels, near its page [paper]
    seen : (lines, pixels) where the scan shows the page, and no zone is ignored
    """
    grown = grown_light(page, press_context)
    usual = to_numbers(grown[1])
    numbers = to_numbers(light)
    where = place_of(usual, np.where(seen, numbers, usual))
    if not where.located or where.bent:
        return None
    moved = np.stack([[np.nan_to_num(where.moved(one), nan=1.0) for one in step] for step in grown])
    near = cv2.dilate(
        (moved[-1].min(axis=0) < GROWN_PRINT).astype(np.uint8), np.ones((NEAR_PIXELS,) * 2, np.uint8)
    )
    at = np.flatnonzero((near > 0) & seen)
    at = at[:: max(1, at.size // MOST_SAMPLES)]
    if at.size < LEAST_SAMPLES:
        return None
    dark = np.stack([[rings(1 - one).reshape(len(RINGS), -1)[:, at].T for one in step] for step in moved])
    square = np.ones((3, 3), np.uint8)
    varying = [(cv2.dilate(one, square) - cv2.erode(one, square)).ravel()[at] for one in to_numbers(moved[1])]
    return SheetEdges(dark=dark, numbers=numbers.reshape(len(numbers), -1)[:, at], varying=np.stack(varying))


def fitted_chain(sheets: Sequence[SheetEdges], raster_mm: float) -> SignalChain:
    """Return the chain of one or more sheets, robustly over all their edges.

    Growth is the one with the least sum of bounded squares; its standard deviation is that of the growths of single
    sheets where there are three or more, else a step of the growths that are tried. raster_mm: pixel of the pages'
    raster.
    """
    dark = np.concatenate([one.dark for one in sheets], axis=2)
    numbers = np.concatenate([one.numbers for one in sheets], axis=1)
    varying = np.concatenate([one.varying for one in sheets], axis=1)
    pixels = _best_growth(dark, numbers)
    kernels = [_kernel(one, seen)[0] for one, seen in zip(between(dark, pixels), numbers, strict=True)]
    off = [
        (seen - _shown(one, kernel))[around > VARYING] / around[around > VARYING]
        for one, kernel, seen, around in zip(between(dark, pixels), kernels, numbers, varying, strict=True)
    ]
    edge_sd = float(np.quantile(np.abs(np.concatenate(off)), OUTER)) / 2 if any(map(len, off)) else 0.0
    each = [_best_growth(one.dark, one.numbers) for one in sheets] if len(sheets) > LEAST_OTHERS else []
    growth_sd = float(np.std(each, ddof=1)) if each else GROWN_PIXELS / (GROWTHS - 1)
    um = raster_mm * UM_PER_MM
    return SignalChain(
        growth_um=pixels * um,
        growth_sd_um=growth_sd * um,
        kernels=np.array(kernels),
        edge_sd=edge_sd,
        sheets=len(sheets),
    )


def chains_of(edges: Mapping[str, SheetEdges], raster_mm: float) -> dict[str, SignalChain]:
    """Return the chain for each page by its name: of the other sheets where these suffice, and of all for others."""
    if not edges:
        return {}
    chains = {"": fitted_chain(list(edges.values()), raster_mm)}
    if len(edges) > LEAST_OTHERS:
        for name in edges:
            others = [one for other, one in edges.items() if other != name]
            chains[name] = fitted_chain(others, raster_mm)
    return chains


def _best_growth(dark: NDArray[np.float32], numbers: NDArray[np.float32]) -> float:
    """Return the growth at which the chain explains most. [pixels of the raster]"""
    tried = np.linspace(0, GROWN_PIXELS, GROWTHS)
    cost = np.array(
        [
            sum(_kernel(one, seen)[1] for one, seen in zip(between(dark, growth), numbers, strict=True))
            for growth in tried
        ]
    )
    best = int(cost.argmin())
    if best in (0, GROWTHS - 1):
        return float(tried[best])
    before, least, after = cost[best - 1 : best + 2]
    return float(tried[best] + (before - after) / (before - 2 * least + after) / 2 * (tried[1] - tried[0]))


def _kernel(dark: NDArray[np.float32], numbers: NDArray[np.float32]) -> tuple[NDArray[np.float64], float]:
    """Return the weights of rings that explain one channel, and the sum of bounded squares that is left.

    They add up to 1: how light and dark a sheet is belongs to its tone, which is fitted first. What is clipped at
    white says only that the light is not less. dark : (samples, rings)
    """
    whole, others = dark[:, 0], dark[:, 1:] - dark[:, :1]
    weights = np.zeros(others.shape[1])
    for _ in range(ROUNDS):
        light = 1 - whole - others @ weights
        off = numbers - to_numbers(np.minimum(light, 1))
        counts = (light < 1) | (numbers < 1)
        slopes = -others * slope_of_numbers(np.clip(light, 0, 1))[:, None]
        trust = counts / (1 + (off / DOUBT) ** 2)
        weighted = (slopes * trust[:, None]).T
        weights = weights + np.linalg.solve(weighted @ slopes + RIDGE * np.eye(len(weights)), weighted @ off)
    weights = np.concatenate([[1 - weights.sum()], weights])
    off = numbers - _shown(dark, weights)
    return weights, float((off**2 / (1 + (off / DOUBT) ** 2)).sum())


def _shown(dark: NDArray[np.float32], weights: NDArray[np.float64]) -> NDArray[np.float32]:
    return to_numbers(1 - dark @ weights)
