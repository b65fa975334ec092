"""Worker processes on this machine, each started again when it was killed.

Dask's own nannies give up on a worker that starts slowly, as on a machine under load; it is then missing to the end.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import signal
import tempfile
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

from distributed import Worker

from prooflight.pages.parallel import end_with_parent

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


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
