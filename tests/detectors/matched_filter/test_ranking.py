"""How what forests say adds up: rows, a forest and a score, each by hand."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.detectors.matched_filter.ranking import (
    ADDED_FROM,
    ADDED_SLOPE,
    ALONE_FROM,
    ALONE_SLOPE,
    Forest,
    every_column,
    family_columns,
    ranked,
    rising_columns,
    scores_of,
    strongest_alone,
)


def test_a_rows_columns_are_what_families_say_and_the_first_third_and_sixth_of_them() -> None:
    row = np.array([[1.0, 6.0, 3.0, 5.0, 2.0, 4.0]])
    assert family_columns(row).tolist() == [[1, 6, 3, 5, 2, 4, 6, 4, 1]]
    every = every_column(row, np.array([[7.0, 8.0]]), np.array([[-1.0, 2.0]]))
    assert every.tolist() == [[1, 6, 3, 5, 2, 4, 6, 4, 1, 7, 8, 0, 2, 1, 0]]
    rising = rising_columns(every.shape[1], features=2, statistics=2)
    assert np.flatnonzero(~rising).tolist() == [9, 10]


def test_a_page_need_look_like_one_kind_only() -> None:
    of_all, of_kinds = np.array([0.5, -2.0]), np.array([[1.0, 3.0, -4.0], [-1.0, -3.0, -5.0]])
    evidence = np.ones((2, 4))
    none = np.zeros(4, bool)
    assert ranked(of_all + 9, of_kinds, evidence, none).tolist() == [12.5, 6.0]
    assert ranked(of_all + 9, of_kinds[:, ::-1], evidence, none).tolist() == [12.5, 6.0]
    # One kind has taught: all there is.
    assert ranked(of_all + 9, np.zeros((2, 0)), evidence, none).tolist() == [9.5, 7.0]


def test_a_family_that_is_far_out_adds_to_what_forests_say() -> None:
    """After Bonferroni of three families, from ``ADDED_FROM`` on."""
    nothing, none = np.full(3, 50.0), np.zeros((3, 0))
    far = ADDED_FROM + np.log10(3)
    evidence = np.array([[0.5, far - 1, 1.0], [far + 2, 0.1, 0.0], [far + 2, far + 1, 0.0]])
    found = ranked(nothing, none, evidence, np.zeros(3, bool))
    assert found == pytest.approx([50, 50 + 2 * ADDED_SLOPE, 50 + 2 * ADDED_SLOPE])


def test_forests_only_add_to_what_the_strongest_family_says_alone() -> None:
    """Two groups of families, each after Bonferroni: one mark needs less evidence than one of a hundred others."""
    marks = np.array([True, False, *[False] * 99])
    evidence = np.zeros((3, 101))
    evidence[0, 0] = evidence[1, 1] = 5.0
    assert strongest_alone(evidence, marks) == pytest.approx([5.0, 3.0, 0.0])
    against, none = np.full(3, -100.0), np.zeros((3, 0))
    expected = ALONE_SLOPE * (np.array([5.0, 3.0, 0.0]) - ALONE_FROM)
    assert ranked(against, none, evidence, marks) == pytest.approx(expected)
    assert (ranked(against + 200, none, evidence, marks) > 90).all()


def test_a_forest_says_the_odds_of_its_trees_mean_share() -> None:
    """Two trees: one parts at 1.5 by the second column, the other holds 0.4 alone; a value on a cut goes left."""
    forest = Forest(
        column=np.array([1, -1, -1, -1], np.int32),
        cut=np.array([1.5, 0, 0, 0], np.float32),
        left=np.array([1, -1, -1, -1], np.int32),
        right=np.array([2, -1, -1, -1], np.int32),
        share=np.array([0, 0, 1, 0.4], np.float32),
        root=np.array([0, 3], np.int32),
    )
    rows = np.array([[9.0, 1.5], [-9.0, 1.6]])
    chance = np.array([0.2, 0.7])
    odds = np.log((chance + 0.01) / (1.01 - chance))
    assert forest.score(rows) == pytest.approx(odds, rel=1e-5)
    assert scores_of([forest, forest], rows) == pytest.approx(np.stack([odds, odds], axis=1), rel=1e-5)
    assert scores_of([], rows).shape == (2, 0)
