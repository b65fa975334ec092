"""How a run is watched: deadline, queues, threads, memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

DEADLINE_S: Final = 0.5
"""From a sheet's last line to its verdict: the reject gate is a metre further on at 2 m/s."""
STALL_S: Final = 10.0
"""assumed: a web that changes its speed needs less, and an operator notices no sooner."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How a run is watched."""

    source_waits: bool
    """Whether the source can be made to wait; if not, sheets have deadlines and may be lost."""
    source_clock: bool = False
    """Whether the source's times are by the watcher's clock; if not, a sheet counts from when it was received."""
    deadline_s: float = DEADLINE_S
    room: int = 6
    """Sheets that may wait."""
    inspectors: int = 2
    """Threads that inspect; kernels let go of the interpreter's lock."""
    ahead: int = 16
    """Sheets whose designs are made ready ahead; the pager thinks of the next 8."""
    preparers: int = 2
    """Threads that make designs ready, and yield to those that inspect; one does not keep up with 3 designs/s."""
    ahead_bytes: int = 4_000_000_000
    """Of memory for designs."""
    stall_s: float = STALL_S
    """Without a line from the source, after which that is announced."""
    sample: float = 0.0
    """Share of the sheets that pass for which a person is asked for a word. [-]"""
    seed: int = 0
    """Of randomised integral transforms, and of ranks that tie."""
