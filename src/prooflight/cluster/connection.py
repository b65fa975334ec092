"""Connection to the workers of ``--cluster``: those of a scheduler, or some that are started here.

Those of this machine are started again when they were killed. Dask's own nannies give up on a worker that starts
slowly, as on a machine under load; it is then missing to the end.

Needs the extra ``cluster``.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import re
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any, Final

from distributed import Client, LocalCluster, Security, Worker
from distributed.comm import connect
from llvmlite import binding  # type: ignore[import-untyped]

from prooflight.cluster.cluster import Cluster
from prooflight.cluster.worker import describe, refuse_other_program
from prooflight.errors import RequestError
from prooflight.files.program import program_parts
from prooflight.pages.parallel import end_with_parent

CONNECT_S: Final = 5
ANSWER_S: Final = 5
START_S: Final = 300
"""Longest start of workers on this machine; assumed: each takes some seconds, under load a minute."""
MOST_LOCAL: Final = 512
PACKAGES: Final = ("prooflight",)
"""Packages that every worker needs; that of the work is checked with its first item."""
REMEDY: Final = (
    "start `dask scheduler` and `dask worker --nthreads 1` there, and give tcp://HOST:PORT, or local:N"
)

_log = logging.getLogger(__name__)


@contextmanager
def connected(where: str) -> Iterator[Cluster]:
    """Connect to the workers of a cluster, which run the same program as this process.

    where: ``local:N``, so many worker processes on this machine for this time, or the address of a Dask scheduler.

    Raises
    ------
    RequestError
        Nothing answers there, there are no workers, they have several threads, or another version of the program.
    """
    with ExitStack() as stack:
        stack.enter_context(_quiet())
        number = _local(where)
        if number is not None:
            scheduler = LocalCluster(
                n_workers=0, host="127.0.0.1", dashboard_address="127.0.0.1:0", silence_logs=logging.CRITICAL
            )
            stack.enter_context(scheduler)
            start_missing = stack.enter_context(local_workers(number, scheduler.scheduler_address))
            client = stack.enter_context(Client(scheduler, set_as_default=False))
            _await_workers(client, number, where)
        else:
            start_missing = _start_none
            _refuse_other(where)
            try:
                client = stack.enter_context(Client(where, timeout=CONNECT_S, set_as_default=False))
            except (OSError, ValueError, TypeError) as error:
                raise _no_answer(where) from error
        _check(client, where)
        yield Cluster(client=client, where=where, start_missing=start_missing)


def _start_none() -> None:
    """Start no worker: those of a scheduler are started by whoever runs it."""


def _await_workers(client: Client, number: int, where: str) -> None:
    try:
        client.wait_for_workers(number, timeout=START_S)
    except TimeoutError as error:
        what = f"its workers did not start within {START_S} s"
        raise RequestError(f"cluster {where}", what, remedy="request fewer workers") from error


def _local(where: str) -> int | None:
    """Return the number of workers that are started here; None: it is the address of a scheduler."""
    if not where.startswith("local"):
        return None
    match = re.fullmatch(r"local:([0-9]{1,4})", where)
    if match is None or not 1 <= int(match[1]) <= MOST_LOCAL:
        remedy = f"write local:N, with 1 to {MOST_LOCAL} workers on this machine, or tcp://HOST:PORT"
        raise RequestError("cluster", f"{where[:40]!r} names no workers", remedy=remedy)
    return int(match[1])


def _refuse_other(where: str) -> None:
    """Raise RequestError unless a scheduler answers at an address.

    Dask's client would wait for ever for the greeting of a silent program, and leave a thread that reports late.
    """
    match = re.fullmatch(r"(?:tcp|tls)://\[?([^/]+?)\]?:([0-9]{1,5})", where)
    if match is None:
        raise RequestError("cluster", f"{where[:40]!r} names no workers", remedy=REMEDY)
    try:
        kind = asyncio.run(asyncio.wait_for(_kind(where), CONNECT_S + ANSWER_S))
    except (
        Exception
    ) as error:  # another program's greeting may be read as anything, such as a size of 10^18 bytes
        raise _no_answer(where) from error
    if kind != "Scheduler":
        raise _no_answer(where)


async def _kind(where: str) -> object:
    """Return which of Dask's servers answers at an address."""
    comm = await connect(where, timeout=CONNECT_S, **Security().get_connection_args("client"))
    try:
        await comm.write({"op": "identity", "reply": True})
        answer = await comm.read()
        return answer["type"]
    finally:
        comm.abort()


def _no_answer(where: str) -> RequestError:
    return RequestError(f"cluster {where}", "no Dask cluster answers", remedy=REMEDY)


def _check(client: Client, where: str) -> None:
    """Raise RequestError unless all workers can do the work of this program; warn of other processors."""
    threads: Mapping[str, int] = client.nthreads()
    if not threads:
        raise RequestError(f"cluster {where}", "its scheduler has no workers", remedy=REMEDY)
    for worker, number in threads.items():
        if number != 1:  # PDFs must not be drawn by several threads of a process (decision 7)
            remedy = "start workers with `dask worker --nthreads 1 --nworkers auto`"
            raise RequestError(f"worker {worker}", f"has {number} threads", remedy=remedy)
    answers: Mapping[str, Any] = client.run(describe, PACKAGES, on_error="return")
    own = str(binding.get_host_cpu_name())
    for worker, answer in answers.items():
        if isinstance(answer, Exception):
            what, remedy = f"cannot run Prooflight: {answer}", "install this version of Prooflight there"
            raise RequestError(f"worker {worker}", what, remedy=remedy)
        program, processor = answer
        refuse_other_program(worker, program, program_parts(*PACKAGES))
        if processor != own:
            _log.warning(
                "worker %s computes on another processor (%s, here %s): last digits may differ",
                worker,
                processor,
                own,
            )


@contextmanager
def _quiet() -> Iterator[None]:
    """Let Dask log errors alone: what concerns the user, such as a lost cluster, is raised."""
    logger = logging.getLogger("distributed")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)


@contextmanager
def local_workers(number: int, scheduler: str) -> Iterator[Callable[[], None]]:
    """Start workers of one thread for a scheduler; yield the function that starts again those that have ended."""
    context = multiprocessing.get_context("spawn")
    processes: list[multiprocessing.process.BaseProcess] = []
    with tempfile.TemporaryDirectory(prefix="prooflight-workers-", ignore_cleanup_errors=True) as folder:

        def start_missing() -> None:
            alive = [process for process in processes if process.is_alive()]
            for _ in range(number - len(alive)):
                process = context.Process(target=_serve, args=(scheduler, folder), daemon=True)
                process.start()
                alive.append(process)
            processes[:] = alive

        try:
            start_missing()
            yield start_missing
        finally:
            for process in processes:
                process.kill()  # results are with the head, and the folder is removed here
            for process in processes:
                process.join()


def _serve(scheduler: str, folder: str) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for whoever started this process
    threading.Thread(target=end_with_parent, daemon=True).start()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    asyncio.run(_work(scheduler, folder))


async def _work(scheduler: str, folder: str) -> None:
    worker = await Worker(
        scheduler, nthreads=1, memory_limit=0, host="127.0.0.1", local_directory=folder, dashboard=False
    )
    await worker.finished()
