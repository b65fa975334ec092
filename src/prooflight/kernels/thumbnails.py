"""Compiled loops over lines and thumbnails, on one core and without allocation."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel

SHRINK = 8
"""Camera pixels in a thumbnail's pixel, either way: 0.84 mm of the prototype's page."""
STEPS = 200
"""Steps of a thumbnail's byte in paper white."""


@inner_kernel()
def sum_eight(lines, first, sums):  # type: ignore[no-untyped-def]
    """Set sums (pixels,) uint32 to those of eight lines (n, pixels) uint16 from ``first`` on."""
    a, b, c, d = lines[first], lines[first + 1], lines[first + 2], lines[first + 3]
    e, f, g, h = lines[first + 4], lines[first + 5], lines[first + 6], lines[first + 7]
    for i in range(sums.size):
        upper = (np.uint32(a[i]) + np.uint32(b[i])) + (np.uint32(c[i]) + np.uint32(d[i]))
        lower = (np.uint32(e[i]) + np.uint32(f[i])) + (np.uint32(g[i]) + np.uint32(h[i]))
        sums[i] = np.uint32(upper + lower)


@inner_kernel()
def add_light(sums, scale, of_row):  # type: ignore[no-untyped-def]
    """Add the sums of eight lines (pixels,) to a row of light (columns,)."""
    for column in range(of_row.size):
        at = SHRINK * column
        left = sums[at] * scale[at] + sums[at + 1] * scale[at + 1]
        left += sums[at + 2] * scale[at + 2] + sums[at + 3] * scale[at + 3]
        right = sums[at + 4] * scale[at + 4] + sums[at + 5] * scale[at + 5]
        right += sums[at + 6] * scale[at + 6] + sums[at + 7] * scale[at + 7]
        of_row[column] += left + right


@kernel(
    "lines (N, P), summed, sums (P), scale (Q), light ((summed + N) // SHRINK, Q // SHRINK)",
    where="0 <= summed, Q <= P",
)
def shrink(lines, summed, sums, scale, light):  # type: ignore[no-untyped-def]
    """Add lines (n, pixels) uint16 of one sensor to light (rows, columns), rows of 8 lines; the remainder to sums.

    summed: number of lines already in sums (pixels,) uint32. scale (pixels,): light of a digital number in this
    mean.
    """
    row, n = 0, 0
    while n < lines.shape[0]:
        if summed == 0 and n + SHRINK <= lines.shape[0]:
            sum_eight(lines, n, sums)
            summed, n = SHRINK, n + SHRINK
        else:
            line = lines[n]
            for pixel in range(line.size):
                sums[pixel] += line[pixel]
            summed, n = summed + 1, n + 1
        if summed == SHRINK:
            add_light(sums, scale, light[row])
            sums[:] = 0
            summed, row = 0, row + 1


@kernel("light (R, _), level, reach, counts (R)")
def count_near(light, level, reach, counts):  # type: ignore[no-untyped-def]
    """Count each row's columns nearer to a level than reach; light (rows, columns), counts (rows,)."""
    for row in range(light.shape[0]):
        count = 0
        for column in range(light.shape[1]):
            count += abs(light[row, column] - level) < reach
        counts[row] = count


@kernel(
    "seen (R, C), here (R, C), there (R, C), box, skip (R), floor, blur, ink, least",
    where="0 < box[0], box[1] < R, 0 < box[2], box[3] < C",
)
def log_ratio(seen, here, there, box, skip, floor, blur, ink, least):  # type: ignore[no-untyped-def]
    """Return log P(seen | there) - log P(seen | here), where the two pages differ inside ``box``.

    seen (rows, columns) light; here, there: bytes of thumbnails. Residuals are normal with variance floor^2 +
    (blur slope)^2 + (ink darkness)^2, the greater of both pages', and count as no more than 3 standard
    deviations, for a misprint is neither page's. box: first and last row, first and last column, the last not
    included; skip (rows,): rows that do not count. Every fourth row is evaluated first, and no more where the
    sum is then below ``least``.
    """
    total, step = 0.0, 1.0 / STEPS
    for turn in range(4):
        for row in range(box[0] + turn, box[1], 4):
            if skip[row]:
                continue
            for column in range(box[2], box[3]):
                p, q = int(here[row, column]), int(there[row, column])
                if -2 <= p - q <= 2:
                    continue
                ax = int(here[row, column + 1]) - int(here[row, column - 1])
                ay = int(here[row + 1, column]) - int(here[row - 1, column])
                bx = int(there[row, column + 1]) - int(there[row, column - 1])
                by = int(there[row + 1, column]) - int(there[row - 1, column])
                slope2 = max(ax * ax + ay * ay, bx * bx + by * by) * (step * step / 4)
                dark = max(1 - min(p, q) * step, 0.0)
                variance = floor * floor + blur * blur * slope2 + ink * ink * dark * dark
                from_a, from_b = seen[row, column] - p * step, seen[row, column] - q * step
                total += min(from_a * from_a / variance, 9.0) - min(from_b * from_b / variance, 9.0)
        if total / 2 < least:
            break
    return total / 2
