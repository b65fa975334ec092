"""Baselines score each page by itself."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from prooflight_studies.harness.baselines import VariationModel, all_scores

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


@settings(max_examples=8)
@given(seed=st.integers(0, 1000), order=st.permutations(range(5)))
def test_permuting_pages_permutes_the_scores_of_baselines_and_changes_no_input(
    seed: int, order: list[int]
) -> None:
    model = VariationModel(floor=0.01, edge=0.1, signal=0.01)
    scans = pages(seed)
    scores = np.stack([all_scores(*page, variation=model, white_dn=[3000.0] * 2) for page in scans])
    again = [all_scores(*scans[place], variation=model, white_dn=[3000.0] * 2) for place in order]
    np.testing.assert_array_equal(np.stack(again), scores[order])
