"""Compiled loops: how they are made, and which shapes their arrays must have.

Compiled code does not ask whether an index lies within its array: given one that is too small it reads and writes
whatever memory lies behind. So every kernel that Python calls says what shapes it takes, and is entered with no others.

    @kernel("measured (L, P), expected (L, P), offset (P), scale, out (L, P)")
    def residuals(measured, expected, offset, scale, out): ...

All parameters are named in order; one without a shape is a number. The same letter is the same extent; an extent may
also be a number, ``_`` for any, or an expression of letters, constants of the kernel's module and parameters that are
numbers: ``out (L // 8, 2 * n)``. What belongs together is one record (a ``NamedTuple``): its arrays are
``room.value (W)`` by name, its numbers ``grid.pitch``; a tuple's are ``lights[] (N, L, P)`` and ``tables[].codes
(N, 16)`` for N of one shape. ``where`` holds what else must be so: ``where="0 <= first, last <= grid.pitch * L"``.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, update_wrapper
from inspect import signature
from types import CodeType
from typing import Any, Final, Self

from numba import njit

from prooflight.kernels.cache import keep

Function = Callable[..., Any]
Extents = tuple[int, ...]

ANY: Final = "_"
KNOWN_CALLS: Final = 1024
"""Shapes and numbers of so many calls are known to fit: a page's kernels are called with the same again and again."""
BUILT_IN: Final = {"__builtins__": {"max": max, "min": min}}


def inner_kernel(**options: Any) -> Callable[[Function], Function]:
    """A compiled loop that only compiled loops call; options: numba's."""

    def made(function: Function) -> Function:
        compiled: Function = njit(nogil=True, **options)(function)
        keep(compiled, function)
        return compiled

    return made


def kernel(shapes: str, *, where: str = "", **options: Any) -> Callable[[Function], Kernel]:
    """A compiled loop that Python calls, with the shapes that it takes; where, options: see above, and numba's."""

    def made(function: Function) -> Kernel:
        return Kernel(inner_kernel(**options)(function), function, Contract.of(function, shapes, where))

    return made


