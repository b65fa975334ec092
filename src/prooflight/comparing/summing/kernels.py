"""Compiled loops: block means for the nuisance fit, residuals without what was fitted, sums of modes over tiles."""

from __future__ import annotations

import numpy as np
from numba import njit

INKS = 4


@njit(cache=True, nogil=True, fastmath=True)
def shape_values(cover, centres, root, length, out):  # type: ignore[no-untyped-def]
    """Features of colour at one recipe: out = root @ k, k_j = exp(-|cover - centres_j|^2 / length^2)."""
    count = centres.shape[0]
    for j in range(count):
        out[j] = np.float32(0)
    for i in range(count):
        distance = np.float32(0)
        for ink in range(INKS):
            step = cover[ink] - centres[i, ink]
            distance += step * step
        value = np.exp(-distance / (length * length))
        for j in range(count):
            out[j] += root[j, i] * value


@njit(cache=True, nogil=True, fastmath=True)
def block_sums(  # type: ignore[no-untyped-def]
    measured, expected, offset, variance, inside, gain, dot, texture, cover, centres, root, length, side, out
):
    """Sums over blocks of ``side`` pixels of one sensor, (channels, block rows, block columns) added to ``out``.

    Channels: pixels inside, residual, light, variance, squared slope of light, texture, ink gains (4), dot gains (4),
    shapes times light (centres), plane slopes across (4) and along (4).
    """
    lines, pixels = measured.shape
    shapes = centres.shape[0]
    phi = np.empty(shapes, np.float32)
    here = np.empty(INKS, np.float32)
    last = np.full(INKS, np.float32(-1))
    for line in range(1, lines - 1):
        row = line // side
        if row >= out.shape[1]:
            break
        for x in range(1, pixels - 1):
            column = x // side
            if column >= out.shape[2] or not inside[line, x]:
                continue
            light = expected[line, x] - offset[x]
            across = (expected[line, x + 1] - expected[line, x - 1]) * np.float32(0.5)
            along = (expected[line + 1, x] - expected[line - 1, x]) * np.float32(0.5)
            out[0, row, column] += 1
            out[1, row, column] += measured[line, x] - expected[line, x]
            out[2, row, column] += light
            out[3, row, column] += variance[line, x]
            out[4, row, column] += across * across + along * along
            out[5, row, column] += texture[line, x]
            same = True
            for ink in range(INKS):
                out[6 + ink, row, column] += gain[ink, line, x]
                out[10 + ink, row, column] += dot[ink, line, x]
                here[ink] = cover[ink, line, x]
                same = same and abs(here[ink] - last[ink]) < np.float32(0.004)
            if not same:
                shape_values(here, centres, root, length, phi)
                last[:] = here
            for j in range(shapes):
                out[14 + j, row, column] += phi[j] * light
            for ink in range(INKS):
                if here[ink] > np.float32(0.02):
                    j_bar = gain[ink, line, x] / here[ink]
                    out[14 + shapes + ink, row, column] += (
                        j_bar * (cover[ink, line, x + 1] - cover[ink, line, x - 1]) * np.float32(0.5)
                    )
                    out[18 + shapes + ink, row, column] += (
                        j_bar * (cover[ink, line + 1, x] - cover[ink, line - 1, x]) * np.float32(0.5)
                    )


@njit(cache=True, nogil=True, fastmath=True)
def residuals(  # type: ignore[no-untyped-def]
    measured,
    expected,
    offset,
    inside,
    gain,
    dot,
    cover,
    centres,
    root,
    length,
    shape_weights,
    columns,
    gains,
    dots,
    planes,
    out,
):
    """What is left of one sensor's scan after the fitted nuisances, (lines, pixels) [DN]; 0 outside.

    columns (pixels,): relative change of light by column. gains (4, 3): at the centre, and added at the right and lower
    edges; dots (4,); planes (4, 2): how far each lies too far right and down [pixels]; shape_weights (centres,).
    """
    lines, pixels = measured.shape
    shapes = centres.shape[0]
    phi = np.empty(shapes, np.float32)
    here = np.empty(INKS, np.float32)
    last = np.full(INKS, np.float32(-1))
    relative = np.float32(0)
    for line in range(lines):
        v = np.float32(2 * (line + 0.5) / lines - 1)
        for x in range(pixels):
            if line == 0 or x == 0 or line == lines - 1 or x == pixels - 1 or not inside[line, x]:
                out[line, x] = np.float32(0)
                continue
            u = np.float32(2 * (x + 0.5) / pixels - 1)
            same = True
            for ink in range(INKS):
                here[ink] = cover[ink, line, x]
                same = same and abs(here[ink] - last[ink]) < np.float32(0.004)
            if not same:
                shape_values(here, centres, root, length, phi)
                relative = np.float32(0)
                for j in range(shapes):
                    relative += phi[j] * shape_weights[j]
                last[:] = here
            fitted = (expected[line, x] - offset[x]) * (relative + columns[x])
            for ink in range(INKS):
                mode = gain[ink, line, x]
                fitted += mode * (gains[ink, 0] + gains[ink, 1] * u + gains[ink, 2] * v)
                fitted += dot[ink, line, x] * dots[ink]
                if here[ink] > np.float32(0.02):
                    j_bar = mode / here[ink]
                    across = (cover[ink, line, x + 1] - cover[ink, line, x - 1]) * np.float32(0.5)
                    along = (cover[ink, line + 1, x] - cover[ink, line - 1, x]) * np.float32(0.5)
                    fitted -= j_bar * (across * planes[ink, 0] + along * planes[ink, 1])
            out[line, x] = measured[line, x] - expected[line, x] - fitted


