"""A study on a cluster: the rows of one process, stored where the command runs."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import cloudpickle
import numpy as np
import pytest

from prooflight_studies.harness.result_cache import minutes_spent, run_pieces

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_studies.harness.result_cache import Rows

pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")  # Dask's own, of sockets and loops that it closes late

PIECES = tuple(range(24))
cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers cannot import test modules


def draws(piece: int) -> Rows:
    return {"piece": np.array([piece]), "draw": np.random.default_rng([7, piece]).normal(size=(1, 3))}


def test_rows_are_those_of_one_process(tmp_path: Path) -> None:
    from prooflight.cluster.connection import connected

    here = run_pieces(draws, PIECES, tmp_path / "here", digest="0" * 64, processes=1)
    with connected("local:2") as cluster:
        rows = run_pieces(draws, PIECES, tmp_path / "there", digest="0" * 64, processes=cluster)
    assert rows.keys() == here.keys()
    for name, column in here.items():
        np.testing.assert_array_equal(rows[name], column)
    assert minutes_spent(PIECES, tmp_path / "there", digest="0" * 64) > 0
