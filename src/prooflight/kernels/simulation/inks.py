"""Compiled loops of the fast path: inks as they came out, looked up in the true tables."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel
from prooflight.kernels.planes import compose_row
from prooflight.kernels.prediction.look_up import NODE_STEP, NODES

TRUE_NODES = NODES + 4
"""The true tables reach to 113 % of a full solid, which ink gain may lay."""
NOISE_STEPS = 1024
STRIDES = (TRUE_NODES**3, TRUE_NODES**2, TRUE_NODES)
LAST_PLACE = np.float32(TRUE_NODES - 1.001)
ALIKE = 4
"""Four neighbours whose bytes differ by no more are looked up once, at their mean: for the steepest ink, black near its
solid, that errs by less than 5 x (4 / 255 / 2)^2 / 2 of white, 0.02 %."""
RUNS = 128
"""A row of one colour is looked up so often, because inks' gain tilts over the page: to half a per cent of the tilt."""


@inner_kernel()
def node_place(byte, gain, dot_gain):  # type: ignore[no-untyped-def]
    """Where in the true tables an ink of a raster's byte value (a float32) lies, given its gain. [nodes]"""
    area = byte * np.float32(1 / 255)
    printed = area * (np.float32(1) + gain + np.float32(4) * dot_gain * (np.float32(1) - area))
    return min(max(printed * np.float32(255 / NODE_STEP), np.float32(0)), LAST_PLACE)


@inner_kernel()
def look_up(nodes, bends, places):  # type: ignore[no-untyped-def]
    """Light and texture, a halftone's variance at unit contrast, at four places [nodes]; nodes (37^4, 2).

    Light is bent between nodes as it is along each ink alone (bends (4, 36), see ``TrueSensor``); relative variance is
    linear in the innermost ink, black.
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
    """Whether four recipes differ by at most ``ALIKE`` in every ink."""
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
def look_up_rows(upper, lower, v, gains, dot_gains, nodes, bends, paper, light, texture):  # type: ignore[no-untyped-def]
    """Two printed raster rows looked up in squares of 2 x 2: upper, lower (columns,) -> light, texture (2, columns).

    v: where the rows lie on the page, -1 top .. 1 bottom. gains (4, 3): at the centre, and added at the right and lower
    edges. paper: reflectance over what it should be. Squares of one colour are looked up once, and so are runs of them.
    """
    columns = upper.size
    places = np.empty(4, np.float32)
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
            u = np.float32((2 * left + 2) / columns - 1)
            for ink in range(4):
                s = np.uint32(8 * ink)
                total = ((one >> s) & np.uint32(255)) + ((two >> s) & np.uint32(255))
                total += ((three >> s) & np.uint32(255)) + ((four >> s) & np.uint32(255))
                gain = gains[ink, 0] + gains[ink, 1] * u + gains[ink, 2] * v
                places[ink] = node_place(np.float32(total) * np.float32(0.25), gain, dot_gains[ink])
            square_light, square_texture = look_up(nodes, bends, places)
            square_light *= paper
            square_texture *= paper * paper
            last = one
            run = 1 if same else longest
        else:
            run = longest
            u = np.float32((2 * left + 2) / columns - 1)
            for corner in range(4):
                word = (one if corner == 0 else two) if corner < 2 else (three if corner == 2 else four)
                at = right if corner & 1 else left
                # A square at a letter's edge has two colours: often the last but one is this one again.
                for ink in range(4):
                    byte = np.float32((word >> np.uint32(8 * ink)) & np.uint32(255))
                    gain = gains[ink, 0] + gains[ink, 1] * u + gains[ink, 2] * v
                    places[ink] = node_place(byte, gain, dot_gains[ink])
                found_light, found_texture = look_up(nodes, bends, places)
                light[corner >> 1, at] = found_light * paper
                texture[corner >> 1, at] = found_texture * paper * paper
            continue
        for row in range(2):
            light[row, left] = square_light
            light[row, right] = square_light
            texture[row, left] = square_texture
            texture[row, right] = square_texture


@inner_kernel()
def add_specks(places, packed, top, v, gains, dot_gains, nodes, bends, paper, lights, textures):  # type: ignore[no-untyped-def]
    """Light and texture (2, columns) of the rows from ``top`` on where specks lie: as ``look_up_rows``, a pixel each.

    places (n, 2), packed (n,) as ``speck_pixels``; v: how far down the page these rows are, -1 to 1.
    """
    place = np.empty(4, np.float32)
    columns = lights.shape[1]
    for n in range(packed.size):
        row = places[n, 0] - top
        if row == 0 or row == 1:
            u = np.float32((2 * places[n, 1] + 1) / columns - 1)
            for ink in range(4):
                byte = np.float32((packed[n] >> np.uint32(8 * ink)) & np.uint32(255))
                gain = gains[ink, 0] + gains[ink, 1] * u + gains[ink, 2] * v
                place[ink] = node_place(byte, gain, dot_gains[ink])
            light, texture = look_up(nodes, bends, place)
            lights[row, places[n, 1]] = light * paper
            textures[row, places[n, 1]] = texture * paper * paper


@inner_kernel()
def look_up_pair(  # type: ignore[no-untyped-def]
    packed,
    top,
    planes,
    gains,
    dot_gains,
    speck_places,
    speck_words,
    nodes,
    bends,
    paper,
    printed,
    lights,
    textures,
):
    """Light above the backing's and texture (2, columns) of rows ``top`` and the next as they came out.

    Arguments as in ``scan_lines``. A last row without a next one is its own. printed (2, columns): working space.
    """
    rows = packed.shape[0]
    v = np.float32((2 * top + 2) / rows - 1)
    upper, lower = printed[0], printed[1]
    compose_row(packed, top, planes, upper)
    if top + 1 < rows:
        compose_row(packed, top + 1, planes, lower)
    else:
        lower[:] = upper
    look_up_rows(upper, lower, v, gains, dot_gains, nodes, bends, paper[0], lights, textures)
    add_specks(speck_places, speck_words, top, v, gains, dot_gains, nodes, bends, paper[0], lights, textures)
    lights -= paper[1]
