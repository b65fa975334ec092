"""The process that rips for this one, kept from page to page, and ended when a page exceeds its limits.

A PDF is a program: it may loop, request any amount of memory, or hit a fault of the renderer. Here that costs
its page, and nothing else.
"""

from __future__ import annotations

import contextlib
import json
import mmap
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import weakref
from dataclasses import dataclass
from multiprocessing import Pipe
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from prooflight import errors
from prooflight.errors import RequestError

if TYPE_CHECKING:
    from multiprocessing.connection import Connection


SECONDS: Final = "PROOFLIGHT_RIP_SECONDS"
"""Environment variable: longest time for opening a PDF, or ripping a page."""
GIGABYTES: Final = "PROOFLIGHT_RIP_GB"
"""Environment variable: most memory beyond the raster's own."""
USUAL_SECONDS: Final = 60.0
"""Default time: a page of A4 takes a third of a second, A0 with photographs and transparency some ten."""
USUAL_GIGABYTES: Final = 2.0
"""Default memory: MuPDF keeps 0.25 for fonts and images; an uncompressed CMYK photograph as large as A0 at
300 dpi takes 0.6."""
START_SECONDS: Final = 60.0
ANSWER_BYTES_MAX: Final = 64 * 2**20


@dataclass(frozen=True, slots=True, kw_only=True)
class RipLimits:
    """Limits of one request."""

    seconds: float = USUAL_SECONDS
    gigabytes: float = USUAL_GIGABYTES

    @classmethod
    def of_environment(cls) -> RipLimits:
        """Read the limits from the environment; RequestError if one that is set is not a number above 0."""
        return cls(seconds=_number(SECONDS, USUAL_SECONDS), gigabytes=_number(GIGABYTES, USUAL_GIGABYTES))


class RipFailure(Exception):
    """The process that rips has been lost; the message is the predicate of a sentence, ``remedy`` what may help."""

    def __init__(self, what: str, remedy: str) -> None:
        self.what, self.remedy = what, remedy
        super().__init__(what)


class RipProcess:
    """A child process that answers one request at a time, from any thread."""

    def __init__(self) -> None:
        """Start the process; RipFailure if it does not start."""
        ours, theirs = Pipe()
        lifeline, kept = os.pipe()
        self._memory = _shared_memory()
        self.folder = tempfile.mkdtemp(prefix="prooflight-rip-")
        """Folder for the output of other engines, until it is read."""
        self._map: mmap.mmap | None = None
        try:
            descriptors = (theirs.fileno(), lifeline, self._memory)
            process = subprocess.Popen(
                [
                    sys.executable,
                    "-P",
                    "-m",
                    "prooflight.pages.pdf.worker",
                    *map(str, descriptors),
                    self.folder,
                ],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=descriptors,
                start_new_session=True,  # Ctrl-C is for this process, which then ends that one
                env=os.environ
                | {
                    "PYTHONPATH": os.pathsep.join(str(Path(place).absolute()) for place in sys.path),
                    "OPENBLAS_NUM_THREADS": "1",
                },
            )
        finally:
            theirs.close()
            os.close(lifeline)
        self._process, self._connection, self._loaded = process, ours, False
        self.end = weakref.finalize(self, _end, process, ours, (kept, self._memory), self.folder)
        """Finalizer that ends the process and frees all that was shared with it; also called at the
        interpreter's exit."""
        self._answer(START_SECONDS, "does not start")

    def ask(self, request: dict[str, Any], limits: RipLimits) -> dict[str, Any]:
        """Return the answer, with the raster of a drawn page as ``cmyk``.

        InputError: the request was refused; RipFailure: the process was lost.
        """
        limited = {"seconds": limits.seconds, "room_bytes": limits.gigabytes * 1e9}
        try:
            if request.get("drawn_dpi") is not None and not self._loaded:
                self._send({"do": "load", "seconds": START_SECONDS, "room_bytes": None})
                self._answer(START_SECONDS, "does not start")
                self._loaded = True
            self._send(request | limited)
            answer = self._answer(limits.seconds, f"takes longer than {limits.seconds:g} s")
            if "shape" in answer:
                answer["cmyk"] = self._raster(answer["shape"])
        except BaseException:  # KeyboardInterrupt as well: the next request would get this one's answer
            self.end()
            raise
        if "memory" in answer:
            self.end()  # what MuPDF left half done is not used again
            what = f"takes more than {limits.gigabytes:g} GB of memory beyond its raster"
            raise RipFailure(what, f"simplify it, or set {GIGABYTES} above {limits.gigabytes:g}")
        if "refused" in answer:
            kind, where, what, remedy = answer["refused"]
            raise getattr(errors, kind)(where, what, remedy=remedy)
        return answer

    def _send(self, request: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):  # it has ended: the answer will say so
            self._connection.send_bytes(json.dumps(request).encode())

    def _answer(self, seconds: float, late: str) -> dict[str, Any]:
        try:
            if self._connection.poll(seconds):
                return json.loads(self._connection.recv_bytes(ANSWER_BYTES_MAX))
        except (EOFError, OSError):
            raise RipFailure(_fate(self._process), "export it again, or simplify it") from None
        raise RipFailure(late, f"simplify it, or set {SECONDS} above {seconds:g}")

    def _raster(self, shape: tuple[int, int, int]) -> NDArray[np.uint8]:
        """Return a copy of the shared memory, because the next page is drawn over it."""
        size = os.fstat(self._memory).st_size
        if self._map is None or len(self._map) != size:
            self._map = mmap.mmap(self._memory, size, prot=mmap.PROT_READ)
        return np.frombuffer(self._map, np.uint8, int(np.prod(shape))).reshape(shape).copy()


