"""Pages in worker processes, of which the system may kill some."""

from __future__ import annotations

import operator
import os
from functools import partial

import pytest

from prooflight.errors import ProoflightError
from prooflight.pages.parallel import in_order, worker_processes

ITEMS = [partial(abs, -1), partial(abs, -2), partial(os._exit, 9), partial(abs, -4)]
"""The third ends its process as the system does, without a word."""


def test_an_item_that_kills_its_process_costs_itself_alone() -> None:
    found = in_order(operator.call, ITEMS, processes=2, fewest=2, killed=lambda _item: "killed")
    assert list(found) == [1, 2, "killed", 4]


def test_a_process_serves_several_works_one_after_the_other() -> None:
    with worker_processes(1) as pool:
        first = list(in_order(operator.call, [os.getpid] * 2, processes=2, fewest=2, pool=pool))
        second = list(in_order(abs, [-1, -2], processes=2, fewest=2, pool=pool))
        (process,) = set(first)
        assert process != os.getpid()
        assert second == [1, 2]
        assert list(in_order(operator.call, [os.getpid] * 2, processes=2, fewest=2, pool=pool)) == first


def test_where_nothing_stands_for_it_it_is_an_error_that_says_so() -> None:
    found = in_order(operator.call, ITEMS, processes=2, fewest=2)
    assert [next(found), next(found)] == [1, 2]
    with pytest.raises(ProoflightError, match="killed, perhaps for lack of memory"):
        next(found)
