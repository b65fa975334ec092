"""Compiled loops for extremes of small windows by class of place, and for pixels that differ by a stated share."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.extremes import greatest_of
from prooflight.kernels.prediction.filtering import copy_row

WINDOWS = (1, 2, 4, 8)
"""Sides of the windows, each twice the one before. [pixels]"""
SIZES = len(WINDOWS)
TALLEST = WINDOWS[-1]
_LINES = (2, 3, 5, 1)
"""Number of lines whose sums over windows of each size are kept: as many as the next size is made of."""
CLASSES = 6
"""Classes of places: bare paper, flat tint, gradient, edge, text, border."""
NOT_INSPECTED = 255
"""Stands for the class of a place that is not inspected."""
_BARE, _BORDER = 0, 5
GRADIENT, EDGE, TEXT, INKED, ROUGH, OF_DESIGN = (np.uint8(1 << bit) for bit in range(6))
"""Traits of places: the slope of light reaches each of three limits, there is ink, the slope is too steep for the
floor, and an edge is part of the design. Windows have those of all places near by."""
_MOST_COUNT = 255
"""Greatest number that a byte can count to."""
LEAST_T = np.float32(2.5)
"""Least deviation that is noted: 1.2 % of Gaussian noise are beyond."""
_AT_ONCE = 64
"""Flags of windows that are tested at once, as numbers of 8 bytes."""
_LEAST_POWER = np.float32(1.0)
"""Information below which a window says nothing: it could not tell whether all of its light is gone."""


@inner_kernel(fastmath=True, error_model="numpy")
def slope_row(above, here, below, per_white, out):  # type: ignore[no-untyped-def]
    """Raise out (pixels,) to a row's slope of light, as a share of white's, where that is greater; not at its ends.

    per_white (pixels,): reciprocal of each column's white, so that columns of different gain make no slope.
    """
    for x in range(1, out.size - 1):
        across = (here[x + 1] * per_white[x + 1] - here[x - 1] * per_white[x - 1]) * np.float32(0.5)
        along = (below[x] - above[x]) * per_white[x] * np.float32(0.5)
        out[x] = max(out[x], np.sqrt(across * across + along * along))


@inner_kernel(error_model="numpy")
def hidden_row(squares, white, out):  # type: ignore[no-untyped-def]
    """Raise out (pixels,) to the slope of edges that do not show in the light, where that is greater.

    squares (pixels,): of the slope [DN^2/pixel^2]; white (pixels,): least of any sensor.
    """
    for x in range(out.size):
        out[x] = max(out[x], np.sqrt(max(squares[x], np.float32(0))) / white[x])


@inner_kernel(error_model="numpy")
def trait_row(slope, limits, floor, out):  # type: ignore[no-untyped-def]
    """Write the traits of the places of a row, out (pixels,) bytes, that have slopes from limits on."""
    gradient, edge, text, none = limits[0], limits[1], limits[2], np.uint8(0)
    for x in range(out.size):
        traits = (GRADIENT if slope[x] >= gradient else none) | (EDGE if slope[x] >= edge else none)
        traits |= (TEXT if slope[x] >= text else none) | (ROUGH if slope[x] >= floor else none)
        out[x] = traits


@inner_kernel(error_model="numpy")
def dark_row(light, white, share, out):  # type: ignore[no-untyped-def]
    """Mark the places of a row, out (pixels,) bytes, with no more than a share of white's light as inked."""
    for x in range(out.size):
        out[x] |= np.uint8(0) if light[x] > share * white[x] else INKED


@inner_kernel()
def design_row(inside, out):  # type: ignore[no-untyped-def]
    """Mark the design's edges in a row, out (pixels,) bytes: those inside the page, unlike the sheet's own."""
    for x in range(out.size):
        out[x] |= OF_DESIGN if (inside[x] != 0) & (out[x] & EDGE != 0) else np.uint8(0)