class Kernel:
    """A compiled loop behind its contract; other compiled loops call it without."""

    def __init__(self, compiled: Function, function: Function, contract: Contract) -> None:
        update_wrapper(self, function)
        self.compiled, self.py_func, self.contract = compiled, function, contract
        self._seen = contract.reader()
        self._fits = lru_cache(maxsize=KNOWN_CALLS)(contract.check)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """ValueError, before any memory is touched, where shapes do not fit."""
        self._fits(self._seen(*arguments, **named))
        return self.compiled(*arguments, **named)

    def __reduce__(self) -> str:
        return self.py_func.__qualname__

    @property
    def _numba_type_(self) -> Any:
        """By this numba knows it for the compiled loop that it holds."""
        return self.compiled._numba_type_  # type: ignore[attr-defined]


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """What one argument must be."""

    path: str
    """``name``, or of a record's or a tuple's ``name.field``, ``name[]``, ``name[].field``."""
    extents: tuple[str, ...] | None
    """None: it is a number."""

    @classmethod
    def of(cls, text: str) -> Self:
        """From ``path (extents)`` or ``path``."""
        found = re.fullmatch(r"(\w+(?:\[\])?(?:\.\w+)?)\s*(?:\((.*)\))?", text)
        if found is None:
            raise TypeError(f"{text!r} is no argument with its shape")
        path, extents = found.groups()
        return cls(path=path, extents=None if extents is None else tuple(_parted(extents)))

    @property
    def name(self) -> str:
        """Of the parameter."""
        return re.split(r"[.\[]", self.path)[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Contract:
    """What a kernel asks of its arguments."""

    kernel: str
    parameters: tuple[str, ...]
    expected: tuple[Expected, ...]
    constants: dict[str, int]
    numbers: frozenset[str]
    """Paths of those that extents or ``where`` speak of."""
    codes: dict[str, CodeType]
    """Of extents that are neither letters nor any."""
    where: tuple[str, ...]

    @classmethod
    def of(cls, function: Function, shapes: str, where: str) -> Self:
        """As declared; TypeError: that does not name the function's parameters in order."""
        expected = tuple(Expected.of(text) for text in _parted(shapes))
        parameters = tuple(signature(function).parameters)
        if tuple(dict.fromkeys(one.name for one in expected)) != parameters:
            raise TypeError(f"{function.__name__}: {shapes!r} does not name {', '.join(parameters)} in order")
        conditions = tuple(_parted(where))
        extents = {text for one in expected for text in one.extents or ()}
        words = {
            word for text in (*extents, *conditions) for word in re.findall(r"[A-Za-z]\w*(?:\.\w+)?", text)
        }
        globals_ = function.__globals__
        constants = {word: globals_[word] for word in words if isinstance(globals_.get(word), int)}
        given = words & {one.path for one in expected if one.extents is None}
        letters = extents & words - set(constants) - given
        if unknown := words - set(constants) - given - letters - {"max", "min"}:
            raise TypeError(f"{function.__name__}: nothing says what {', '.join(sorted(unknown))} is")
        codes = {
            text: compile(_flat(text), function.__name__, "eval")
            for text in (*extents, *conditions)
            if text not in letters
        }
        return cls(
            kernel=function.__name__,
            parameters=parameters,
            expected=expected,
            constants=constants,
            numbers=frozenset(given),
            codes=codes,
            where=conditions,
        )

    def reader(self) -> Callable[..., tuple[Any, ...]]:
        """Arguments -> the shapes and numbers that ``check`` looks at."""
        reads = []
        for one in self.expected:
            if one.extents is None:
                reads.append(one.path if one.path in self.numbers else f"getattr({one.path}, 'shape', ())")
            elif "[]" in one.path:
                field = one.path.removeprefix(f"{one.name}[]")
                reads.append(f"tuple([each{field}.shape for each in {one.name}])")
            else:
                reads.append(f"{one.path}.shape")
        found: Callable[..., tuple[Any, ...]] = eval(
            f"lambda {', '.join(self.parameters)}: ({', '.join(reads)},)"
        )
        return found

    def check(self, seen: tuple[Any, ...]) -> None:
        """ValueError if shapes and numbers, as ``reader`` reads them, do not fit."""
        known: dict[str, int] = dict(self.constants)
        arrays: list[tuple[str, tuple[str, ...], Extents]] = []
        for one, value in zip(self.expected, seen, strict=True):
            if one.extents is not None:
                shapes = [(len(value), *shape) for shape in value] if "[]" in one.path else [value]
                arrays += [(one.path, one.extents, shape) for shape in shapes]
            elif one.path in self.numbers:
                known[_flat(one.path)] = value
            elif value != ():
                raise ValueError(
                    f"kernel {self.kernel}: {one.path} is of shape {value} and should be a number"
                )
        for path, extents, shape in arrays:
            if len(shape) != len(extents):
                self._refuse(path, extents, shape, known)
            for text, extent in zip(extents, shape, strict=True):
                if text != ANY and text not in self.codes:
                    known.setdefault(text, extent)  # letters that are seen first here are of these extents
        for path, extents, shape in arrays:
            asked = [self._extent(text, known) for text in extents]
            if any(extent not in (None, has) for extent, has in zip(asked, shape, strict=True)):
                self._refuse(path, extents, shape, known)
        for condition in self.where:
            if not eval(self.codes[condition], BUILT_IN, known):
                raise ValueError(f"kernel {self.kernel}: {condition} does not hold; {_told(known)}")

    def _extent(self, text: str, known: dict[str, int]) -> int | None:
        if text == ANY:
            return None
        return int(eval(self.codes[text], BUILT_IN, known)) if text in self.codes else known[text]

    def _refuse(self, path: str, extents: tuple[str, ...], shape: Extents, known: dict[str, int]) -> None:
        asked, told = ", ".join(extents), _told(known)
        raise ValueError(
            f"kernel {self.kernel}: {path} is of shape {shape} and should be ({asked})"
            + (f"; {told}" if told else "")
        )


def _flat(text: str) -> str:
    """Expressions with a record's numbers as plain names."""
    return re.sub(r"(?<=\w)\.(?=[A-Za-z])", "_", text)


def _parted(text: str) -> list[str]:
    """Parts between commas that stand in no brackets."""
    parts, depth, begin = [], 0, 0
    for at, letter in enumerate(text):
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append(text[begin:at].strip())
            begin = at + 1
    parts.append(text[begin:].strip())
    return [part for part in parts if part]


def _told(known: dict[str, int]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in known.items())
