"""Compiled loops that displace images to a page's placement, by displacements that are linear between nodes."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel

STRETCH = 16
"""Pixels between nodes, along lines and across them."""
CELL, CELL_LINES = 4 * STRETCH, STRETCH // 2
"""Width and height of cells that are left out where they show nothing."""
_HALF = np.float32(0.5)


@inner_kernel()
def node_row(nodes, line, out):  # type: ignore[no-untyped-def]
    """Interpolate one line at node columns, linear between rows of nodes ``STRETCH`` lines apart."""
    cell = min(line // STRETCH, nodes.shape[0] - 2)
    share = np.float32((line - cell * STRETCH) / STRETCH)
    for k in range(out.size):
        out[k] = nodes[cell, k] + share * (nodes[cell + 1, k] - nodes[cell, k])


@inner_kernel()
def aimed(off, k, start, count):  # type: ignore[no-untyped-def]
    """Return the whole pixels by which a stretch is displaced, the remainder at its first pixel, and its slope."""
    slope = (off[k + 1] - off[k]) / np.float32(STRETCH)
    whole = np.int64(np.floor(off[k] + slope * np.float32(count) * _HALF))
    return whole, np.float32(off[k] - whole), np.float32(slope)


@inner_kernel(fastmath=True, error_model="numpy")
def aim_line(right, down, pixels, whole, shares):  # type: ignore[no-untyped-def]
    """Split the displacement of a line, right and down at nodes, into whole pixels and remainders.

    Written: whole (2, stretches), the whole pixels of each stretch, right and down; shares (2, pixels), the
    remainder at each pixel.
    """
    for k in range(whole.shape[1]):
        start = k * STRETCH
        count = min(STRETCH, pixels - start)
        whole[0, k], x0, x_slope = aimed(right, k, start, count)
        whole[1, k], y0, y_slope = aimed(down, k, start, count)
        u, v = shares[0, start : start + count], shares[1, start : start + count]
        for i in range(count):
            u[i] = x0 + x_slope * np.float32(i)
            v[i] = y0 + y_slope * np.float32(i)


@inner_kernel(fastmath=True, error_model="numpy")
def move_run(above, below, unit, u, v, out):  # type: ignore[no-untyped-def]
    """Interpolate bilinearly between two rows of neighbours, one longer than out (n,), in levels of a unit."""
    for i in range(out.size):
        a, b = np.float32(above[i]), np.float32(below[i])
        p = a + u[i] * (np.float32(above[i + 1]) - a)
        q = b + u[i] * (np.float32(below[i + 1]) - b)
        out[i] = unit * (p + v[i] * (q - p))


@inner_kernel(fastmath=True, error_model="numpy")
def move_edge(image, unit, left, top, u, v, out):  # type: ignore[no-untyped-def]
    """Interpolate the same way in an image from (top, left) on, with a border; 0 beyond."""
    lines, pixels = image.shape
    one = np.float32(1)
    for i in range(out.size):
        out[i] = np.float32(0)
        for j in range(2):
            for n in range(2):
                x, y = left + i + n, top + j
                if 0 <= x < pixels and 0 <= y < lines:
                    share = (u[i] if n else one - u[i]) * (v[i] if j else one - v[i])
                    out[i] += share * (unit * np.float32(image[y, x]))


@inner_kernel()
def move_span(image, unit, left, top, u, v, out):  # type: ignore[no-untyped-def]
    """Interpolate part of a line, out (n,), u, v (n,) beyond neighbours from (top, left) on, inside and at borders."""
    lines, pixels = image.shape
    if left >= 0 and left + out.size < pixels and top >= 0 and top + 2 <= lines:
        size = out.size + 1
        move_run(image[top, left : left + size], image[top + 1, left : left + size], unit, u, v, out)
        return
    first, last = max(0, -left), min(out.size, pixels - 1 - left)
    if first >= last or top < 0 or top + 2 > lines:
        move_edge(image, unit, left, top, u, v, out)
        return
    inner = slice(left + first, left + last + 1)
    above, below = image[top, inner], image[top + 1, inner]
    move_run(above, below, unit, u[first:last], v[first:last], out[first:last])
    move_edge(image, unit, left, top, u[:first], v[:first], out[:first])
    move_edge(image, unit, left + last, top, u[last:], v[last:], out[last:])


@inner_kernel()
def move_line(image, unit, line, whole, shares, begin, end, out):  # type: ignore[no-untyped-def]
    """Displace stretches begin .. end - 1 of one line of an image to out (pixels,) as from ``aim_line``.

    Equal stretches are processed at once.
    """
    start = begin * STRETCH
    for k in range(begin, end):
        right, down = whole[0, k], whole[1, k]
        if k + 1 < end and whole[0, k + 1] == right and whole[1, k + 1] == down:
            continue
        stop = min((k + 1) * STRETCH, out.size)
        u, v = shares[0, start:stop], shares[1, start:stop]
        move_span(image, unit, start + right, line + down, u, v, out[start:stop])
        start = stop


@inner_kernel()
def add_shown(row, shown):  # type: ignore[no-untyped-def]
    """Set shown (pixels,) to 1 where a row is not 0."""
    for x in range(row.size):
        shown[x] |= np.uint8(row[x] != 0)


@inner_kernel()
def any_of(shown):  # type: ignore[no-untyped-def]
    """Return the bits that any of shown (n,) has."""
    bits = np.uint8(0)
    for x in range(shown.size):
        bits |= shown[x]
    return bits


@kernel("image (L, P), scale, levels (L, P)")
def quantise(image, scale, levels):  # type: ignore[no-untyped-def]
    """Compute levels (lines, pixels) uint16: an image times ``scale``, rounded."""
    for line in range(levels.shape[0]):
        quantise_row(image[line], scale, levels[line])


@inner_kernel()
def quantise_row(row, scale, levels):  # type: ignore[no-untyped-def]
    """Run ``quantise`` on a row (n,)."""
    for x in range(levels.size):
        levels[x] = np.uint16(np.int32(np.rint(row[x] * scale)))


@kernel("images (N, L, P), out (N, (L + CELL_LINES - 1) // CELL_LINES, (P + CELL - 1) // CELL)")
def find_filled(images, out):  # type: ignore[no-untyped-def]
    """Compute which cells of images (n, lines, pixels) show anything, out (n, ., .) uint8."""
    shown = np.empty(images.shape[2], np.uint8)
    for n in range(out.shape[0]):
        for row in range(out.shape[1]):
            for x in range(shown.size):
                shown[x] = np.uint8(0)
            for line in range(row * CELL_LINES, min((row + 1) * CELL_LINES, images.shape[1])):
                add_shown(images[n, line], shown)
            for cell in range(out.shape[2]):
                out[n, row, cell] = any_of(shown[cell * CELL : (cell + 1) * CELL])


@inner_kernel()
def cells_seen(filled, lines, low, high, pixels, cells):  # type: ignore[no-untyped-def]
    """Compute which cells (n,) of some lines see anything that is displaced by ``low`` to ``high`` pixels.

    filled: as from ``find_filled``; lines: the first that are seen, and the one beyond.
    """
    first, stop = lines
    for n in range(cells.size):
        left, right = max(n * CELL + low, 0), min((n + 1) * CELL + high, pixels)
        cells[n] = False
        for row in range(first // CELL_LINES, (stop + CELL_LINES - 1) // CELL_LINES):
            for cell in range(left // CELL, (right + CELL - 1) // CELL):
                cells[n] |= filled[row, cell] != 0


@inner_kernel()
def clear(row):  # type: ignore[no-untyped-def]
    """Set a row to 0."""
    for x in range(row.size):
        row[x] = np.float32(0)


@kernel(
    "images (N, L, P), units (N), filled (N, (L + CELL_LINES - 1) // CELL_LINES, (P + CELL - 1) // CELL), which (_), "
    "across (R, C), along (R, C), blank, out (N, L, P)",
    where="R >= 2, (R - 1) * STRETCH >= L, (C - 1) * STRETCH >= P",
)
def move_smooth(images, units, filled, which, across, along, blank, out):  # type: ignore[no-untyped-def]
    """Sample some of images (n, lines, pixels) at pixel + across, line + along (nodes) to out, bilinear; 0 beyond.

    They are float32, or uint16 levels; units (n,): value of 1 in each; filled: as from ``find_filled``.
    Some lines of all images are processed at a time, one image after the other, so that pixels and positions
    stay in the cache. Cells without content are not interpolated: most of a page has none of most inks. They are set to
    0 from image ``blank`` on, and left as they are in the images before. Returned: which cells, ``CELL`` pixels of
    ``STRETCH`` lines, of each image have content, (images of ``which``, ., .).
    """
    lines, pixels = images.shape[1:]
    right, down = np.empty(across.shape[1], np.float32), np.empty(across.shape[1], np.float32)
    whole = np.empty((STRETCH, 2, (pixels + STRETCH - 1) // STRETCH), np.int64)
    shares = np.empty((STRETCH, 2, pixels), np.float32)
    shown = np.empty((which.size, (lines + STRETCH - 1) // STRETCH, (pixels + CELL - 1) // CELL), np.bool_)
    for first in range(0, lines, STRETCH):
        count = min(STRETCH, lines - first)
        for i in range(count):
            node_row(across, first + i, right)
            node_row(along, first + i, down)
            aim_line(right, down, pixels, whole[i], shares[i])
        top = min(max(first + whole[:count, 1].min(), 0), lines)  # a wrong page may lie anywhere
        stop = max(min(first + count + whole[:count, 1].max() + 1, lines), top)
        low, high = whole[:count, 0].min(), whole[:count, 0].max() + 1
        for place in range(which.size):
            n = which[place]
            cells = shown[place, first // STRETCH]
            cells_seen(filled[n], (top, stop), low, high, pixels, cells)
            end = 0
            while end < cells.size:
                begin, end = end, end + 1
                seen = cells[begin]
                while end < cells.size and cells[end] == seen:
                    end += 1
                if not seen and n < blank:
                    continue
                x0, x1 = begin * CELL, min(end * CELL, pixels)
                for line in range(first, first + count):
                    if seen:
                        i, last = line - first, (x1 + STRETCH - 1) // STRETCH
                        move_line(
                            images[n], units[n], line, whole[i], shares[i], x0 // STRETCH, last, out[n, line]
                        )
                    else:
                        clear(out[n, line, x0:x1])
    return shown


@kernel(
    "across (R, C), along (R, C), left, right, top, bottom, out (L, P)",
    where="R >= 2, (R - 1) * STRETCH >= L, (C - 1) * STRETCH >= P",
    fastmath=True,
    error_model="numpy",
)
def within(across, along, left, right, top, bottom, out):  # type: ignore[no-untyped-def]
    """Compute which pixels see a point between left and right, top and bottom [pixels]; out (lines, pixels) uint8."""
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