@kernel(
    "light (S, L, P), white (S, P), hidden (H, L, P), inside (L, P), limits (3), bare, floor, first, last, out (L, P)",
    where="0 <= first, last <= L",
    error_model="numpy",
)
def traits_of(light, white, hidden, inside, limits, bare, floor, first, last, out):  # type: ignore[no-untyped-def]
    """Write the traits of each place by itself, bytes (lines, pixels), lines first .. last - 1.

    limits: slopes from which a place is a gradient, an edge, and text [shares of white a pixel]; bare: share of white's
    light that paper exceeds; floor: slope from which the floor does not apply. hidden (sensors, or none, lines,
    pixels): squared slope of edges that do not show in the light [DN^2/pixel^2]; inside: bytes.
    """
    sensors, lines, pixels = light.shape
    per_white, least_white = np.float32(1) / white, white[0].copy()
    for s in range(1, sensors):
        least_white = np.minimum(least_white, white[s])
    slope = np.empty(pixels, np.float32)
    for line in range(first, last):
        slope[:] = np.float32(0)
        if 0 < line < lines - 1:
            for s in range(sensors):
                slope_row(light[s, line - 1], light[s, line], light[s, line + 1], per_white[s], slope)
        for s in range(hidden.shape[0]):
            hidden_row(hidden[s, line], least_white, slope)
        row = out[line]
        trait_row(slope, limits, floor, row)
        for s in range(sensors):
            dark_row(light[s, line], white[s], bare, row)
        design_row(inside[line], row)


@inner_kernel()
def join_row(row, out):  # type: ignore[no-untyped-def]
    """Add the traits of a row (pixels,) to another."""
    for x in range(out.size):
        out[x] |= row[x]


@kernel("traits (L, P), reach, first, last, out (L, P)", where="0 <= reach, 0 <= first, last <= L")
def spread_traits(traits, reach, first, last, out):  # type: ignore[no-untyped-def]
    """Write the traits of all places within ``reach`` lines and pixels of each, bytes, lines first .. last - 1."""
    lines, pixels = traits.shape
    near = np.zeros(pixels + 2 * reach, np.uint8)
    for line in range(first, last):
        of_lines, row = near[reach : reach + pixels], out[line]
        of_lines[:] = np.uint8(0)
        for other in range(max(line - reach, 0), min(line + reach + 1, lines)):
            join_row(traits[other], of_lines)
        row[:] = np.uint8(0)
        for shift in range(2 * reach + 1):
            join_row(near[shift : shift + pixels], row)


@inner_kernel()
def class_row(traits, of_border, border, inside, out):  # type: ignore[no-untyped-def]
    """Write the class of each place of a row (pixels,)."""
    for x in range(out.size):
        near = traits[x]
        which = np.uint8(1) + np.uint8(near & GRADIENT != 0)
        which += np.uint8(near & EDGE != 0) + np.uint8(near & TEXT != 0)
        which = which if near & (INKED | EDGE) != 0 else np.uint8(_BARE)
        which = which if border[x] | (near & of_border) != 0 else np.uint8(_BORDER)
        out[x] = which if inside[x] != 0 else np.uint8(NOT_INSPECTED)


@inner_kernel()
def count_row(classes, which, counts):  # type: ignore[no-untyped-def]
    """Count up the columns (pixels,) bytes at which a row is of a class."""
    for x in range(classes.size):
        counts[x] += np.uint8(classes[x] == which)


@kernel(
    "traits (L, P), of_border, border (L, P), inside (L, P), first, last, out (L, P), counts (CLASSES)",
    where="0 <= first, last <= L",
)
def classes_of(traits, of_border, border, inside, first, last, out, counts):  # type: ignore[no-untyped-def]
    """Write the class of each place (lines, pixels), and add how many there are of each to counts (classes,).

    Lines first .. last - 1 are written. All arrays are bytes: the traits of all places near by, whether all are inside
    the border, and whether the place is inspected. of_border: trait whose places are of no border; 0: all may be.
    """
    columns = np.zeros((CLASSES, traits.shape[1]), np.uint8)
    for begin in range(first, last, _MOST_COUNT):
        end = min(begin + _MOST_COUNT, last)
        columns[:] = np.uint8(0)
        for line in range(begin, end):
            class_row(traits[line], of_border, border[line], inside[line], out[line])
            for which in range(CLASSES):
                count_row(out[line], np.uint8(which), columns[which])
        for which in range(CLASSES):
            counts[which] += columns[which].sum()


