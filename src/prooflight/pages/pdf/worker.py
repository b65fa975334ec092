"""The process that rips: PDFs are opened and drawn here, within limits of memory and time.

Started by ``rip_process`` as ``python -m prooflight.pages.pdf.worker`` with three file descriptors: a socket
for requests and answers as JSON; a pipe that is never written to, whose end is the end of the requesting
process; and the shared memory that pages are drawn into; and with a folder for the output of other engines
(``external``). It ends when the socket closes, and with it every program that it started.
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
from numpy.typing import NDArray

from prooflight.errors import InputError, JobError
from prooflight.pages.memory import file_stamp, keep_memory
from prooflight.pages.pdf.document import BYTES_PER_PIXEL, PdfFile, read_profile
from prooflight.pages.pdf.engine import RipEngine
from prooflight.pages.pdf.rip_model import RipModel
from prooflight.pages.spots.spot_ink import SpotPrint

if TYPE_CHECKING:
    from prooflight.pages.warnings import PageWarning

FILES_CACHED: Final = 8
"""PDFs kept open for their next page."""
SPARE: Final = 4
"""Largest ratio of shared memory to the page; beyond it, memory is returned."""
GRACE_S: Final = 5.0
"""Time beyond its limit after which the process ends by itself, if no parent is left to end it."""


class SharedRaster:
    """Memory that both processes see: pages of one size, one after the other, are drawn into the same."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._memory: mmap.mmap | None = None

    def __call__(self, shape: tuple[int, int, int]) -> NDArray[np.uint8]:
        """Return an array of zeros; MemoryError or OSError if there is no room for it."""
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
    """Worker that answers requests, each of which contains everything that it depends on."""

    def __init__(self, raster: SharedRaster, folder: Path) -> None:
        self._raster, self._folder = raster, folder
        self._files: OrderedDict[tuple[Any, ...], PdfFile] = OrderedDict()
        self._examined: tuple[tuple[Any, ...], PdfFile] | None = None

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return the answer to a request, or the reason for a refusal."""
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
        """Compile the combination of pixels, or load it, before the memory and time of a page are limited.

        It takes as long as all else that this process loads, and is requested with the first page that needs
        it.
        """
        from prooflight.pages.pdf.area_averages import area_averaged

        area_averaged(np.zeros((2, 2, 4), np.uint8), np.zeros((1, 1, 4), np.uint8), None, step=2.0)
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
        stated = {name: _tuple(value) for name, value in request["rip"].items()}
        how: dict[str, Any] = {"drawn_dpi": request["drawn_dpi"], "light": light, "rip": RipModel(**stated)}
        if request["engine"] is None:
            shape = file.draw(request["number"], request["dpi"], raster, **how).shape
        else:
            engine = RipEngine(name=request["engine"][0], command=tuple(request["engine"][1]))
            room_bytes, folder = request["room_bytes"], self._folder
            shape = file.draw_by(
                engine, folder, request["number"], request["dpi"], raster, room_bytes=room_bytes, **how
            ).shape
        return {"shape": shape, "warnings": _plain(file.warnings())}

    def _picture(self, request: dict[str, Any]) -> dict[str, Any]:
        file, shapes = self._file(request), list[tuple[int, int, int]]()

        def raster(shape: tuple[int, int, int], drawn_pixels: int) -> NDArray[np.uint8]:
            _limit_memory(request["room_bytes"] + BYTES_PER_PIXEL * drawn_pixels)
            shapes.append(shape)
            return self._raster(shape)

        dpi = file.picture(request["number"], raster)
        return {"shape": shapes[0], "dpi": dpi, "warnings": _plain(file.warnings())}

    def _marks(self, request: dict[str, Any]) -> dict[str, Any]:
        file = self._file(request)
        return {"marks": file.marks(request["number"]), "warnings": _plain(file.warnings())}

    def _facts(self, request: dict[str, Any]) -> dict[str, Any]:
        # Of a document of its own: drawing may rename what it draws with.
        key = _key(request)
        if self._examined is None or self._examined[0] != key:
            self._examined = key, self._opened(request)
        file = self._examined[1]
        facts = file.facts(request["number"], Path(request["swatches"]))
        file.warnings()  # what is wrong with the page is said when it is drawn
        return facts | {"warnings": []}

    def _document(self, request: dict[str, Any]) -> dict[str, Any]:
        file = self._file(request)
        return {"facts": file.document_facts(), "warnings": _plain(file.warnings())}

    def _extract(self, request: dict[str, Any]) -> dict[str, Any]:
        file = self._opened(request)  # a document of its own, as it is in the file
        try:
            file.extract(request["numbers"], Path(request["out"]))
            return {"warnings": _plain(file.warnings())}
        finally:
            file.close()

    def _close(self, request: dict[str, Any]) -> dict[str, Any]:
        file, examined = self._files.pop(_key(request), None), self._examined
        if file is not None:
            file.close()
        if examined is not None and examined[0] == _key(request):
            examined[1].close()
            self._examined = None
        return {}

    def _file(self, request: dict[str, Any]) -> PdfFile:
        """Return the PDF, opened if it is not open, or no longer; JobError if it is another one than before."""
        key = _key(request)
        if key not in self._files:
            self._files[key] = self._opened(request)
            if len(self._files) > FILES_CACHED:
                self._files.popitem(last=False)[1].close()
        self._files.move_to_end(key)
        return self._files[key]

    @staticmethod
    def _opened(request: dict[str, Any]) -> PdfFile:
        path, shown, profile = Path(request["path"]), request["shown"], request["profile"]
        if file_stamp(path) != request["stamp"]:
            what = "has been changed while it was in use"
            raise JobError(shown, what, remedy="do not change it until the job is done")
        icc = None if profile is None else read_profile(Path(profile), request["shown_profile"])
        spots = [
            SpotPrint(name=name, mixture=tuple(map(_tuple, mixture))) for name, mixture in request["spots"]
        ]
        return PdfFile(path, shown, icc, spots)


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _plain(warnings: list[PageWarning]) -> list[dict[str, Any]]:
    return [dataclasses.asdict(warning) for warning in warnings]


def _key(request: dict[str, Any]) -> tuple[Any, ...]:
    return request["path"], *request["stamp"], request["profile"], json.dumps(request["spots"])


def _limit_memory(room_bytes: float | None) -> None:
    """Let this process take more memory by ``room_bytes``; None: without a limit.

    If the system does not count memory, time is the only limit.
    """
    with contextlib.suppress(OSError, ValueError):
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        allowed = most if room_bytes is None else int(pages * mmap.PAGESIZE + room_bytes)
        resource.setrlimit(resource.RLIMIT_AS, (allowed, most))


def _end_with(lifeline: int) -> None:
    """End with the requesting process, also in the midst of a page: Python's own threads would wait for MuPDF."""
    signal.signal(signal.SIGIO, signal.SIG_DFL)  # its default is to end the process
    with contextlib.suppress(OSError):
        fcntl.fcntl(lifeline, fcntl.F_SETOWN, -os.getpgrp())  # and the programs that it started
        fcntl.fcntl(lifeline, fcntl.F_SETFL, fcntl.fcntl(lifeline, fcntl.F_GETFL) | os.O_ASYNC)


def main() -> None:
    """Answer requests until the socket closes."""
    connection, lifeline, memory = (int(text) for text in sys.argv[1:4])
    _end_with(lifeline)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    keep_memory()
    asked, worker = Connection(connection), Worker(SharedRaster(memory), Path(sys.argv[4]))
    with contextlib.suppress(EOFError, ConnectionError):
        asked.send_bytes(b"{}")  # ready
        while True:
            asked.send_bytes(json.dumps(worker.answer(json.loads(asked.recv_bytes()))).encode())


if __name__ == "__main__":
    main()
