"""Compiled loops of the lens correction: block means, small convolutions, what they add to every line."""

from __future__ import annotations

import numpy as np
from numba import njit

from prooflight.pages.sampling import NEAR_REACH


@njit(cache=True, nogil=True)
def block_means(image, block, first_row, last_row, means):  # type: ignore[no-untyped-def]
    """Means of image (lines, pixels) over square blocks -> means[first_row:last_row]; outside the image is 0."""
    lines, pixels = image.shape
    share = np.float32(1 / block**2)
    for row in range(first_row, last_row):
        out = means[row]
        out[:] = 0
        for line in range(row * block, min((row + 1) * block, lines)):
            source = image[line]
            for column in range(pixels // block):
                total = np.float32(0)
                for i in range(column * block, (column + 1) * block):
                    total += source[i]
                out[column] += share * total
            for i in range(pixels // block * block, pixels):
                out[pixels // block] += share * source[i]


@njit(cache=True, nogil=True)
def convolve(image, weights, out):  # type: ignore[no-untyped-def]
    """Plain convolution of a small image with symmetric weights (2 n + 1, 2 n + 1); outside the image is 0."""
    rows, columns = image.shape
    reach = weights.shape[0] // 2
    out[:] = 0
    for row in range(rows):
        target = out[row]
        for dy in range(max(-reach, -row), min(reach, rows - 1 - row) + 1):
            source = image[row + dy]
            for dx in range(max(-reach, 1 - columns), min(reach, columns - 1) + 1):
                weight = weights[reach + dy, reach + dx]
                start = max(0, -dx)
                count = columns - abs(dx)
                seen = source[start + dx : start + dx + count]
                part = target[start : start + count]
                for i in range(count):
                    part[i] += weight * seen[i]


@njit(cache=True, nogil=True)
def between_rows(image, block, line, out):  # type: ignore[no-untyped-def]
    """The row of block values that a line lies at, linear between the blocks' centres, level beyond the outer ones."""
    place = min(max((line + 0.5) / block - 0.5, 0.0), image.shape[0] - 1.0)
    above = int(place)
    below = min(above + 1, image.shape[0] - 1)
    share = np.float32(place - above)
    for i in range(out.size):
        out[i] = image[above, i] + share * (image[below, i] - image[above, i])


@njit(cache=True, nogil=True)
def add_between(row, block, line):  # type: ignore[no-untyped-def]
    """Line (pixels,) += what a row of block values is there, linear between their centres, level at the ends."""
    last = row.size - 1
    half = block // 2
    for i in range(min(half, line.size)):
        line[i] += row[0]
    full = max(min(last, (line.size - half) // block), 0)
    for phase in range(block):
        share = np.float32((phase + 0.5) / block)
        for cell in range(full):
            line[half + cell * block + phase] += row[cell] + share * (row[cell + 1] - row[cell])
    for i in range(half + full * block, line.size):
        cell = min((i - half) // block, last)
        share = np.float32((i - half - cell * block + 0.5) / block)
        line[i] += row[cell] + share * (row[min(cell + 1, last)] - row[cell])


@njit(cache=True, nogil=True)
def add_blocks(blocks, block, image):  # type: ignore[no-untyped-def]
    """Image (lines, pixels) += block values, bilinear between their centres."""
    row = np.empty(blocks.shape[1], np.float32)
    for line in range(image.shape[0]):
        between_rows(blocks, block, line, row)
        add_between(row, block, image[line])


@njit(cache=True, nogil=True)
def near_line(rows, sums, weights, out):  # type: ignore[no-untyped-def]
    """One line by its neighbours: rows (7, pixels + 6), the line in the middle; out (pixels,).

    weights (4, 4): of pixels so many lines and pixels away. sums (pixels + 6,) is working space.
    """
    reach = NEAR_REACH
    for dy in range(reach + 1):
        if dy == 0:
            sums[:] = rows[reach]
        else:
            above, below = rows[reach - dy], rows[reach + dy]
            for i in range(sums.size):
                sums[i] = above[i] + below[i]
        w0, w1, w2, w3 = weights[dy, 0], weights[dy, 1], weights[dy, 2], weights[dy, 3]
        a, b, c, d = sums[0:], sums[1:], sums[2:], sums[3:]
        e, f, g = sums[4:], sums[5:], sums[6:]
        if dy == 0:
            for i in range(out.size):
                out[i] = w3 * (a[i] + g[i]) + w2 * (b[i] + f[i]) + w1 * (c[i] + e[i]) + w0 * d[i]
        else:
            for i in range(out.size):
                out[i] += w3 * (a[i] + g[i]) + w2 * (b[i] + f[i]) + w1 * (c[i] + e[i]) + w0 * d[i]


@njit(cache=True, nogil=True)
def correct_lines(light, above, below, weights, far, block, line_from, line_to):  # type: ignore[no-untyped-def]
    """Lines line_from .. line_to - 1 of light (lines, pixels) corrected in place.

    above, below (3, pixels): the uncorrected lines before and after these, which another thread may be changing.
    weights (4, 4) as in ``near_line``; far: block values to be added. Even neighbourhoods are only scaled.
    """
    pixels = light.shape[1]
    reach = NEAR_REACH
    window = 2 * reach + 1
    rows = np.zeros((window, pixels + 2 * reach), np.float32)
    sums = np.empty(pixels + 2 * reach, np.float32)
    far_row = np.empty(far.shape[1], np.float32)
    for n in range(window - 1):
        line = line_from - reach + n
        if line < line_from:
            rows[n + 1, reach : reach + pixels] = above[n]
        elif line < line_to:
            rows[n + 1, reach : reach + pixels] = light[line]
        else:
            rows[n + 1, reach : reach + pixels] = below[line - line_to]
    for line in range(line_from, line_to):
        for n in range(window - 1):
            rows[n] = rows[n + 1]
        ahead = line + reach
        rows[window - 1, reach : reach + pixels] = light[ahead] if ahead < line_to else below[ahead - line_to]
        near_line(rows, sums, weights, light[line])
        between_rows(far, block, line, far_row)
        add_between(far_row, block, light[line])
