"""A study on a Dask cluster, workers lost midway included."""

from __future__ import annotations

import os
import signal
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cloudpickle
import numpy as np
import pytest

from prooflight.errors import RequestError
from prooflight_studies.harness.result_cache import run_pieces

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_studies.harness.result_cache import Rows

distributed = pytest.importorskip("distributed")

pytestmark = pytest.mark.filterwarnings("default")  # Dask's own, of sockets and loops that it closes late

PIECES = tuple(range(24))
cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers cannot import test modules


@dataclass(frozen=True)
class Draws:
    """Some random numbers of each piece; slow enough that a worker can be lost at it."""

    seconds: float = 0.0

    def __call__(self, piece: int) -> Rows:
        time.sleep(self.seconds)
        return {"piece": np.array([piece]), "draw": np.random.default_rng([7, piece]).normal(size=(1, 3))}


def rows_of(tmp_path: Path, name: str, *, workers: int, lose_one: bool = False) -> Rows:
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        lost: list[int] = []

        def progress(done: int, _all: int) -> None:
            if lose_one and done >= 3 and not lost:
                nanny = next(iter(cluster.workers.values()))
                lost.append(nanny.pid)
                os.kill(nanny.pid, signal.SIGKILL)

        rows = run_pieces(
            Draws(0.05),
            PIECES,
            tmp_path / name,
            digest="0" * 64,
            cluster=cluster.scheduler_address,
            progress=progress,
        )
    assert bool(lost) == lose_one
    return rows


def test_same_rows_wherever_and_whoever_is_lost(tmp_path: Path) -> None:
    here = run_pieces(Draws(), PIECES, tmp_path / "here", digest="0" * 64, processes=1)
    one = rows_of(tmp_path, "one", workers=1)
    four = rows_of(tmp_path, "four", workers=4, lose_one=True)
    for rows in (one, four):
        assert rows.keys() == here.keys()
        for name, column in here.items():
            np.testing.assert_array_equal(rows[name], column)


def test_no_cluster_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="no Dask cluster answers"):
        run_pieces(Draws(), PIECES, tmp_path, digest="0" * 64, cluster="tcp://127.0.0.1:9")
