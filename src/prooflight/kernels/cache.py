"""Where compiled kernels are kept between runs, whatever state that place is in.

Numba keeps them beside the source or in the user's cache folder. Where it may write neither it refuses to compile at
all, and a file that was cut short when a disk filled or a machine lost power ends every later run. Here the first
falls back to a folder for temporary files, and the second is compiled anew.
"""

from __future__ import annotations

import logging
import os
import stat
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from numba import config
from numba.core.caching import FunctionCache

if TYPE_CHECKING:
    from collections.abc import Callable

_log = logging.getLogger(__name__)
PRIVATE: Final = 0o700


class KernelCache(FunctionCache):
    """Numba's cache of one kernel; what it cannot read or write is compiled anew."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """A kernel as it was kept; None: there is none that can be read."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:  # pickle raises whatever the bytes make it raise
            _log.warning("%s: a compiled kernel is damaged (%s); it is compiled anew", self.cache_path, error)
            self._forget()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a kernel for the next run, if that can be."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            why = error.strerror or error
            _log.warning(
                "%s: compiled kernels cannot be kept (%s); each run compiles them", self.cache_path, why
            )
            self.disable()

    def _forget(self) -> None:
        try:
            self.flush()
        except OSError:
            self.disable()


def kept(function: Callable[..., Any]) -> FunctionCache:
    """The cache of a kernel's compiled forms; in a temporary folder where no other can be written, which is said."""
    try:
        return KernelCache(function)
    except RuntimeError:  # numba has no error of its own for "no locator available"
        if config.CACHE_DIR:
            raise
    folder = _temporary_folder()
    _log.warning(
        "compiled kernels are kept in %s: neither the installation nor a home can be written", folder
    )
    config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"] = str(
        folder
    )  # processes that this one starts use it too
    return KernelCache(function)


def _temporary_folder() -> Path:
    """The same for all runs of a user, if nobody else can write it: what lies in it is executed."""
    owner = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"prooflight-kernels-{owner}"
    try:
        folder.mkdir(mode=PRIVATE, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return Path(tempfile.mkdtemp(prefix="prooflight-kernels-"))
    if stat.S_ISDIR(found.st_mode) and found.st_uid == owner and not found.st_mode & 0o077:
        return folder
    return Path(tempfile.mkdtemp(prefix="prooflight-kernels-"))
