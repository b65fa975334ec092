"""Compiled loops of the fast path: inks as printed, looked up in the true tables."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.compiled import inner_kernel
from prooflight.kernels.planes import compose_row
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.prediction.lookup import NODE_STEP, NODES

TRUE_NODES = NODES + 4
"""Number of nodes of the true tables, which reach to 113 % of a full solid, as ink gain may exceed it."""
NOISE_STEPS = 1024
STRIDES = (TRUE_NODES**3, TRUE_NODES**2, TRUE_NODES)
LAST_PLACE = np.float32(TRUE_NODES - 1.001)
ALIKE = 4
"""Greatest difference of bytes of four neighbours that are looked up once, at their mean: for the steepest
ink, black near its solid, the error is below 5 x (4 / 255 / 2)^2 / 2 of white, 0.02 %."""
RUNS = 128
"""Number of look-ups in a row of one colour, because inks' gain varies over the page: to half a per cent of
that."""


class PrintedInks(NamedTuple):
    """Deviations of a print from its raster."""

    planes: NDArray[np.int64]
    """Raster pixels by which each plane lies too far right and down, (4, 2)."""
    gains: NDArray[np.float32]
    """Gain of each ink at the centre, and added at the right and lower edges, (4, 3)."""
    dot_gains: NDArray[np.float32]
    """Dot gain of each ink, (4,)."""
    speck_places: NDArray[np.int64]
    """Places of specks as from ``speck_pixels``, (n, 2)."""
    packed_specks: NDArray[np.uint32]
    """Recipes of the specks, (n,)."""
    gain_field: NDArray[np.float32]
    """Gain of each ink from place to place, besides, (4, nodes down, nodes across)."""
    dot_field: NDArray[np.float32]
    """Dot gain of each ink from place to place, besides, likewise."""
    field_pitch: np.float32
    """Pitch of their nodes. [raster pixels]"""


def no_fields() -> tuple[NDArray[np.float32], NDArray[np.float32], np.float32]:
    """Return the last three of ``PrintedInks`` for inks that are the same at every place."""
    return np.zeros((4, 2, 2), np.float32), np.zeros((4, 2, 2), np.float32), np.float32(1e9)


class TrueTable(NamedTuple):
    """True response of one sensor to inks; as ``TrueSensor``."""

    nodes: NDArray[np.float32]
    """Light and relative variance at each node, (37^4, 2)."""
    bends: NDArray[np.float32]
    """Curvature between nodes along each ink, (4, 36)."""
    white: np.float32
    """Factor of the paper."""
    backing: np.float32
    """Light of the backing. [DN]"""


@inner_kernel()
def node_place(byte, gain, dot_gain):  # type: ignore[no-untyped-def]
    """Return the position in the true tables of an ink of a raster's byte value (a float32), given its gain. [nodes]"""
    area = byte * np.float32(1 / 255)
    printed = area * (np.float32(1) + gain + np.float32(4) * dot_gain * (np.float32(1) - area))
    return min(max(printed * np.float32(255 / NODE_STEP), np.float32(0)), LAST_PLACE)


@inner_kernel()
def fields_of_row(inks, row, of_row):  # type: ignore[no-untyped-def]
    """Compute gain and dot gain of each ink at a row's nodes, of_row (2, 4, nodes across), linear between rows."""
    place = np.float32(row) / inks.field_pitch
    cell = min(int(place), inks.gain_field.shape[1] - 2)
    share = place - np.float32(cell)
    for ink in range(4):
        for j in range(of_row.shape[2]):
            one, other = inks.gain_field[ink, cell, j], inks.gain_field[ink, cell + 1, j]
            of_row[0, ink, j] = one + share * (other - one)
            one, other = inks.dot_field[ink, cell, j], inks.dot_field[ink, cell + 1, j]
            of_row[1, ink, j] = one + share * (other - one)


