"""Decorators for compiled loops, with contracts for the shapes of their arrays.

Compiled code does not check whether an index is within its array: given one that is too small it reads and
writes other memory. So every kernel that Python calls declares the shapes that it takes, and is entered with
no others.

    @kernel("measured (L, P), expected (L, P), offset (P), scale, out (L, P)")
    def residuals(measured, expected, offset, scale, out): ...

All parameters are named in order; one without a shape is a number. The same letter is the same extent; an
extent may also be a number, ``_`` for any, or an expression of letters, constants of the kernel's module and
parameters that are numbers: ``out (L // 8, 2 * n)``. Related arguments are one record (a ``NamedTuple``): its
arrays are ``room.value (W)`` by name, its numbers ``grid.pitch``; a tuple's are ``lights[] (N, L, P)`` and
``tables[].codes (N, 16)`` for N of one shape. ``where`` holds further conditions:

    where="0 <= first, last <= grid.pitch * L"
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, update_wrapper
from inspect import signature
from types import CodeType
from typing import Any, Final, Self

from numba import config, njit

from prooflight.kernels.cache import keep
from prooflight.kernels.self_contained import InnerCompiler, SelfContainedCompiler

Function = Callable[..., Any]
Extents = tuple[int, ...]

ANY: Final = "_"
CACHED_CALLS: Final = 1024
"""Number of calls whose checked shapes and numbers are cached: a page's kernels are called with the same
again and again."""
OPTIONS: Final = {"fastmath": False, "error_model": "python", "no_cfunc_wrapper": True}
"""Numba's options where a kernel states no others: no loop is called by C.

Without them a loop takes those of the loop for which it happens to be compiled first.
"""
BUILT_IN: Final = {"__builtins__": {"max": max, "min": min}}


def inner_kernel(**options: Any) -> Callable[[Function], InnerKernel]:
    """Compile a loop that only compiled loops call; options: numba's."""

    def decorate(function: Function) -> InnerKernel:
        return InnerKernel(function, InnerCompiler, options | {"no_cpython_wrapper": True})

    return decorate


def kernel(shapes: str, *, where: str = "", **options: Any) -> Callable[[Function], Kernel]:
    """Compile a loop that Python calls, with the shapes that it takes; where: see above; options: numba's."""

    def decorate(function: Function) -> Kernel:
        return Kernel(function, SelfContainedCompiler, options, contract=Contract.of(function, shapes, where))

    return decorate


class InnerKernel:
    """A compiled loop that other compiled loops call.

    It is compiled without an entry for Python, which costs a tenth of the time of compiling.
    """

    def __init__(
        self, function: Function, compiler: type[SelfContainedCompiler], options: dict[str, Any]
    ) -> None:
        update_wrapper(self, function)
        self.py_func, self._compiler, self._options = function, compiler, options

    @cached_property
    def compiled(self) -> Function:
        """Numba's form of the loop, made where it is used first: most loops are part of stored kernels."""
        options = OPTIONS | self._options
        compiled: Function = njit(nogil=True, pipeline_class=self._compiler, **options)(self.py_func)
        keep(compiled, self.py_func)
        return compiled

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Refuse a call by Python; run the loop's source where numba is switched off."""
        if config.DISABLE_JIT:
            return self.py_func(*arguments, **named)
        raise TypeError(f"{self.py_func.__name__} is called by compiled loops only; Python calls a kernel")

    def __reduce__(self) -> str:
        return self.py_func.__qualname__

    @property
    def _numba_type_(self) -> Any:
        """Numba's type of the compiled loop, by which other loops can call it."""
        return self.compiled._numba_type_  # type: ignore[attr-defined]


