"""Memory is used again once nobody looks at it, and not before."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.kernels import memory
from prooflight.kernels.memory import MOST_PIECES, unset

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

SHAPE = (3, 1000, 7)


@pytest.fixture(autouse=True)
def _none_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "_POOL", memory._Pool())


def place(array: NDArray[Any]) -> int:
    return array.ctypes.data


def test_what_is_gone_leaves_its_memory_to_the_next() -> None:
    first = unset(SHAPE)
    assert (first.shape, first.dtype) == (SHAPE, np.float32)
    assert first.flags.c_contiguous
    assert first.flags.writeable
    at = place(first)
    del first
    assert place(unset((3 * 950, 7))) == at


@pytest.mark.parametrize("part", [lambda array: array[1:, ::2].T, lambda array: array.view(np.int32)[0, :3]])
def test_memory_of_which_a_part_is_looked_at_stays(part: Callable[[NDArray[Any]], NDArray[Any]]) -> None:
    first = unset(SHAPE)
    at, kept = place(first), part(first)
    del first
    other = unset(SHAPE)
    other[:] = 1
    assert place(other) != at
    del kept
    assert place(unset(SHAPE)) == at


def test_a_much_smaller_array_takes_no_large_memory() -> None:
    at = place(unset(SHAPE))
    assert place(unset((3, 500, 7))) != at


def test_threads_have_their_own() -> None:
    at = place(unset(SHAPE))
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(lambda: place(unset(SHAPE))).result() != at


def test_few_pieces_are_kept() -> None:
    for size in range(1, 3 * MOST_PIECES):
        unset((2**size % 1_000_003,))
    assert len(memory._POOL.pieces) == MOST_PIECES
