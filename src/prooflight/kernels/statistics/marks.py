"""Compiled loops for extremes of small windows by class of place, and for pixels that differ by a stated share."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel

WINDOWS = (1, 2, 4, 8)
"""Sides of the windows, each twice the one before. [pixels]"""
SIZES = len(WINDOWS)
TALLEST = WINDOWS[-1]
STRIP = 64
"""Lines after which sums start again, so that they do not depend, to the last bit, on how threads divide the
lines."""
CLASSES = 6
"""Classes of places: bare paper, flat tint, gradient, edge, text, border."""
NOT_INSPECTED = 255
"""Stands for the class of a place that is not inspected."""
_BARE, _GRADIENT, _BORDER = 0, 2, 5
LEAST_T = np.float32(2.5)
"""Least deviation that is noted: 1.2 % of Gaussian noise are beyond."""
_BLOCK = 64
_AT_ONCE = 8
"""Flags of windows that are tested at once, as one number."""
_LEAST_POWER = np.float32(1.0)
"""Information below which a window says nothing: it could not tell whether all of its light is gone. What sliding sums
leave of lines that were lost, by rounding, is less."""


@inner_kernel(fastmath=True, error_model="numpy")
def slope_row(above, here, below, per_white, out):  # type: ignore[no-untyped-def]
    """Raise out (pixels,) to a row's slope of light, as a share of white's, where that is greater; not at its ends.

    per_white (pixels,): reciprocal of each column's white, so that columns of different gain make no slope.
    """
    for x in range(1, out.size - 1):
        across = (here[x + 1] * per_white[x + 1] - here[x - 1] * per_white[x - 1]) * np.float32(0.5)
        along = (below[x] - above[x]) * per_white[x] * np.float32(0.5)
        out[x] = max(out[x], np.sqrt(across * across + along * along))


@kernel(
    "light (S, L, P), white (S, P), first, last, out (L, P)",
    where="0 <= first, last <= L",
    fastmath=True,
    error_model="numpy",
)
def slopes(light, white, first, last, out):  # type: ignore[no-untyped-def]
    """Compute the steepest slope of any sensor's light at each pixel, (lines, pixels), in shares of white a pixel.

    Lines first .. last - 1 are written; 0 at the edges of the field.
    """
    lines = light.shape[1]
    per_white = np.float32(1) / white
    for line in range(first, last):
        out[line] = np.float32(0)
        if 0 < line < lines - 1:
            for s in range(light.shape[0]):
                slope_row(light[s, line - 1], light[s, line], light[s, line + 1], per_white[s], out[line])


@inner_kernel(error_model="numpy")
def step_row(slope, limits, out):  # type: ignore[no-untyped-def]
    """Count for each place of a row how many limits its slope reaches, out (pixels,) bytes."""
    out[:] = np.uint8(0)
    for limit in limits:  # one after the other, so that the inner loop runs in vectors
        for x in range(out.size):
            out[x] += np.uint8(slope[x] >= limit)


@inner_kernel(error_model="numpy")
def bright_row(light, white, share, out):  # type: ignore[no-untyped-def]
    """Clear the places of a row, out (pixels,) bytes, with no more than a share of white's light."""
    for x in range(out.size):
        out[x] &= np.uint8(light[x] > share * white[x])


@kernel(
    "slope (L, P), light (S, L, P), white (S, P), limits (_), bare, first, last, steps (L, P), paper (L, P)",
    where="0 <= first, last <= L",
    error_model="numpy",
)
def steps_of(slope, light, white, limits, bare, first, last, steps, paper):  # type: ignore[no-untyped-def]
    """Compute how many limits the slope of each place reaches, and whether all sensors see bare paper there.

    Written: bytes (lines, pixels) of lines first .. last - 1. bare: share of white's light that paper exceeds.
    """
    for line in range(first, last):
        step_row(slope[line], limits, steps[line])
        paper[line] = np.uint8(1)
        for s in range(light.shape[0]):
            bright_row(light[s, line], white[s], bare, paper[line])


@inner_kernel()
def class_row(steps, bare, border, inside, out):  # type: ignore[no-untyped-def]
    """Write the class of each place of a row (pixels,)."""
    for x in range(out.size):
        which = steps[x] + np.uint8(1)
        which = np.uint8(_BARE) if bare[x] != 0 and which <= _GRADIENT else which
        which = np.uint8(_BORDER) if border[x] == 0 else which
        out[x] = which if inside[x] != 0 else np.uint8(NOT_INSPECTED)


@inner_kernel()
def count_row(classes, which):  # type: ignore[no-untyped-def]
    """Return how many places of a row are of a class."""
    count = 0
    for x in range(classes.size):
        count += classes[x] == which
    return count


