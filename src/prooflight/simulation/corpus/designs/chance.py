"""Random choices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import numpy as np

Choice = TypeVar("Choice")


def pick(rng: np.random.Generator, choices: Sequence[Choice]) -> Choice:
    """Return one of the choices, all equally likely."""
    return choices[int(rng.integers(len(choices)))]


def pick_weighted(rng: np.random.Generator, weights: Mapping[Choice, float]) -> Choice:
    """Return one of the keys with probability in proportion to its weight.

    The weights need not add up to 1.
    """
    keys = list(weights)
    total = sum(weights.values())
    return keys[int(rng.choice(len(keys), p=[weights[key] / total for key in keys]))]


def often(rng: np.random.Generator, share: float) -> bool:
    """Return True with this probability."""
    return bool(rng.random() < share)


def some(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number uniformly between low and high."""
    return float(rng.uniform(low, high))


def count(rng: np.random.Generator, low: int, high: int) -> int:
    """Draw a whole number uniformly from low to high, both included."""
    return int(rng.integers(low, high + 1))