@njit(cache=True, nogil=True, fastmath=True)
def variances(light, variance, texture, inside, scale, edge, contrast, share, out, of_edges):  # type: ignore[no-untyped-def]
    """Inverse variance of residuals of one sensor, (lines, pixels) [1/DN^2], and the edges' share of it; 0 outside.

    scale x temporal variance + edge x mean squared slope over 3 x 3 pixels + contrast x texture + (share x light)^2.
    """
    lines, pixels = light.shape
    squares = np.zeros((lines, pixels), np.float32)
    for line in range(1, lines - 1):
        for x in range(1, pixels - 1):
            across = (light[line, x + 1] - light[line, x - 1]) * np.float32(0.5)
            along = (light[line + 1, x] - light[line - 1, x]) * np.float32(0.5)
            squares[line, x] = across * across + along * along
    for line in range(lines):
        for x in range(pixels):
            if line < 2 or x < 2 or line >= lines - 2 or x >= pixels - 2 or not inside[line, x]:
                out[line, x] = np.float32(0)
                of_edges[line, x] = np.float32(0)
                continue
            slope = np.float32(0)
            for i in range(-1, 2):
                for j in range(-1, 2):
                    slope += squares[line + i, x + j]
            slope *= np.float32(1 / 9)
            level = share * light[line, x]
            out[line, x] = np.float32(1) / (
                scale * variance[line, x] + edge * slope + contrast * texture[line, x] + level * level
            )
            of_edges[line, x] = edge * slope * out[line, x]


@njit(cache=True, nogil=True, fastmath=True)
def tile_sums(residual, weight, light, white, add, gain, of_edges, side, pushes, powers, shared, edges):  # type: ignore[no-untyped-def]
    """Sums over tiles of one sensor, added to pushes, powers, shared, edges (modes, tile rows, tile columns).

    Modes: light, each ink added (4), each ink's gain (4), void, blur, all inks' gain, energy. pushes: sum
    P r / V; powers: sum P^2 / V; shared: sum P light / V; edges: the edges' part of powers. Of the energy: sum
    min(r^2 / V, 25), pixels, nothing. white (pixels,): bare paper's light. Kept below 10 sigma a pixel.
    """
    lines, pixels = residual.shape
    mode = np.empty(12, np.float32)
    for line in range(2, lines - 2):
        row = line // side
        if row >= pushes.shape[1]:
            break
        for x in range(2, pixels - 2):
            w = weight[line, x]
            column = x // side
            if w <= 0 or column >= pushes.shape[2]:
                continue
            level = light[line, x]
            r = residual[line, x]
            z2 = r * r * w
            if z2 > np.float32(100):
                r *= np.float32(10) / np.sqrt(z2)
            mode[0] = level
            for ink in range(INKS):
                mode[1 + ink] = add[ink, line, x]
                mode[5 + ink] = gain[ink, line, x]
            mode[9] = white[x] - level
            mode[10] = (
                light[line, x + 1] + light[line, x - 1] + light[line + 1, x] + light[line - 1, x]
            ) * np.float32(0.5) - np.float32(2) * level
            mode[11] = mode[5] + mode[6] + mode[7] + mode[8]
            for m in range(12):
                weighted = mode[m] * w
                pushes[m, row, column] += weighted * r
                powers[m, row, column] += weighted * mode[m]
                edges[m, row, column] += weighted * mode[m] * of_edges[line, x]
                shared[m, row, column] += weighted * level
            pushes[12, row, column] += min(z2, np.float32(25))
            powers[12, row, column] += np.float32(1)