@inner_kernel()
def gains_at(column, u, v, inks, of_row, gains):  # type: ignore[no-untyped-def]
    """Compute gain and dot gain of each ink at a place, gains (2, 4).

    u, v: position on the page, -1 to 1; of_row: of ``fields_of_row``.
    """
    place = np.float32(column) / inks.field_pitch
    cell = min(int(place), of_row.shape[2] - 2)
    share = place - np.float32(cell)
    for ink in range(4):
        gain = inks.gains[ink, 0] + inks.gains[ink, 1] * u + inks.gains[ink, 2] * v
        gain += of_row[0, ink, cell] + share * (of_row[0, ink, cell + 1] - of_row[0, ink, cell])
        dots = of_row[1, ink, cell] + share * (of_row[1, ink, cell + 1] - of_row[1, ink, cell])
        gains[0, ink] = gain
        gains[1, ink] = inks.dot_gains[ink] + dots


@inner_kernel()
def place_inks(packed_inks, gains, places):  # type: ignore[no-untyped-def]
    """Compute the positions in the true tables of the four inks of a pixel, given their gains (``gains_at``)."""
    for ink in range(4):
        byte = np.float32((packed_inks >> np.uint32(8 * ink)) & np.uint32(255))
        places[ink] = node_place(byte, gains[0, ink], gains[1, ink])


@inner_kernel()
def lookup(nodes, bends, places):  # type: ignore[no-untyped-def]
    """Return light and texture, a halftone's variance at unit contrast, at four positions [nodes]; nodes (37^4, 2).

    Light between nodes is curved as along each ink alone (bends (4, 36), see ``TrueSensor``); relative
    variance is linear in the innermost ink, black.
    """
    c, m, y, k = int(places[0]), int(places[1]), int(places[2]), int(places[3])
    base = c * STRIDES[0] + m * STRIDES[1] + y * STRIDES[2] + k
    one = np.float32(1)
    fc = places[0] - np.float32(c)
    fm = places[1] - np.float32(m)
    fy = places[2] - np.float32(y)
    straight = places[3] - np.float32(k)
    fc += bends[0, c] * fc * (one - fc)
    fm += bends[1, m] * fm * (one - fm)
    fy += bends[2, y] * fy * (one - fy)
    fk = straight + bends[3, k] * straight * (one - straight)
    light = np.float32(0)
    texture = np.float32(0)
    for i in range(2):
        wc = fc if i else one - fc
        if wc == 0:
            continue
        for j in range(2):
            wm = wc * (fm if j else one - fm)
            if wm == 0:
                continue
            for h in range(2):
                wy = wm * (fy if h else one - fy)
                if wy == 0:
                    continue
                node = base + i * STRIDES[0] + j * STRIDES[1] + h * STRIDES[2]
                light += wy * (nodes[node, 0] + fk * (nodes[node + 1, 0] - nodes[node, 0]))
                texture += wy * (nodes[node, 1] + straight * (nodes[node + 1, 1] - nodes[node, 1]))
    return light, light * light * max(texture, np.float32(0))


@inner_kernel()
def alike(one, two, three, four):  # type: ignore[no-untyped-def]
    """Return whether four recipes differ by at most ``ALIKE`` in every ink."""
    for ink in range(4):
        shift = np.uint32(8 * ink)
        a = int((one >> shift) & np.uint32(255))
        b = int((two >> shift) & np.uint32(255))
        c = int((three >> shift) & np.uint32(255))
        d = int((four >> shift) & np.uint32(255))
        if max(max(a, b), max(c, d)) - min(min(a, b), min(c, d)) > ALIKE:
            return False
    return True


