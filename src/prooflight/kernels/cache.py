"""On-disk cache of compiled kernels that tolerates unwritable folders, damaged files and concurrent processes.

Numba stores kernels beside the source or in the user's cache folder. Where neither can be written it refuses
to compile at all, and a file that was truncated when a disk filled or a machine lost power ends every later
run. Here the first case falls back to a folder for temporary files, and in the second the kernel is compiled
again.

Processes that start together need the same kernels. Here one of them compiles a kernel, and the others wait
for its result; two that wrote the index of one kernel at once could also lose or exchange each other's
overloads.

Numba compiles a stored kernel again when its own file changes. Its machine code also contains the loops that it
calls, the instructions of its intrinsics and the numbers of other modules, so that a change of their files has to
count as well (``source_digest``): otherwise two folders with the same source compute different results.
"""

from __future__ import annotations

import gc
import hashlib
import logging
import os
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from inspect import unwrap
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, Final

import numpy as np
from numba import config
from numba.core.caching import FunctionCache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.runtime import rtsys

from prooflight.kernels.self_contained import StoredKernel

if sys.platform != "win32":
    import fcntl


LIBRARIES: Final = ("llvmlite", "numba", "numpy")
"""Packages whose versions numba compares itself, or whose functions are not compiled."""
COMPILING: Final = tuple(str(Path(__file__).with_name(name)) for name in ("compiled.py", "self_contained.py"))
"""Files that say how kernels are compiled."""
NUMBERS: Final = (bool, int, float, complex, str, tuple, np.generic)


@cache
def source_digest(function: Callable[..., Any]) -> str:
    """Return the SHA-256 of the files of a loop, of all functions that it calls, and of the numbers that they use."""
    parts = {_digest_of_file(name) for name in COMPILING}
    waiting, seen = [unwrap(function)], set()
    while waiting:
        one = waiting.pop()
        seen.add(one)
        parts.add(_digest_of_file(one.__code__.co_filename))
        for name, value in _used(one):
            called = unwrap(value) if callable(value) else None
            if isinstance(called, FunctionType):
                if called not in seen and called.__module__.split(".")[0] not in LIBRARIES:
                    waiting.append(called)
            elif isinstance(value, np.ndarray):
                parts.add(f"{name} = {value.dtype} {value.tolist()}")
            elif isinstance(value, NUMBERS):
                parts.add(f"{name} = {value!r}")
    return hashlib.sha256("\n".join(sorted(parts)).encode()).hexdigest()


