"""Parts of a page shared out over threads."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.pages import parallel
from prooflight.pages.parallel import (
    _page,
    _pool_of,
    _WorkerPool,
    due,
    leave_processors,
    parts_of,
    shared_out,
)


@pytest.mark.parametrize("threads", [1, 3])
def test_results_come_in_the_order_of_the_tasks(threads: int) -> None:
    assert shared_out([partial(pow, n, 2) for n in range(20)], threads=threads) == [n**2 for n in range(20)]


def _run_out(threads: list[threading.Thread]) -> None:
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)


def test_no_more_run_at_once_than_asked_for_whoever_asks() -> None:
    under_way, most, guard = [0], [0], threading.Lock()
    met = threading.Barrier(2)

    def task() -> None:
        with guard:
            under_way[0] += 1
            most[0] = max(most[0], under_way[0])
        met.wait(20)  # two do run at once
        with guard:
            under_way[0] -= 1

    asking = [threading.Thread(target=shared_out, args=([task] * 6,), kwargs={"threads": 2}) for _ in "ab"]
    _run_out(asking)
    assert most[0] == 2


def test_parts_of_the_page_due_first_are_done_first_and_of_one_page_in_turn() -> None:
    pool, gate, done = _WorkerPool(1), threading.Event(), list[str]()
    pool.do([lambda: gate.wait(20)], -math.inf, gate.is_set)
    parts = [("late", math.inf), ("a1", 3.0), ("b1", 1.0), ("a2", 3.0), ("b2", 1.0)]
    last = [pool.do([partial(done.append, name)], due_s, gate.is_set)[0] for name, due_s in parts]
    gate.set()
    for one in last:
        one.result(20)
    assert done == ["b1", "b2", "a1", "a2", "late"]


def test_what_is_overdue_comes_last() -> None:
    now = 0.0
    with due(5.0, lambda: now, processors=3):
        assert _page.due_s() == 5.0
        now = 6.0
        assert _page.due_s() == math.inf
    assert _page.due_s() == math.inf
    assert _page.pool is None


def test_pages_and_their_parts_take_no_more_processors_than_there_are() -> None:
    under_way, most, guard = [0], [0], threading.Lock()

    def work() -> None:
        with guard:
            under_way[0] += 1
            most[0] = max(most[0], under_way[0])
        time.sleep(0.002)
        with guard:
            under_way[0] -= 1

    def page(due_s: float) -> None:
        with due(due_s, lambda: 0.0, processors=2):
            for _ in range(4):
                work()
                shared_out([work] * 4, threads=2)

    pages = [threading.Thread(target=page, args=(due_s,)) for due_s in (3.0, 1.0, 2.0, 4.0)]
    _run_out(pages)
    assert most[0] == 2


def test_the_page_due_first_is_given_the_next_processor() -> None:
    gate, held, done = threading.Event(), threading.Barrier(3), list[str]()

    def holds() -> None:
        with due(0.0, lambda: 0.0, processors=2):
            held.wait(20)
            gate.wait(20)

    def page(name: str, due_s: float) -> None:
        with due(due_s, lambda: 0.0, processors=2):
            done.append(name)

    first = [threading.Thread(target=holds) for _ in range(2)]
    for thread in first:
        thread.start()
    held.wait(20)
    waiting = [threading.Thread(target=page, args=one) for one in (("late", 8.0), ("soon", 7.0))]
    pool = _pool_of(2)
    for at, thread in enumerate(waiting, start=1):
        thread.start()
        until = time.monotonic() + 20
        while len(pool._asked) < at and time.monotonic() < until:
            time.sleep(0.001)
    pool.leave()  # as if a page ended; it is taken back below
    waiting[1].join(20)
    assert done[0] == "soon"
    pool.wait(-math.inf)
    gate.set()
    for thread in (*first, *waiting):
        thread.join(20)
    assert done == ["soon", "late"]


def test_a_process_of_pages_does_their_parts_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "_stored", [print])
    assert set(shared_out([threading.get_ident] * 8, threads=2)) == {threading.get_ident()}
    monkeypatch.undo()
    assert threading.get_ident() not in shared_out([threading.get_ident] * 8, threads=2)


def test_parts_run_in_turn_while_other_processes_need_the_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "_elsewhere", [])
    others = [0]
    leave_processors(lambda threads: others[0] + threads > 4)
    for others[0], threads, alone in (
        (0, 2, False),
        (3, 2, True),
        (2, 2, False),
        (2, 3, True),
        (0, 4, False),
    ):
        used = set(shared_out([threading.get_ident] * 8, threads=threads))
        assert (used == {threading.get_ident()}) == alone


@given(st.integers(0, 50), st.integers(1, 9))
def test_parts_lie_one_behind_the_other_and_are_about_as_long(extent: int, parts: int) -> None:
    found = parts_of(extent, parts)
    assert [at for part in found for at in range(*part)] == list(range(extent))
    assert len(found) == min(parts, extent)
    lengths = [last - first for first, last in found]
    assert max(lengths, default=0) - min(lengths, default=0) <= 1


def test_what_a_task_raises_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        shared_out([partial(divmod, 1, 0), partial(divmod, 1, 1)], threads=2)


PARENT = """
import os, time
from prooflight.pages.parallel import in_order

def told(_item):
    os.write(1, f"{os.getpid()}\\n".encode())  # in one piece, whoever else writes
    time.sleep(0.2)

if __name__ == "__main__":
    list(in_order(told, range(2000), processes=2, fewest=2))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks processes up in /proc")
def test_workers_end_with_a_parent_that_was_killed(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    workers: set[int] = set()
    while len(workers) < 2:
        workers.add(int(parent.stdout.readline()))
    parent.kill()
    parent.wait(20)
    parent.stdout.close()
    until = time.monotonic() + 20
    while any(map(_runs, workers)):
        assert time.monotonic() < until, "a worker is still there"
        time.sleep(0.05)


def _runs(process: int) -> bool:
    """Whether it is there and has not ended; nobody may have taken note of its end yet."""
    try:
        return "State:\tZ" not in Path(f"/proc/{process}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