@inner_kernel(fastmath=True, error_model="numpy")
def evidence_row(residual, weight, light, push, power):  # type: ignore[no-untyped-def]
    """Compute a row's evidence (pixels,) of a relative change of light: r light / V, and light^2 / V."""
    for x in range(residual.size):
        weighted_light = weight[x] * light[x]
        push[x] = residual[x] * weighted_light
        power[x] = light[x] * weighted_light


@inner_kernel(fastmath=True, error_model="numpy")
def quadrupled(above, here, step, count, out):  # type: ignore[no-untyped-def]
    """Add the first ``count`` of two rows of sums to those ``step`` further on."""
    # Slices, so that the compiler knows that no index is negative, and the loop runs in vectors.
    above_left, above_right, left, right = above[:count], above[step:], here[:count], here[step:]
    for x in range(left.size):
        out[x] = above_left[x] + above_right[x] + left[x] + right[x]


@inner_kernel(error_model="numpy")
def flag_row(push, power, tolerance, flags):  # type: ignore[no-untyped-def]
    """Flag the windows of a row (pixels,) that deviate by ``LEAST_T`` or more and say anything at all; flags: bytes."""
    for x in range(push.size):
        own_power = power[x]
        scatter = own_power + tolerance * own_power * own_power
        beyond = push[x] * push[x] >= LEAST_T * LEAST_T * scatter
        flags[x] = np.uint8(beyond & (own_power >= _LEAST_POWER))


