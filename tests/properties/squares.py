"""Scans with a lighter square, and what was expected of them."""

from __future__ import annotations

import numpy as np

SENSORS = 2
SHAPE = (SENSORS, 128, 128)


def pages(seed: int, count: int = 5) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Scans with what was expected of them; every other one has a lighter square. Nothing may be written to."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(count):
        expected = rng.uniform(300, 3000, SHAPE).astype(np.float32)
        variance = (4 + expected / 100).astype(np.float32)
        seen = expected + rng.standard_normal(SHAPE) * np.sqrt(variance)
        seen[:, 30:60, 30:60] += 40 * rng.random() * (number % 2)
        arrays = (np.rint(seen).clip(0, 4095).astype(np.uint16), expected, variance)
        for array in arrays:
            array.setflags(write=False)
        found.append(arrays)
    return found
