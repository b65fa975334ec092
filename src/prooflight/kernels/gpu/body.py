"""The arithmetic of one place as a function, run as a CUDA kernel, as a plain compiled loop, or in CUDA's simulator.

    @body
    def binned(y, x, scan, bins, out): ...        # writes out[y, x]

    binned.loop((lines, pixels), scan, 2, out)                    # compiled loop, the reference
    binned.launch(stream, (lines, pixels), scan, 2, out)          # CUDA kernel, a thread a place

The kernels of a processor are tuned in other ways (rows in vectors), and tests hold both to each other. Functions
that bodies call are ``@inner``. Nothing imports this folder unless a card is asked for.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cached_property
from typing import Any, Final

from numba import config, cuda, njit

config.CUDA_LOW_OCCUPANCY_WARNINGS = 0  # some bodies have few places, and numba warns of each

SIMULATED: Final = os.environ.get("NUMBA_ENABLE_CUDASIM") == "1"
"""Whether kernels run in CUDA's simulator, that is as Python; numba reads the same variable when it is imported."""
THREADS: Final = (32, 8)
"""Threads of a block across and down: a warp's 32 threads read neighbours of one row."""
MOST_BLOCKS: Final = 65_535
"""Blocks down that a grid may have (CUDA C++ Programming Guide, technical specifications); threads then step on."""

Function = Callable[..., Any]
inner: Callable[[Function], Function] = (
    (lambda function: function) if SIMULATED else njit(error_model="numpy", nogil=True)
)
"""Compile a function that bodies call."""


class Body:
    """The arithmetic of one place."""

    def __init__(self, function: Function) -> None:
        self.function, self.name = function, function.__name__
        self.__doc__ = function.__doc__

    @cached_property
    def _compiled(self) -> Function:
        return inner(self.function)

    @cached_property
    def _loop(self) -> Function:
        place = self._compiled

        def run(rows, columns, arguments):  # type: ignore[no-untyped-def]
            for y in range(rows):
                for x in range(columns):
                    place(y, x, *arguments)

        return inner(run)

    @cached_property
    def kernel(self) -> Any:
        """The CUDA kernel, of rows, columns and a tuple of the other arguments."""
        place = self._compiled

        def run(rows, columns, arguments):  # type: ignore[no-untyped-def]
            x, first = cuda.grid(2)
            step = cuda.gridDim.y * cuda.blockDim.y
            if x < columns:
                for y in range(first, rows, step):
                    place(y, x, *arguments)

        run.__name__ = run.__qualname__ = self.name
        return cuda.jit(run)

    def loop(self, shape: tuple[int, int], *arguments: Any) -> None:
        """Run as a plain loop over ``shape``, rows and columns."""
        self._loop(*shape, arguments)

    def launch(self, stream: Any, shape: tuple[int, int], *arguments: Any) -> None:
        """Run as a CUDA kernel over ``shape``, rows and columns; returns before it is done."""
        rows, columns = shape
        blocks = -(-columns // THREADS[0]), min(-(-rows // THREADS[1]), MOST_BLOCKS)
        self.kernel[blocks, THREADS, stream](rows, columns, arguments)


def body(function: Function) -> Body:
    """Make a ``Body`` of a function of a place (y, x) and of what it reads and writes."""
    return Body(function)