@inner_kernel(error_model="numpy")
def note_row(push, power, tolerance, specks, count, places, line, size, flags, most, at, beyond):  # type: ignore[no-untyped-def]
    """Record the windows of a row that deviate by ``LEAST_T`` or more, by the class of the pixel in their middle.

    specks: share of its light that a benign speck may take from a window of this size. flags (pixels,): working
    space, a multiple of ``_AT_ONCE`` bytes that are 0 from ``count`` on.
    """
    half = WINDOWS[size] // 2
    flag_row(push[:count], power[:count], tolerance, flags[:count])
    groups = flags.view(np.uint64)
    for first in range(0, count, _AT_ONCE):  # one window in five hundred is flagged
        any_of = np.uint64(0)
        for n in range(_AT_ONCE // 8):
            any_of |= groups[first // 8 + n]
        if any_of == 0:
            continue
        for x in range(first, min(first + _AT_ONCE, count)):
            if flags[x] == 0 or places[x + half] >= CLASSES:
                continue
            which = places[x + half]
            scatter = power[x] + tolerance * power[x] * power[x]
            beyond[which, size] += 1
            sign = 0 if push[x] > 0 else 1
            deviation = push[x] if push[x] > 0 else min(push[x] + specks * power[x], np.float32(0))
            square = deviation * deviation / scatter
            if square > most[which, size, sign]:
                most[which, size, sign] = square
                at[which, size, sign, 0] = line
                at[which, size, sign, 1] = x


@kernel(
    "residual (S, L, P), weight (S, L, P), light (S, L, P), places (SIZES, L, P), tolerance, specks (SIZES), "
    "first, last, most (CLASSES, SIZES, 2), at (CLASSES, SIZES, 2, 2), beyond (CLASSES, SIZES)",
    where="0 <= first, last <= L",
    error_model="numpy",
)
def window_extremes(  # type: ignore[no-untyped-def]
    residual, weight, light, places, tolerance, specks, first, last, most, at, beyond
):
    """Find extremes of T over windows of every size, of each sensor and, where there are several, of all together.

    A window's T is N / sqrt(D + tolerance D^2), N = sum light r / V, D = sum light^2 / V: the deviation of
    its light in standard deviations of noise and of a relative tolerance, whose square is ``tolerance``. Of a
    darker window, as much as benign specks may take from its light, ``specks`` (sizes,), is taken off N first.
    places (sizes, lines, pixels): class of each place, for windows of each size about it. Written, for
    windows whose last line is first .. last - 1: most, the greatest T squared of both signs, lighter and
    darker; at, first line and first pixel of that window; beyond, how many windows deviate by ``LEAST_T`` or
    more, specks included.
    """
    sensors, _, pixels = residual.shape
    channels = sensors + 1 if sensors > 1 else 1
    # A window is made of four of half its side, so that sums are the same however threads divide the lines.
    ring = np.empty((channels, SIZES, 2, max(_LINES), pixels), np.float32)
    flags = np.zeros((SIZES, -(-pixels // _AT_ONCE) * _AT_ONCE), np.uint8)
    above = max(first - TALLEST + 1, 0)
    for line in range(above, last):
        slot = line % _LINES[0]
        for s in range(sensors):
            push, power = ring[s, 0, 0, slot], ring[s, 0, 1, slot]
            evidence_row(residual[s, line], weight[s, line], light[s, line], push, power)
        if channels > 1:
            for part in range(2):
                copy_row(ring[0, 0, part, slot], ring[sensors, 0, part, slot])
                for s in range(1, sensors):
                    pair_rows(ring[s, 0, part, slot], ring[sensors, 0, part, slot])
        for channel in range(channels):
            count = pixels
            for size in range(SIZES):
                top = line - WINDOWS[size] + 1
                if top < above:
                    break
                slot = line % _LINES[size]
                push, power = ring[channel, size, 0, slot], ring[channel, size, 1, slot]
                if size > 0:
                    step = WINDOWS[size - 1]
                    count -= step
                    before, here = (line - step) % _LINES[size - 1], line % _LINES[size - 1]
                    pushes, powers = ring[channel, size - 1, 0], ring[channel, size - 1, 1]
                    quadrupled(pushes[before], pushes[here], step, count, push)
                    quadrupled(powers[before], powers[here], step, count, power)
                if line < first:
                    continue
                note_row(
                    push,
                    power,
                    tolerance,
                    specks[size],
                    count,
                    places[size, top + WINDOWS[size] // 2],
                    top,
                    size,
                    flags[size],
                    most,
                    at,
                    beyond,
                )


@inner_kernel(fastmath=True, error_model="numpy")
def pair_rows(row, out):  # type: ignore[no-untyped-def]
    """Add a row to another, in place."""
    for x in range(out.size):
        out[x] += row[x]


@inner_kernel(fastmath=True, error_model="numpy")
def excess_row(residual, white, share, out):  # type: ignore[no-untyped-def]
    """Compute by how much the places of a row, out (pixels,), differ by more than a share of white."""
    for x in range(out.size):
        out[x] = abs(residual[x]) - share * white[x]


@kernel(
    "residual (S, L, P), weight (S, L, P), white (S, P), flat (L, P), share, least_z, first, last, out (2, L, P)",
    where="0 <= first, last <= L",
    error_model="numpy",
)
def beyond_share(residual, weight, white, flat, share, least_z, first, last, out):  # type: ignore[no-untyped-def]
    """Mark flat pixels of any sensor that differ by more than a share of white; return their number.

    out (2, lines, pixels) bytes, lighter and darker, lines first .. last - 1 of which are written; flat
    (lines, pixels) bytes. A pixel counts only where it deviates by ``least_z`` standard deviations too.
    """
    sensors, _, pixels = residual.shape
    excess, count = np.empty(pixels, np.float32), 0
    for line in range(first, last):
        out[0, line] = np.uint8(0)
        out[1, line] = np.uint8(0)
        for s in range(sensors):
            excess_row(residual[s, line], white[s], share, excess)
            if greatest_of(excess) <= 0:
                continue
            for x in range(pixels):
                if excess[x] <= 0 or flat[line, x] == 0:
                    continue
                r = residual[s, line, x]
                if r * r * weight[s, line, x] < least_z * least_z:
                    continue
                sign = 0 if r > 0 else 1
                count += 1 - out[sign, line, x]
                out[sign, line, x] = 1
    return count