def _used(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Return names and values of what a function and those within it use of its module and of functions around it."""
    code: CodeType = function.__code__
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents
    variables = function.__globals__
    waiting = [code]
    while waiting:
        one = waiting.pop()
        yield from ((name, variables[name]) for name in one.co_names if name in variables)
        waiting += [constant for constant in one.co_consts if isinstance(constant, CodeType)]


@cache
def _digest_of_file(name: str) -> str:
    """Return the SHA-256 of a file; of none for what is not in a file, which numba tells apart itself."""
    try:
        return hashlib.sha256(Path(name).read_bytes()).hexdigest()
    except OSError:
        return ""


_log = logging.getLogger(__name__)
PRIVATE: Final = 0o700
PATIENCE_S: Final = 120.0
"""Longest wait for another process. The slowest kernel takes 10 s with those that it calls; a process that
compiles for longer has been halted."""
POLL_S: Final = 0.02
"""Interval of checks whether the other process is done: a twentieth of what a kernel takes."""
COMPILED_OBJECTS: Final = 50_000
"""Objects made between two collections of garbage while kernels compile: with Python's 700, a tenth of that time."""


class KernelCache(FunctionCache):
    """Numba's cache of one kernel; an overload that it cannot read or write is compiled again."""

    _impl_class = StoredKernel
    turn: int | None = None
    """Open file whose lock lets this process compile; None if it has no lock."""

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return numba's key of a stored kernel, and what it is made of: numba looks at the kernel's own file alone."""
        return (*super()._index_key(sig, codegen), source_digest(self._py_func))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a stored kernel; None: there is none that can be read, and this process has the lock to compile it.

        Where kernels call each other they are locked in the order of the calls, which have no cycles, so
        there is no deadlock.
        """
        overload = self._read(sig, target_context)
        if overload is None and self.turn is None:
            self._take_turn()
            overload = self._read(sig, target_context)  # another process may have stored it by now
        return overload

    def end_turn(self) -> None:
        """Release the lock, so that other processes can compile."""
        if self.turn is not None:
            os.close(self.turn)
            self.turn = None

    def _take_turn(self) -> None:
        """Wait for the process that compiles this kernel; where nothing can be locked, each compiles for itself."""
        try:
            self._impl.locator.ensure_cache_path()
            self.turn = os.open(
                Path(self.cache_path) / f"{self._impl.filename_base}.lock", os.O_RDWR | os.O_CREAT, 0o666
            )
            give_up = time.monotonic() + PATIENCE_S
            while not _locked(self.turn) and time.monotonic() < give_up:
                time.sleep(POLL_S)
        except OSError as error:
            _log.debug("%s: nothing can be locked here (%s)", self.cache_path, error)

    def _read(self, sig: Any, target_context: Any) -> Any:
        overload = None
        try:
            # Numba's own method first loads all that it compiles with, which takes as long as loading ten kernels.
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                overload = self._load_overload(sig, target_context)
        except Exception as error:  # pickle raises whatever the bytes make it raise
            _log.warning(
                "%s: a compiled kernel is damaged (%s); it is compiled again", self.cache_path, error
            )
            self._forget()
        return overload

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a kernel for the next run, if possible."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            why = error.strerror or error
            _log.warning(
                "%s: compiled kernels cannot be stored (%s); each run compiles them", self.cache_path, why
            )
            self.disable()

    def _forget(self) -> None:
        try:
            self.flush()
        except OSError:
            self.disable()


def keep(compiled: Any, function: Callable[..., Any]) -> None:
    """Make numba store the compiled forms of a loop, which one process at a time compiles."""
    if config.DISABLE_JIT:  # compiled is the function itself
        return
    cache, compiles = cache_of(function), compiled.compile

    def compiles_in_turn(signature: Any) -> Any:
        # The lock is the process's: its threads must not release each other's.
        with global_compiler_lock, few_collections():
            try:
                return compiles(signature)
            finally:
                cache.end_turn()

    compiled._cache, compiled.compile = cache, compiles_in_turn  # noqa: SLF001 - numba has no other way in


@contextmanager
def few_collections() -> Iterator[None]:
    """Collect cyclic garbage seldom: the compiler makes many objects, most of which last as long as it works."""
    usual = gc.get_threshold()
    seldom = (max(usual[0], COMPILED_OBJECTS), *usual[1:])
    gc.set_threshold(*seldom)
    try:
        yield
    finally:
        # Else the first collection of a command has ended its own delay meanwhile.
        if gc.get_threshold() == seldom:
            gc.set_threshold(*usual)


def cache_of(function: Callable[..., Any]) -> KernelCache:
    """Return the cache of a kernel; in a temporary folder where no other can be written, with a warning."""
    try:
        return KernelCache(function)
    except RuntimeError:  # numba has no error of its own for "no locator available"
        if config.CACHE_DIR:
            raise
    folder = _temporary_folder()
    _log.warning(
        "compiled kernels are stored in %s: neither the installation nor a home can be written", folder
    )
    config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"] = str(
        folder
    )  # processes that this one starts use it too
    return KernelCache(function)


def is_cached(kernel: Any) -> bool:
    """Return whether a compiled form of a kernel is stored, of this or of an older version of it."""
    index = getattr(getattr(kernel.compiled, "_cache", None), "_cache_file", None)
    return index is not None and Path(index._index_path).exists()  # noqa: SLF001 - numba does not say it


def _locked(handle: int) -> bool:
    """Return whether this process holds the lock now; the lock ends with the process."""
    if sys.platform == "win32":
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _temporary_folder() -> Path:
    """Return a folder common to all runs of a user, if no one else can write it, since its contents are executed."""
    owner = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"prooflight-kernels-{owner}"
    try:
        folder.mkdir(mode=PRIVATE, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return Path(tempfile.mkdtemp(prefix="prooflight-kernels-"))
    if stat.S_ISDIR(status.st_mode) and status.st_uid == owner and not status.st_mode & 0o077:
        return folder
    return Path(tempfile.mkdtemp(prefix="prooflight-kernels-"))
