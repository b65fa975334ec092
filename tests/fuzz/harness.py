"""Spoilt files for every reader: each must be read, or refused in one line that names it; nothing else may happen.

A reader is registered as a ``Target`` in ``registry.TARGETS``. Its functions are those of a module, or
``functools.partial`` of such (they go to other processes by name), and deterministic: the same seed and number give the
same mutant. ``samples`` runs once, in the first process; a press that takes long to build should be small.

A mutant is read in a process of its own kind (``reading.serve``), which may use so much memory and time. What came of
it is one of ``OUTCOMES``; ``FAILURES`` are those that no reader may show.
"""

from __future__ import annotations

import itertools
import math
import multiprocessing
import os
import shutil
import tempfile
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from tests.fuzz.reading import Order, serve

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from multiprocessing.connection import Connection

    import numpy as np

OUTCOMES = ("clean", "accepted", "unclear", "traceback", "slow", "memory", "died")
"""Refused in one line; read; refused in words that do not name the file or are no line; an exception that no user
should see; over the time; over the memory; the process ended."""
FAILURES = ("unclear", "traceback", "slow", "memory", "died")
_START_S = 120.0
"""For a process to start and to read good samples once: kernels may have to be compiled."""


@dataclass(frozen=True, kw_only=True)
class Target:
    """One reader.

    ``samples`` gives good files, which the reader must accept. ``mutate`` spoils one of them. ``read`` reads a file as
    the program does, and asserts what must hold of everything that is accepted. ``command``: arguments of the command
    line that read it; every ``COMMAND_EVERY``-th mutant goes that way.
    """

    name: str
    suffix: str
    samples: Callable[[], list[bytes]]
    mutate: Callable[[bytes, np.random.Generator], bytes]
    read: Callable[[Path], object]
    command: Callable[[Path], list[str]] | None = None
    named: bool = True
    """Whether a refusal must name the file."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What reading one file may take: seconds of processor time, since others may keep the processors busy."""

    seconds: float = 10.0
    seconds_waited: float = 60.0
    """By the clock: who waits for a pipe uses no processor."""
    bytes_more: int = 2 * 2**30


@dataclass
class Tally:
    """What came of a target's mutants."""

    counts: Counter[str] = field(default_factory=Counter)
    slowest_s: float = 0.0
    """Of processor time."""


@dataclass
class Spent:
    """Time that mutants took, of all jobs, and may take."""

    most_s: float
    seconds: float = 0.0


def fuzz(
    targets: Sequence[Target],
    *,
    seed: int,
    mutants: int | None = None,
    seconds: float | None = None,
    jobs: int = 2,
    limits: Limits | None = None,
    keep: Path | None = None,
) -> dict[str, Tally]:
    """Read mutants of every target in turn, until each had so many or time is up; offenders go to ``keep``.

    seconds: of each job, without what a process takes to import, compile and read good samples.
    """
    tallies = {target.name: Tally() for target in targets}
    lock = threading.Lock()
    spent = Spent(most_s=math.inf if seconds is None else seconds * jobs)
    with tempfile.TemporaryDirectory(prefix="prooflight-fuzz-") as name:
        folder = Path(name)
        for target in targets:
            _write_samples(target, folder / target.name)
        orders = _orders(targets, folder, seed=seed, mutants=mutants, spent=spent)

        def work(number: int) -> None:
            reader = _Reader(folder / f"reader-{number}", limits or Limits())
            try:
                while True:
                    with lock:
                        order = next(orders, None)
                    if order is None:
                        return
                    warm, begun_s = order.target.name in reader.warm, time.monotonic()
                    outcome, detail, took_s = reader.outcome(order)
                    with lock:
                        spent.seconds += time.monotonic() - begun_s if warm else 0.0
                        tally = tallies[order.target.name]
                        tally.counts[outcome] += 1
                        tally.slowest_s = max(tally.slowest_s, took_s)
                        if outcome in FAILURES and keep is not None:
                            _keep(keep, order, reader.mutant(order), outcome, detail)
            finally:
                reader.stop()

        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(work, range(jobs)))
    return tallies


def _write_samples(target: Target, folder: Path) -> None:
    folder.mkdir()
    for number, data in enumerate(target.samples()):
        (folder / f"{number:03d}{target.suffix}").write_bytes(data)


def _orders(
    targets: Sequence[Target], folder: Path, *, seed: int, mutants: int | None, spent: Spent
) -> Iterator[Order]:
    for index in itertools.count() if mutants is None else range(mutants):
        for target in targets:
            if spent.seconds > spent.most_s:
                return
            yield Order(target=target, samples=folder / target.name, seed=seed, index=index)


def _keep(keep: Path, order: Order, mutant: Path, outcome: str, detail: str) -> None:
    keep.mkdir(parents=True, exist_ok=True)
    stem = f"{order.target.name}-{order.seed}-{order.index}-{outcome}"
    if mutant.exists():
        shutil.copyfile(mutant, keep / f"{stem}{order.target.suffix}")
    (keep / f"{stem}.why").write_text(detail, encoding="utf-8", errors="replace")


class _Reader:
    """A process that reads one mutant after the other, and is replaced when it ends or takes too long."""

    def __init__(self, folder: Path, limits: Limits) -> None:
        self.folder, self.limits = folder, limits
        folder.mkdir()
        self._context = multiprocessing.get_context("spawn")
        self._pipe: Connection | None = None
        self.warm: set[str] = set()
        """Targets whose readers the process has imported and compiled."""

    def mutant(self, order: Order) -> Path:
        return self.folder / f"mutant{order.target.suffix}"

    def outcome(self, order: Order) -> tuple[str, str, float]:
        """What came of it, why, and the processor time that it took. [s]"""
        if self._pipe is None:
            self._start()
        assert self._pipe is not None
        try:
            self._pipe.send(order)
            if not self._pipe.poll(_START_S):
                self.stop()
                return "slow", f"not ready to read after {_START_S:g} s", _START_S
            trouble = self._pipe.recv()
            if trouble is not None:
                raise RuntimeError(trouble)
            self.warm.add(order.target.name)
            at = time.monotonic()  # the mutant lies there
            used_s = self._processor_s()
            while not self._pipe.poll(0.5):
                took_s = self._processor_s() - used_s
                if took_s > self.limits.seconds or time.monotonic() - at > self.limits.seconds_waited:
                    self.stop()
                    return "slow", f"not read after {took_s:g} s of work", took_s
            outcome, detail = self._pipe.recv()
            return outcome, detail, self._processor_s() - used_s
        except (EOFError, ConnectionError):
            self._process.join()
            code = self._process.exitcode
            self.stop()
            return "died", f"the process ended with {code}", 0.0

    def _start(self) -> None:
        self._pipe, theirs = self._context.Pipe()
        self._process = self._context.Process(
            target=serve, args=(theirs, self.folder, self.limits.bytes_more), daemon=True
        )
        self._process.start()
        theirs.close()

    def _processor_s(self) -> float:
        """Processor time of the process so far. [s]"""
        try:
            words = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:  # it has ended, or the system has no /proc: the clock alone counts
            return time.monotonic()
        return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")

    def stop(self) -> None:
        """End the process, whatever it does."""
        if self._pipe is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
            self._pipe = None
            self.warm.clear()
