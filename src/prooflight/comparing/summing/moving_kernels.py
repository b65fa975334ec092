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
def move(image, across, along, out):  # type: ignore[no-untyped-def]
    """An image (lines, pixels) seen at pixel + across, line + along (nodes), by ``cubic``; its edge goes on beyond."""
    lines, pixels = image.shape
    right, down = np.empty(across.shape[1], np.float32), np.empty(across.shape[1], np.float32)
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
            left, top = start + whole_x - 1, line + whole_y - 1
            if left >= 0 and left + count + 3 <= pixels and top >= 0 and top + 4 <= lines:
                # Rows cut out: only an index that is surely not negative lets the loop run in vectors.
                end = left + count + 3
                top0, top1 = image[top, left:end], image[top + 1, left:end]
                top2, top3 = image[top + 2, left:end], image[top + 3, left:end]
                target = out[line, start : start + count]
                for i in range(count):
                    a, b, c, d = cubic(x0 + x_slope * np.float32(i))
                    e, f, g, h = cubic(y0 + y_slope * np.float32(i))
                    p = a * top0[i] + b * top0[i + 1] + c * top0[i + 2] + d * top0[i + 3]
                    q = a * top1[i] + b * top1[i + 1] + c * top1[i + 2] + d * top1[i + 3]
                    r = a * top2[i] + b * top2[i + 1] + c * top2[i + 2] + d * top2[i + 3]
                    s = a * top3[i] + b * top3[i + 1] + c * top3[i + 2] + d * top3[i + 3]
                    target[i] = e * p + f * q + g * r + h * s
            else:
                for i in range(count):
                    weights = cubic(x0 + x_slope * np.float32(i))
                    heights = cubic(y0 + y_slope * np.float32(i))
                    total = np.float32(0)
                    for j in range(4):
                        y = min(max(top + j, 0), lines - 1)
                        for n in range(4):
                            x = min(max(left + i + n, 0), pixels - 1)
                            total += heights[j] * weights[n] * image[y, x]
                    out[line, start + i] = total


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def move_shadow(shadow, across, along, right, down, light):  # type: ignore[no-untyped-def]
    """Light (lines, pixels) with a plane's shadow, seen at across, along, cast ``right`` and ``down`` of there."""
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
