"""Misprints of whole ink planes: one lost, two mixed up, too much or too little ink, one off its place, banding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_NAMES
from prooflight.simulation.misprints.drawing import (
    FULL,
    SAMPLE_STEP,
    Box,
    Drawn,
    Mishap,
    inks_named,
    plateau,
    rewrite,
)

WHOLE_PAGE_SHARE = 0.5
"""assumed: share of fading inks that cover the whole page rather than a band of it."""
LEAST_BAND_SHARE = 0.25
"""assumed: the least part of the page's height that such a band covers."""
FADE_MM = 5.0
"""assumed: distance over which an ink fades in and out at a band's ends."""
PULSE_SHARE = 0.2
"""assumed: share of a turn that a dent in a roller marks."""
ROOM = 0.1
"""assumed: least room for more ink: the change of the page by adding ink, over that by removing it."""


def missing_plane(mishap: Mishap) -> Drawn:
    """Fade or remove one ink, over the page or a band of it."""
    left = mishap.amount("ink_left_percent") / 100
    inks = mishap.one_ink()
    rows, columns = mishap.page.cmyk.shape[:2]
    if mishap.rng.random() < WHOLE_PAGE_SHARE:
        top, bottom, where, weight = 0, rows, "the page", np.ones(rows, np.float32)
    else:
        top, bottom = span(mishap.rng, rows)
        where, weight = "a band", plateau(bottom - top, FADE_MM / mishap.page.pixel_mm)
    box = Box(top=top, left=0, bottom=bottom, right=columns)
    cmyk = _gained(mishap, box, inks, (1 - (1 - left) * weight).astype(np.float32))
    return mishap.drawn(f"{inks_named(inks)} faded to {left:.0%} over {where}", cmyk=cmyk, boxes=[box])


def swapped_planes(mishap: Mishap) -> Drawn:
    """Print two inks from each other's plates, or partly so: a' = (1 - m) a + m b, and b' likewise."""
    mixed = mishap.amount("mix_percent") / 100
    first = mishap.one_ink().start
    second = int(mishap.rng.choice([ink for ink in range(4) if ink != first]))
    source, cmyk = mishap.page.cmyk, mishap.page.cmyk.copy()
    for ink, other in ((first, second), (second, first)):

        def mix(values: NDArray[np.float32], rows: slice, other: int = other) -> None:
            values *= np.float32(1 - mixed)
            values[..., 0] += source[rows, :, other] * np.float32(mixed)

        rewrite(cmyk, Box.whole(mishap.page), slice(ink, ink + 1), mix, mishap.rounding)
    detail = f"{INK_NAMES[first]} and {INK_NAMES[second]} exchanged by {mixed:.0%}"
    return mishap.drawn(detail, cmyk=cmyk)


def density(mishap: Mishap) -> Drawn:
    """Print too much or too little of one ink or of all; a full solid cannot take more."""
    gain = mishap.amount("gain_percent") / 100
    inks = mishap.one_or_all_inks()
    sample = mishap.page.cmyk[::SAMPLE_STEP, ::SAMPLE_STEP, inks].astype(np.float32)
    room = float((np.minimum(sample * (1 + gain), FULL) - sample).sum())
    more = mishap.rng.random() < 0.5 and room >= ROOM * gain * float(sample.sum())
    box = Box.whole(mishap.page)
    change = 1 + gain if more else 1 - gain
    cmyk = _gained(mishap, box, inks, np.full(box.shape[0], change, np.float32))
    detail = f"{gain:.0%} too {'much' if more else 'little'} of {inks_named(inks)}"
    return mishap.drawn(detail, cmyk=cmyk)


def plane_register(mishap: Mishap) -> Drawn:
    """Displace one plane by a distance in any direction, to the nearest raster pixel.

    It is not that of the ink that the page has the most of: the reference of the others is the page's place.
    The raster drawn into the page is the artwork's bleed, taken to go on as at the edge (3 mm are usual). On
    a page of one ink there is no reference: that is a page off its place, and nothing is changed.
    """
    distance_mm = mishap.amount("shift_mm")
    angle = mishap.rng.uniform(0, 2 * np.pi)
    present = mishap.inks()
    shares = mishap.ink_shares()
    ink = int(mishap.rng.choice(sorted(present, key=lambda one: shares[one])[:-1] or present))
    right_mm, down_mm = distance_mm * np.cos(angle), distance_mm * np.sin(angle)
    detail = (
        f"{INK_NAMES[ink]} {distance_mm:.2f} mm out of register: {abs(right_mm):.2f} mm "
        f"{'right' if right_mm > 0 else 'left'}, {abs(down_mm):.2f} mm {'down' if down_mm > 0 else 'up'}"
    )
    if len(present) == 1:
        return mishap.drawn(detail)
    cmyk = mishap.page.cmyk.copy()
    rows, columns = (
        np.clip(np.arange(count) - round(shift_mm / mishap.page.pixel_mm), 0, count - 1)
        for count, shift_mm in zip(cmyk.shape[:2], (down_mm, right_mm), strict=True)
    )
    plane = np.ascontiguousarray(mishap.page.cmyk[..., ink])
    cmyk[..., ink] = plane.take(columns, axis=1).take(rows, axis=0)
    return mishap.drawn(detail, cmyk=cmyk)


def banding(mishap: Mishap) -> Drawn:
    """Draw bands across the travel, once a period: an ink's gain swings, or a dent in a roller leaves a line a turn."""
    gain = mishap.amount("gain_percent") / 100
    period_mm = mishap.between("period_mm")
    inks, box = mishap.one_or_all_inks(), Box.whole(mishap.page)
    y_mm = (np.arange(box.shape[0]) + 0.5) * mishap.page.pixel_mm
    turn = (y_mm / period_mm + mishap.rng.random()) % 1
    dent = mishap.rng.random() < 0.5
    sign = 1 if mishap.rng.random() < 0.5 else -1
    if dent:
        inside = np.minimum(turn / PULSE_SHARE, 1)
        profile = sign * (0.5 - 0.5 * np.cos(2 * np.pi * inside))
    else:
        profile = np.sin(2 * np.pi * turn)
    cmyk = _gained(mishap, box, inks, (1 + gain * profile).astype(np.float32))
    shape = ("dark lines" if sign > 0 else "light lines") if dent else "waves"
    detail = f"{shape} of {gain:.1%} in {inks_named(inks)}, one every {period_mm:.1f} mm"
    return mishap.drawn(detail, cmyk=cmyk)


def span(rng: np.random.Generator, rows: int) -> tuple[int, int]:
    """Draw first and last + 1 row of a part of the page's height, at least a quarter of it."""
    length = max(int(rows * rng.uniform(LEAST_BAND_SHARE, 1.0)), 1)
    top = int(rng.random() * (rows - length + 1))
    return top, top + length


def _gained(mishap: Mishap, box: Box, inks: slice, gain: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the page with inks multiplied by a gain (rows of the box,)."""

    def multiply(values: NDArray[np.float32], rows: slice) -> None:
        values *= gain[rows, None, None]

    return mishap.rewritten(box, inks, multiply)
