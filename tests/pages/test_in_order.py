"""Pages in worker processes, of which the system may kill some."""

from __future__ import annotations

import operator
import os
from functools import partial

import pytest

from prooflight.errors import ProoflightError
from prooflight.pages.parallel import in_order

ITEMS = [partial(abs, -1), partial(abs, -2), partial(os._exit, 9), partial(abs, -4)]
"""The third ends its process as the system does, without a word."""


def test_an_item_that_kills_its_process_costs_itself_alone() -> None:
    found = in_order(operator.call, ITEMS, processes=2, fewest=2, killed=lambda _item: "killed")
    assert list(found) == [1, 2, "killed", 4]


def test_where_nothing_stands_for_it_it_is_an_error_that_says_so() -> None:
    found = in_order(operator.call, ITEMS, processes=2, fewest=2)
    assert [next(found), next(found)] == [1, 2]
    with pytest.raises(ProoflightError, match="killed, perhaps for lack of memory"):
        next(found)
