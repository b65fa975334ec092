"""Settings of a process that inspects page after page of the same size."""

from __future__ import annotations

import gc
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import cv2
import scipy.linalg  # noqa: F401  before its threads can be limited, a library of linear algebra must be there
from threadpoolctl import threadpool_limits

from prooflight.pages.memory import keep_memory

SWITCH_S: Final = 5e-4
"""Time for which a thread may keep the interpreter while another waits: a tenth of Python's own. A page
calls a thousand kernels, and needs the interpreter again after each; with this time, two threads inspect a
tenth more pages."""
LOWEST: Final = 19
"""Priority, of nice(2), of threads that prepare pages, so that they use only the time that inspection leaves."""


def settle_process() -> None:
    """Keep freed memory for the next page, and leave the use of threads to the code that distributes the pages.

    A page takes some 200 MB for moments; if memory is returned and requested again, the system clears it each
    time, which costs a tenth of an inspection. OpenCV's own threads and those of linear algebra would compete
    with the ones that inspect: two processes on two cores took a quarter longer. This applies to the whole
    process; if the C library is not glibc, memory is handled as before.
    """
    cv2.setNumThreads(1)
    threadpool_limits(limits=1)
    sys.setswitchinterval(SWITCH_S)
    keep_memory()


@contextmanager
def collector_spared() -> Iterator[None]:
    """Exclude the objects that exist now from cyclic garbage collection.

    A collection of all prepared objects of a run takes a tenth of a second, in which no thread gets the
    interpreter.
    """
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def step_back() -> None:
    """Lower this thread's priority below those that inspect, where the system gives threads a priority of their own."""
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), LOWEST)
