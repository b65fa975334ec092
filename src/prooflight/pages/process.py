"""How a process is set for page after page of the same size."""

from __future__ import annotations

import gc
import os
import sys
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
import scipy.linalg  # noqa: F401  before its threads can be limited, a library of linear algebra must be there
from threadpoolctl import threadpool_limits

from prooflight.pages.heap import keep_memory

if TYPE_CHECKING:
    from collections.abc import Iterator

SWITCH_S: Final = 5e-4
"""For which a thread may keep the interpreter while another waits: a tenth of Python's own. A page calls a thousand
kernels, and after each must have the interpreter again; two threads inspect a tenth more pages so."""
TOUCHED_BYTES: Final = 1_500_000_000
"""Well below ``heap.KEPT_BYTES``, beyond which freed memory is given back; two seconds of work."""
LOWEST: Final = 19
"""Priority, of nice(2): what inspecting leaves, in which pages are made ready."""


def settle_process() -> None:
    """Keep freed memory for the next page, and leave threads to whoever shares out the pages.

    A page takes some 200 MB for moments; given back and asked for again, the system clears it each time, which costs
    a tenth of an inspection. OpenCV's own threads and those of linear algebra would fight with the ones that inspect:
    two processes on two cores took a quarter longer. For the whole process; where the C library is not glibc, memory
    stays as it was.
    """
    cv2.setNumThreads(1)
    threadpool_limits(limits=1)
    sys.setswitchinterval(SWITCH_S)
    keep_memory()


def touch(size_bytes: int) -> None:
    """Have the system clear memory now that pages will take soon, up to ``TOUCHED_BYTES``.

    It stays with the process after ``settle_process``. Where the first pages take it bit by bit, each waits for that.
    """
    np.full(min(size_bytes, TOUCHED_BYTES), 1, np.uint8)


@contextmanager
def collector_spared() -> Iterator[None]:
    """Have the collector of cyclic garbage not look at what is there now.

    To look at all that a run has ready takes it a tenth of a second, in which no thread gets the interpreter.
    """
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def step_back() -> None:
    """Let this thread yield to those that inspect, where the system gives threads a priority of their own."""
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), LOWEST)
