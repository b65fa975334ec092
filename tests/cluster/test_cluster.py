"""Work on a cluster of two processes: the same bits, whoever is lost, and one line where it cannot be done."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cloudpickle
import numpy as np
import pytest

from prooflight.errors import JobError, RequestError
from prooflight.pages.parallel import Files, in_order

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.cluster.cluster import Cluster

pytest.importorskip("distributed")
from prooflight.cluster.cluster import _Sent

pytestmark = pytest.mark.filterwarnings("default")  # Dask's own, of sockets and loops that it closes late
cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers cannot import test modules

ITEMS = tuple(range(24))


@dataclass(frozen=True)
class Draws:
    """Random numbers of each item, of which some kill their process or fail."""

    seconds: float = 0.0
    killing: int = -1
    failing: int = -1

    def __call__(self, item: int) -> NDArray[np.float64]:
        if item == self.killing:
            os._exit(9)
        if item == self.failing:
            raise JobError("job.pdf", f"page {item} cannot be drawn", remedy="export it again")
        time.sleep(self.seconds)
        return np.random.default_rng([7, item]).normal(size=5)


@dataclass(frozen=True)
class ReadsFiles:
    """What lies in a folder of all items, and in the file of one."""

    folder: Path

    def __call__(self, file: Path) -> tuple[str, ...]:
        return (*(one.read_text() for one in sorted(self.folder.rglob("*.txt"))), file.read_text())


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    from prooflight.cluster.connection import connected

    with connected("local:2") as connection:
        yield connection


def expected() -> list[NDArray[np.float64]]:
    return list(in_order(Draws(), ITEMS, processes=1))


def test_results_are_the_same_bits_in_the_same_order(cluster: Cluster) -> None:
    np.testing.assert_array_equal(list(in_order(Draws(), ITEMS, processes=cluster)), expected())
    finished = dict(cluster.as_finished(Draws(), ITEMS))
    np.testing.assert_array_equal([finished[place] for place in ITEMS], expected())


def test_the_work_of_a_killed_worker_is_done_again(cluster: Cluster) -> None:
    results = []
    for result in cluster.in_order(Draws(0.1), ITEMS):
        if len(results) == 3:
            os.kill(next(iter(cluster.client.run(os.getpid).values())), signal.SIGKILL)
        results.append(result)
    np.testing.assert_array_equal(results, expected())


def test_a_killed_worker_of_this_machine_is_started_again(cluster: Cluster) -> None:
    processes = set(cluster.client.run(os.getpid).values())
    for process in processes:
        os.kill(process, signal.SIGKILL)
    np.testing.assert_array_equal(list(cluster.in_order(Draws(), ITEMS)), expected())
    cluster.client.wait_for_workers(2, timeout=120)
    assert not processes & set(cluster.client.run(os.getpid).values())


def test_an_item_that_kills_its_worker_three_times_costs_itself_alone(cluster: Cluster) -> None:
    results = list(cluster.in_order(Draws(killing=5), ITEMS[:9], killed=lambda item: np.array([item])))
    assert results.pop(5) == [5]
    np.testing.assert_array_equal(results, [row for item, row in enumerate(expected()[:9]) if item != 5])


def test_where_nothing_stands_for_it_it_is_an_error_that_says_so(cluster: Cluster) -> None:
    ended = cluster._killed(_Sent(place=2, item=2, order=None), None)  # type: ignore[arg-type]
    with pytest.raises(
        RequestError, match=r"^cluster local:2: item 3 ended its worker 3 times; give workers"
    ):
        ended.value()


def test_an_error_comes_where_its_result_would_have_come(cluster: Cluster) -> None:
    results = cluster.in_order(Draws(failing=4), ITEMS)
    assert len([next(results) for _ in range(4)]) == 4
    with pytest.raises(JobError, match=r"^job.pdf: page 4 cannot be drawn; export it again$"):
        next(results)


def test_items_are_taken_when_workers_are_free(cluster: Cluster) -> None:
    taken: list[int] = []

    def items() -> Iterator[int]:
        for item in range(1000):
            taken.append(item)
            yield item

    results = cluster.in_order(Draws(), items())
    for _ in range(10):
        next(results)
    assert len(taken) < 30  # two workers, with four results ahead of each
    results.close()


def test_files_travel_to_a_worker_that_has_others_there(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from prooflight.cluster.parcels import FileAt

    folder = tmp_path / "job"
    (folder / "inner").mkdir(parents=True)
    (folder / "a.txt").write_text("one")
    (folder / "inner" / "b.txt").write_text("two")
    scans = [tmp_path / f"scan-{number}.txt" for number in range(4)]
    for number, scan in enumerate(scans):
        scan.write_text(f"scan {number}")
    # On this machine a worker would read the files where they are.
    monkeypatch.setattr(FileAt, "digest_there", lambda _: "", raising=False)
    cluster.client.run(setattr, FileAt, "digest_there", lambda _: "")
    files = Files(of_work=[folder], of_item=lambda scan: [scan])
    results = list(cluster.in_order(ReadsFiles(folder), scans, files=files))
    assert results == [("one", "two", f"scan {number}") for number in range(4)]


def test_a_worker_of_another_version_does_no_work(cluster: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    from prooflight.cluster import connection
    from prooflight.files.program import program_parts

    monkeypatch.setattr(
        connection, "program_parts", lambda *_: program_parts("prooflight") | {"numpy": "1.0"}
    )
    where = cluster.client.scheduler.address
    with (
        pytest.raises(
            RequestError, match=r"^worker tcp://127.0.0.1:\d+: has numpy [\d.]+, and this machine 1.0; ins"
        ),
        connection.connected(where),
    ):
        pass


@pytest.mark.parametrize(
    ("where", "what"),
    [
        ("tcp://127.0.0.1:9", "no Dask cluster answers; start `dask scheduler`"),
        ("tcp://127.0.0.1:99999", "no Dask cluster answers"),
        ("local:0", "names no workers; write local:N, with 1 to 512 workers on this machine"),
        ("local", "names no workers"),
        ("127.0.0.1:8786", "names no workers; start `dask scheduler`"),
    ],
)
def test_no_cluster_is_one_line(where: str, what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from prooflight.cluster import connection

    monkeypatch.setattr(connection, "CONNECT_S", 1)
    with pytest.raises(RequestError, match=what), connection.connected(where):
        pass


@pytest.mark.parametrize("greeting", [b"", b"SSH-2.0-OpenSSH_9.6\r\n", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_another_program_at_the_address_is_one_line(greeting: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    from prooflight.cluster import connection

    monkeypatch.setattr(connection, "CONNECT_S", 1)
    monkeypatch.setattr(connection, "ANSWER_S", 1)
    with socket.create_server(("127.0.0.1", 0)) as server:
        where = f"tcp://127.0.0.1:{server.getsockname()[1]}"

        def greet() -> None:
            other, _ = server.accept()
            other.sendall(greeting)
            heard.append(other)  # it stays open, and says nothing more

        heard: list[socket.socket] = []
        thread = threading.Thread(target=greet)
        thread.start()
        with (
            pytest.raises(
                RequestError, match=r"^cluster tcp://127.0.0.1:\d+: no Dask cluster answers; start"
            ),
            connection.connected(where),
        ):
            pass
        thread.join()
        for other in heard:
            other.close()


def test_workers_of_several_threads_are_refused() -> None:
    from distributed import LocalCluster

    from prooflight.cluster.connection import connected

    with (
        LocalCluster(
            n_workers=1,
            threads_per_worker=2,
            processes=False,
            protocol="tcp://",
            host="127.0.0.1",
            dashboard_address=None,
        ) as two,
        pytest.raises(RequestError, match=r"has 2 threads; start workers with `dask worker --nthreads 1"),
        connected(two.scheduler_address),
    ):
        pass
