"""Compiled loops: images moved to where a page lies, by displacements that are linear between nodes."""

from __future__ import annotations

import numpy as np
from numba import njit

STRETCH = 16
"""Pixels from node to node, along lines and across them."""
_HALF = np.float32(0.5)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def cubic(f):  # type: ignore[no-untyped-def]
    """Weights of four neighbours at f between the inner two: the cubic convolution that is exact for parabolas.

    Keys (1981), Cubic convolution interpolation for digital image processing, IEEE Trans. ASSP 29, a = -1/2.
    """
    return (
        _HALF * f * (f * (np.float32(2) - f) - np.float32(1)),
        np.float32(1) + f * f * (np.float32(1.5) * f - np.float32(2.5)),
        _HALF * f * (np.float32(1) + f * (np.float32(4) - np.float32(3) * f)),
        _HALF * f * f * (f - np.float32(1)),
    )


@njit(cache=True, nogil=True)
def node_row(nodes, line, out):  # type: ignore[no-untyped-def]
    """Values of one line at node columns, linear between rows of nodes ``STRETCH`` lines apart."""
    cell = min(line // STRETCH, nodes.shape[0] - 2)
    share = np.float32((line - cell * STRETCH) / STRETCH)
    for k in range(out.size):
        out[k] = nodes[cell, k] + share * (nodes[cell + 1, k] - nodes[cell, k])


@njit(cache=True, nogil=True)
def aimed(off, k, start, count):  # type: ignore[no-untyped-def]
    """Whole pixels by which a stretch is displaced, what is left at its first pixel, and what that grows by."""
    slope = (off[k + 1] - off[k]) / np.float32(STRETCH)
    whole = np.int64(np.floor(off[k] + slope * np.float32(count) * _HALF))
    return whole, np.float32(off[k] - whole), np.float32(slope)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def add_tap(first, second, third, fourth, x0, x_slope, y0, y_slope, tap, out):  # type: ignore[no-untyped-def]
    """Add one line of neighbours, the ``tap``-th of four, to a stretch of an image that is moved by ``cubic``."""
    for i in range(out.size):
        a, b, c, d = cubic(x0 + x_slope * np.float32(i))
        e, f, g, h = cubic(y0 + y_slope * np.float32(i))
        height = e if tap == 0 else (f if tap == 1 else (g if tap == 2 else h))
        out[i] += height * (a * first[i] + b * second[i] + c * third[i] + d * fourth[i])


@njit(cache=True, nogil=True)
def move(phases, across, along, out):  # type: ignore[no-untyped-def]
    """An image seen at pixel + across, line + along (nodes) of out (lines, pixels), by ``cubic``.

    phases (n, n, lines, pixels): [p, q] is an image n times as fine as out at lines n i + p and pixels n j + q; its
    edge goes on beyond.
    """
    n, lines, pixels = phases.shape[0], phases.shape[2], phases.shape[3]
    right, down = np.empty(across.shape[1], np.float32), np.empty(across.shape[1], np.float32)
    for line in range(lines):
        node_row(across, line, right)
        node_row(along, line, down)
        right *= np.float32(n)
        down *= np.float32(n)
        for k in range(right.size - 1):
            start = k * STRETCH
            count = min(STRETCH, pixels - start)
            if count <= 0:
                break
            whole_x, x0, x_slope = aimed(right, k, start, count)
            whole_y, y0, y_slope = aimed(down, k, start, count)
            left, top = n * start + whole_x - 1, n * line + whole_y - 1
            target = out[line, start : start + count]
            target[:] = 0
            inner = left >= 0 and left + n * (count - 1) + 4 <= n * pixels
            if inner and top >= 0 and top + 4 <= n * lines:
                for tap in range(4):
                    of = phases[(top + tap) % n, :, (top + tap) // n]
                    a, b = of[left % n, left // n :], of[(left + 1) % n, (left + 1) // n :]
                    c, d = of[(left + 2) % n, (left + 2) // n :], of[(left + 3) % n, (left + 3) // n :]
                    add_tap(a, b, c, d, x0, x_slope, y0, y_slope, tap, target)
            else:
                for i in range(count):
                    weights = cubic(x0 + x_slope * np.float32(i))
                    heights = cubic(y0 + y_slope * np.float32(i))
                    for j in range(4):
                        y = min(max(top + j, 0), n * lines - 1)
                        for m in range(4):
                            x = min(max(left + n * i + m, 0), n * pixels - 1)
                            target[i] += heights[j] * weights[m] * phases[y % n, x % n, y // n, x // n]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def move_shadow(shadow, across, along, right, down, light):  # type: ignore[no-untyped-def]
    """Light (lines, pixels) with a plane's shadow (1, 1, lines, pixels), as ``move`` takes it, cast right and down."""
    here, there = np.empty_like(light), np.empty_like(light)
    move(shadow, across, along, here)
    move(shadow, across - right, along - down, there)
    for line in range(light.shape[0]):
        target, more, less = light[line], here[line], there[line]
        for x in range(target.size):
            target[x] += more[x] - less[x]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def move_smooth(image, across, along, out):  # type: ignore[no-untyped-def]
    """``move``, bilinear; 0 beyond the image."""
    lines, pixels = image.shape
    right, down = np.empty(across.shape[1], np.float32), np.empty(across.shape[1], np.float32)
    one = np.float32(1)
    for line in range(lines):
        node_row(across, line, right)
        node_row(along, line, down)
        for k in range(right.size - 1):
            start = k * STRETCH
            count = min(STRETCH, pixels - start)
            if count <= 0:
                break
            whole_x, x0, x_slope = aimed(right, k, start, count)
            whole_y, y0, y_slope = aimed(down, k, start, count)
            left, top = start + whole_x, line + whole_y
            target = out[line, start : start + count]
            if left >= 0 and left + count + 1 <= pixels and top >= 0 and top + 2 <= lines:
                above, below = image[top, left : left + count + 1], image[top + 1, left : left + count + 1]
                for i in range(count):
                    u, v = x0 + x_slope * np.float32(i), y0 + y_slope * np.float32(i)
                    p = above[i] + u * (above[i + 1] - above[i])
                    q = below[i] + u * (below[i + 1] - below[i])
                    target[i] = p + v * (q - p)
            else:
                for i in range(count):
                    u, v = x0 + x_slope * np.float32(i), y0 + y_slope * np.float32(i)
                    target[i] = np.float32(0)
                    for j in range(2):
                        for n in range(2):
                            x, y = left + i + n, top + j
                            if 0 <= x < pixels and 0 <= y < lines:
                                target[i] += (u if n else one - u) * (v if j else one - v) * image[y, x]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def within(across, along, left, right, top, bottom, out):  # type: ignore[no-untyped-def]
    """Which pixels look between left and right, top and bottom [pixels]; out (lines, pixels) uint8."""
    lines, pixels = out.shape
    at_x, at_y = np.empty(across.shape[1], np.float32), np.empty(across.shape[1], np.float32)
    for line in range(lines):
        node_row(across, line, at_x)
        node_row(along, line, at_y)
        for k in range(at_x.size - 1):
            start = k * STRETCH
            x_slope = (at_x[k + 1] - at_x[k]) / np.float32(STRETCH) + np.float32(1)
            y_slope = (at_y[k + 1] - at_y[k]) / np.float32(STRETCH)
            x0, y0 = at_x[k] + np.float32(start), at_y[k] + np.float32(line)
            for i in range(min(STRETCH, pixels - start)):
                x, y = x0 + x_slope * np.float32(i), y0 + y_slope * np.float32(i)
                out[line, start + i] = (x > left) & (x < right) & (y > top) & (y < bottom)
