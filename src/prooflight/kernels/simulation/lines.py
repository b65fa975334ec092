"""Compiled loops of the fast path: light of the inks filtered as in prediction, illumination, and noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.aiming import place_row, weights_at_phases
from prooflight.kernels.simulation.inks import NOISE_STEPS, lookup_pair

PHASES = 1024
"""Phases of a raster pixel for which weights are tabulated: the nearest is off by at most 1/4096 camera pixel
at s = 2, which is less than a thousandth of an edge."""


class PrintLight(NamedTuple):
    """Factors on the light of one print as a whole."""

    columns: NDArray[np.float32]
    """Lamps, table gain and residual of flat-fielding, (pixels,). [-]"""
    flicker: NDArray[np.float32]
    """Flicker of the lamp, (lines,). [-]"""
    cloud: NDArray[np.float32]
    """Nodes of cloudy paper, less 1. [-]"""
    cloud_down: NDArray[np.float32]
    """Positions of lines among them, below 0 off the page, (lines,)."""
    cloud_across: NDArray[np.float32]
    """Positions of pixels among them, likewise, (pixels,)."""
    contrast: np.float32
    """Contrast of the halftone."""


class NoisySensor(NamedTuple):
    """Response of one sensor to light."""

    column_offset: NDArray[np.float32]
    """Offset of each column, (pixels,). [DN]"""
    column_gain: NDArray[np.float32]
    backing: np.float32
    """Light of the backing. [DN]"""
    noise: NDArray[np.float32]
    """Variance before rounding at light 0 .. noise_top, (NOISE_STEPS,). [DN^2]"""
    noise_top: np.float32
    top_code: np.float32


@inner_kernel()
def begin_at(nodes, segment, reach, first, phase):  # type: ignore[no-untyped-def]
    """Compute the start of every camera pixel's footprint: raster pixel and phase, (pixels,) each.

    nodes: as of ``place_row``.
    """
    for k in range(nodes.size - 1):
        start = k * segment
        advance = (nodes[k + 1] - nodes[k]) / segment
        for i in range(start, min(start + segment, first.size)):
            at = nodes[k] + (i - start) * advance - reach
            whole = np.floor(at)
            first[i] = int(whole)
            phase[i] = int((at - whole) * PHASES + 0.5)


@inner_kernel(fastmath={"reassoc", "contract"})
def sample_across(light, texture, pad, first, phase, table, light_out, texture_out):  # type: ignore[no-untyped-def]
    """Sample one raster row at camera columns; light, texture: with ``pad`` zeros at both ends, as many as taps.

    Sums may be taken in any order, so that taps run in vectors, which needs slices.
    """
    taps = table.shape[1]
    last = light.size - pad
    for i in range(first.size):
        begin = min(max(first[i] + pad, 0), last)
        weights = table[phase[i]]
        lights, textures = light[begin : begin + taps], texture[begin : begin + taps]
        light_sum = np.float32(0)
        texture_sum = np.float32(0)
        for t in range(taps):
            light_sum += weights[t] * lights[t]
            texture_sum += weights[t] * textures[t]
        light_out[i] = light_sum
        texture_out[i] = texture_sum


@inner_kernel()
def sample_along(  # type: ignore[no-untyped-def]
    light_ring, texture_ring, rows, first, phase, table, weights, light_out, texture_out
):
    """Sample one line from rings of filtered rows, row r at r % depth; rows off the page count as 0.

    table (taps, 1025); weights (pixels,) is working space: small loops run in vectors, one large one would
    not.
    """
    depth = light_ring.shape[0]
    light_out[:] = 0
    texture_out[:] = 0
    start = 0
    while start < first.size:
        stop = start + 1
        while stop < first.size and first[stop] == first[start]:
            stop += 1
        count = stop - start
        phases = phase[start:stop]
        light_sum, texture_sum = light_out[start:stop], texture_out[start:stop]
        for t in range(max(-first[start], 0), min(table.shape[0], rows - first[start])):
            slot = (first[start] + t) % depth
            light, texture, of_tap = light_ring[slot, start:stop], texture_ring[slot, start:stop], table[t]
            for i in range(count):
                weights[i] = of_tap[np.uint32(phases[i])]
            for i in range(count):
                light_sum[i] += weights[i] * light[i]
            for i in range(count):
                texture_sum[i] += weights[i] * texture[i]
        start = stop


@kernel(
    "packed (H, _), inks.planes (4, 2), inks.gains (4, 3), inks.dot_gains (4), inks.speck_places (N, 2), "
    "inks.packed_specks (N), inks.gain_field (4, F, G), inks.dot_field (4, F, G), inks.field_pitch, "
    "table.nodes (_, 2), table.bends (4, _), across.places (I, J), across.pitch, "
    "across.segment, across.cumulative (_), along.places (K, M), along.pitch, along.segment, "
    "along.cumulative (_), depth, above_backing (L, P), texture_variance (L, P)",
    where=(
        "(I - 1) * across.pitch >= H, (J - 1) * across.segment >= P, (K - 1) * along.pitch >= L, "
        "(M - 1) * along.segment >= P, F >= 2, G >= 2, (F - 1) * inks.field_pitch + 0.5 >= H"
    ),
)
def scan_lines(  # type: ignore[no-untyped-def]
    packed, inks, table, across, along, depth, above_backing, texture_variance
):
    """Compute light above the backing's and texture of every line of one sensor, before lamp and columns.

    packed (rows, columns) uint32: the raster; inks: ``PrintedInks``; table: ``TrueTable``; across, along:
    ``FilterPass``; depth: rows that a line crosses and its footprint sees, and some. Written: above_backing
    [DN], texture_variance [DN^2], both (lines, pixels).
    """
    rows, columns = packed.shape
    lines, pixels = above_backing.shape
    taps = int(np.ceil((across.cumulative.size - 1) / across.step)) + 1
    reach = (across.cumulative.size - 1) / (2 * across.step)
    across_table = weights_at_phases(across.cumulative, across.step, PHASES, taps)
    along_table = np.ascontiguousarray(weights_at_phases(along.cumulative, along.step, PHASES, taps).T)
    printed = np.empty((2, columns), np.uint32)
    of_row = np.empty((2, 4, inks.gain_field.shape[2]), np.float32)
    light = np.zeros((2, columns + 2 * taps), np.float32)
    texture = np.zeros((2, columns + 2 * taps), np.float32)
    lights, textures = light[:, taps : taps + columns], texture[:, taps : taps + columns]
    light_ring = np.empty((depth, pixels), np.float32)
    texture_ring = np.empty((depth, pixels), np.float32)
    x_places = np.empty(across.places.shape[1])
    y_places = np.empty(along.places.shape[1])
    x_first = np.empty(pixels, np.int32)
    x_phase = np.empty(pixels, np.int32)
    y_first = np.empty(pixels, np.int32)
    y_phase = np.empty(pixels, np.int32)
    weights = np.empty(pixels, np.float32)
    next_row = -1
    pair = -1
    for line in range(lines):
        place_row(along.places, along.pitch, line, y_places)
        begin_at(y_places, along.segment, reach, y_first, y_phase)
        if next_row < 0:
            next_row = max(y_first.min(), 0)
        while next_row < min(y_first.max() + taps, rows):
            if pair != next_row // 2:
                pair = next_row // 2
                lookup_pair(packed, 2 * pair, inks, table, printed, of_row, lights, textures)
            place_row(across.places, across.pitch, next_row, x_places)
            begin_at(x_places, across.segment, reach, x_first, x_phase)
            slot = next_row % depth
            sample_across(
                light[next_row & 1],
                texture[next_row & 1],
                taps,
                x_first,
                x_phase,
                across_table,
                light_ring[slot],
                texture_ring[slot],
            )
            next_row += 1
        sample_along(
            light_ring,
            texture_ring,
            rows,
            y_first,
            y_phase,
            along_table,
            weights,
            above_backing[line],
            texture_variance[line],
        )


@kernel(
    "mean (L, P), variance (L, P), light.columns (P), light.flicker (L), light.cloud (_, _), "
    "light.cloud_down (L), light.cloud_across (P), sensor.column_offset (P), sensor.column_gain (P), "
    "sensor.noise (NOISE_STEPS)"
)
def light_lines(mean, variance, light, sensor):  # type: ignore[no-untyped-def]
    """Convert light above the backing's and texture to expected DN and its variance, in place, (lines, pixels) each.

    light: ``PrintLight``; sensor: ``NoisySensor``.
    """
    lines, pixels = mean.shape
    columns, flicker, contrast = light.columns, light.flicker, light.contrast
    cloud, cloud_down, cloud_across = light.cloud, light.cloud_down, light.cloud_across
    column_offset, column_gain, noise = sensor.column_offset, sensor.column_gain, sensor.noise
    backing, top_code = sensor.backing, sensor.top_code
    to_step = np.float32((NOISE_STEPS - 1) / sensor.noise_top)
    row = np.empty(cloud.shape[1], np.float32)
    for i in range(lines):
        on_page = cloud_down[i] >= 0
        if on_page:
            cell = int(cloud_down[i])
            share = np.float32(cloud_down[i] - cell)
            for j in range(row.size):
                row[j] = cloud[cell, j] + share * (cloud[cell + 1, j] - cloud[cell, j])
        for j in range(pixels):
            factor = columns[j] * flicker[i]
            if on_page and cloud_across[j] >= 0:
                cell = int(cloud_across[j])
                share = cloud_across[j] - np.float32(cell)
                factor *= np.float32(1) + row[cell] + share * (row[cell + 1] - row[cell])
            factor *= column_gain[j]
            level = factor * (mean[i, j] + backing)
            place = min(max(level, np.float32(0)) * to_step, np.float32(NOISE_STEPS - 1.001))
            at = int(place)
            sensor = noise[at] + (place - np.float32(at)) * (noise[at + 1] - noise[at])
            halftone = factor * contrast
            variance[i, j] = (
                sensor + halftone * halftone * max(variance[i, j], np.float32(0)) + np.float32(1 / 12)
            )
            mean[i, j] = min(max(column_offset[j] + level, np.float32(0)), top_code)


@kernel("mean (N), variance (N), top_code, normal (65536), key, dn (N)")
def add_noise(mean, variance, top_code, normal, key, dn):  # type: ignore[no-untyped-def]
    """Draw digital numbers from expected DN and its variance, rounding included; all (n,), dn uint16.

    Noise is the sum of two draws from ``normal``, 2^16 even quantiles of a normal distribution of variance
    1/2, at 16 bits each of a counter's hash (splitmix64: Steele, Lea and Flood 2014), two pixels a hash.
    """
    mask = np.uint64(0xFFFF)
    bits = np.uint64(0)
    for i in range(mean.size):
        if i & 1 == 0:
            bits = key + np.uint64(i // 2 + 1) * np.uint64(0x9E3779B97F4A7C15)
            bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            bits = bits ^ (bits >> np.uint64(31))
        else:
            bits = bits >> np.uint64(32)
        noise = normal[bits & mask] + normal[(bits >> np.uint64(16)) & mask]
        spread = np.sqrt(max(variance[i] - np.float32(1 / 12), np.float32(0)))
        value = np.rint(mean[i] + spread * noise)
        dn[i] = np.uint16(min(max(value, np.float32(0)), top_code))
