"""Where bodies run: in memory of this machine as plain loops, or on a CUDA card.

A runner gives arrays (``put``, ``room``), runs bodies on them, and brings them back. A room is an array that one name
stands for: it is made once and used again by every scan, so that a CUDA graph can hold all launches of a step.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from functools import cache
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.gpu.body import SIMULATED, Body

Shape = tuple[int, ...]
MOST_GRAPHS = 1000
"""Recorded steps of a card's stream; beyond, they are recorded anew. A design has some twelve."""


class Runner(Protocol):
    """Memory and arithmetic of one scan at a time; not safe for several threads at once."""

    def put(self, array: NDArray[Any]) -> Any:
        """Return a copy of an array where bodies run."""

    def room(self, name: str, shape: Shape, kind: Any = np.float32) -> Any:
        """Return the array of that name and shape."""

    def fill(self, room: Any, array: NDArray[Any]) -> None:
        """Copy an array into a room of its shape."""

    def run(self, body: Body, shape: tuple[int, int], *arguments: Any) -> None:
        """Run a body at every place."""

    def step(self, key: Hashable, launches: Callable[[], None]) -> None:
        """Run bodies that are the same, with the same arrays and numbers, whenever ``key`` is."""

    def back(self, room: Any) -> NDArray[Any]:
        """Return a copy of a room in this machine's memory, once all that runs before it is done."""


class Rooms:
    """Arrays by name and shape."""

    def __init__(self, make: Callable[[Shape, Any], Any]) -> None:
        self._make, self._rooms = make, dict[tuple[str, Shape], Any]()

    def room(self, name: str, shape: Shape, kind: Any = np.float32) -> Any:
        """See ``Runner``."""
        key = name, shape
        if key not in self._rooms:
            self._rooms[key] = self._make(shape, kind)
        return self._rooms[key]


class Loops(Rooms):
    """Plain compiled loops: the reference of what a card computes."""

    def __init__(self) -> None:
        super().__init__(np.zeros)

    def put(self, array: NDArray[Any]) -> NDArray[Any]:
        """See ``Runner``."""
        return np.array(array, order="C")

    def fill(self, room: NDArray[Any], array: NDArray[Any]) -> None:
        """See ``Runner``."""
        room[...] = array

    def run(self, body: Body, shape: tuple[int, int], *arguments: Any) -> None:
        """See ``Runner``."""
        body.loop(shape, *arguments)

    def step(self, key: Hashable, launches: Callable[[], None]) -> None:
        """See ``Runner``."""
        launches()

    def back(self, room: NDArray[Any]) -> NDArray[Any]:
        """See ``Runner``."""
        return room.copy()


class Card(Rooms):
    """One scan at a time on a CUDA card, on a stream of its own."""

    def __init__(self) -> None:
        from numba import cuda

        self._cuda, self.stream = cuda, cuda.stream()
        self.graphs: dict[Hashable, Any] = {}
        """Recorded steps by key."""
        self._launched: set[Hashable] = set()
        self._pinned = Rooms(lambda shape, kind: cuda.pinned_array(shape, kind))
        super().__init__(lambda shape, kind: cuda.device_array(shape, kind, stream=self.stream))

    def put(self, array: NDArray[Any]) -> Any:
        """See ``Runner``."""
        on_card = self._cuda.to_device(np.ascontiguousarray(array), stream=self.stream)
        self.stream.synchronize()
        return on_card

    def pinned(self, room: Any) -> NDArray[Any]:
        """Return the memory of this machine by way of which a room is filled, which the card reads by itself.

        Each room has its own: a scan fills it again only after it has waited for what read it.
        """
        return self._pinned.room(f"to {id(room)}", room.shape, room.dtype)

    def fill(self, room: Any, array: NDArray[Any]) -> None:
        """See ``Runner``."""
        pinned = self.pinned(room)
        pinned[...] = array
        room.copy_to_device(pinned, stream=self.stream)

    def run(self, body: Body, shape: tuple[int, int], *arguments: Any) -> None:
        """See ``Runner``."""
        body.launch(self.stream, shape, *arguments)

    def step(self, key: Hashable, launches: Callable[[], None]) -> None:
        """See ``Runner``: launched one by one the first time, which compiles, and recorded as a graph the second."""
        if SIMULATED or key not in self._launched:
            self._launched.add(key)
            launches()
            return
        if key not in self.graphs:
            if len(self.graphs) >= MOST_GRAPHS:
                self.graphs.clear()
            self.graphs[key] = recorded(self.stream, launches)
        launched(self.graphs[key], self.stream)

    def back(self, room: Any) -> NDArray[Any]:
        """See ``Runner``."""
        pinned = self._pinned.room(f"from {room.dtype}", room.shape, room.dtype)
        room.copy_to_host(pinned, stream=self.stream)
        self.stream.synchronize()
        return np.array(pinned)


def recorded(stream: Any, launches: Callable[[], None]) -> Any:
    """Return launches on a stream as a CUDA graph that can be launched; none of them runs."""
    from cuda.bindings import driver

    handle = _handle(stream)
    _checked(
        driver.cuStreamBeginCapture(handle, driver.CUstreamCaptureMode.CU_STREAM_CAPTURE_MODE_THREAD_LOCAL)
    )
    try:
        launches()
    finally:
        graph = _checked(driver.cuStreamEndCapture(handle))
    return _checked(driver.cuGraphInstantiate(graph, 0))


def launched(graph: Any, stream: Any) -> None:
    """Launch a graph on a stream."""
    from cuda.bindings import driver

    _checked(driver.cuGraphLaunch(graph, _handle(stream)))


def _handle(stream: Any) -> Any:
    from cuda.bindings import driver

    handle = stream.handle
    return driver.CUstream(int(getattr(handle, "value", handle) or 0))


def _checked(answer: tuple[Any, ...]) -> Any:
    """Return a driver call's result; RuntimeError: it failed."""
    error, *result = answer
    if int(error) != 0:
        raise RuntimeError(f"the CUDA driver answers {error}")
    return result[0] if result else None


@cache
def lacking() -> str | None:
    """Return what is missing to compute on a card; None: nothing."""
    if find_spec("numba_cuda") is None:
        return "the package numba-cuda is not installed"
    from numba import cuda

    return None if cuda.is_available() else "no NVIDIA card with a CUDA driver answers"


def card_name() -> str:
    """Return the card's name and the newest CUDA that its driver has."""
    from numba import cuda

    name = cuda.get_current_device().name
    version = cuda.cudadrv.driver.driver.get_version()
    return f"{name.decode() if isinstance(name, bytes) else name}, CUDA {'.'.join(map(str, version))}"


class Pool:
    """Runners that scans take and give back, as many as scans are analysed at once."""

    def __init__(self, make: Callable[[], Runner]) -> None:
        self._make, self._free, self._guard = make, list[Runner](), threading.Lock()

    def take(self) -> Runner:
        """Return a runner that no other scan uses."""
        with self._guard:
            if self._free:
                return self._free.pop()
        return self._make()

    def give(self, runner: Runner) -> None:
        """Give a runner back."""
        with self._guard:
            self._free.append(runner)