@kernel(
    "steps (L, P), bare (L, P), border (L, P), inside (L, P), first, last, out (L, P), counts (CLASSES)",
    where="0 <= first, last <= L",
)
def classes_of(steps, bare, border, inside, first, last, out, counts):  # type: ignore[no-untyped-def]
    """Write the class of each place (lines, pixels), and add how many there are of each to counts (classes,).

    Lines first .. last - 1 are written. All arrays are bytes: how many limits the steepest slope near by exceeds, and
    whether all places near by are bare paper, inside the border, and inspected.
    """
    for line in range(first, last):
        class_row(steps[line], bare[line], border[line], inside[line], out[line])
        for which in range(CLASSES):
            counts[which] += count_row(out[line], np.uint8(which))


@inner_kernel(fastmath=True, error_model="numpy")
def evidence_row(residual, weight, light, push, power):  # type: ignore[no-untyped-def]
    """Compute a row's evidence (pixels,) of a relative change of light: r light / V, and light^2 / V."""
    for x in range(residual.size):
        weighted_light = weight[x] * light[x]
        push[x] = residual[x] * weighted_light
        power[x] = light[x] * weighted_light


@inner_kernel(fastmath=True, error_model="numpy")
def pair_up(row, step, count, out):  # type: ignore[no-untyped-def]
    """Add each of the first ``count`` of a row to the one ``step`` further on."""
    for x in range(count):
        out[x] = row[x] + row[x + step]


@inner_kernel(fastmath=True, error_model="numpy")
def slide(sums, new, old):  # type: ignore[no-untyped-def]
    """Move column sums (pixels,) on by a row."""
    for x in range(sums.size):
        sums[x] += new[x] - old[x]


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
    for group in range(groups.size):  # one window in a hundred is flagged
        if groups[group] == 0:
            continue
        for x in range(group * _AT_ONCE, (group + 1) * _AT_ONCE):
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
    where="0 <= first, last <= L, first % STRIP == 0",
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
    more, specks included. ``first`` is a multiple of ``STRIP``.
    """
    sensors, _, pixels = residual.shape
    channels = sensors + 1 if sensors > 1 else 1
    # Sums over windows are made of sums along a row, which each line makes once: twice as wide from as wide.
    ring = np.empty((channels, SIZES, 2, TALLEST + 1, pixels), np.float32)
    sums = np.zeros((channels, SIZES, 2, pixels), np.float32)
    flags = np.zeros((SIZES, -(-pixels // _AT_ONCE) * _AT_ONCE), np.uint8)
    for begin in range(first, last, STRIP):
        sums[:] = np.float32(0)
        above = max(begin - TALLEST + 1, 0)
        for line in range(above, min(begin + STRIP, last)):
            slot = line % (TALLEST + 1)
            for s in range(sensors):
                narrow = ring[s, 0]
                evidence_row(
                    residual[s, line], weight[s, line], light[s, line], narrow[0, slot], narrow[1, slot]
                )
            if channels > 1:
                for part in range(2):
                    ring[sensors, 0, part, slot] = ring[0, 0, part, slot]
                    for s in range(1, sensors):
                        pair_rows(ring[s, 0, part, slot], ring[sensors, 0, part, slot])
            for channel in range(channels):
                rows, count = ring[channel], pixels
                for size in range(SIZES):
                    tall = WINDOWS[size]
                    if size > 0:
                        step = WINDOWS[size - 1]
                        count -= step
                        for part in range(2):
                            pair_up(rows[size - 1, part, slot], step, count, rows[size, part, slot])
                    oldest = (line - tall) % (TALLEST + 1)
                    for part in range(2):
                        column_sums = sums[channel, size, part]
                        if line - tall >= above:
                            slide(column_sums, rows[size, part, slot], rows[size, part, oldest])
                        else:
                            pair_rows(rows[size, part, slot], column_sums)
                    top = line - tall + 1
                    if line < begin or top < 0:
                        continue
                    push, power = sums[channel, size, 0], sums[channel, size, 1]
                    classes = places[size, top + tall // 2]
                    note_row(
                        push,
                        power,
                        tolerance,
                        specks[size],
                        count,
                        classes,
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
    count = 0
    for line in range(first, last):
        out[0, line] = np.uint8(0)
        out[1, line] = np.uint8(0)
        for s in range(sensors):
            for begin in range(0, pixels, _BLOCK):
                end = min(begin + _BLOCK, pixels)
                most = np.float32(0)
                for x in range(begin, end):
                    most = max(most, abs(residual[s, line, x]) - share * white[s, x])
                if most <= 0:
                    continue
                for x in range(begin, end):
                    r = residual[s, line, x]
                    if abs(r) <= share * white[s, x] or flat[line, x] == 0:
                        continue
                    if r * r * weight[s, line, x] < least_z * least_z:
                        continue
                    sign = 0 if r > 0 else 1
                    count += 1 - out[sign, line, x]
                    out[sign, line, x] = 1
    return count