class Kernel(InnerKernel):
    """A compiled loop that checks its contract; other compiled loops call it without the check."""

    def __init__(
        self,
        function: Function,
        compiler: type[SelfContainedCompiler],
        options: dict[str, Any],
        *,
        contract: Contract,
    ) -> None:
        super().__init__(function, compiler, options)
        self.contract = contract
        self._seen = contract.reader()
        self._fits = lru_cache(maxsize=CACHED_CALLS)(contract.check)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Run the loop; ValueError, before any memory is touched, where shapes do not fit."""
        self._fits(self._seen(*arguments, **named))
        return self.compiled(*arguments, **named)


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """Requirement on one argument."""

    path: str
    """Path of the argument: ``name``, or of a record's or a tuple's ``name.field``, ``name[]``,
    ``name[].field``."""
    extents: tuple[str, ...] | None
    """Extents of an array; None for a number."""

    @classmethod
    def of(cls, text: str) -> Self:
        """Parse ``path (extents)`` or ``path``."""
        match = re.fullmatch(r"(\w+(?:\[\])?(?:\.\w+)?)\s*(?:\((.*)\))?", text)
        if match is None:
            raise TypeError(f"{text!r} is not an argument with its shape")
        path, extents = match.groups()
        return cls(path=path, extents=None if extents is None else tuple(_parted(extents)))

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return re.split(r"[.\[]", self.path)[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Contract:
    """Requirements of a kernel on its arguments."""

    kernel: str
    parameters: tuple[str, ...]
    expected: tuple[Expected, ...]
    constants: dict[str, int]
    numbers: frozenset[str]
    """Paths of numbers that extents or ``where`` use."""
    codes: dict[str, CodeType]
    """Compiled expressions of extents that are neither letters nor any."""
    where: tuple[str, ...]

    @classmethod
    def of(cls, function: Function, shapes: str, where: str) -> Self:
        """Parse a declaration; TypeError: it does not name the function's parameters in order."""
        expected = tuple(Expected.of(text) for text in _parted(shapes))
        parameters = tuple(signature(function).parameters)
        if tuple(dict.fromkeys(one.name for one in expected)) != parameters:
            raise TypeError(f"{function.__name__}: {shapes!r} does not name {', '.join(parameters)} in order")
        conditions = tuple(_parted(where))
        extents = {text for one in expected for text in one.extents or ()}
        symbols = {
            symbol
            for text in (*extents, *conditions)
            for symbol in re.findall(r"[A-Za-z]\w*(?:\.\w+)?", text)
        }
        globals_ = function.__globals__
        constants = {symbol: globals_[symbol] for symbol in symbols if isinstance(globals_.get(symbol), int)}
        given = symbols & {one.path for one in expected if one.extents is None}
        letters = extents & symbols - set(constants) - given
        if unknown := symbols - set(constants) - given - letters - {"max", "min"}:
            raise TypeError(f"{function.__name__}: nothing defines {', '.join(sorted(unknown))}")
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
        """Return the function from arguments to the shapes and numbers that ``check`` uses."""
        reads = []
        for one in self.expected:
            if one.extents is None:
                reads.append(one.path if one.path in self.numbers else f"getattr({one.path}, 'shape', ())")
            elif "[]" in one.path:
                field = one.path.removeprefix(f"{one.name}[]")
                reads.append(f"tuple([each{field}.shape for each in {one.name}])")
            else:
                reads.append(f"{one.path}.shape")
        read: Callable[..., tuple[Any, ...]] = eval(
            f"lambda {', '.join(self.parameters)}: ({', '.join(reads)},)"
        )
        return read

    def check(self, seen: tuple[Any, ...]) -> None:
        """Raise ValueError if shapes and numbers, as ``reader`` reads them, do not fit."""
        bindings: dict[str, int] = dict(self.constants)
        arrays: list[tuple[str, tuple[str, ...], Extents]] = []
        for one, value in zip(self.expected, seen, strict=True):
            if one.extents is not None:
                shapes = [(len(value), *shape) for shape in value] if "[]" in one.path else [value]
                arrays += [(one.path, one.extents, shape) for shape in shapes]
            elif one.path in self.numbers:
                bindings[_flat(one.path)] = value
            elif value != ():
                raise ValueError(
                    f"kernel {self.kernel}: {one.path} is of shape {value} and should be a number"
                )
        for path, extents, shape in arrays:
            if len(shape) != len(extents):
                self._refuse(path, extents, shape, bindings)
            for text, extent in zip(extents, shape, strict=True):
                if text != ANY and text not in self.codes:
                    bindings.setdefault(text, extent)  # the first occurrence of a letter defines its extent
        for path, extents, shape in arrays:
            required = [self._extent(text, bindings) for text in extents]
            if any(extent not in (None, has) for extent, has in zip(required, shape, strict=True)):
                self._refuse(path, extents, shape, bindings)
        for condition in self.where:
            if not eval(self.codes[condition], BUILT_IN, bindings):
                raise ValueError(f"kernel {self.kernel}: {condition} does not hold; {_listing(bindings)}")

    def _extent(self, text: str, bindings: dict[str, int]) -> int | None:
        if text == ANY:
            return None
        return int(eval(self.codes[text], BUILT_IN, bindings)) if text in self.codes else bindings[text]

    def _refuse(self, path: str, extents: tuple[str, ...], shape: Extents, bindings: dict[str, int]) -> None:
        required, listing = ", ".join(extents), _listing(bindings)
        raise ValueError(
            f"kernel {self.kernel}: {path} is of shape {shape} and should be ({required})"
            + (f"; {listing}" if listing else "")
        )


def _flat(text: str) -> str:
    """Replace the dots of records' numbers in expressions by underscores."""
    return re.sub(r"(?<=\w)\.(?=[A-Za-z])", "_", text)


def _parted(text: str) -> list[str]:
    """Split a text at commas outside brackets."""
    parts, depth, begin = [], 0, 0
    for at, letter in enumerate(text):
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append(text[begin:at].strip())
            begin = at + 1
    parts.append(text[begin:].strip())
    return [part for part in parts if part]


def _listing(bindings: dict[str, int]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in bindings.items())
