"""How what families say adds up: rows, a forest and what speaks for itself, each by hand."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.detectors.matched_filter.ranking import (
    Forest,
    Logit,
    Outright,
    family_columns,
    group_columns,
    mixed_columns,
    scores_of,
)


def test_what_is_hardly_ever_seen_on_good_pages_speaks_for_itself() -> None:
    """Up to the guard what misprints taught counts alone; beyond it no page is lower than few good ones are."""
    outright = Outright(guard=10.0, score=2.0)
    trained = np.array([-5.0, 7.0, -5.0, -5.0, 7.0, np.nan])
    untaught = np.array([10.0, 10.0, 10.5, 30.0, 30.0, 3.0])
    assert outright.lifted(trained, untaught) == pytest.approx([-5, 7, 2.5, 22, 27, np.nan], nan_ok=True)


def test_a_rows_columns_are_what_families_say_and_the_first_third_and_sixth_of_them() -> None:
    row = np.array([[1.0, 6.0, 3.0, 5.0, 2.0, 4.0]])
    assert family_columns(row).tolist() == [[1, 6, 3, 5, 2, 4, 6, 4, 1]]


def test_groups_say_what_their_families_say_most() -> None:
    row = np.array([[1.0, 9.0, 4.0, 0.0, 6.0]])
    found = group_columns(row, ["box/C", "box/K", "ghost/C", "ghost/K", "streak/C"])
    runs = [9, (6 + 4 + 1) / 3, 0]  # the first, the second to fourth, the rest
    assert found == pytest.approx(np.array([[*runs, 3, 9, 4, 6, 3, 2, np.sqrt(6)]]))


def test_a_page_need_look_like_one_kind_only() -> None:
    of_kinds = np.log([[1.0, 8.0, 2.0, 5.0]])
    found = mixed_columns(np.array([0.5]), np.array([-0.5]), of_kinds)
    mean_of_three = np.log(8 * 5 * 2) / 3
    assert found == pytest.approx(np.array([[0.5, -0.5, np.log(8), np.log(5), mean_of_three, np.log(4)]]))
    assert mixed_columns(np.array([0.5]), np.array([-0.5]), np.zeros((1, 0))).tolist() == [[0.5, -0.5]]


def test_a_weighted_sum_starts_where_it_says() -> None:
    logit = Logit(weights=np.array([2.0, -1.0]), start=0.25)
    assert logit.score(np.array([[1.0, 1.0], [0.0, 3.0]])).tolist() == [1.25, -2.75]


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
