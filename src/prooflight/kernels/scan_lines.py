"""Compiled loop that segments scan lines across a bar code into its elements."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel


@inner_kernel()
def elements_of(light, half, starts):  # type: ignore[no-untyped-def]
    """Segment a line (samples,) by a threshold; return the number of elements, and write starts (samples + 1,)."""
    count = 1
    starts[0] = 0
    for i in range(1, light.size):
        if (light[i] < half) != (light[i - 1] < half):
            starts[count] = i
            count += 1
    starts[count] = light.size
    return count


@inner_kernel()
def non_monotony(light, sign, ahead):  # type: ignore[no-untyped-def]
    """Return the greatest reversal of an element's light (n,) between more extreme light on both sides.

    sign: 1 of paper, -1 of a bar. ahead: working space (n,).
    """
    last = light.size - 1
    ahead[last] = sign * light[last]
    for i in range(last - 1, -1, -1):
        ahead[i] = max(ahead[i + 1], sign * light[i])
    before, worst = sign * light[0], 0.0
    for i in range(light.size):
        lit = sign * light[i]
        before = max(before, lit)
        worst = max(worst, min(before, ahead[i]) - lit)
    return worst


@kernel("lines (L, S), edges (L, S), peaks (L, S), defects (L, S), counts (L)", where="1 <= S")
def cut_lines(lines, edges, peaks, defects, counts):  # type: ignore[no-untyped-def]
    """Segment lines (L, samples) into elements: counts (L,), 0 for a line that does not begin and end with paper.

    Of each element, in order from the left of its line: its most extreme light, its greatest non-monotony,
    and for all but the last the edge at which it ends [sample].
    """
    samples = lines.shape[1]
    starts, middles = np.empty(samples + 1, np.int64), np.empty(samples, np.int64)
    ahead = np.empty(samples)
    for number in range(lines.shape[0]):
        light = lines[number]
        half = (light.max() + light.min()) / 2
        counts[number] = 0
        if light[0] < half or light[-1] < half:
            continue
        count = elements_of(light, half, starts)
        counts[number] = count
        for element in range(count):
            sign = 1.0 - 2.0 * (element % 2)
            at = starts[element]
            for i in range(at + 1, starts[element + 1]):
                if sign * light[i] > sign * light[at]:
                    at = i
            middles[element] = at
            peaks[number, element] = light[at]
            within = light[starts[element] : starts[element + 1]]
            defects[number, element] = non_monotony(within, sign, ahead)
        for element in range(count - 1):
            sign = 1.0 - 2.0 * (element % 2)
            between = (light[middles[element]] + light[middles[element + 1]]) / 2
            at = middles[element] + 1
            while sign * light[at] >= sign * between and at < middles[element + 1]:
                at += 1
            part = (between - light[at - 1]) / (light[at] - light[at - 1])
            edges[number, element] = at - 1 + part