@njit(cache=True, nogil=True, fastmath=True)
def line_sums(  # type: ignore[no-untyped-def]
    residual,
    weight,
    light,
    white,
    add,
    gain,
    of_edges,
    shift,
    segments,
    segment_lines,
    pushes,
    powers,
    shared,
    edges,
):
    """Sums down the columns of a page, in segments of its height, added to (modes, segments, pixels).

    Modes as in ``tile_sums`` but for blur and energy. shift (lines,): whole pixels by which a line is moved left, so
    that columns of a page that is turned lie on each other.
    """
    lines, pixels = residual.shape
    mode = np.empty(10, np.float32)
    for line in range(2, lines - 2):
        segment = min(line // segment_lines, segments - 1)
        for x in range(2, pixels - 2):
            w = weight[line, x]
            if w <= 0:
                continue
            column = x - shift[line]
            if column < 0 or column >= pixels:
                continue
            level = light[line, x]
            r = residual[line, x]
            z2 = r * r * w
            if z2 > np.float32(16):
                r *= np.float32(4) / np.sqrt(z2)
            mode[0] = level
            for ink in range(INKS):
                mode[1 + ink] = add[ink, line, x]
                mode[5 + ink] = gain[ink, line, x]
            mode[9] = white[x] - level
            for m in range(10):
                weighted = mode[m] * w
                pushes[m, segment, column] += weighted * r
                powers[m, segment, column] += weighted * mode[m]
                edges[m, segment, column] += weighted * mode[m] * of_edges[line, x]
                shared[m, segment, column] += weighted * level


@njit(cache=True, nogil=True, fastmath=True)
def slope_sums(residual, weight, light, side, out):  # type: ignore[no-untyped-def]
    """What residuals of one sensor say of local displacements, added to out (5, tile rows, tile columns).

    Sums of gx r / V, gy r / V, gx^2 / V, gy^2 / V, gx gy / V; gx, gy: slopes of the light across and along.
    """
    lines, pixels = residual.shape
    for line in range(2, lines - 2):
        row = min(line // side, out.shape[1] - 1)
        for x in range(2, pixels - 2):
            w = weight[line, x]
            if w <= 0:
                continue
            column = min(x // side, out.shape[2] - 1)
            r = residual[line, x]
            z2 = r * r * w
            if z2 > np.float32(64):
                r *= np.float32(8) / np.sqrt(z2)
            across = (light[line, x + 1] - light[line, x - 1]) * np.float32(0.5)
            along = (light[line + 1, x] - light[line - 1, x]) * np.float32(0.5)
            out[0, row, column] += across * r * w
            out[1, row, column] += along * r * w
            out[2, row, column] += across * across * w
            out[3, row, column] += along * along * w
            out[4, row, column] += across * along * w


@njit(cache=True, nogil=True, fastmath=True)
def take_slopes(residual, weight, light, across_by, along_by):  # type: ignore[no-untyped-def]
    """Take local displacements, fields (lines, pixels) [pixels], out of one sensor's residuals, in place."""
    lines, pixels = residual.shape
    for line in range(2, lines - 2):
        for x in range(2, pixels - 2):
            if weight[line, x] > 0:
                across = (light[line, x + 1] - light[line, x - 1]) * np.float32(0.5)
                along = (light[line + 1, x] - light[line - 1, x]) * np.float32(0.5)
                residual[line, x] -= across * across_by[line, x] + along * along_by[line, x]


@njit(cache=True, nogil=True, fastmath=True)
def column_gains(residual, weight, light, known, out):  # type: ignore[no-untyped-def]
    """Relative gain of each column of one sensor from its residuals, (pixels,) [-]; known: 1 / prior variance."""
    lines, pixels = residual.shape
    power = np.full(pixels, known)
    out[:] = 0
    for line in range(2, lines - 2):
        for x in range(pixels):
            w = weight[line, x]
            if w > 0:
                r = residual[line, x]
                z2 = r * r * w
                if z2 > np.float32(9):
                    r *= np.float32(3) / np.sqrt(z2)
                out[x] += light[line, x] * r * w
                power[x] += light[line, x] * light[line, x] * w
    for x in range(pixels):
        out[x] /= power[x]


@njit(cache=True, nogil=True, fastmath=True)
def take_columns(residual, weight, light, gains):  # type: ignore[no-untyped-def]
    """Take column gains (pixels,) out of one sensor's residuals, in place."""
    lines, pixels = residual.shape
    for line in range(lines):
        for x in range(pixels):
            if weight[line, x] > 0:
                residual[line, x] -= light[line, x] * gains[x]
