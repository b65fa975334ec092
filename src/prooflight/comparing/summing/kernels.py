"""Compiled loops: block means for the nuisance fit, residuals without what was fitted, sums of modes over tiles."""

from __future__ import annotations

import numpy as np
from numba import njit

INKS = 4


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
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


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
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


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def variances(light, variance, texture, inside, scale, edge, contrast, share, dark, white, out, of_edges):  # type: ignore[no-untyped-def]
    """Inverse variance of residuals of one sensor, (lines, pixels) [1/DN^2], and the edges' share of it; 0 outside.

    What is dark counts for no variance in that share.

    scale x temporal variance + edge x mean squared slope over 3 x 3 pixels + contrast x texture + (s x light)^2, s =
    share + dark x log(white / light)^2.
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
            depth = np.log(white / min(max(light[line, x], np.float32(0.01) * white), white))
            at_white, level = share * light[line, x], (share + dark * depth * depth) * light[line, x]
            rest = scale * variance[line, x] + edge * slope + contrast * texture[line, x]
            out[line, x] = np.float32(1) / (rest + level * level)
            # What is dark is not flat for that.
            of_edges[line, x] = edge * slope / (rest + at_white * at_white)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
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


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def take_slopes(residual, weight, light, across_by, along_by):  # type: ignore[no-untyped-def]
    """Take local displacements, fields (lines, pixels) [pixels], out of one sensor's residuals, in place."""
    lines, pixels = residual.shape
    for line in range(2, lines - 2):
        for x in range(2, pixels - 2):
            if weight[line, x] > 0:
                across = (light[line, x + 1] - light[line, x - 1]) * np.float32(0.5)
                along = (light[line + 1, x] - light[line - 1, x]) * np.float32(0.5)
                residual[line, x] -= across * across_by[line, x] + along * along_by[line, x]


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
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


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def take_columns(residual, weight, light, gains):  # type: ignore[no-untyped-def]
    """Take column gains (pixels,) out of one sensor's residuals, in place."""
    lines, pixels = residual.shape
    for line in range(lines):
        for x in range(pixels):
            if weight[line, x] > 0:
                residual[line, x] -= light[line, x] * gains[x]