@inner_kernel()
def lookup_rows(upper, lower, v, inks, of_row, table, light, texture):  # type: ignore[no-untyped-def]
    """Look up two printed raster rows in squares of 2 x 2: upper, lower (columns,) -> light, texture (2, columns).

    v: position of the rows on the page, -1 top .. 1 bottom; of_row: of ``fields_of_row``.
    Squares of one colour are looked up once, and so are runs of them.
    """
    nodes, bends, paper = table.nodes, table.bends, table.white
    columns = upper.size
    places = np.empty(4, np.float32)
    gains = np.empty((2, 4), np.float32)
    last = np.uint32(0)
    longest = max(columns // (2 * RUNS), 1)
    run = longest
    square_light = np.float32(0)
    square_texture = np.float32(0)
    for left in range(0, columns, 2):
        right = min(left + 1, columns - 1)
        one, two, three, four = upper[left], upper[right], lower[left], lower[right]
        same = one == two and one == three and one == four
        if same and one == last and run < longest:
            run += 1
        elif same or alike(one, two, three, four):
            gains_at(left, np.float32((2 * left + 2) / columns - 1), v, inks, of_row, gains)
            for ink in range(4):
                s = np.uint32(8 * ink)
                total = ((one >> s) & np.uint32(255)) + ((two >> s) & np.uint32(255))
                total += ((three >> s) & np.uint32(255)) + ((four >> s) & np.uint32(255))
                places[ink] = node_place(np.float32(total) * np.float32(0.25), gains[0, ink], gains[1, ink])
            square_light, square_texture = lookup(nodes, bends, places)
            square_light *= paper
            square_texture *= paper * paper
            last = one
            run = 1 if same else longest
        else:
            run = longest
            gains_at(left, np.float32((2 * left + 2) / columns - 1), v, inks, of_row, gains)
            before = one
            for corner in range(4):
                packed_inks = (
                    (one if corner == 0 else two) if corner < 2 else (three if corner == 2 else four)
                )
                # A square at a letter's edge has two colours.
                if corner == 0 or packed_inks != before:
                    place_inks(packed_inks, gains, places)
                    square_light, square_texture = lookup(nodes, bends, places)
                    square_light *= paper
                    square_texture = square_texture * paper * paper
                    before = packed_inks
                at = right if corner & 1 else left
                light[corner >> 1, at] = square_light
                texture[corner >> 1, at] = square_texture
            continue
        for row in range(2):
            light[row, left] = square_light
            light[row, right] = square_light
            texture[row, left] = square_texture
            texture[row, right] = square_texture


@inner_kernel()
def add_specks(inks, top, v, of_row, table, lights, textures):  # type: ignore[no-untyped-def]
    """Set light and texture (2, columns) of the rows from ``top`` on at specks, each pixel as in ``lookup_rows``.

    v: position of these rows on the page, -1 top to 1 bottom.
    """
    places, packed = inks.speck_places, inks.packed_specks
    nodes, bends, paper = table.nodes, table.bends, table.white
    place = np.empty(4, np.float32)
    gains = np.empty((2, 4), np.float32)
    columns = lights.shape[1]
    for n in range(packed.size):
        row = places[n, 0] - top
        if row == 0 or row == 1:
            u = np.float32((2 * places[n, 1] + 1) / columns - 1)
            gains_at(places[n, 1], u, v, inks, of_row, gains)
            place_inks(packed[n], gains, place)
            light, texture = lookup(nodes, bends, place)
            lights[row, places[n, 1]] = light * paper
            textures[row, places[n, 1]] = texture * paper * paper


@inner_kernel()
def lookup_pair(packed, top, inks, table, printed, of_row, lights, textures):  # type: ignore[no-untyped-def]
    """Compute light above the backing's and texture (2, columns) of rows ``top`` and the next as printed.

    Arguments as in ``scan_lines``. A last row without a next one is repeated. printed (2, columns) and
    of_row (2, 4, nodes across): working space.
    """
    rows = packed.shape[0]
    v = np.float32((2 * top + 2) / rows - 1)
    upper, lower = printed[0], printed[1]
    compose_row(packed, top, inks.planes, upper)
    if top + 1 < rows:
        compose_row(packed, top + 1, inks.planes, lower)
    else:
        copy_row(upper, lower)
    fields_of_row(inks, top, of_row)
    lookup_rows(upper, lower, v, inks, of_row, table, lights, textures)
    add_specks(inks, top, v, of_row, table, lights, textures)
    lights -= table.backing
