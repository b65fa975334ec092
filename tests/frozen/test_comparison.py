"""What counts as a change of a frozen figure, and what other processors may do to it."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from tests.frozen.cases import CASES, digest
from tests.frozen.comparison import LEAST, MARGIN, SPREAD, Spread, deviations

VALUES = np.linspace(-3, 5, 40).astype(np.float32)
SPOT = {"kind": "spots-voids", "box_mm": [10.0, 20.0, 1.7, 1.7]}
STREAK = {"kind": "streak", "box_mm": [3.0, 0.0, 0.5, 44.0]}
FROZEN: dict[str, Any] = {
    "words": {"verdict": "misprint", "kind": None},
    "score": 3.1,
    "area": [[4, 400]],
    "values": digest(VALUES),
    "regions": [SPOT, STREAK],
}
NOTHING_MEASURED = Spread(numbers={}, open=frozenset())


def changed(found: dict[str, Any], spread: Spread = NOTHING_MEASURED) -> list[str]:
    return [one.path for one in deviations(FROZEN | found, FROZEN) if not spread.allows(one)]


@pytest.mark.parametrize(
    ("found", "paths"),
    [
        ({"words": {"verdict": "good", "kind": None}}, ["words/verdict"]),
        ({"words": {"verdict": "misprint", "kind": "scum"}}, ["words/kind"]),
        ({"words": {"verdict": "misprint"}}, ["words"]),
        ({"score": 3.104}, ["score"]),
        ({"score": None}, ["score"]),
        ({"area": [[4, 402]]}, ["area[0][1]"]),
        ({"area": []}, ["area"]),
        ({"values": digest(VALUES[:39])}, ["values/shape", "values/mean", "values/norm"]),
        ({"values": digest(VALUES + np.float32(0.01))}, ["values/mean"]),
        ({"values": digest(VALUES * np.float32(1.01))}, ["values/mean", "values/norm"]),
        ({"regions": [SPOT]}, ["regions"]),
        ({"regions": [STREAK, SPOT | {"kind": "scum"}]}, ["regions"]),
        ({"regions": [SPOT | {"box_mm": [10.8, 20.0, 1.7, 1.7]}, STREAK]}, ["regions"]),
    ],
)
def test_a_change_is_seen(found: dict[str, Any], paths: list[str]) -> None:
    assert set(paths) <= set(changed(found))


@pytest.mark.parametrize(
    "found",
    [
        {"score": 3.1 * (1 + LEAST / 2)},
        {"area": [[5, 401]]},
        {"values": digest(VALUES * np.float32(1 + 1e-6))},
        {"regions": [STREAK, SPOT]},
        {"regions": [SPOT | {"box_mm": [10.01, 19.99, 1.71, 1.69]}, STREAK]},
    ],
)
def test_last_bits_are_no_change(found: dict[str, Any]) -> None:
    assert changed(found) == []


def test_a_figure_may_move_a_margin_further_than_it_did_on_other_processors() -> None:
    processors = [FROZEN | {"score": 3.1 * share} for share in (1.01, 0.999)]
    spread = Spread.of(processors, [FROZEN | {"score": 99.0}], FROZEN)
    assert spread.numbers["score"] == pytest.approx(0.01)
    assert changed({"score": 3.1 * (1 + 0.009 * MARGIN)}, spread) == []
    assert changed({"score": 3.1 * (1 + 0.011 * MARGIN)}, spread) == ["score"]


def test_words_that_differ_between_runs_are_open() -> None:
    other, moved = {"words": {"verdict": "misprint", "kind": "scum"}}, {"regions": [SPOT]}
    spread = Spread.of([FROZEN | other], [FROZEN | moved], FROZEN)
    assert spread.open == {"words/kind", "regions"}
    assert changed(other | moved, spread) == []


def test_a_value_on_the_edge_of_a_bin_is_no_change_of_counts() -> None:
    counts = np.full(50, 40)
    moved = counts + np.eye(50, dtype=int)[3] - np.eye(50, dtype=int)[4]
    frozen, found = {"histogram": digest(counts)}, {"histogram": digest(moved)}
    assert all(NOTHING_MEASURED.allows(one) for one in deviations(found, frozen) if "sums" in one.path)


def test_what_was_measured_lets_no_verdict_differ_and_no_figure_go_far() -> None:
    """A tolerance of a third of a figure's scale would let anything pass."""
    kept = json.loads(SPREAD.read_text(encoding="utf-8"))["cases"]
    assert list(kept) == [case.__name__ for case in CASES]
    for case in kept:
        spread = Spread.read(case)
        assert not [path for path in spread.open if path.endswith("words/verdict")]
        wide = {name: one for name, one in spread.numbers.items() if not one < 1 / 3 / MARGIN}
        assert not wide, case
    assert math.isinf(next(one.amount for one in deviations({"a": 1.0}, {"a": "x"})))
