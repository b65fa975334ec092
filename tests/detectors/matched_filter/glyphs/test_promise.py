"""The promise of glyphs: thresholds, p-values, and both tests as one decision."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.detectors.matched_filter.glyphs.scoring import NONE, GlyphThreshold, combined_score

SCORES = st.lists(st.floats(NONE, 60), min_size=2, max_size=200)


def test_pages_that_scatter_as_stated_leave_the_threshold_to_the_theorem() -> None:
    assert GlyphThreshold(own=np.full(119, -20.0), rate=0.001).threshold == pytest.approx(math.log(1000))


def test_pages_that_scatter_more_widely_raise_it() -> None:
    narrow = GlyphThreshold(own=np.array([*[-20.0] * 115, 1, 2, 3, 4]), rate=0.001)
    wide = GlyphThreshold(own=np.array([*[-20.0] * 115, 10, 20, 30, 40]), rate=0.001)
    assert wide.threshold > 40
    assert wide.threshold > narrow.threshold


@given(own=SCORES, rate=st.floats(1e-4, 0.05))
def test_no_page_that_taught_alarms_and_the_bound_of_the_theorem_holds(own: list[float], rate: float) -> None:
    promise = GlyphThreshold(own=np.array(own), rate=rate)
    assert promise.threshold >= max(max(own), math.log(1 / rate)) - 1e-9


@given(own=SCORES, rate=st.floats(1e-4, 0.05), score=st.floats(NONE, 500), more=st.floats(0, 100))
def test_p_values_fall_and_are_below_the_rate_where_it_alarms(
    own: list[float], rate: float, score: float, more: float
) -> None:
    promise = GlyphThreshold(own=np.array(own), rate=rate)
    assert promise.p_value(score + more) <= promise.p_value(score) <= 1
    assert (promise.p_value(score) <= rate) or score <= promise.threshold


@given(
    score=st.floats(-50, 1000), threshold=st.floats(0, 50), glyphs=st.floats(NONE, 500), own=st.floats(1, 50)
)
def test_the_one_score_alarms_if_either_does(
    score: float, threshold: float, glyphs: float, own: float
) -> None:
    one = combined_score(score, threshold, glyphs, own)
    assert (one > threshold) == (
        score > threshold or (threshold + (glyphs - own) > threshold and glyphs > own)
    )
    assert one >= score


def test_a_score_that_is_none_stays_so() -> None:
    assert math.isnan(combined_score(math.nan, 1.0, 500.0, 7.0))
