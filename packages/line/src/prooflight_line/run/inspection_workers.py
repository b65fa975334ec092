"""Worker processes that inspect sheets, on machines with more processors than one interpreter can keep at work.

Each inspecting thread of a run hands its sheet to a worker of its own and waits. A scan travels in memory that both
processes share; designs and the press travel as files, written once and mapped by all workers.
"""

from __future__ import annotations

import gc
import io
import itertools
import logging
import multiprocessing
import pickle
import shutil
import signal
import threading
import weakref
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from multiprocessing.shared_memory import SharedMemory
from typing import TYPE_CHECKING, Any, Final
from uuid import uuid4

import numpy as np

from prooflight.detectors.optional import StoresPages
from prooflight.detectors.verdict import Verdict
from prooflight.errors import InputError, ProoflightError
from prooflight.files.lock import WriterLock, writer_lives
from prooflight.files.user_folders import user_folder
from prooflight.pages.parallel import KILLED, end_with_parent, leave_processors
from prooflight.pages.process import settle_process
from prooflight_line.run.shared_designs import SharedDesigns, read_design

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from ctypes import c_int
    from multiprocessing.connection import Connection
    from multiprocessing.context import SpawnProcess
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.inspection.inspector import Inspector
    from prooflight.inspection.packed_design import PackedDesign
    from prooflight_line.run.sheet_inspector import SheetInspector, SheetResult

_log = logging.getLogger(__name__)

THREADS_A_WORKER: Final = 2
"""Threads of a worker, while there are processors for all that are at work.

A page calls a thousand kernels, and its thread needs the interpreter after each: on 16 processors, one process with 8
threads inspected 10.7 sheets a second, 8 processes with 2 each 55 (docs/performance.md)."""
INSPECTOR_FILE: Final = "inspector"
SPAWN: Final = multiprocessing.get_context("spawn")