_guard = threading.RLock()
_running: list[RipProcess] = []
"""The process that rips for this process, if there is one."""


def ask(request: dict[str, Any], limits: RipLimits) -> dict[str, Any]:
    """Ask as ``RipProcess.ask``, with the existing process or a new one."""
    with _guard:
        if _running and not _running[0].end.alive:
            _running.clear()
        if not _running:
            _running.append(RipProcess())
        return _running[0].ask(request, limits)


def forget(request: dict[str, Any]) -> None:
    """Make the process, if there is one, close the file of a request."""
    with _guard, contextlib.suppress(RipFailure):
        if _running and _running[0].end.alive:
            _running[0].ask(request | {"do": "close"}, RipLimits())


def _abandoned() -> None:
    """Detach, in a forked process, the process that rips, which belongs to the parent."""
    global _guard
    _guard = threading.RLock()
    for detached in [one.end.detach() for one in _running]:
        if detached is not None:
            process, connection, descriptors, _folder = detached[2]
            connection.close()
            for descriptor in descriptors:
                os.close(descriptor)
            process.returncode = 0  # so that nobody waits for it here
    _running.clear()


os.register_at_fork(after_in_child=_abandoned)


def _end(
    process: subprocess.Popen[bytes], connection: Connection, descriptors: tuple[int, ...], folder: str
) -> None:
    connection.close()
    for descriptor in descriptors:
        os.close(descriptor)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)  # with it whatever draws for it
    process.wait()
    shutil.rmtree(folder, ignore_errors=True)


def _fate(process: subprocess.Popen[bytes]) -> str:
    """Return how a process ended, as the predicate of a sentence."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        code = process.wait(5)
        if code == -signal.SIGKILL:
            return "is ended by the system, as happens when memory runs out"
        if code < 0:
            return f"makes the renderer fail ({signal.Signals(-code).name})"
    return "makes the renderer fail"


def _shared_memory() -> int:
    """Return a file without a name that is in memory, where the system has such."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("prooflight-page")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())


def _number(name: str, usual: float) -> float:
    text = os.environ.get(name, "")
    try:
        value = float(text) if text.strip() else usual
    except ValueError:
        value = -1.0
    if not 0 < value < float("inf"):
        raise RequestError(name, f"{text!r} is not a limit", remedy=f"give a number above 0, as {usual:g}")
    return value
