"""Baselines score each page by itself."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.properties.squares import pages

from prooflight_studies.harness.baselines import VariationModel, all_scores


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