def worker_count(threads: int, inspector: Inspector, *, source_waits: bool = False) -> int:
    """Return the number of worker processes for so many inspecting threads; 0: they inspect in this process.

    A press that does not wait gets two even from two processors: of its sheets half as many were too late. Designs
    travel as the store of prepared designs keeps them, so that a detector that stores no pages, and pages with zones,
    are inspected in this process.
    """
    if not isinstance(inspector.detector, StoresPages) or inspector.zones is not None:
        return 0
    if threads < (2 * THREADS_A_WORKER if source_waits else 2):
        return 0
    return max(threads // THREADS_A_WORKER, 2)


class InspectionWorkers:
    """Worker processes of one run; safe to call from several threads at once."""

    def __init__(self, count: int, *, processors: int) -> None:
        """Prepare for ``count`` processes, which start with their first sheet.

        processors: number that they may use; while others need them, a process inspects in one thread. InputError: the
        user's cache folder cannot be written.
        """
        self._at_work = SPAWN.RawValue("i", 0)
        self._folder, self._lock = _own_folder(user_folder("cache") / "workers")
        self._workers = [_Worker(self._at_work, processors) for _ in range(count)]
        self._idle, self._changed = list(self._workers), threading.Condition()
        self._designs = SharedDesigns()
        self._numbers, self._writing = itertools.count(), threading.Lock()
        self._first: SheetInspector | None = None
        self._inspectors: weakref.WeakKeyDictionary[SheetInspector, Path] = weakref.WeakKeyDictionary()

    def inspect(
        self,
        inspector: SheetInspector,
        ready: PackedDesign,
        scan: NDArray[np.uint16],
        *,
        decided: Callable[[Verdict], None] | None = None,
        **arguments: Any,
    ) -> SheetResult:
        """Inspect a scan (sensors, lines, pixels) [DN] in a worker that is idle.

        decided, arguments: as of ``SheetInspector.inspect``. ProoflightError: the worker was killed; another takes its
        place.
        """
        files = self.provide(inspector, ready)
        with self._reserved() as worker:
            return worker.inspect(*files, scan, arguments, decided)

    def rehearse(
        self, inspector: SheetInspector, ready: PackedDesign, scan: NDArray[np.uint16], **arguments: Any
    ) -> None:
        """Inspect a scan in every worker at once; as ``inspect``."""
        files = self.provide(inspector, ready)
        self._in_each(lambda worker: worker.inspect(*files, scan, arguments))

    def load(self, inspector: SheetInspector, ready: PackedDesign) -> None:
        """Let every worker read a design, so that its first sheet need not wait for that.

        ProoflightError: a worker was killed, or cannot read the design.
        """
        files = self.provide(inspector, ready)
        self._in_each(lambda worker: worker.load(*files))

    def _in_each(self, act: Callable[[_Worker], object]) -> None:
        def act_in(worker: _Worker) -> None:
            with self._reserved(worker):
                act(worker)

        with ThreadPoolExecutor(len(self._workers)) as pool:
            list(pool.map(act_in, self._workers))

    @contextmanager
    def _reserved(self, only: _Worker | None = None) -> Iterator[_Worker]:
        """Reserve a worker for this thread, and this one alone if it is given."""
        with self._changed:
            self._changed.wait_for(lambda: only in self._idle if only else bool(self._idle))
            worker = only or self._idle[-1]
            self._idle.remove(worker)
            self._at_work.value += 1
        try:
            yield worker
        finally:
            with self._changed:
                self._idle.append(worker)
                self._at_work.value -= 1
                self._changed.notify_all()

    def provide(self, inspector: SheetInspector, ready: PackedDesign) -> tuple[Path, Path]:
        """Return an inspector's folder and a design's file, written unless they are there.

        The file is of the design as it was prepared: workers adapt it to the light of an inspector themselves.
        """
        folder = self._folder_of(inspector)
        return folder, self._designs.file(ready.origin or ready, inspector.inspector, folder)

    def _folder_of(self, inspector: SheetInspector) -> Path:
        """Return an inspector's folder; it holds what the inspector does not share with the first of the run."""
        folder = self._inspectors.get(inspector)
        if folder is not None:
            return folder
        with self._writing:
            folder = self._inspectors.get(inspector)
            if folder is None:
                folder = self._folder / f"{next(self._numbers):06d}"
                folder.mkdir()
                alone = replace(inspector, workers=None)
                (folder / INSPECTOR_FILE).write_bytes(_pickled(alone, self._first))
                self._first = self._first or alone
                self._inspectors[inspector] = folder
            return folder

    @property
    def at_work(self) -> int:
        """Number of workers that have a sheet or a design now."""
        return self._at_work.value

    @property
    def processes(self) -> list[int]:
        """Process identifiers of the workers that have started."""
        return [worker.process.pid for worker in self._workers if worker.process and worker.process.pid]

    def close(self) -> None:
        """End the processes, and remove what they have read."""
        for worker in self._workers:
            worker.close()
        self._designs.close()
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.with_suffix(".lock").unlink(missing_ok=True)
        self._lock.release()


def _parts(inspector: Inspector) -> list[object]:
    """Return the parts of an inspector that one on the same press in other light may share."""
    owners: tuple[Any, ...] = (inspector.press, inspector.detector, *inspector.press.sensors)
    parts = [getattr(one, part.name) for one in owners if is_dataclass(one) for part in fields(one)]
    return [part for part in parts if not isinstance(part, (int, float, str, type(None)))]


def _pickled(inspector: SheetInspector, first: SheetInspector | None) -> bytes:
    """Return an inspector pickled without what it shares with the first of the run."""
    file = io.BytesIO()
    pickler = pickle.Pickler(file, protocol=pickle.HIGHEST_PROTOCOL)
    if first is not None:
        places = {id(part): at for at, part in enumerate(_parts(first.inspector))}
        pickler.persistent_id = lambda one: places.get(id(one))  # type: ignore[method-assign]
    pickler.dump(inspector)
    return file.getvalue()


def _unpickled(data: bytes, first: SheetInspector | None) -> SheetInspector:
    unpickler = pickle.Unpickler(io.BytesIO(data))
    if first is not None:
        unpickler.persistent_load = _parts(first.inspector).__getitem__  # type: ignore[method-assign]
    loaded: SheetInspector = unpickler.load()
    return loaded


def _own_folder(base: Path) -> tuple[Path, WriterLock]:
    """Return a new folder and its lock; remove those of runs that were killed."""
    for old in base.glob("*.lock") if base.is_dir() else ():
        if not writer_lives(old.with_suffix("")):
            shutil.rmtree(old.with_suffix(""), ignore_errors=True)
            old.unlink(missing_ok=True)
    folder = base / uuid4().hex
    lock = WriterLock.take(
        folder, error=InputError, wait="try again", elsewhere="state another folder by XDG_CACHE_HOME"
    )
    folder.mkdir()
    return folder, lock


class _Worker:
    """One worker process, as the run sees it; used by one thread at a time."""

    def __init__(self, at_work: c_int, processors: int) -> None:
        self._at_work, self._processors = at_work, processors
        self._scan: SharedMemory | None = None
        self.process: SpawnProcess | None = None

    def inspect(
        self,
        folder: Path,
        design: Path,
        scan: NDArray[np.uint16],
        arguments: dict[str, Any],
        decided: Callable[[Verdict], None] | None = None,
    ) -> SheetResult:
        shared = self._room(scan.nbytes)
        np.ndarray(scan.shape, scan.dtype, shared.buf)[...] = scan
        return self._answer(folder, design, (shared.name, scan.shape, arguments), decided)

    def load(self, folder: Path, design: Path) -> None:
        self._answer(folder, design, None)

    def _answer(
        self,
        folder: Path,
        design: Path,
        sheet: tuple[str, tuple[int, ...], dict[str, Any]] | None,
        decided: Callable[[Verdict], None] | None = None,
    ) -> Any:
        if self.process is None:
            self._start()
        try:
            self._link.send((folder, design, sheet))
            while isinstance(result := self._link.recv(), Verdict):  # before the result
                if decided is not None:
                    decided(result)
        except (EOFError, OSError) as error:
            self.process = None
            raise ProoflightError(f"a sheet: {KILLED}; free some") from error
        if isinstance(result, Exception):
            raise result
        return result

    def close(self) -> None:
        if self.process is not None:
            self._link.close()
            self.process.join()
        if self._scan is not None:
            self._scan.close()
            self._scan.unlink()

    def _start(self) -> None:
        self._link, end = SPAWN.Pipe()
        self.process = SPAWN.Process(target=_work, args=(end, self._at_work, self._processors), daemon=True)
        self.process.start()
        end.close()

    def _room(self, size: int) -> SharedMemory:
        """Return shared memory of at least so many bytes."""
        if self._scan is not None and self._scan.size < size:
            self._scan.close()
            self._scan.unlink()
            self._scan = None
        if self._scan is None:
            self._scan = SharedMemory(create=True, size=size)
        return self._scan


def _work(link: Connection, at_work: c_int, processors: int) -> None:
    """Inspect sheets, and read designs, until the run closes the link.

    at_work: number of workers that do so now. processors: number that they may all use.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the run, which inspects what has passed
    threading.Thread(target=end_with_parent, daemon=True).start()
    settle_process()
    leave_processors(lambda threads: at_work.value * threads > processors)
    designs = _Designs()
    scans = dict[str, SharedMemory]()
    while True:
        try:
            folder, design, sheet = link.recv()
        except EOFError:
            return
        try:
            inspector, ready = designs.get(folder, design)
            result = None
            if sheet is not None:
                name, shape, arguments = sheet
                if name not in scans:
                    scans.clear()
                    scans[name] = SharedMemory(name=name)
                scan = np.ndarray(shape, np.uint16, scans[name].buf)
                result = inspector.inspect(ready, scan, decided=link.send, **arguments)
                del scan  # memory that arrays refer to cannot be closed
            link.send(result)
        except Exception as error:
            _log.debug("%s", design, exc_info=error)
            link.send(error)


class _Designs:
    """Inspectors and designs that a worker has read."""

    def __init__(self) -> None:
        self._inspectors: dict[Path, SheetInspector] = {}
        self._designs: dict[Path, PackedDesign] = {}
        self._adapted: dict[Path, tuple[Path, PackedDesign]] = {}
        """By the file of each design the last inspector that used it, and the design in that one's light."""

    def get(self, folder: Path, file: Path) -> tuple[SheetInspector, PackedDesign]:
        """Return an inspector, and a design in its light."""
        inspector = self._inspector(folder)
        if file not in self._designs:
            for old in [one for one in self._designs if not one.exists()]:  # the run uses them no more
                del self._designs[old], self._adapted[old]
            self._designs[file] = read_design(file, self._inspector(file.parent).inspector)
            self._adapted[file] = file.parent, self._designs[file]
            gc.freeze()  # or each cyclic collection would visit all designs
        light, ready = self._adapted[file]
        if light != folder:
            ready = inspector.renewed(self._designs[file])
            self._adapted[file] = folder, ready
        return inspector, ready

    def _inspector(self, folder: Path) -> SheetInspector:
        if folder not in self._inspectors:
            first = min(folder.parent.iterdir())
            of_run = self._inspector(first) if folder != first else None
            self._inspectors[folder] = _unpickled((folder / INSPECTOR_FILE).read_bytes(), of_run)
        return self._inspectors[folder]
