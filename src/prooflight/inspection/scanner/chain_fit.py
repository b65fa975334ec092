"""Fit of the signal chain of printer and scanner to the edges of the sheets themselves.

The chain has one growth and one kernel a channel for all edges of all sheets, so that no single misprint can bend it:
what it does not explain weighs little (Cauchy weights), and a sheet is judged by the chain of the others where there
are enough of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

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

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.base import PressContext
    from prooflight.pages.raster import Page

NEAR_PIXELS: Final = 7
"""Side of the squares about printed pixels whose pixels are samples."""
PRINTED: Final = 0.95
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
        (moved[-1].min(axis=0) < PRINTED).astype(np.uint8), np.ones((NEAR_PIXELS,) * 2, np.uint8)
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
