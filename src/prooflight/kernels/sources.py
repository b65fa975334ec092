"""Digest of all source text that goes into a kernel's machine code.

Numba compiles a stored kernel again when its own file changes. Its machine code also contains the loops that it
calls, the instructions of its intrinsics and the numbers of other modules, so that a change of their files has to
count as well: otherwise two folders with the same source compute different results.
"""

from __future__ import annotations

import hashlib
from functools import cache
from inspect import unwrap
from pathlib import Path
from types import CodeType, FunctionType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

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
