"""The process that rips: PDFs are opened and drawn here, within limits of memory and time.

Started by ``rip_process`` as ``python -m prooflight.pages.pdf.worker`` with three file descriptors: a socket, on which
requests and answers travel as JSON; a pipe that nobody writes to, whose end is the end of the process that asks; and
the shared memory that pages are drawn into. It ends when it is no longer asked.
"""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import json
import mmap
import os
import resource
import signal
import sys
from collections import OrderedDict
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.errors import InputError, JobError
from prooflight.pages.heap import keep_memory
from prooflight.pages.memory import file_stamp
from prooflight.pages.pdf.document import BYTES_PER_PIXEL, PdfFile, read_profile

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.warnings import PageWarning

FILES_KEPT: Final = 8
"""PDFs kept open for their next page."""
SPARE: Final = 4
"""Shared memory is given back if it is so many times as large as the page."""
GRACE_S: Final = 5.0
"""Beyond its limit of time the process ends by itself, if nobody is there any more to end it."""


class SharedRaster:
    """Memory that both processes see: pages of one size, one after the other, are drawn into the same."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._memory: mmap.mmap | None = None

    def __call__(self, shape: tuple[int, int, int]) -> NDArray[np.uint8]:
        """An array of zeros. MemoryError, OSError: there is no room for it."""
        needed = int(np.prod(shape))
        memory = self._memory
        if memory is None or not needed <= len(memory) <= SPARE * needed:
            memory = self._memory = None  # the arrays of earlier pages are gone by now
            os.ftruncate(self._descriptor, 0)
            os.ftruncate(self._descriptor, needed)
            memory = self._memory = mmap.mmap(self._descriptor, needed)
        raster: NDArray[np.uint8] = np.frombuffer(memory, np.uint8, needed).reshape(shape)
        raster[:] = 0
        return raster


class Worker:
    """Answers requests, each of which says everything that it depends on."""

    def __init__(self, raster: SharedRaster) -> None:
        self._raster = raster
        self._files: OrderedDict[tuple[Any, ...], PdfFile] = OrderedDict()

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """What was asked for, or why not."""
        signal.setitimer(signal.ITIMER_REAL, request["seconds"] + GRACE_S)
        try:
            _limit_memory(request["room_bytes"])
            return getattr(self, f"_{request['do']}")(request)
        except InputError as error:
            return {"refused": [type(error).__name__, error.where, error.what, error.remedy]}
        except MemoryError:
            return {"memory": True}
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)

    def _load(self, _: dict[str, Any]) -> dict[str, Any]:
        """Compile what takes pixels together, or load it, before the memory and time of a page are limited.

        It takes as long as all else that this process loads, and is asked for with the first page that needs it.
        """
        from prooflight.pages.pdf.taking_together import taken_together

        taken_together(np.zeros((2, 2, 4), np.uint8), np.zeros((1, 1, 4), np.uint8), None, step=2.0)
        return {}

    def _open(self, request: dict[str, Any]) -> dict[str, Any]:
        file = self._file(request)
        return {"pages": file.pages, "warnings": _plain(file.warnings())}

    def _sizes(self, request: dict[str, Any]) -> dict[str, Any]:
        file = self._file(request)
        return {"sizes": file.sizes_points(), "warnings": _plain(file.warnings())}

    def _page(self, request: dict[str, Any]) -> dict[str, Any]:
        file = self._file(request)

        def raster(shape: tuple[int, int, int], drawn_pixels: int) -> NDArray[np.uint8]:
            _limit_memory(request["room_bytes"] + BYTES_PER_PIXEL * max(drawn_pixels, shape[0] * shape[1]))
            return self._raster(shape)

        light = request["light"] and tuple(map(tuple, request["light"]))
        shape = file.draw(
            request["number"], request["dpi"], raster, drawn_dpi=request["drawn_dpi"], light=light
        ).shape
        return {"shape": shape, "warnings": _plain(file.warnings())}

    def _marks(self, request: dict[str, Any]) -> dict[str, Any]:
        file = self._file(request)
        return {"marks": file.marks(request["number"]), "warnings": _plain(file.warnings())}

    def _close(self, request: dict[str, Any]) -> dict[str, Any]:
        file = self._files.pop(_key(request), None)
        if file is not None:
            file.close()
        return {}

    def _file(self, request: dict[str, Any]) -> PdfFile:
        """The PDF, opened if it is not open, or no longer. JobError: it is another one than before."""
        key = _key(request)
        if key not in self._files:
            path, shown, profile = Path(request["path"]), request["shown"], request["profile"]
            if file_stamp(path) != request["stamp"]:
                what = "has been changed while it was in use"
                raise JobError(shown, what, remedy="leave it alone until the job is done")
            icc = None if profile is None else read_profile(Path(profile), request["shown_profile"])
            self._files[key] = PdfFile(path, shown, icc)
            if len(self._files) > FILES_KEPT:
                self._files.popitem(last=False)[1].close()
        self._files.move_to_end(key)
        return self._files[key]


def _plain(warnings: list[PageWarning]) -> list[dict[str, Any]]:
    return [dataclasses.asdict(warning) for warning in warnings]


def _key(request: dict[str, Any]) -> tuple[Any, ...]:
    return request["path"], *request["stamp"], request["profile"]


def _limit_memory(room_bytes: float | None) -> None:
    """Let this process take so much more than it has; where the system does not count, time is the only limit.

    None: as much as it likes.
    """
    with contextlib.suppress(OSError, ValueError):
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        allowed = most if room_bytes is None else int(pages * mmap.PAGESIZE + room_bytes)
        resource.setrlimit(resource.RLIMIT_AS, (allowed, most))


def _end_with(lifeline: int) -> None:
    """End with the process that asks, also in the midst of a page: Python's own threads would wait for MuPDF."""
    signal.signal(signal.SIGIO, signal.SIG_DFL)  # its default is to end the process
    with contextlib.suppress(OSError):
        fcntl.fcntl(lifeline, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(lifeline, fcntl.F_SETFL, fcntl.fcntl(lifeline, fcntl.F_GETFL) | os.O_ASYNC)


def main() -> None:
    """Answer until nobody asks."""
    connection, lifeline, memory = (int(text) for text in sys.argv[1:])
    _end_with(lifeline)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    keep_memory()
    asked, worker = Connection(connection), Worker(SharedRaster(memory))
    with contextlib.suppress(EOFError, ConnectionError):
        asked.send_bytes(b"{}")  # ready
        while True:
            asked.send_bytes(json.dumps(worker.answer(json.loads(asked.recv_bytes()))).encode())


if __name__ == "__main__":
    main()
